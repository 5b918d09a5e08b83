"""Which way is up: from the planes of floor, tables and walls (open3d).

Points of several frames are put together in the poses' world and thinned out to voxels. RANSAC
finds the largest planes. A camera is held roughly upright, so of the planes whose normal lies
within 45° of the cameras' mean up direction the largest is floor or table. Its normal is then
refined against the normals of all points: those along it (floors, tables) and those across it
(walls), as Gupta et al. 2013, Sec. 4.1, do for single images.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import apply
from imodbatch.engines.open3d_library import open3d
from imodbatch.errors import DataError

Array = NDArray[np.float64]
VOXEL_M = 0.03
MAX_DEPTH_M = 4.0
PLANE_DISTANCE_M = 0.02
MAX_PLANES = 8
MAX_TILT_DEG = 45.0
REFINE_WITHIN_DEG = (10.0, 5.0, 5.0)
MIN_SHARE = 0.05


@dataclass(frozen=True)
class Up:
    """An up direction (3,) in the poses' world, and the share of points on planes it rests on."""

    direction: Array
    plane_share: float
    tilt_deg: float

    def __str__(self) -> str:
        x, y, z = self.direction
        return (
            f"up ({x:.3f}, {y:.3f}, {z:.3f}) from planes with {100 * self.plane_share:.0f} % "
            f"of the points, {self.tilt_deg:.0f}° from the cameras' mean up"
        )


def estimate_up(
    points_cam: Iterable[Array], world_from_cam: Iterable[Array], where: str, seed: int = 0
) -> Up:
    """Estimate up from depth.

    Args:
        points_cam: per frame (P, 3) points in the camera, metres, all finite.
        world_from_cam: per frame (4, 4).
        where: name of the sequence, for errors.
        seed: of RANSAC.

    Raises:
        DataError: no plane within 45° of the cameras' up holds 5 % of the points.
    """
    o3d = open3d()
    o3d.utility.random.seed(seed)
    poses = [np.asarray(pose) for pose in world_from_cam]
    clouds = [
        apply(pose, points) for pose, points in zip(poses, points_cam, strict=True) if len(points)
    ]
    if not clouds:
        raise DataError(f"{where}: no depth to find the floor in. Give world.up in the manifest.")
    camera_up = np.mean([-pose[:3, 1] for pose in poses], axis=0)
    camera_up /= np.linalg.norm(camera_up)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.concatenate(clouds)))
    cloud = cloud.voxel_down_sample(VOXEL_M)
    normal, share = _floor_normal(cloud, camera_up)
    if normal is None:
        raise DataError(
            f"{where}: no floor or table plane found (largest holds {100 * share:.0f} % of the "
            f"points, {100 * MIN_SHARE:.0f} % needed). Give world.up in the manifest."
        )
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=3 * VOXEL_M, max_nn=30))
    direction = _refine(normal, np.asarray(cloud.normals))
    tilt = float(np.degrees(np.arccos(np.clip(direction @ camera_up, -1, 1))))
    return Up(direction, share, tilt)


def _floor_normal(cloud: Any, camera_up: Array) -> tuple[Array | None, float]:
    """Normal of the largest upright plane and the share of points on planes parallel to it."""
    total, rest, planes = len(cloud.points), cloud, []
    for _ in range(MAX_PLANES):
        if len(rest.points) < max(MIN_SHARE * total, 50):
            break
        (a, b, c, _), inliers = rest.segment_plane(PLANE_DISTANCE_M, 3, 1000)
        normal = np.array([a, b, c]) / np.linalg.norm([a, b, c])
        planes.append((len(inliers) / total, normal * np.sign(normal @ camera_up or 1.0)))
        rest = rest.select_by_index(inliers, invert=True)
    upright = [p for p in planes if p[1] @ camera_up > np.cos(np.radians(MAX_TILT_DEG))]
    if not upright:
        return None, 0.0
    best = max(upright, key=lambda plane: plane[0])
    parallel = [s for s, normal in upright if normal @ best[1] > np.cos(np.radians(10.0))]
    share = float(sum(parallel))
    return (best[1] if best[0] >= MIN_SHARE else None), share


def _refine(up: Array, normals: Array) -> Array:
    """Direction closest to the normals along it and most across the normals across it."""
    for limit_deg in REFINE_WITHIN_DEG:
        cosine = np.abs(normals @ up)
        along = normals[cosine > np.cos(np.radians(limit_deg))]
        across = normals[cosine < np.sin(np.radians(limit_deg))]
        scatter = along.T @ along - across.T @ across
        refined = np.linalg.eigh(scatter)[1][:, -1]
        up = refined * np.sign(refined @ up)
    return up
