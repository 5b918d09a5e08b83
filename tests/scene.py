"""A tiny analytic scene with exact truth in memory, for tests: ``from scene import make_scene``.

Three objects on one table, each well inside a 0.2 m voxel of its own, their yaws whole azimuth
bins; 12 frames on a circle at 20°, 30° and 48° in turn. All arrays are read-only: a function that
writes into its arguments fails.
"""

from dataclasses import dataclass, fields
from functools import cache

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.viewpoint import ViewGrid, view_angles
from imodbatch.lab.analytic.catalogue import CAN, CARTON, CLASSES, MUG, half_height_m
from imodbatch.lab.analytic.path import look_at
from imodbatch.lab.analytic.render import shade, trace
from imodbatch.lab.analytic.truth import true_objects
from imodbatch.lab.analytic.world import PlacedObject, Surface, World, build_world

Array = NDArray[np.float64]

CAMERA = PinholeCamera(160, 120, 145.0, 145.0, 80.0, 60.0)
GRID = ViewGrid(16, (np.deg2rad(10.0), np.deg2rad(30.0), np.deg2rad(50.0)))
VOXEL_SIZE_M = 0.2
N_FRAMES = 12
TABLE = Surface(0.0, 0.0, 1.2, 1.2, 0.77)
PLACES = ((CARTON, (-0.3, -0.1), 3), (MUG, (0.1, 0.3), 10), (CAN, (0.3, -0.3), 0))
"""Class, (x, y) in metres, yaw in azimuth bins."""
TRUE_SCORE = 0.9
"""Ideal score of the true class, elevation and azimuth; all others share the rest evenly."""


@dataclass(frozen=True, eq=False)
class Scene:
    """F frames of O objects, all of them visible in every frame.

    Attributes:
        world: the solids, to trace more of them.
        color: (F, H, W, 3) uint8 RGB.
        depth_m: (F, H, W) exact z-depth.
        owner: (F, H, W) which object a pixel shows, -1 = none.
        world_from_cam: (F, 4, 4).
        class_id: (O,) ordinals in the catalogue's CLASSES.
        xyz_world: (O, 3) middles, metres.
        yaw_rad: (O,).
        yaw_bin: (O,) the same in azimuth bins.
        boxes_px: (F, O, 4) x0, y0, x1, y1 of the visible pixels.
        azimuth_bin: (F, O) geometric, in the world.
        elevation_bin: (F, O).
        view_scores: (F, O, K, M, N) ideal scores; the predicted azimuth is the geometric one less
            the yaw.
        background_score: (F, O).
    """

    world: World
    color: NDArray[np.uint8]
    depth_m: Array
    owner: NDArray[np.int64]
    world_from_cam: Array
    class_id: NDArray[np.int64]
    xyz_world: Array
    yaw_rad: Array
    yaw_bin: NDArray[np.int64]
    boxes_px: Array
    azimuth_bin: NDArray[np.int64]
    elevation_bin: NDArray[np.int64]
    view_scores: Array
    background_score: Array


@cache
def make_scene() -> Scene:
    """The scene; made once, since nobody can change it."""
    world = build_world([_place(*place) for place in PLACES], [TABLE])
    world_from_cam = _poses()
    traces = [trace(world, CAMERA, pose) for pose in world_from_cam]
    truths = [true_objects(world, *pair) for pair in zip(world_from_cam, traces, strict=True)]
    class_id = np.array([placed.class_id for placed in world.objects])
    yaw_bin = np.array([yaw for _, _, yaw in PLACES])
    xyz_world = np.array([placed.xyz_world for placed in world.objects])
    azimuth, elevation = view_angles(xyz_world[None], world_from_cam[:, None, :3, 3])
    azimuth_bin, elevation_bin = GRID.azimuth_bins(azimuth), GRID.elevation_bins(elevation)
    seen_from_bin = (azimuth_bin - yaw_bin) % GRID.n_azimuths
    view_scores, background = ideal_scores(class_id[None], elevation_bin, seen_from_bin)
    frames = zip(world_from_cam, traces, strict=True)
    return _read_only(
        Scene(
            world=world,
            color=np.stack([shade(world, CAMERA, pose, traced) for pose, traced in frames]),
            depth_m=np.stack([traced.depth_m for traced in traces]),
            owner=np.stack([traced.owner for traced in traces]),
            world_from_cam=world_from_cam,
            class_id=class_id,
            xyz_world=xyz_world,
            yaw_rad=np.array([placed.yaw_rad for placed in world.objects]),
            yaw_bin=yaw_bin,
            boxes_px=np.array([[true.box_px for true in seen] for seen in truths]),
            azimuth_bin=azimuth_bin,
            elevation_bin=elevation_bin,
            view_scores=view_scores,
            background_score=background,
        )
    )


def ideal_scores(class_id, elevation_bin, azimuth_bin) -> tuple[Array, Array]:
    """Scores (..., K, M, N) and background (...,): `TRUE_SCORE` where the truth is.

    Args:
        class_id: (...,), broadcast with the bins.
        elevation_bin: (...,).
        azimuth_bin: (...,) in the object's own frame.
    """
    shape = (len(CLASSES), GRID.n_elevations, GRID.n_azimuths)
    cell = np.ravel_multi_index(np.broadcast_arrays(class_id, elevation_bin, azimuth_bin), shape)
    rest = (1 - TRUE_SCORE) / np.prod(shape)
    scores = np.where(np.arange(np.prod(shape)) == cell[..., None], TRUE_SCORE, rest)
    return scores.reshape(*cell.shape, *shape), np.full(cell.shape, rest)


def _place(class_id: int, xy: tuple[float, float], yaw_bin: int) -> PlacedObject:
    xyz = (*xy, TABLE.height_m + half_height_m(class_id))
    return PlacedObject(class_id, CLASSES[class_id], xyz, yaw_bin * GRID.azimuth_step_rad)


def _poses() -> Array:
    azimuth = np.arange(N_FRAMES) * 2 * np.pi / N_FRAMES + 0.1
    elevation = np.deg2rad(np.resize([20.0, 30.0, 48.0], N_FRAMES))
    target = np.array([0.0, 0.0, 0.85])
    level = np.cos(elevation)
    away = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
    return look_at(target + 1.5 * away, target)


def _read_only(scene: Scene) -> Scene:
    for field in fields(scene):
        value = getattr(scene, field.name)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return scene
