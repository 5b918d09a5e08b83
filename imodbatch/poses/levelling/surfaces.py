"""The surfaces of a scene: the planes of all frames, put together where they are the same.

Planes are looked for frame by frame: seen in one image a plane is sharp even where poses drift.
What bears witness of up is a surface, though, not each look at it: a table that stands askew does
so in every frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import apply
from imodbatch.poses.levelling.planes import Plane, find_planes, thinned

Array = NDArray[np.float64]
SAME_WITHIN_DEG, SAME_WITHIN_M = 8.0, 0.1
SURFACE_SIGMA_DEG = 1.0  # how level tables and how upright walls are, and what a sensor makes of it
MIN_SHARE = 0.005
SAMPLE_POINTS = 4000


@dataclass(frozen=True)
class Surfaces:
    """S flat surfaces in the poses' world, largest first.

    Attributes:
        normals: (S, 3) of length 1, turned to where they were seen from.
        centroids: (S, 3) metres.
        share: (S,) of all frames' points, after thinning to voxels.
        variance_deg2: (S,) of the normal.
        points: (N, 3) a sample of all points.
    """

    normals: Array
    centroids: Array
    share: Array
    variance_deg2: Array
    points: Array


def find_surfaces(frames: Sequence[tuple[Array, Array]], seed: int) -> Surfaces:
    """Surfaces of frames.

    Args:
        frames: points (P, 3) in the camera and world_from_cam (4, 4) of each.
        seed: of RANSAC.
    """
    rng = np.random.default_rng(seed)
    planes: list[Plane] = []
    clouds = []
    for points_cam, world_from_cam in frames:
        points, normals = thinned(points_cam)
        clouds.append(apply(world_from_cam, points))
        planes += [_moved(plane, world_from_cam) for plane in find_planes(points, normals, rng)]
    cloud = np.concatenate(clouds)
    groups = [g for g in _groups(planes) if _size(g) >= MIN_SHARE * len(cloud)]
    merged = [_merged(group) for group in groups]
    return Surfaces(
        np.reshape([normal for normal, _, _ in merged], (-1, 3)),
        np.reshape([centroid for _, centroid, _ in merged], (-1, 3)),
        np.array([_size(group) / len(cloud) for group in groups]),
        np.array([variance for _, _, variance in merged]),
        cloud[:: max(1, len(cloud) // SAMPLE_POINTS)],
    )


def _moved(plane: Plane, world_from_cam: Array) -> Plane:
    normal, centroid = world_from_cam[:3, :3] @ plane.normal, apply(world_from_cam, plane.centroid)
    return replace(plane, normal=normal, centroid=centroid)


def _groups(planes: list[Plane]) -> list[list[Plane]]:
    """Planes that are one surface as each of the largest is, largest first."""
    rest = sorted(planes, key=lambda plane: -plane.n_points)
    groups = []
    while rest:
        same = [_is_same(rest[0], plane) for plane in rest]
        groups.append([plane for plane, yes in zip(rest, same, strict=True) if yes])
        rest = [plane for plane, yes in zip(rest, same, strict=True) if not yes]
    return sorted(groups, key=lambda group: -_size(group))


def _is_same(a: Plane, b: Plane) -> bool:
    offset_m = abs(float((b.centroid - a.centroid) @ (a.normal + b.normal))) / 2
    turned = float(a.normal @ b.normal) < np.cos(np.radians(SAME_WITHIN_DEG))
    return offset_m < SAME_WITHIN_M and not turned


def _size(group: list[Plane]) -> int:
    return sum(plane.n_points for plane in group)


def _merged(group: list[Plane]) -> tuple[Array, Array, float]:
    """Normal, centroid and the normal's variance of planes that are one surface."""
    weights = 1 / np.array([plane.sigma_deg for plane in group]) ** 2
    normals = np.stack([plane.normal for plane in group])
    mean = weights @ normals
    mean /= np.linalg.norm(mean)
    centroid = weights @ np.stack([plane.centroid for plane in group]) / weights.sum()
    off_deg = np.degrees(np.arccos(np.clip(normals @ mean, -1, 1)))
    excess = float(weights @ off_deg**2) / max(2 * (len(group) - 1), 1)
    return mean, centroid, SURFACE_SIGMA_DEG**2 + max(1.0, excess) / float(weights.sum())
