"""Which focal length of the colour camera explains best how features move.

A turn of the camera shifts pixels by focal length times angle, and a wrong focal length also bends
the paths of points at different depths. So each candidate is asked twice: how well do the motions
of the poses project the points (where poses are worth it), and how well does the best free motion?
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.motions import Motions, median_error_px
from imodbatch.checkup.peaks import peak
from imodbatch.core.camera import PinholeCamera
from imodbatch.poses.rgbd.resection import ransac

Array = NDArray[np.float64]
FACTORS = np.exp(np.linspace(np.log(0.72), np.log(1.38), 27))
FEWEST_PAIRS = 6
RESAMPLES = 200
FREE_ITERATIONS = 60


@dataclass(frozen=True)
class FocalFit:
    """The focal length that fits best, over the manifest's.

    Attributes:
        factor: of both fx and fy.
        sigma: standard deviation of its logarithm, over the choice of pairs.
        gain: the manifest's pixel error over that of the best factor.
        n_pairs: pairs of views asked.
    """

    factor: float
    sigma: float
    gain: float
    n_pairs: int


def fit_focal(motions: Motions, b_from_a: Array | None) -> FocalFit | None:
    """The factor that fits best; None = too few pairs.

    Args:
        motions: what the images tell.
        b_from_a: (P, 4, 4) motions by the poses, in metres of the depth; None = no poses.
    """
    if len(motions) < FEWEST_PAIRS:
        return None
    costs = [_cost_curve(motions, factor, b_from_a) for factor in FACTORS]
    curves = np.stack(costs)  # (factors, pairs)
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(motions), size=(RESAMPLES, len(motions)))
    logs = np.log(FACTORS)
    peaks = np.array([peak(logs, -curves[:, rows].mean(axis=1)) for rows in drawn])
    mean = curves.mean(axis=1)
    best = peak(logs, -mean)
    as_given = int(np.abs(logs).argmin())
    gain = float(np.exp(mean[as_given] - mean.min()))
    return FocalFit(float(np.exp(best)), float(max(peaks.std(), 0.005)), gain, len(motions))


def camera_costs(
    motions: Motions, b_from_a: Array | None, cameras: list[PinholeCamera]
) -> list[float]:
    """The same cost for named colour cameras, to compare them."""
    return [float(_cost(motions, camera, b_from_a).mean()) for camera in cameras]


def _cost_curve(motions: Motions, factor: float, b_from_a: Array | None) -> Array:
    given = motions.camera
    camera = replace(given, fx_px=factor * given.fx_px, fy_px=factor * given.fy_px)
    return _cost(motions, camera, b_from_a)


def _cost(motions: Motions, camera: PinholeCamera, b_from_a: Array | None) -> Array:
    """Mean log pixel error (P,) under a camera, by free motions and by those of the poses."""
    given = motions.camera
    shrink = np.array([given.fx_px / camera.fx_px, given.fy_px / camera.fy_px, 1.0])
    points_a = motions.points_a * shrink
    free = _free_errors(motions, points_a, camera)
    if b_from_a is None:
        return np.log1p(free)
    posed = median_error_px(b_from_a, points_a, motions.pixels_b, camera)
    return np.where(np.isfinite(posed), 0.5 * (np.log1p(free) + np.log1p(posed)), np.log1p(free))


def _free_errors(motions: Motions, points_a: Array, camera: PinholeCamera) -> Array:
    """Pixel errors (P,) of the motion that fits each pair best."""
    b_from_a = motions.b_from_a.copy()
    for pair in range(len(motions)):
        is_point = np.isfinite(points_a[pair, :, 0])
        found = ransac(
            camera, points_a[pair, is_point], motions.pixels_b[pair, is_point], FREE_ITERATIONS
        )
        if found is not None:
            b_from_a[pair] = found[0]
    return median_error_px(b_from_a, points_a, motions.pixels_b, camera)
