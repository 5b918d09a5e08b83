"""How much of an instance is in view: its outline alone, held against what the frame shows."""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import apply, invert
from imodbatch.lab.masks import bounds_of
from imodbatch.lab.render.raycast.geometry import caster_of
from imodbatch.lab.render.raycast.interface import Instance, InstanceView

Box = tuple[float, float, float, float]
NEAR_M = 0.01
"""An instance nearer to the camera's plane than this has no bounded outline."""
MARGIN = 1.0
"""Outlines are followed this many image sizes beyond the border."""
MAX_RAYS = 60_000
"""A larger window beyond the image is looked at in steps of several pixels."""


def view_of(
    instance: Instance,
    camera: PinholeCamera,
    world_from_cam: NDArray[np.float64],
    instance_ids: NDArray[np.int32],
) -> InstanceView:
    """How an instance appears.

    Args:
        instance: with a number of its own.
        camera: of the frame.
        world_from_cam: (4, 4).
        instance_ids: (H, W) of the frame.
    """
    number = instance.instance_id
    mesh_from_cam = invert(instance.world_from_mesh) @ world_from_cam
    window = _window(instance, camera, mesh_from_cam)
    if window is None:
        return InstanceView(number, 0, 0.0, 0.0, False, None)
    x0, y0, x1, y1 = window
    inner = (max(x0, 0), max(y0, 0), min(x1, camera.width_px), min(y1, camera.height_px))
    is_within = inner == window
    if inner[0] >= inner[2] or inner[1] >= inner[3]:
        return InstanceView(number, 0, 0.0, 0.0, False, None)
    alone = _outline(instance, camera, mesh_from_cam, inner, 1)
    n_alone = int(alone.sum())
    shown = instance_ids[inner[1] : inner[3], inner[0] : inner[2]] == number
    n_visible = int(shown.sum())
    inside_fraction = 1.0
    if not is_within:
        step = max(1, int(np.ceil(np.sqrt((x1 - x0) * (y1 - y0) / MAX_RAYS))))
        whole = _outline(instance, camera, mesh_from_cam, window, step)
        n_whole = int(whole.sum()) * step * step
        ys, xs = np.arange(y0, y1, step), np.arange(x0, x1, step)
        across = (xs >= 0) & (xs < camera.width_px)
        down = (ys >= 0) & (ys < camera.height_px)
        n_inside = int(whole[np.ix_(down, across)].sum()) * step * step
        inside_fraction = n_inside / n_whole if n_whole else 0.0
    fraction = min(n_visible / n_alone, 1.0) if n_alone else 0.0
    is_cut = inside_fraction < 1 and n_alone > 0
    return InstanceView(
        number,
        n_visible,
        fraction,
        inside_fraction if n_alone else 0.0,
        is_cut,
        _box(alone, inner),
    )


def _window(
    instance: Instance, camera: PinholeCamera, mesh_from_cam: NDArray[np.float64]
) -> tuple[int, int, int, int] | None:
    """Pixels that enclose the outline, up to a margin beyond the image; None = behind it."""
    points = apply(invert(mesh_from_cam), instance.mesh.vertices)
    width, height = camera.width_px, camera.height_px
    limits = np.array(
        [-MARGIN * width, -MARGIN * height, (1 + MARGIN) * width, (1 + MARGIN) * height]
    )
    if not len(points) or (points[:, 2] <= 0).all():
        return None
    if (points[:, 2] < NEAR_M).any():
        x0, y0, x1, y1 = limits.astype(int)
        return int(x0), int(y0), int(x1), int(y1)
    pixels = camera.project(points)
    low, high = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
    low, high = np.maximum(low, limits[:2]), np.minimum(high, limits[2:])
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _outline(
    instance: Instance,
    camera: PinholeCamera,
    mesh_from_cam: NDArray[np.float64],
    window: tuple[int, int, int, int],
    step: int,
) -> NDArray[np.bool_]:
    """Which pixels of a window show the instance if it stands alone, every `step` pixels."""
    x = (np.arange(window[0], window[2], step) + 0.5 - camera.cx_px) / camera.fx_px
    y = (np.arange(window[1], window[3], step) + 0.5 - camera.cy_px) / camera.fy_px
    ahead = np.ones((3, len(y), len(x)), np.float32)
    ahead[0], ahead[1] = x, y[:, None]
    directions = mesh_from_cam[:3, :3].astype(np.float32) @ ahead.reshape(3, -1)
    origin = mesh_from_cam[:3, 3:].astype(np.float32)
    return caster_of(instance.mesh).is_hit(origin, directions).reshape(len(y), len(x))


def _box(mask: NDArray[np.bool_], window: tuple[int, int, int, int]) -> Box | None:
    """The box around the pixels of a mask that lies at a window's top-left corner."""
    bounds = bounds_of(mask)
    if bounds is None:
        return None
    (left, top, right, bottom), (x, y, _, _) = bounds, window
    return float(x + left), float(y + top), float(x + right), float(y + bottom)
