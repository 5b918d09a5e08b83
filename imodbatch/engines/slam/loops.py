"""Closing loops: an old place seen again pulls the path together, or joins two parts of the map."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import invert, orthonormal, twist_between
from imodbatch.engines.open3d_library import open3d
from imodbatch.engines.slam.landmarks import NO_POINT, Keyframe, Landmarks
from imodbatch.engines.slam.places import Places
from imodbatch.engines.slam.refinement import Tie, move_keyframe
from imodbatch.engines.slam.registration import settle
from imodbatch.engines.slam.surfaces import Surface
from imodbatch.engines.slam.tracking import Frame, Located, recognise

Array = NDArray[np.float64]
N_ALIKE, N_NEAR = 3, 2
NEAR_M, NEAR_DEG = 1.0, 45.0
MIN_FITTING = 30
MIN_MET, MIN_SURFACE_FIT = 0.25, 0.6
MIN_SHARED_EDGE, EDGE_SIGMA = 30, 0.004


@dataclass(frozen=True)
class Loop:
    """A keyframe found again from an older one.

    Attributes:
        old, new: keyframes.
        located: the new one as seen from the old one's points.
        cam_from_world: (4, 4) of the new one in the old one's world, by features and surfaces.
        information: (6, 6) inverse covariance of a twist on its left.
        correction_m, correction_rad: how far that is from where it was thought to be.
    """

    old: int
    new: int
    located: Located
    cam_from_world: Array
    information: Array
    correction_m: float
    correction_rad: float


def find_loop(
    landmarks: Landmarks,
    frames: Sequence[Frame],
    surfaces: Sequence[Surface],
    places: Places,
    camera: PinholeCamera,
    new: int,
) -> Loop | None:
    """The first older place, of those that look alike or should lie near, that proves the same."""
    frame, keyframe = frames[new], landmarks.keyframes[new]
    for old in _candidates(landmarks, places, frame, new):
        nearby = landmarks.points_of(landmarks.surroundings(old))
        located = recognise(frame, landmarks, landmarks.keyframes[old], nearby)
        if located is None or len(located.rows) < MIN_FITTING:
            continue
        settled = settle(
            camera,
            located.cam_from_world,
            frame.sightings(landmarks, located.point_ids, located.rows),
            surfaces[new].samples,
            [(surfaces[old], landmarks.keyframes[old].cam_from_world)],
        )
        if settled.met < MIN_MET or settled.fitting < MIN_SURFACE_FIT:
            continue
        away = twist_between(settled.cam_from_world, keyframe.cam_from_world)
        return Loop(
            old,
            new,
            located,
            settled.cam_from_world,
            settled.information,
            float(np.linalg.norm(away[:3])),
            float(np.linalg.norm(away[3:])),
        )
    return None


def _candidates(landmarks: Landmarks, places: Places, frame: Frame, new: int) -> list[int]:
    """Older keyframes that do not share points with this one yet."""
    known = {new, *landmarks.keyframes[new].neighbours}
    for k in landmarks.keyframes[new].neighbours[:3]:
        known |= set(landmarks.keyframes[k].neighbours)
    scores = places.scores(frame.features.descriptors)
    scores[list(known)] = 0
    typical = float(np.median(scores[scores > 0])) if (scores > 0).any() else 0.0
    alike = [int(k) for k in np.argsort(-scores)[:N_ALIKE] if scores[k] > 1.2 * typical]
    near = [k for k in nearest(landmarks, new) if k not in known][:N_NEAR]
    return list(dict.fromkeys([*alike, *near]))


def nearest(landmarks: Landmarks, new: int) -> list[int]:
    """Keyframes of the same part that look at the same side from nearby, nearest first."""
    keyframes = landmarks.keyframes
    found = nearest_views(np.stack([k.cam_from_world for k in keyframes]), new)
    return [k for k in found if keyframes[k].part == keyframes[new].part]


def nearest_views(cam_from_world: Array, number: int) -> list[int]:
    """Those of K cameras (K, 4, 4) that look at the same side from nearby as one, nearest first."""
    world_from_cam = invert(cam_from_world)
    distance = np.linalg.norm(world_from_cam[:, :3, 3] - world_from_cam[number, :3, 3], axis=1)
    cosine = world_from_cam[:, :3, 2] @ world_from_cam[number, :3, 2]
    fits = (distance < NEAR_M) & (cosine > np.cos(np.radians(NEAR_DEG)))
    return [int(k) for k in np.argsort(distance, kind="stable") if fits[k] and k != number]


def join_parts(landmarks: Landmarks, loop: Loop) -> None:
    """Carry the new keyframe's whole part over to the old one's world."""
    old, new = landmarks.keyframes[loop.old], landmarks.keyframes[loop.new]
    then_from_now = invert(loop.cam_from_world) @ new.cam_from_world
    joined = [k for k, key in enumerate(landmarks.keyframes) if key.part == new.part]
    everything = np.ones(landmarks.n_points, dtype=np.bool_)
    for k in joined:
        keyframe = landmarks.keyframes[k]
        moved = orthonormal(keyframe.cam_from_world @ invert(then_from_now))
        move_keyframe(landmarks, k, moved, everything)
        keyframe.part = old.part


def spread_correction(landmarks: Landmarks, ties: Sequence[Tie], loop: Loop) -> None:
    """Pose graph optimisation (open3d): every keyframe of the part gives way a little.

    Edges are the present relative poses of keyframes that share points or a tie, and the loop.
    """
    o3d = open3d()
    registration = o3d.pipelines.registration
    part = landmarks.keyframes[loop.new].part
    numbers = [k for k, key in enumerate(landmarks.keyframes) if key.part == part]
    node = {k: n for n, k in enumerate(numbers)}
    graph = registration.PoseGraph()
    for k in numbers:
        world_from_cam = invert(landmarks.keyframes[k].cam_from_world)
        graph.nodes.append(registration.PoseGraphNode(world_from_cam))
    for (a, b), information in _edges(landmarks, ties, numbers).items():
        # open3d's edge takes its source to its target
        b_from_a = _between(landmarks.keyframes[b], landmarks.keyframes[a])
        edge = registration.PoseGraphEdge(node[a], node[b], b_from_a, information, uncertain=False)
        graph.edges.append(edge)
    old_from_new = landmarks.keyframes[loop.old].cam_from_world @ invert(loop.cam_from_world)
    graph.edges.append(
        registration.PoseGraphEdge(
            node[loop.new], node[loop.old], old_from_new, _open3d_order(loop.information), False
        )
    )
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(
            max_correspondence_distance=0.05, edge_prune_threshold=0.0, reference_node=0
        ),
    )
    everything = np.ones(landmarks.n_points, dtype=np.bool_)
    for k, found in zip(numbers, graph.nodes, strict=True):
        cam_from_world = orthonormal(invert(np.asarray(found.pose)))
        move_keyframe(landmarks, k, cam_from_world, everything)


def _between(target: Keyframe, source: Keyframe) -> Array:
    return orthonormal(target.cam_from_world @ invert(source.cam_from_world))


def _edges(
    landmarks: Landmarks, ties: Sequence[Tie], numbers: list[int]
) -> dict[tuple[int, int], Array]:
    """Pairs of keyframes that hold together, with open3d's information matrices.

    As many shared points as an edge needs count as one feature of one pixel at two metres: 4 mm,
    and as much of an arc. Their errors go together, for that is what drift is; were they taken as
    independent, the edges along the way would outweigh the loop.
    """
    found: dict[tuple[int, int], Array] = {}
    for a, b in pairwise(numbers):
        found[a, b] = 1e4 * np.eye(6)
    for k in numbers:
        for other in landmarks.keyframes[k].neighbours:
            if landmarks.keyframes[other].part != landmarks.keyframes[k].part:
                continue
            wanted = landmarks.mask(landmarks.keyframes[other].seen)
            n_shared = int(wanted[landmarks.keyframes[k].seen].sum())
            if n_shared >= MIN_SHARED_EDGE:
                pair = (min(k, other), max(k, other))
                found[pair] = n_shared / MIN_SHARED_EDGE / EDGE_SIGMA**2 * np.eye(6)
    for t in ties:
        pair = (min(t.first, t.second), max(t.first, t.second))
        if pair in found:
            found[pair] = found[pair] + _open3d_order(t.information)
    return found


def _open3d_order(information: Array) -> Array:
    """Twists with rotation first, as open3d has them, from twists with translation first."""
    order = [3, 4, 5, 0, 1, 2]
    return information[np.ix_(order, order)]


def fuse_points(landmarks: Landmarks, loop: Loop) -> None:
    """Make one of the points that the new keyframe has and those it was found by."""
    keyframe = landmarks.keyframes[loop.new]
    own = keyframe.point_ids[loop.located.rows]
    kept, rows = loop.located.point_ids, loop.located.rows
    doubled = (own != NO_POINT) & (own != kept)
    free = (own == NO_POINT) & ~np.isin(kept, keyframe.point_ids)
    keyframe.point_ids[rows[free]] = kept[free]
    landmarks.merge(kept[doubled], own[doubled])
