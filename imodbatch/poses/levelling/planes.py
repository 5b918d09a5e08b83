"""The planes of one frame, whichever way they stand: voxels and normals by open3d, then RANSAC."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.libraries.open3d_library import open3d

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
MAX_DEPTH_M = 4.0
VOXEL_M = 0.04
NORMAL_RADIUS_M, NORMAL_NEIGHBOURS = 0.1, 30
PLANE_DISTANCE_M = 0.02
N_SEEDS, N_DRAWS, N_JUDGES = 80, 150, 800
SEED_WITHIN_DEG, PLANE_WITHIN_DEG = 15.0, 20.0
MAX_ROUNDS = 12
MIN_SHARE, MIN_POINTS = 0.03, 40
SENSOR_BEND_M = 0.01


@dataclass(frozen=True)
class Plane:
    """A plane seen in one frame, in its camera.

    Attributes:
        normal: (3,) of length 1, turned to the camera: floors and ceilings are told apart.
        centroid: (3,) metres.
        n_points: voxels on it.
        sigma_deg: how far off the normal may be: a sensor bends a surface by about a centimetre,
            which turns a small one more than a large one.
    """

    normal: Array
    centroid: Array
    n_points: int
    sigma_deg: float

    @classmethod
    def fit(cls, points: Array) -> "Plane":
        """The plane of least squares through points (P, 3)."""
        centroid = points.mean(axis=0)
        variances, axes = np.linalg.eigh(np.cov((points - centroid).T))
        normal = axes[:, 0] * (-1.0 if axes[:, 0] @ centroid > 0 else 1.0)
        half_width_m = float(np.sqrt(max(variances[1], 1e-6)))
        return cls(normal, centroid, len(points), np.degrees(SENSOR_BEND_M / half_width_m))


def thinned(points_cam: Array) -> tuple[Array, Array]:
    """Points (P, 3) of voxels and their normals (P, 3), turned to the camera."""
    o3d: Any = open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(points_cam)))
    cloud = cloud.voxel_down_sample(VOXEL_M)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMAL_RADIUS_M, NORMAL_NEIGHBOURS))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    return np.asarray(cloud.points), np.asarray(cloud.normals)


def find_planes(points: Array, normals: Array, rng: np.random.Generator) -> list[Plane]:
    """Planes of a frame's points (P, 3) with normals, those of the commonest direction first.

    RANSAC sees only points whose normals agree: it needs few draws, and lays no plane across
    unrelated things.
    """
    minimum = max(MIN_SHARE * len(points), MIN_POINTS)
    rest, planes = np.arange(len(points)), []
    for _ in range(MAX_ROUNDS):
        members = _commonest(normals, rest)
        if len(members) < minimum:
            break
        core = members[_largest_plane(points[members], rng)]
        on_plane = _grown(points, normals, rest, core)
        if on_plane.sum() >= minimum:
            planes.append(Plane.fit(points[rest[on_plane]]))
        rest = rest[~(on_plane | np.isin(rest, core))]
    return planes


def _commonest(normals: Array, rest: Rows) -> Rows:
    """Those of the rows whose normals agree with that of the row that most agree with."""
    compact = normals[rest].astype(np.float32)
    seeds = compact[:: max(1, len(rest) // N_SEEDS)]
    agreeing = seeds @ compact.T > np.cos(np.radians(SEED_WITHIN_DEG))
    return rest[agreeing[np.argmax(agreeing.sum(axis=1))]] if len(rest) else rest


def _largest_plane(points: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which points (P, 3) lie on the plane through three of them that has most points."""
    corners = points[rng.integers(len(points), size=(N_DRAWS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    offsets_m = np.einsum("di,di->d", normals, corners[:, 0])
    judges = points[rng.integers(len(points), size=N_JUDGES)]
    near = np.abs(normals @ judges.T - offsets_m[:, None]) < PLANE_DISTANCE_M
    near[np.abs(normals).max(axis=1) < 0.5] = False  # three points on a line
    best = int(np.argmax(near.sum(axis=1)))
    return np.asarray(np.abs(points @ normals[best] - offsets_m[best]) < PLANE_DISTANCE_M)


def _grown(points: Array, normals: Array, rest: Rows, core: Rows) -> NDArray[np.bool_]:
    """Which of the rest (R,) lie on the plane of the core and face its way."""
    plane = Plane.fit(points[core])
    near = np.abs((points[rest] - plane.centroid) @ plane.normal) < PLANE_DISTANCE_M
    return near & (normals[rest] @ plane.normal > np.cos(np.radians(PLANE_WITHIN_DEG)))
