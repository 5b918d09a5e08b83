"""Closing loops: an old place seen again pulls the path together, or joins two parts of the map."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import invert, orthonormal, twist_between
from imodbatch.core.pairs import nearest_views
from imodbatch.libraries.open3d_library import open3d
from imodbatch.poses.rgbd.registration import Settled, settle
from imodbatch.poses.slam.landmarks import NO_POINT, Landmarks
from imodbatch.poses.slam.places import Places
from imodbatch.poses.slam.refinement import move_keyframe
from imodbatch.poses.slam.tracking import Located, recognise

Array = NDArray[np.float64]
N_ALIKE, N_NEAR = 3, 2
MIN_FITTING = 30
MIN_MET, MIN_SURFACE_FIT = 0.25, 0.6
MIN_SHARED_EDGE, EDGE_SIGMA = 30, 0.004


@dataclass(frozen=True)
class Loop:
    """A keyframe found again from an older one.

    Attributes:
        old, new: keyframes.
        located: the new one as seen from the old one's points.
        settled: its pose in the old one's world, by features and surfaces.
        correction_m, correction_rad: how far that is from where it was thought to be.
    """

    old: int
    new: int
    located: Located
    settled: Settled
    correction_m: float
    correction_rad: float


def find_loop(landmarks: Landmarks, places: Places, new: int) -> Loop | None:
    """The first older place, of those that look alike or should lie near, that proves the same."""
    keyframes = landmarks.keyframes
    frame = keyframes[new].frame
    for old in _candidates(landmarks, places, new):
        nearby = landmarks.points_of(landmarks.surroundings(old))
        located = recognise(frame, landmarks, keyframes[old], nearby)
        if located is None or len(located.rows) < MIN_FITTING:
            continue
        settled = settle(
            frame.camera,
            located.cam_from_world,
            frame.sightings(landmarks.positions[located.point_ids], located.rows),
            frame.surface.samples,
            [(keyframes[old].frame.surface, keyframes[old].cam_from_world)],
        )
        if settled.met < MIN_MET or settled.fitting < MIN_SURFACE_FIT:
            continue
        away = twist_between(settled.cam_from_world, keyframes[new].cam_from_world)
        return Loop(
            old,
            new,
            located,
            settled,
            float(np.linalg.norm(away[:3])),
            float(np.linalg.norm(away[3:])),
        )
    return None


def _candidates(landmarks: Landmarks, places: Places, new: int) -> list[int]:
    """Older keyframes that do not share points with this one yet."""
    keyframe = landmarks.keyframes[new]
    known = {new, *keyframe.neighbours}
    for k in keyframe.neighbours[:3]:
        known |= set(landmarks.keyframes[k].neighbours)
    scores = places.scores(keyframe.frame.features.descriptors)
    scores[list(known)] = 0
    typical = float(np.median(scores[scores > 0])) if (scores > 0).any() else 0.0
    alike = [int(k) for k in np.argsort(-scores)[:N_ALIKE] if scores[k] > 1.2 * typical]
    near = [k for k in nearest(landmarks, new) if k not in known][:N_NEAR]
    return list(dict.fromkeys([*alike, *near]))


def nearest(landmarks: Landmarks, new: int) -> list[int]:
    """Keyframes of the same part that look at the same side from nearby, nearest first."""
    keyframes = landmarks.keyframes
    found = nearest_views(invert(landmarks.cam_from_world), new)
    return [k for k in found if keyframes[k].part == keyframes[new].part]


def join_parts(landmarks: Landmarks, loop: Loop) -> None:
    """Carry the new keyframe's whole part over to the old one's world."""
    old, new = landmarks.keyframes[loop.old], landmarks.keyframes[loop.new]
    now_from_then = invert(new.cam_from_world) @ loop.settled.cam_from_world
    for k in landmarks.part(new.part):
        keyframe = landmarks.keyframes[k]
        move_keyframe(landmarks, k, orthonormal(keyframe.cam_from_world @ now_from_then))
        keyframe.part = old.part


def spread_correction(landmarks: Landmarks, loop: Loop) -> None:
    """Pose graph optimisation (open3d): every keyframe of the part gives way a little.

    Edges are the present relative poses of keyframes that share points or a tie, and the loop.
    """
    registration = open3d().pipelines.registration
    keyframes = landmarks.keyframes
    numbers = landmarks.part(keyframes[loop.new].part)
    node = {k: n for n, k in enumerate(numbers)}
    graph = registration.PoseGraph()
    for k in numbers:
        graph.nodes.append(registration.PoseGraphNode(invert(keyframes[k].cam_from_world)))
    edges = [
        (a, b, orthonormal(keyframes[b].cam_from_world @ invert(keyframes[a].cam_from_world)), held)
        for (a, b), held in _edges(landmarks, numbers).items()
    ]
    old_from_new = keyframes[loop.old].cam_from_world @ invert(loop.settled.cam_from_world)
    edges.append((loop.new, loop.old, old_from_new, _open3d_order(loop.settled.information)))
    for a, b, b_from_a, information in edges:  # open3d's edge takes its source to its target
        graph.edges.append(
            registration.PoseGraphEdge(node[a], node[b], b_from_a, information, uncertain=False)
        )
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(
            max_correspondence_distance=0.05, edge_prune_threshold=0.0, reference_node=0
        ),
    )
    for k, found in zip(numbers, graph.nodes, strict=True):
        move_keyframe(landmarks, k, orthonormal(invert(np.asarray(found.pose))))


def _edges(landmarks: Landmarks, numbers: list[int]) -> dict[tuple[int, int], Array]:
    """Pairs of keyframes that hold together, with open3d's information matrices.

    As many shared points as an edge needs count as one feature of one pixel at two metres: 4 mm,
    and as much of an arc. Their errors go together, for that is what drift is; were they taken as
    independent, the edges along the way would outweigh the loop.
    """
    found = {pair: 1e4 * np.eye(6) for pair in pairwise(numbers)}
    for k in numbers:
        for other in landmarks.keyframes[k].neighbours:
            if landmarks.keyframes[other].part != landmarks.keyframes[k].part:
                continue
            wanted = landmarks.mask(landmarks.keyframes[other].seen)
            n_shared = int(wanted[landmarks.keyframes[k].seen].sum())
            if n_shared >= MIN_SHARED_EDGE:
                pair = (min(k, other), max(k, other))
                found[pair] = n_shared / MIN_SHARED_EDGE / EDGE_SIGMA**2 * np.eye(6)
    for t in landmarks.ties:
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
