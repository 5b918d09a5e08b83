"""Poses of the frames between keyframes: reconstructed points tracked into them, then PnP.

From the keyframe before and the one after, the patch round each reconstructed point is looked for
in the frame (pyramidal Lucas–Kanade). The patch is always the keyframe's own and the search starts
where it was last found, so nothing drifts. The pixels found give the pose (Lepetit et al. 2009,
with RANSAC and refinement as in COLMAP); depth and the surfaces of the two keyframes settle it.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import invert
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.rgbd.flow import track
from imodbatch.poses.rgbd.gray import read_gray
from imodbatch.poses.sfm.colmap import SEED, Progress, colmap_camera, pycolmap
from imodbatch.poses.sfm.depth_adjustment import settle_on, target
from imodbatch.poses.sfm.mapping import Model, Sights

Array = NDArray[np.float64]
WINDOW_PX = 21
PYRAMID_LEVELS = 3
MIN_TRACKS, MAX_TRACKS = 30, 300  # per keyframe; more only cost time
MIN_INLIER_SHARE = 0.5
MAX_ERROR_PX = 4.0


def localize(
    frames: RgbdFrames, model: Model, use_depth: bool, progress: Progress
) -> dict[int, Array]:
    """Poses of frames that are not firmly in the model, as far as tracks reach.

    Args:
        frames: the sequence.
        model: the reconstruction.
        use_depth: whether to settle each frame on the surfaces of the keyframes around it.
        progress: wraps the stretches between keyframes.

    Returns:
        position → world_from_cam (4, 4) in the model's units.
    """
    camera, keyframes = colmap_camera(frames.camera), model.firm_keyframes()
    stretches = zip([None, *keyframes], [*keyframes, None], strict=True)
    poses = {}
    for before, after in progress(list(stretches)):
        found = _sights_between(frames, model, before, after)
        around = [k for k in (before, after) if k is not None and found and use_depth]
        targets = [target(frames, model, k) for k in around]
        for position, parts in found.items():
            sights = _together(parts)
            located = _locate(sights, camera)
            if located is None:
                continue
            cam_from_world, fitting = located
            if targets:
                cam_from_world = settle_on(targets, frames, position, cam_from_world, fitting)
            poses[position] = invert(cam_from_world)
    return poses


def _sights_between(
    frames: RgbdFrames, model: Model, before: int | None, after: int | None
) -> dict[int, list[Sights]]:
    """What frames between two keyframes see of the points that these see; None = no keyframe."""
    first = -1 if before is None else before
    last = len(frames) if after is None else after
    found: dict[int, list[Sights]] = {}
    directions = [(before, range(first + 1, last)), (after, range(last - 1, first, -1))]
    for keyframe, positions in directions:
        if keyframe is None or len(positions) == 0:
            continue
        for position, sights in _follow(frames, keyframe, model.sights(keyframe), positions):
            found.setdefault(position, []).append(sights)
    return found


def _follow(
    frames: RgbdFrames, keyframe: int, sights: Sights, positions: range
) -> Iterator[tuple[int, Sights]]:
    """Track what a keyframe sees through the frames, until too little is left."""
    template = read_gray(frames, keyframe)
    if template is None:
        return
    rows = np.unique(np.linspace(0, len(sights.pixels) - 1, MAX_TRACKS).astype(int))
    start = tracks = sights.pixels[rows]
    followed = sights.take(rows)
    for position in positions:
        gray = read_gray(frames, position)
        if gray is None:
            continue
        if len(start) < MIN_TRACKS:
            return
        tracks, kept = track(template, gray, start, tracks, WINDOW_PX, PYRAMID_LEVELS)
        start, tracks, followed = start[kept], tracks[kept], followed.take(kept)
        yield position, replace(followed, pixels=tracks)


def _together(parts: list[Sights]) -> Sights:
    """What several keyframes' tracks see, in one."""
    return Sights(
        np.concatenate([part.pixels for part in parts]),
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.scale_px for part in parts]),
    )


def _locate(sights: Sights, camera: Any) -> tuple[Array, Sights] | None:
    """cam_from_world (4, 4) and what agrees on it, or None where that is too little."""
    if len(sights.pixels) < MIN_TRACKS:
        return None
    colmap = pycolmap()
    options = colmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = MAX_ERROR_PX
    options.ransac.random_seed = SEED
    answer = colmap.estimate_and_refine_absolute_pose(sights.pixels, sights.points, camera, options)
    if answer is None:
        return None
    if answer["num_inliers"] < max(MIN_TRACKS, MIN_INLIER_SHARE * len(sights.pixels)):
        return None
    agrees = np.asarray(answer["inlier_mask"], dtype=np.bool_)
    cam_from_world = np.vstack([answer["cam_from_world"].matrix(), [0.0, 0.0, 0.0, 1.0]])
    return cam_from_world, sights.take(agrees)
