"""Camera trajectories: giving each frame a pose from poses taken at other moments."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.frames import (
    is_rigid,
    make_transform,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_between,
    slerp,
)

Array = NDArray[np.float64]
TRACKED, DENSE, INTERPOLATED, LOST = "tracked", "dense", "interpolated", "lost"
STATUSES = (TRACKED, DENSE, INTERPOLATED, LOST)


@dataclass(frozen=True)
class FramePoses:
    """A pose for each of F frames.

    Attributes:
        world_from_cam: (F, 4, 4), NaN where lost.
        status: (F,) of tracked; dense (by depth and brightness as a whole, where features were too
            few); interpolated; lost.
    """

    world_from_cam: Array
    status: NDArray[np.str_]

    @classmethod
    def from_matrices(cls, world_from_cam: ArrayLike) -> "FramePoses":
        """Poses (F, 4, 4) as given; those that are not rigid transforms count as lost."""
        given = np.asarray(world_from_cam, dtype=np.float64).reshape(-1, 4, 4)
        good = is_rigid(given)
        poses = np.full_like(given, np.nan)
        rotation = matrix_from_quaternion(quaternion_from_matrix(given[good, :3, :3]))
        poses[good] = make_transform(rotation, given[good, :3, 3])
        return cls(poses, np.where(good, TRACKED, LOST))


@dataclass(frozen=True)
class Trajectory:
    """What a source of poses gives for a sequence, in a world of its own, in metres.

    Attributes:
        poses: of the F frames.
        summary: how they came about, in a few words.
        warnings: what a user should know, a sentence each.
        figures: figures of the source itself by name, unit in the name: rows of `pose_quality`.
    """

    poses: FramePoses
    summary: str = ""
    warnings: tuple[str, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)


def associate(stamps_a: ArrayLike, stamps_b: ArrayLike, max_gap: int) -> NDArray[np.int64]:
    """Nearest-stamp association, one to one, closest pairs first.

    Args:
        stamps_a: (A,) sorted or not.
        stamps_b: (B,) in the same unit, sorted or not.
        max_gap: largest difference of a pair.

    Returns:
        (A,) index into b, −1 where nothing within the gap is left.
    """
    a, b = np.asarray(stamps_a, dtype=np.int64), np.asarray(stamps_b, dtype=np.int64)
    partner = np.full(len(a), -1, dtype=np.int64)
    if len(a) == 0 or len(b) == 0:
        return partner
    order = np.argsort(b, kind="stable")
    low = np.searchsorted(b[order], a - max_gap, side="left")
    high = np.searchsorted(b[order], a + max_gap, side="right")
    index_a = np.repeat(np.arange(len(a)), high - low)
    within = np.arange(len(index_a)) - np.repeat(np.cumsum(high - low) - (high - low), high - low)
    index_b = order[np.repeat(low, high - low) + within]
    taken = np.zeros(len(b), dtype=np.bool_)
    for pair in np.argsort(np.abs(a[index_a] - b[index_b]), kind="stable"):
        i, j = index_a[pair], index_b[pair]
        if partner[i] < 0 and not taken[j]:
            partner[i], taken[j] = j, True
    return partner


def interpolate(stamps: ArrayLike, world_from_cam: ArrayLike, at: ArrayLike, max_gap: int) -> Array:
    """Poses at given moments between neighbouring poses: linear in position, slerp in rotation.

    Args:
        stamps: (P,) strictly increasing.
        world_from_cam: (P, 4, 4), all finite.
        at: (Q,) moments.
        max_gap: largest distance between the two neighbours; beyond it, and outside the
            trajectory, nothing is invented. A moment that has a pose of its own gets that one.

    Returns:
        (Q, 4, 4), NaN where no pose can be given.
    """
    stamps, at = np.asarray(stamps, dtype=np.int64), np.asarray(at, dtype=np.int64)
    poses = np.asarray(world_from_cam, dtype=np.float64)
    result = np.full((len(at), 4, 4), np.nan)
    known, position = np.isin(at, stamps), np.searchsorted(stamps, at)
    result[known] = poses[position[known]]
    if len(stamps) < 2:
        return result
    after = np.clip(np.searchsorted(stamps, at, side="left"), 1, len(stamps) - 1)
    span = stamps[after] - stamps[after - 1]
    good = ~known & (at >= stamps[0]) & (at <= stamps[-1]) & (span <= max_gap)
    after, at, span = after[good], at[good], span[good]
    fraction = (at - stamps[after - 1]) / span
    quaternion = quaternion_from_matrix(poses[:, :3, :3])
    rotation = matrix_from_quaternion(slerp(quaternion[after - 1], quaternion[after], fraction))
    start, end = poses[after - 1, :3, 3], poses[after, :3, 3]
    result[good] = make_transform(rotation, start + fraction[:, None] * (end - start))
    return result


def level(world_from_cam: Array, up: ArrayLike) -> Array:
    """Turn the world so that its direction `up` (3,) becomes +z; the origin stays.

    Args:
        world_from_cam: (F, 4, 4), NaN allowed.
        up: direction in the world of the poses, any length.
    """
    levelled_from_world = make_transform(rotation_between(up, [0.0, 0.0, 1.0]), np.zeros(3))
    with np.errstate(invalid="ignore"):
        return levelled_from_world @ world_from_cam
