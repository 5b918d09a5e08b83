"""What a user should know of poses that come with a dataset: contradictions, and clocks apart."""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import is_rigid
from imodbatch.datasets.base import NS_PER_MS, NS_PER_S, Odometry

SAME_POSE = 1e-6  # entries of printed matrices; metres for places


def left_out(odometry: Odometry) -> str:
    """How many poses by moment are none, in a few words; of poses by number a lost frame tells."""
    n_poses = len(odometry.world_from_color)
    n_unusable = n_poses - int(is_rigid(odometry.world_from_color).sum())
    if odometry.timestamp_ns is None or n_unusable == 0:
        return ""
    return f"{n_unusable} of the trajectory's {n_poses} poses left out: no stamp or no transform"


def contradictions(odometry: Odometry) -> tuple[str, ...]:
    """Different poses for one moment or frame, a sentence; poses that are repeated do no harm."""
    keys, what = odometry.timestamp_ns, "stamps"
    if keys is None:
        keys, what = odometry.frame_index, "frame numbers"
    rows = np.flatnonzero(is_rigid(odometry.world_from_color))
    poses = odometry.world_from_color[rows]
    unique, first, owner = np.unique(keys[rows], return_index=True, return_inverse=True)  # type: ignore[index]
    apart = np.abs(poses - poses[first[owner]]).max(axis=(1, 2), initial=0.0) > SAME_POSE
    if not apart.any():
        return ()
    distance_m = np.linalg.norm((poses - poses[first[owner]])[:, :3, 3], axis=-1).max()
    return (
        f"{len(np.unique(owner[apart]))} of {len(unique)} {what} of the trajectory stand more than "
        f"once with different poses, up to {distance_m:.3f} m apart; the first of them counts",
    )


def why_none_fits(
    frame_index: NDArray[np.int64], timestamp_ns: NDArray[np.int64] | None, odometry: Odometry
) -> str:
    """Why no frame got a pose, with the cure.

    Args:
        frame_index: (F,) numbers of the frames.
        timestamp_ns: (F,) their moments, if they are known.
        odometry: poses, none of which fits.
    """
    usable = is_rigid(odometry.world_from_color)
    if not usable.any():
        return (
            f"None of the trajectory's {len(usable)} poses is a rigid transform with a stamp or "
            "frame number. Check odometry.format and odometry.path."
        )
    if odometry.timestamp_ns is None or timestamp_ns is None:
        numbers = odometry.frame_index[usable]  # type: ignore[index]
        return (
            f"Frames are numbered {frame_index.min()} to {frame_index.max()}, poses "
            f"{numbers.min()} to {numbers.max()}. Check odometry.path and the sequence's frames."
        )
    return _clocks(timestamp_ns, odometry.timestamp_ns[usable])


def _clocks(frames_ns: NDArray[np.int64], poses_ns: NDArray[np.int64]) -> str:
    """Both spans of time, and what to change so that they meet."""
    frames_ns, poses_ns = np.sort(frames_ns), np.sort(poses_ns)
    spans = (
        f"Frames run from {_seconds(frames_ns[0])} to {_seconds(frames_ns[-1])} s, "
        f"the trajectory from {_seconds(poses_ns[0])} to {_seconds(poses_ns[-1])} s"
    )
    if frames_ns[0] > poses_ns[-1] or poses_ns[0] > frames_ns[-1]:
        offset_ms = int(frames_ns[0] - poses_ns[0]) / NS_PER_MS
        return (
            f"{spans}: their clocks differ. Check odometry.clock_offset_ms; "
            f"{offset_ms:+.3f} ms would let both start together."
        )
    after = np.searchsorted(poses_ns, frames_ns).clip(1, max(len(poses_ns) - 1, 1))
    neighbours = poses_ns[np.stack([after - 1, np.minimum(after, len(poses_ns) - 1)])]
    gap_ms = int(np.abs(neighbours - frames_ns).min()) / NS_PER_MS
    return (
        f"{spans}; the nearest stamps are {gap_ms:.3f} ms apart. "
        "Raise poses.max_gap_ms above that, or check odometry.clock_offset_ms."
    )


def _seconds(moment_ns: np.int64) -> str:
    return f"{int(moment_ns) / NS_PER_S:.3f}"
