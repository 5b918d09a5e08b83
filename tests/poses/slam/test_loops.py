"""Closing loops: drift planted into a map is spread out again, and two parts become one."""

import copy
from functools import cache

import numpy as np
import pytest
from rooms import CAMERA, Room, filmed, off

from imodbatch.core.frames import exp_twist, invert
from imodbatch.poses.slam import loops
from imodbatch.poses.slam.landmarks import NO_POINT
from imodbatch.poses.slam.mapping import Mapper
from imodbatch.poses.slam.refinement import move_keyframe, refine_all

N_FEATURES = 600


def gray_of(color):
    return np.ascontiguousarray(color[..., 0])


def fed(mapper, path, positions, room=None):
    colors, depths, _ = filmed(Room() if room is None else room, path)
    for i in positions:
        mapper.add(gray_of(colors[i]), depths[i])
    return mapper


@cache
def open_circle():
    """A mapper that has gone round and back to where it began, without noticing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loops, "find_loop", lambda *_: None)
        mapper = fed(Mapper(CAMERA, N_FEATURES), "circle", range(60))
    mapper._extractor = None  # cannot be copied
    return mapper


def planted(drift_m):
    """Its map with a drift that grows along the way, and the keyframes' true poses."""
    mapper = copy.deepcopy(open_circle())
    landmarks = mapper.landmarks
    truth = filmed(Room(), "circle")[2][[k.position for k in landmarks.keyframes]]
    last = len(landmarks.keyframes) - 1
    for number, keyframe in enumerate(landmarks.keyframes):
        share = number / last * drift_m / np.sqrt(2)
        shift = exp_twist(np.array([share, -share, 0, 0, 0, 0.1 * share]))
        move_keyframe(landmarks, number, keyframe.cam_from_world @ invert(shift))
    return mapper, truth


def errors_m(landmarks, truth):
    found = invert(np.stack([k.cam_from_world for k in landmarks.keyframes]))
    return off(found, truth)[0]


def loop_of(mapper, number):
    return loops.find_loop(mapper.landmarks, mapper._places, number)


@pytest.mark.parametrize("drift_m", [0.1, 0.2])
def test_planted_drift_is_closed(drift_m):
    mapper, truth = planted(drift_m)
    landmarks = mapper.landmarks
    last = len(landmarks.keyframes) - 1
    before = errors_m(landmarks, truth)
    assert before[last] == pytest.approx(drift_m, abs=0.02)
    loop = loop_of(mapper, last)
    assert loop is not None
    assert loop.new == last
    assert truth[loop.old, :3, 3] == pytest.approx(truth[last, :3, 3], abs=0.6)
    assert loop.correction_m == pytest.approx(drift_m, abs=0.04)
    loops.spread_correction(landmarks, loop)
    after = errors_m(landmarks, truth)
    assert after[last] < 0.2 * before[last] + 0.005
    assert after.max() < 0.25 * before.max() + 0.01
    loops.fuse_points(landmarks, loop)
    landmarks.update_neighbours(last)
    assert loop.old in landmarks.keyframes[last].neighbours
    refine_all(landmarks, 0)
    assert errors_m(landmarks, truth).max() < 0.15 * before.max() + 0.005


def test_points_follow_their_keyframes():
    mapper, _ = planted(0.2)
    landmarks = mapper.landmarks
    last = len(landmarks.keyframes) - 1
    own = np.flatnonzero(landmarks.anchor == last)
    before = landmarks.expected(own, landmarks.keyframes[last].cam_from_world)
    loops.spread_correction(landmarks, loop_of(mapper, last))
    after = landmarks.expected(own, landmarks.keyframes[last].cam_from_world)
    assert np.array_equal(before[0], after[0])
    assert before[1] == pytest.approx(after[1], abs=1e-9)


def test_fused_points_are_seen_once_per_keyframe():
    mapper, _ = planted(0.1)
    landmarks = mapper.landmarks
    loop = loop_of(mapper, len(landmarks.keyframes) - 1)
    loops.fuse_points(landmarks, loop)
    for keyframe in landmarks.keyframes:
        assert len(np.unique(keyframe.seen)) == len(keyframe.seen)
    fused = np.isin(loop.located.point_ids, landmarks.keyframes[loop.new].seen)
    assert fused.mean() > 0.9


def test_what_is_bound_already_is_no_loop():
    """A keyframe that shares points with those around it has nothing to close."""
    mapper = fed(Mapper(CAMERA, N_FEATURES), "walk", range(12))
    assert mapper.n_loops == 0
    assert loop_of(mapper, len(mapper.landmarks.keyframes) - 1) is None


def test_nearest_views_look_the_same_way():
    landmarks = open_circle().landmarks
    poses = np.stack([k.cam_from_world for k in landmarks.keyframes])
    ahead = invert(poses)[:, :3, 2]
    for number in range(len(poses)):
        for other in loops.nearest(landmarks, number):
            assert other != number
            assert ahead[number] @ ahead[other] > np.cos(np.radians(45))


class Forgetful(Mapper):
    """Never recognises where it is after it was lost."""

    def _relocalise(self, seen):
        del seen


def test_two_parts_become_one_where_they_meet():
    mapper = fed(Forgetful(CAMERA, N_FEATURES), "circle", range(24))
    for _ in range(3):
        mapper.add(None, None)
    # a new part begins somewhere else and comes to a place that the first part has seen
    fed(mapper, "circle", range(33, 60))
    mapper.finish()
    truth = filmed(Room(), "circle")[2][[*range(24), 33, 33, 33, *range(33, 60)]]
    assert mapper.n_loops >= 1
    parts = {keyframe.part for keyframe in mapper.landmarks.keyframes}
    assert len(parts) == 1
    poses = np.full((len(truth), 4, 4), np.nan)
    for i, record in enumerate(mapper.records):
        if record is not None:
            keyframe = mapper.landmarks.keyframes[record.keyframe]
            poses[i] = invert(record.cam_from_keyframe @ keyframe.cam_from_world)
    assert np.isfinite(poses[30:, 0, 0]).all()
    metres, radians = off(poses, truth)
    assert metres.max() < 0.012
    assert radians.max() < 0.008


def test_joining_keeps_each_part_as_it_is():
    """A part is carried over as a whole; what one camera sees of its points stays the same."""
    mapper = copy.deepcopy(open_circle())
    landmarks = mapper.landmarks
    last = len(landmarks.keyframes) - 1
    of_second = range(last // 2, last + 1)
    first_of_second = len(range(last // 2))
    elsewhere = exp_twist(np.array([5.0, -3, 1, 0.3, -0.5, 2.4]))
    before = np.stack([k.cam_from_world for k in landmarks.keyframes])
    for k in of_second:
        landmarks.keyframes[k].part = 1
        move_keyframe(landmarks, k, before[k] @ elsewhere)
    loop = loop_of(mapper, last)
    assert loop.old < first_of_second
    loops.join_parts(landmarks, loop)
    after = np.stack([k.cam_from_world for k in landmarks.keyframes])
    assert {k.part for k in landmarks.keyframes} == {0}
    assert (
        errors_m(
            landmarks, filmed(Room(), "circle")[2][[k.position for k in landmarks.keyframes]]
        ).max()
        < 0.05
    )
    kept = after[of_second[0]] @ invert(after[last])
    assert kept == pytest.approx(before[of_second[0]] @ invert(before[last]), abs=1e-9)
    for k in of_second:
        own = np.flatnonzero(landmarks.anchor == k)
        assert len(landmarks.expected(own, after[k])[0]) == len(own)
    assert (landmarks.keyframes[last].point_ids != NO_POINT).any()
