"""One camera frame by ray casting: a ray through every pixel centre, the nearest surface wins.

Rays advance one metre along the optical axis per unit, so the nearest hit is the exact z-depth.
Each solid is tried only within the window of pixels that its bounding box projects to.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import apply, invert
from imodbatch.lab.analytic.world import BACKGROUND, Part, World

Array = NDArray[np.float64]
LIGHT = np.array([0.4, 0.25, 0.88])  # direction to the light, +z up
AMBIENT = 0.4
NEAR_M = 0.02
CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T


@dataclass(frozen=True, eq=False)
class Trace:
    """What the rays of one frame met.

    Attributes:
        depth_m: (H, W) exact z-depth, NaN where nothing was met.
        part: (H, W) ordinal of the nearest part, -1 = none.
        owner: (H, W) ordinal of the object that part belongs to, `BACKGROUND` = none.
        alone: (O, H, W) where each object would show if nothing stood before it.
    """

    depth_m: Array
    part: NDArray[np.int64]
    owner: NDArray[np.int64]
    alone: NDArray[np.bool_]


def trace(world: World, camera: PinholeCamera, world_from_cam: Array) -> Trace:
    """Cast a ray through every pixel centre.

    Args:
        world: the solids.
        camera: of H x W pixels.
        world_from_cam: 4x4.
    """
    shape = (camera.height_px, camera.width_px)
    rays = camera.unproject(camera.pixel_centers(), np.ones(shape))
    nearest = np.full(shape, np.inf)
    part_index = np.full(shape, -1, dtype=np.int64)
    alone = np.zeros((len(world.objects), *shape), dtype=np.bool_)
    for index, part in enumerate(world.parts):
        part_from_cam = invert(part.world_from_part) @ world_from_cam
        window = _window(part, camera, part_from_cam)
        directions = rays[window] @ part_from_cam[:3, :3].T
        hit = part.shape.hit(part_from_cam[:3, 3], directions)
        if part.owner != BACKGROUND:
            alone[part.owner][window] |= np.isfinite(hit)
        is_nearer = hit < nearest[window]
        nearest[window] = np.where(is_nearer, hit, nearest[window])
        part_index[window] = np.where(is_nearer, index, part_index[window])
    owners = np.array([part.owner for part in world.parts] + [BACKGROUND])
    depth_m = np.where(np.isfinite(nearest), nearest, np.nan)
    return Trace(depth_m, part_index, owners[part_index], alone)


def shade(
    world: World, camera: PinholeCamera, world_from_cam: Array, traced: Trace
) -> NDArray[np.uint8]:
    """Colour image (H, W, 3) RGB of a trace: paint under one distant light (Lambert)."""
    points = apply(world_from_cam, camera.unproject(camera.pixel_centers(), traced.depth_m))
    image = np.zeros((camera.height_px, camera.width_px, 3))
    for index in np.unique(traced.part[traced.part >= 0]).tolist():
        part, here = world.parts[index], traced.part == index
        points_part = apply(invert(part.world_from_part), points[here])
        normals = part.shape.normal(points_part) @ part.world_from_part[:3, :3].T
        light = AMBIENT + (1 - AMBIENT) * np.maximum(normals @ LIGHT, 0.0)
        image[here] = part.paint.at(points_part) * light[:, None]
    return np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)


def _window(part: Part, camera: PinholeCamera, part_from_cam: Array) -> tuple[slice, slice]:
    """Rows and columns whose pixels the part can cover; all when it reaches behind the camera."""
    corners = CORNERS * np.array(part.shape.half_extents_m)
    corners_cam = apply(invert(part_from_cam), corners)
    if corners_cam[:, 2].min() < NEAR_M:
        return slice(0, camera.height_px), slice(0, camera.width_px)
    pixels = camera.project(corners_cam)
    size = np.array([camera.width_px, camera.height_px])
    first = np.clip(np.floor(pixels.min(axis=0)), 0, size).astype(np.int64)
    last = np.clip(np.ceil(pixels.max(axis=0)), 0, size).astype(np.int64)
    return slice(int(first[1]), int(last[1])), slice(int(first[0]), int(last[0]))
