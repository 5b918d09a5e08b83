"""Pairs of frames: who is next to whom, who sees the same, who has come back."""

import numpy as np
import pytest

from imodbatch.core.frames import make_transform, matrix_from_quaternion
from imodbatch.core.pairs import neighbours, overlapping, revisits, steps_m


def circle(n, turns=1.0, radius_m=2.0):
    """Poses (n, 4, 4) of a camera that walks in a circle and looks outwards."""
    angle = np.linspace(0, 2 * np.pi * turns, n, endpoint=False)
    half = angle / 2
    turn = matrix_from_quaternion(
        np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=-1)
    )
    place = radius_m * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    poses = make_transform(turn, place)
    poses.setflags(write=False)
    return poses


def without(poses, *lost):
    poses = np.array(poses)
    poses[list(lost)] = np.nan
    return poses


def test_neighbours_do_not_step_over_lost_frames():
    known = np.array([1, 1, 0, 1, 1, 1, 0], dtype=bool)
    assert neighbours(known).tolist() == [[0, 1], [3, 4], [4, 5]]
    assert neighbours(np.zeros(3, dtype=bool)).shape == (0, 2)
    assert neighbours(np.ones(1, dtype=bool)).shape == (0, 2)


def test_at_most_so_many_evenly_spread():
    pairs = neighbours(np.ones(1000, dtype=bool), most=5)
    assert pairs[:, 0].tolist() == [0, 250, 499, 748, 998]


def test_overlapping_takes_the_last_that_still_sees_much_the_same():
    poses = without(circle(360), 5)
    pairs = overlapping(poses, most=360, max_frames=30, max_distance_m=0.3)
    reach = dict(pairs.tolist())
    step_m = 2 * 2.0 * np.sin(np.pi / 360)
    assert reach[0] == int(0.3 / step_m)
    assert 5 not in reach
    assert 5 not in reach.values()
    by_angle = dict(overlapping(poses, most=360, max_angle_rad=np.deg2rad(3.5)).tolist())
    assert by_angle[100] == 103
    by_frames = dict(overlapping(poses, most=360, max_frames=2).tolist())
    assert by_frames[100] == 102


def test_who_jumps_has_no_overlap():
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = [0, 1, 2, 3]
    assert overlapping(poses).shape == (0, 2)


def test_a_second_round_revisits_the_first():
    pairs = revisits(circle(200, turns=2), most=1000)
    again = {a: b for a, b in pairs.tolist() if a < 100}
    assert again == {a: a + 100 for a in range(100)}
    assert len(revisits(circle(200, turns=2), most=7)) == 7


def test_half_a_round_does_not():
    assert revisits(circle(200, turns=0.5)).shape == (0, 2)


def test_who_stands_still_has_not_come_back():
    assert revisits(np.tile(np.eye(4), (100, 1, 1))).shape == (0, 2)


def test_who_looks_elsewhere_sees_something_else():
    poses = np.array(circle(200, turns=2))
    poses[100:, :3, :3] = poses[100:, :3, :3] @ np.diag([-1.0, 1, -1])
    pairs = revisits(poses)
    assert ((pairs < 100).all(axis=1) | (pairs >= 100).all(axis=1)).all()


def test_lost_frames_are_in_no_pair():
    pairs = revisits(without(circle(200, turns=2), 0, 17, 150), most=1000)
    assert not {0, 17, 150} & set(pairs.ravel().tolist())


@pytest.mark.parametrize("n", [0, 1, 2])
def test_hardly_any_frames(n):
    poses = circle(n)
    assert overlapping(poses).shape[1] == revisits(poses).shape[1] == 2
    assert steps_m(poses).shape == (max(n - 1, 0),)


def test_many_frames_are_thinned_out():
    pairs = revisits(circle(5000, turns=2), most=10_000)
    assert 100 < len(pairs) <= 600
