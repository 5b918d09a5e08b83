"""Metres: how much larger the world is than its reconstruction.

At every reconstructed point that an image with depth sees, measured over reconstructed depth is
one opinion on the scale. Their median counts, each weighted by the inverse of its expected error:
a depth sensor's noise grows with the square of the depth (Nguyen et al. 2012), so relative error
grows with depth. Opinions of one frame share errors, so the standard error is that of the frames'
medians.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.consistency import bilinear_depth
from imodbatch.core.depth import DepthImage
from imodbatch.core.errors import DataError
from imodbatch.core.frames import apply
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.sfm.colmap import Progress
from imodbatch.poses.sfm.mapping import Model

Array = NDArray[np.float64]
SIGMA_OF_MAD = 1.4826  # of a normal distribution
SIGMA_OF_MEDIAN = 1.2533
MIN_RATIOS = 50
MIN_PER_FRAME = 10
MAX_SPREAD_PERCENT = 30.0
MAX_STANDARD_ERROR_PERCENT = 5.0
RELATIVE_ERROR, RELATIVE_ERROR_PER_M = 0.005, 0.002
N_PROBES = 20


@dataclass(frozen=True)
class MetricScale:
    """Metres per unit of a reconstruction.

    Attributes:
        metres: the scale.
        spread_percent: robust standard deviation of single ratios.
        standard_error_percent: of the scale; a bias of the depth sensor is not in it.
        n_ratios: points compared, over `n_frames` frames.
        n_frames: frames with enough of them.
    """

    metres: float
    spread_percent: float
    standard_error_percent: float
    n_ratios: int
    n_frames: int


def check_depth(frames: RgbdFrames) -> None:
    """Fail early where no frame of a sample has depth.

    Raises:
        DataError: none of twenty frames spread over the sequence has any.
    """
    probes = np.unique(np.linspace(0, len(frames) - 1, N_PROBES).astype(int))
    for position in probes:
        depth_m = frames.read_depth(int(position))
        if depth_m is not None and np.isfinite(depth_m).any():
            return
    raise DataError(
        f"{frames.sequence_id}: no depth in any of {len(probes)} frames looked at; a "
        "reconstruction from images has no metres without. Give depth images in the manifest, or "
        "use poses.source = 'odometry'."
    )


def metric_scale(frames: RgbdFrames, model: Model, progress: Progress) -> MetricScale:
    """Scale of a model from the depth images of its keyframes.

    Raises:
        DataError: too few points have depth, or their ratios do not agree.
    """
    pairs = (_depths(frames.read_depth(k), frames, model, k) for k in progress(model.keyframes()))
    return scale_from_depths(pairs, frames.sequence_id)


def scale_from_depths(depths: Iterable[Array], where: str) -> MetricScale:
    """Scale from depths (n, 2) of points, measured in metres and reconstructed, frame by frame.

    Raises:
        DataError: too few, or their ratios do not agree.
    """
    useful = [pairs for pairs in depths if len(pairs) >= MIN_PER_FRAME]
    n_ratios = sum(map(len, useful))
    if n_ratios < MIN_RATIOS:
        raise DataError(
            f"{where}: depth at only {n_ratios} reconstructed points, {MIN_RATIOS} needed for the "
            "metric scale. Check the depth images and camera.depth, or use "
            "poses.source = 'odometry'."
        )
    logs = [np.log(pairs[:, 0] / pairs[:, 1]) for pairs in useful]
    weights = [1 / (RELATIVE_ERROR + RELATIVE_ERROR_PER_M * pairs[:, 0]) for pairs in useful]
    ratios, weight = np.concatenate(logs), np.concatenate(weights)
    center = weighted_median(ratios, weight)
    spread = SIGMA_OF_MAD * weighted_median(np.abs(ratios - center), weight)
    frame_medians = np.array([weighted_median(*both) for both in zip(logs, weights, strict=True)])
    frame_spread = SIGMA_OF_MAD * float(np.median(np.abs(frame_medians - center)))
    single = SIGMA_OF_MEDIAN * spread / np.sqrt(n_ratios)
    error = float(max(single, SIGMA_OF_MEDIAN * frame_spread / np.sqrt(len(useful))))
    scale = MetricScale(float(np.exp(center)), 100 * spread, 100 * error, n_ratios, len(useful))
    _check_agreement(scale, where)
    return scale


def weighted_median(values: Array, weights: Array) -> float:
    """The value (n,) at which half of the weight is reached."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])


def _depths(depth_m: DepthImage | None, frames: RgbdFrames, model: Model, keyframe: int) -> Array:
    """Measured and reconstructed depth (n, 2) of the points a keyframe sees, away from edges."""
    if depth_m is None:
        return np.zeros((0, 2))
    camera = frames.camera
    if depth_m.shape != (camera.height_px, camera.width_px):
        return np.zeros((0, 2))
    sights = model.sights(keyframe)
    measured = bilinear_depth(depth_m, sights.pixels)
    reconstructed = apply(model.cam_from_world(keyframe), sights.points)[:, 2]
    good = np.isfinite(measured) & (measured > 0) & (reconstructed > 0)
    return np.stack([measured[good], reconstructed[good]], axis=1)


def _check_agreement(scale: MetricScale, where: str) -> None:
    spread, error = scale.spread_percent, scale.standard_error_percent
    if spread <= MAX_SPREAD_PERCENT and error <= MAX_STANDARD_ERROR_PERCENT:
        return
    raise DataError(
        f"{where}: depth and reconstruction do not agree on a scale: {scale.n_ratios:,} ratios "
        f"spread by {spread:.0f} % (at most {MAX_SPREAD_PERCENT:.0f}) and tell it to "
        f"{error:.1f} % (at most {MAX_STANDARD_ERROR_PERCENT:.0f}). Check that depth images belong "
        "to the colour images and camera.depth is right, or use poses.source = 'odometry'."
    )
