"""Frames that no model holds: between two known poses if the gap is short and the turn small.

Across a large turn a camera's path is anyone's guess; such frames are lost, as in a long gap.
"""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.trajectory import INTERPOLATED, LOST, TRACKED, FramePoses, interpolate

Array = NDArray[np.float64]
MAX_TURN_RAD = np.radians(45.0)


def fill_gaps(known: dict[int, Array], n_frames: int, max_gap_frames: int) -> FramePoses:
    """Poses of all frames from those that have one.

    Args:
        known: position → world_from_cam (4, 4).
        n_frames: F.
        max_gap_frames: most frames in a row that may be interpolated.
    """
    positions = np.array(sorted(known), dtype=np.int64)
    poses = np.full((n_frames, 4, 4), np.nan)
    poses[positions] = [known[int(position)] for position in positions]
    missing = np.setdiff1d(np.arange(n_frames), positions)
    filled = interpolate(positions, poses[positions], missing, max_gap_frames + 1)
    filled[_turn_rad(poses, positions, missing) > MAX_TURN_RAD] = np.nan
    poses[missing] = filled
    status = np.full(n_frames, LOST, dtype="<U12")
    status[positions] = TRACKED
    status[missing[np.isfinite(filled[:, 0, 0])]] = INTERPOLATED
    return FramePoses(poses, status)


def _turn_rad(poses: Array, positions: NDArray[np.int64], missing: NDArray[np.int64]) -> Array:
    """Angle (M,) between the known poses before and after each missing one, 0 at the ends."""
    after = np.searchsorted(positions, missing)
    before = poses[positions[np.clip(after - 1, 0, None)], :3, :3]
    following = poses[positions[np.clip(after, None, len(positions) - 1)], :3, :3]
    return rotation_angle_rad(np.swapaxes(before, 1, 2) @ following)


def n_covered(keyframes: list[int], all_keyframes: list[int], n_frames: int) -> int:
    """Frames that some keyframes stand for: each up to the next of all keyframes."""
    ends = dict(zip(all_keyframes, [*all_keyframes[1:], n_frames], strict=True))
    return sum(ends[keyframe] - keyframe for keyframe in keyframes)
