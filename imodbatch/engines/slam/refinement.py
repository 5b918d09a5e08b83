"""From map to network and back: which keyframes, points and ties a refinement moves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import invert
from imodbatch.engines.slam.adjustment import Adjusted, Network, Ties, adjust
from imodbatch.engines.slam.landmarks import NO_POINT, Landmarks
from imodbatch.engines.slam.registration import tie
from imodbatch.engines.slam.surfaces import Surface
from imodbatch.engines.slam.tracking import Frame

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
WINDOW, MAX_FIXED, MIN_SHARED_FIXED = 8, 10, 10
MIN_TIE_MET = 0.3


@dataclass(frozen=True)
class Tie:
    """Relative pose of two keyframes by their surfaces, and its inverse covariance."""

    first: int
    second: int
    first_from_second: Array
    information: Array


def bind(
    surfaces: Sequence[Surface], cam_from_world: Sequence[Array] | Array, first: int, second: int
) -> Tie | None:
    """Tie two keyframes by their surfaces; None where these overlap too little.

    Args:
        surfaces: of all K keyframes.
        cam_from_world: K poses (4, 4).
        first: keyframe whose surface the other's samples are laid on.
        second: that other one.
    """
    first_from_second = cam_from_world[first] @ invert(cam_from_world[second])
    found = tie(surfaces[first], surfaces[second].samples, first_from_second)
    if found.met < MIN_TIE_MET:
        return None
    return Tie(second, first, found.cam_from_world, found.information)


def refine_around(
    landmarks: Landmarks,
    frames: Sequence[Frame],
    ties: Sequence[Tie],
    camera: PinholeCamera,
    number: int,
) -> None:
    """Refine a keyframe, its neighbours and their points; what else sees these stands still."""
    moving = landmarks.surroundings(number)[:WINDOW]
    shared = landmarks.n_shared(landmarks.points_of(moving))
    shared[moving] = 0
    most = np.argsort(-shared, kind="stable")[:MAX_FIXED]
    fixed = [int(k) for k in most if shared[k] >= MIN_SHARED_FIXED]
    if not fixed:
        moving.remove(min(moving))
        fixed = [min(landmarks.surroundings(number)[:WINDOW])]
    if moving:
        _refine(landmarks, frames, ties, camera, moving, fixed, (3, 2))


def refine_all(
    landmarks: Landmarks,
    frames: Sequence[Frame],
    ties: Sequence[Tie],
    camera: PinholeCamera,
    part: int,
) -> None:
    """Refine all keyframes and points of a part; its first keyframe stands still."""
    first, *others = [k for k, key in enumerate(landmarks.keyframes) if key.part == part]
    if others:
        _refine(landmarks, frames, ties, camera, others, [first], (6, 6))


def _refine(
    landmarks: Landmarks,
    frames: Sequence[Frame],
    ties: Sequence[Tie],
    camera: PinholeCamera,
    moving: list[int],
    fixed: list[int],
    rounds: tuple[int, ...],
) -> None:
    numbers = [*moving, *fixed]
    sightings = _sightings(landmarks, numbers, landmarks.points_of(moving))
    owner, row, point = sightings
    ids, place, count = np.unique(point, return_inverse=True, return_counts=True)
    several = count >= 2
    kept = several[place]
    owner, row = owner[kept], row[kept]
    network = Network(
        cam_from_world=np.stack([landmarks.keyframes[k].cam_from_world for k in numbers]),
        moves=np.arange(len(numbers)) < len(moving),
        points=landmarks.positions[ids[several]],
        camera_of=owner,
        point_of=(np.cumsum(several) - 1)[place[kept]],
        measurements=_gather([frames[k].measurements for k in numbers], owner, row),
        sigma=_gather([frames[k].sigma for k in numbers], owner, row),
        ties=ties_between(ties, numbers),
    )
    adjusted = adjust(camera, network, rounds)
    _write_back(landmarks, numbers, len(moving), ids[several], adjusted)
    for c, k in enumerate(numbers):
        landmarks.keyframes[k].point_ids[row[(owner == c) & ~adjusted.fits]] = NO_POINT


def _sightings(
    landmarks: Landmarks, numbers: list[int], ids: Indices
) -> tuple[Indices, Indices, Indices]:
    """Who (position in `numbers`) saw with which feature which of these points."""
    wanted = np.r_[landmarks.mask(ids), False]  # the last stands for `NO_POINT`
    rows = [np.flatnonzero(wanted[landmarks.keyframes[k].point_ids]) for k in numbers]
    owner = np.repeat(np.arange(len(numbers)), [len(r) for r in rows])
    point = [landmarks.keyframes[k].point_ids[r] for k, r in zip(numbers, rows, strict=True)]
    return owner, np.concatenate(rows), np.concatenate(point)


def _gather(arrays: list[Array], owner: Indices, row: Indices) -> Array:
    start = np.cumsum([0, *(len(a) for a in arrays)])
    return np.concatenate(arrays)[start[owner] + row]


def ties_between(ties: Sequence[Tie], numbers: Sequence[int]) -> Ties:
    """Those of the ties that bind two of these keyframes, by their positions in `numbers`."""
    slot = {k: c for c, k in enumerate(numbers)}
    inside = [t for t in ties if t.first in slot and t.second in slot]
    return Ties(
        np.array([slot[t.first] for t in inside], dtype=np.int64),
        np.array([slot[t.second] for t in inside], dtype=np.int64),
        np.array([t.first_from_second for t in inside]).reshape(-1, 4, 4),
        np.array([t.information for t in inside]).reshape(-1, 6, 6),
    )


def _write_back(
    landmarks: Landmarks, numbers: list[int], n_moving: int, ids: Indices, adjusted: Adjusted
) -> None:
    """Move keyframes; points that were not refined go with the keyframe that made them."""
    moves_along = np.ones(landmarks.n_points, dtype=np.bool_)
    moves_along[ids] = False
    for k, cam_from_world in zip(numbers[:n_moving], adjusted.cam_from_world, strict=False):
        move_keyframe(landmarks, k, cam_from_world, moves_along)
    landmarks.positions[ids] = adjusted.points


def move_keyframe(
    landmarks: Landmarks, number: int, cam_from_world: Array, moves_along: NDArray[np.bool_]
) -> None:
    """Put a keyframe elsewhere, with those of its own points (P,) that move along."""
    keyframe = landmarks.keyframes[number]
    own = np.flatnonzero((landmarks.anchor == number) & moves_along)
    landmarks.carry(own, invert(cam_from_world) @ keyframe.cam_from_world)
    keyframe.cam_from_world = cam_from_world
