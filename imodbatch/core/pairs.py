"""Which frames to hold against each other: neighbours, views that overlap, and places seen again.

All are chosen by the trajectory itself, evenly over the walk, and at most so many that judging them
takes seconds.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]
MOST_PAIRS = 40
MOST_CANDIDATES = 600
"""Frames looked at for revisits: all pairs of them are compared."""


def neighbours(is_known: NDArray[np.bool_], most: int = MOST_PAIRS) -> Pairs:
    """Pairs (P, 2) of positions i, i + 1 that both have a pose.

    Args:
        is_known: (F,) which frames have a pose.
        most: how many pairs at most, evenly spread.
    """
    first = np.flatnonzero(is_known[:-1] & is_known[1:])
    return _spread(np.stack([first, first + 1], axis=-1), most)


def overlapping(
    world_from_cam: Array,
    most: int = MOST_PAIRS,
    max_frames: int = 30,
    max_distance_m: float = 0.3,
    max_angle_rad: float = float(np.deg2rad(15)),
) -> Pairs:
    """Pairs (P, 2) of positions a < b, b the last soon after a that sees much the same.

    A frame counts as soon after within `max_frames`, as seeing much the same within the distance
    and the angle of view; where none does, a frame has no pair.

    Args:
        world_from_cam: (F, 4, 4), NaN where lost.
        most: how many pairs at most.
        max_frames: between the two.
        max_distance_m: between their centres.
        max_angle_rad: between their directions of view.
    """
    known = np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]))
    pairs = []
    for a in _spread(known, most).tolist():
        after = known[(known > a) & (known <= a + max_frames)]
        distance, angle = _apart(world_from_cam[[a]], world_from_cam[after])
        near = after[(distance[0] <= max_distance_m) & (angle[0] <= max_angle_rad)]
        if len(near):
            pairs.append((a, int(near[-1])))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def revisits(
    world_from_cam: Array,
    most: int = MOST_PAIRS,
    min_frames: int = 30,
    min_path_m: float = 1.0,
    max_distance_m: float = 0.5,
    max_angle_rad: float = float(np.deg2rad(30)),
) -> Pairs:
    """Pairs (P, 2) of positions far apart on the walk whose views are near each other.

    Each frame is paired with the nearest such view. A trajectory that drifts farther than
    `max_distance_m` before it comes back does not know that it has come back.

    Args:
        world_from_cam: (F, 4, 4), NaN where lost.
        most: how many pairs at most.
        min_frames: more than so many between the two.
        min_path_m: length of the way between them: who stands still has not come back.
        max_distance_m: between their centres.
        max_angle_rad: between their directions of view.
    """
    known = np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]))
    walked = np.concatenate([[0.0], np.cumsum(steps_m(world_from_cam[known]))])[: len(known)]
    chosen = _spread(np.arange(len(known)), MOST_CANDIDATES)
    position, walked = known[chosen], walked[chosen]
    poses = world_from_cam[position]
    distance, angle = _apart(poses, poses)
    is_later = position[None] - position[:, None] > min_frames
    is_far = walked[None] - walked[:, None] >= min_path_m
    is_near = (distance <= max_distance_m) & (angle <= max_angle_rad)
    unlike = np.where(
        is_later & is_far & is_near, distance / max_distance_m + angle / max_angle_rad, np.inf
    )
    if unlike.size == 0:
        return np.zeros((0, 2), dtype=np.int64)
    best = unlike.argmin(axis=1)
    has_one = np.isfinite(unlike[np.arange(len(best)), best])
    return _spread(np.stack([position, position[best]], axis=-1)[has_one], most)


def nearest_views(
    world_from_cam: Array,
    number: int,
    max_distance_m: float = 1.0,
    max_angle_rad: float = float(np.deg2rad(45)),
) -> list[int]:
    """Those of K cameras (K, 4, 4) that look at the same side from nearby as one, nearest first."""
    distance, angle = _apart(world_from_cam[[number]], world_from_cam)
    fits = (distance[0] < max_distance_m) & (angle[0] < max_angle_rad)
    return [int(k) for k in np.argsort(distance[0], kind="stable") if fits[k] and k != number]


def steps_m(world_from_cam: Array) -> Array:
    """Distances (F − 1,) between the centres of successive poses (F, 4, 4)."""
    return np.linalg.norm(np.diff(world_from_cam[:, :3, 3], axis=0), axis=-1)


def _apart(poses_a: Array, poses_b: Array) -> tuple[Array, Array]:
    """Distances (A, B) in metres and angles of view (A, B) in radians between poses."""
    offset = poses_a[:, None, :3, 3] - poses_b[None, :, :3, 3]
    cosine = poses_a[:, :3, 2] @ poses_b[:, :3, 2].T
    return np.linalg.norm(offset, axis=-1), np.arccos(np.clip(cosine, -1, 1))


def _spread(items: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of the items, evenly spread, both ends included."""
    if len(items) <= most:
        return items
    return items[np.linspace(0, len(items) - 1, most).round().astype(np.int64)]
