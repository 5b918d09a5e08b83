"""How far features are found from where a motion of the camera puts them.

Each pair of views gives matched features with depth: points before camera a and their pixels in b.
Any claim about poses is a relative motion for each pair; the claim that projects the points nearest
to their pixels is the likeliest. The motion that fits the images best without any claim (PnP) says
how near one can get.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.checkup.views import Sample
from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import invert
from imodbatch.poses.rgbd.motion import motion_between

Array = NDArray[np.float64]
MOST_POINTS = 120
FARTHEST_PX = 200.0
"""Larger errors, and points behind the camera, count as this much."""


@dataclass(frozen=True, eq=False)
class Motions:
    """P pairs of views whose images tell how the camera moved.

    Attributes:
        camera: the colour camera.
        first: (P,) positions a.
        second: (P,) positions b.
        b_from_a: (P, 4, 4) by features and depth alone.
        points_a: (P, M, 3) metres in camera a, NaN = fewer than M.
        pixels_b: (P, M, 2) where b shows them.
        depth_a_m: (P,) median depth of the points.
    """

    camera: PinholeCamera
    first: NDArray[np.int64]
    second: NDArray[np.int64]
    b_from_a: Array
    points_a: Array
    pixels_b: Array
    depth_a_m: Array

    def __len__(self) -> int:
        return len(self.first)

    @property
    def baseline_m(self) -> Array:
        """(P,) distance between the cameras of each pair, by the images."""
        return np.linalg.norm(self.b_from_a[:, :3, 3], axis=-1)

    @property
    def angle_rad(self) -> Array:
        """(P,) rotation between them."""
        return rotation_angle_rad(self.b_from_a[:, :3, :3])

    def errors_px(self, b_from_a: ArrayLike) -> Array:
        """Median distance (..., P) of points from their pixels under motions (..., P, 4, 4).

        NaN where a motion is NaN.
        """
        claimed = np.asarray(b_from_a, dtype=np.float64)
        return median_error_px(claimed, self.points_a, self.pixels_b, self.camera)


def median_error_px(
    b_from_a: Array, points_a: Array, pixels_b: Array, camera: PinholeCamera
) -> Array:
    """Median pixel error (..., P) of points (P, M, 3) under motions (..., P, 4, 4)."""
    with np.errstate(invalid="ignore"):
        turned = np.einsum("...pij,pmj->...pmi", b_from_a[..., :3, :3], points_a)
        points_b = turned + b_from_a[..., None, :3, 3]
        error = np.linalg.norm(camera.project(points_b) - pixels_b, axis=-1)
    is_point = np.isfinite(points_a[..., 0])
    error = np.minimum(np.where(np.isfinite(error), error, FARTHEST_PX), FARTHEST_PX)
    error = np.where(is_point, error, np.nan)
    known = np.isfinite(b_from_a[..., 0, 0])
    result = np.full(known.shape, np.nan)
    result[known] = np.nanmedian(error[known], axis=-1)
    return result


def measure(sample: Sample, camera: PinholeCamera) -> Motions:
    """The motions that the images of a sample tell."""
    found = {}
    for a, b in sample.pairs:
        motion = motion_between(sample.views[a].features, sample.views[b].features, camera)
        if motion is not None:
            found[a, b] = motion
    points_a = np.full((len(found), MOST_POINTS, 3), np.nan)
    pixels_b = np.full((len(found), MOST_POINTS, 2), np.nan)
    for row, motion in enumerate(found.values()):
        points, pixels = motion.points_a[:MOST_POINTS], motion.pixels_b[:MOST_POINTS]
        points_a[row, : len(points)], pixels_b[row, : len(points)] = points, pixels
    first, second = np.array(list(found), dtype=np.int64).reshape(-1, 2).T
    return Motions(
        camera,
        first,
        second,
        np.array([motion.b_from_a for motion in found.values()]).reshape(-1, 4, 4),
        points_a,
        pixels_b,
        np.array([np.median(motion.points_a[:MOST_POINTS, 2]) for motion in found.values()]),
    )


def relative(world_from_cam: Array, first: NDArray[np.int64], second: NDArray[np.int64]) -> Array:
    """b_from_a (..., 4, 4) of positions a and b; NaN where one is outside or has no pose."""
    inside = (first >= 0) & (second < len(world_from_cam))
    inside &= (second >= 0) & (first < len(world_from_cam))
    result = np.full((*first.shape, 4, 4), np.nan)
    world_from_a, world_from_b = world_from_cam[first[inside]], world_from_cam[second[inside]]
    with np.errstate(invalid="ignore"):
        result[inside] = invert(world_from_b) @ world_from_a
    return result
