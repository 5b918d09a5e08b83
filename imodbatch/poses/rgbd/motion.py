"""How the camera moved between two frames, by what both see; no trajectory is asked."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.poses.rgbd.features import Features
from imodbatch.poses.rgbd.matching import mutual_matches
from imodbatch.poses.rgbd.resection import Sightings, ransac, refine

Array = NDArray[np.float64]
N_ITERATIONS = 500
FEWEST_INLIERS, INLIER_SHARE = 20, 0.4


@dataclass(frozen=True, eq=False)
class Motion:
    """A relative pose and what bears it out.

    Attributes:
        b_from_a: (4, 4).
        points_a: (n, 3) metres in camera a.
        pixels_b: (n, 2) where b shows them, each near where the pose puts it.
    """

    b_from_a: Array
    points_a: Array
    pixels_b: Array


def motion_between(a: Features, b: Features, camera: PinholeCamera) -> Motion | None:
    """The motion that matched features and the depth behind those of a tell; None = not clear."""
    in_a, in_b = mutual_matches(a.descriptors, b.descriptors)
    return motion_of(a.points_cam[in_a], b.pixels[in_b], camera)


def motion_of(points_a: Array, pixels_b: Array, camera: PinholeCamera) -> Motion | None:
    """The motion that projects most points (n, 3) to their pixels (n, 2).

    PnP in RANSAC, then refined. It counts with at least 20 inliers that are 40 % of the points of
    known place (NaN = unknown); else None. Points may be in any unit: the motion is in theirs.
    """
    has_place = np.isfinite(points_a[:, 2])
    points, pixels = points_a[has_place], pixels_b[has_place]
    found = ransac(camera, points, pixels, N_ITERATIONS)
    if found is None or found[1].sum() < max(FEWEST_INLIERS, INLIER_SHARE * len(points)):
        return None
    start, agrees = found
    points, pixels = points[agrees], pixels[agrees]
    unit = float(np.median(points[:, 2]))
    seen = np.column_stack([pixels, np.full(len(pixels), np.nan)])
    start[:3, 3] /= unit
    b_from_a, _ = refine(camera, start, Sightings(points / unit, seen, np.ones_like(seen)))
    b_from_a[:3, 3] *= unit
    return Motion(b_from_a, points, pixels)
