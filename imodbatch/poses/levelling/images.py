"""Up from the depth images of a sequence whose frames have poses."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.poses.levelling import MAX_DEPTH_M, Up, estimate_up
from imodbatch.poses.rgbd import RgbdFrames

Array = NDArray[np.float64]
STRIDE_PX = 4


def up_of_frames(
    frames: RgbdFrames,
    world_from_cam: Array,
    has_depth: NDArray[np.bool_],
    n_frames: int,
    setting: str,
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> Up:
    """Up in the world of the poses, from some frames that have a pose and depth.

    Args:
        frames: F frames.
        world_from_cam: (F, 4, 4), NaN where lost.
        has_depth: (F,) which frames have a depth image.
        n_frames: how many are looked at, spread evenly.
        setting: the key that gives up in place of this estimate, for errors.
        progress: wraps the loop over frames.

    Raises:
        DataError: depth does not tell up: see `estimate_up`.
    """
    usable = np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]) & has_depth)
    picked = np.unique(np.linspace(0, len(usable) - 1, n_frames).astype(int))
    chosen = usable[picked].tolist() if len(usable) else []
    points = [_points_cam(frames, position) for position in progress(chosen)]
    return estimate_up(points, world_from_cam[chosen], frames.sequence_id, setting)


def _points_cam(frames: RgbdFrames, position: int) -> Array:
    """Every fourth pixel of a frame as points (P, 3) in the colour camera; none if unreadable."""
    depth_m = frames.read_depth(position)
    if depth_m is None:  # lift says so for every box of the frame
        return np.zeros((0, 3))
    depth_m = depth_m[::STRIDE_PX, ::STRIDE_PX]
    pixels = frames.camera.pixel_centers()[::STRIDE_PX, ::STRIDE_PX]
    near = depth_m < MAX_DEPTH_M
    return frames.camera.unproject(pixels[near], depth_m[near])
