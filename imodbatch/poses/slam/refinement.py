"""From map to network and back: which keyframes, points and ties a refinement moves."""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import invert
from imodbatch.poses.rgbd.adjustment import Network, adjust, among
from imodbatch.poses.slam.landmarks import NO_POINT, Keyframe, Landmarks

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
WINDOW, MAX_FIXED, MIN_SHARED_FIXED = 8, 10, 10


def refine_around(landmarks: Landmarks, number: int) -> None:
    """Refine a keyframe, its neighbours and their points; what else sees these stands still."""
    moving = landmarks.surroundings(number)[:WINDOW]
    shared = landmarks.n_shared(landmarks.points_of(moving))
    shared[moving] = 0
    most = np.argsort(-shared, kind="stable")[:MAX_FIXED]
    fixed = [int(k) for k in most if shared[k] >= MIN_SHARED_FIXED]
    if not fixed:
        fixed = [min(moving)]
        moving.remove(fixed[0])
    if moving:
        _refine(landmarks, moving, fixed, (3, 2))


def refine_all(landmarks: Landmarks, part: int) -> None:
    """Refine all keyframes and points of a part; its first keyframe stands still."""
    first, *others = landmarks.part(part)
    if others:
        _refine(landmarks, others, [first], (6, 6))


def _refine(
    landmarks: Landmarks, moving: list[int], fixed: list[int], rounds: tuple[int, ...]
) -> None:
    numbers = [*moving, *fixed]
    keyframes = [landmarks.keyframes[k] for k in numbers]
    owner, row, point = _sightings(landmarks, keyframes, landmarks.points_of(moving))
    ids, place, count = np.unique(point, return_inverse=True, return_counts=True)
    several = count >= 2
    kept = several[place]
    owner, row, ids = owner[kept], row[kept], ids[several]
    network = Network(
        cam_from_world=np.stack([k.cam_from_world for k in keyframes]),
        moves=np.arange(len(numbers)) < len(moving),
        points=landmarks.positions[ids],
        camera_of=owner,
        point_of=(np.cumsum(several) - 1)[place[kept]],
        measurements=_gather([k.frame.measurements for k in keyframes], owner, row),
        sigma=_gather([k.frame.sigma for k in keyframes], owner, row),
        ties=among(landmarks.ties, numbers),
    )
    adjusted = adjust(keyframes[0].frame.camera, network, rounds)
    # points that were not refined go with the keyframe that made them
    moves_along = ~landmarks.mask(ids)
    for number, cam_from_world in zip(moving, adjusted.cam_from_world, strict=False):
        move_keyframe(landmarks, number, cam_from_world, moves_along)
    landmarks.positions[ids] = adjusted.points
    for c, keyframe in enumerate(keyframes):
        keyframe.point_ids[row[(owner == c) & ~adjusted.fits]] = NO_POINT


def _sightings(
    landmarks: Landmarks, keyframes: list[Keyframe], ids: Indices
) -> tuple[Indices, Indices, Indices]:
    """Which of these keyframes saw with which feature which of these points."""
    wanted = np.r_[landmarks.mask(ids), False]  # the last stands for `NO_POINT`
    rows = [np.flatnonzero(wanted[k.point_ids]) for k in keyframes]
    owner = np.repeat(np.arange(len(keyframes)), [len(r) for r in rows])
    point = [k.point_ids[r] for k, r in zip(keyframes, rows, strict=True)]
    return owner, np.concatenate(rows), np.concatenate(point)


def _gather(arrays: list[Array], owner: Indices, row: Indices) -> Array:
    start = np.cumsum([0, *(len(a) for a in arrays)])
    return np.concatenate(arrays)[start[owner] + row]


def move_keyframe(
    landmarks: Landmarks,
    number: int,
    cam_from_world: Array,
    moves_along: NDArray[np.bool_] | bool = True,
) -> None:
    """Put a keyframe elsewhere, with those of its own points (P,) that move along."""
    keyframe = landmarks.keyframes[number]
    own = np.flatnonzero((landmarks.anchor == number) & moves_along)
    landmarks.carry(own, invert(cam_from_world) @ keyframe.cam_from_world)
    keyframe.cam_from_world = cam_from_world
