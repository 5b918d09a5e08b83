"""Alignment finds the transform that was applied; errors are those that were put in."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imodbatch.core.alignment import (
    absolute_errors_m,
    align_points,
    align_poses,
    known,
    nearest_rotation,
    relative_errors,
    rotation_angle_rad,
    summarise,
)
from imodbatch.core.frames import apply, exp_twist, invert, make_transform, matrix_from_quaternion

TURN = matrix_from_quaternion([0.8, 0.1, -0.5, 0.3])
SHIFT = np.array([3.0, -2.0, 0.5])


def rotation(seed):
    return matrix_from_quaternion(np.random.default_rng(seed).normal(size=4))


def walk(n=20, seed=0):
    """Poses (n, 4, 4) of a camera that walks and turns; read-only."""
    rng = np.random.default_rng(seed)
    steps = exp_twist(rng.normal(scale=0.1, size=(n, 6)))
    poses = [np.eye(4)]
    for step in steps[1:]:
        poses.append(poses[-1] @ step)
    return read_only(np.array(poses))


def read_only(array):
    array = np.array(array)
    array.setflags(write=False)
    return array


seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds, n=st.integers(3, 30), scale=st.floats(0.01, 100))
def test_a_similarity_is_recovered(seed, n, scale):
    rng = np.random.default_rng(seed)
    source = read_only(rng.normal(size=(n, 3)))
    turn, shift = rotation(seed), rng.normal(size=3)
    target = read_only(scale * source @ turn.T + shift)
    found = align_points(target, source, with_scale=True)
    assert np.allclose(found.rotation, turn, atol=1e-6)
    assert found.scale == pytest.approx(scale, rel=1e-9)
    assert np.allclose(found.points(source), target, atol=1e-6 * max(scale, 1))


@given(seed=seeds, n=st.integers(1, 30))
def test_a_rigid_transform_of_poses_is_recovered_however_they_lie(seed, n):
    source = walk(n, seed)
    target = read_only(make_transform(rotation(seed), [1.0, 2.0, 3.0]) @ source)
    found = align_poses(target, source)
    assert found.scale == 1
    assert np.allclose(found.poses(source), target, atol=1e-6)


def test_the_rotation_is_never_a_reflection():
    source = np.random.default_rng(1).normal(size=(12, 3))
    target = source * [1, 1, -1]
    found = align_points(target, source)
    assert np.linalg.det(found.rotation) == pytest.approx(1)
    noisy = [error(found, target, source, twist) for twist in twists(0.05)]
    assert min(noisy) >= error(found, target, source, np.zeros(6)) - 1e-12


def error(found, target, source, twist):
    moved = apply(exp_twist(twist) @ make_transform(found.rotation, found.translation), source)
    return np.sum((target - moved) ** 2)


def twists(size, n=200):
    return np.random.default_rng(2).normal(scale=size, size=(n, 6))


@pytest.mark.parametrize("size", [0.3, 1e-2, 1e-4])
def test_no_transform_nearby_is_better(size):
    rng = np.random.default_rng(3)
    source = rng.normal(size=(9, 3))
    target = source @ TURN.T + SHIFT + rng.normal(scale=0.2, size=(9, 3))
    found = align_points(target, source)
    best = error(found, target, source, np.zeros(6))
    assert all(error(found, target, source, twist) >= best for twist in twists(size))


def test_no_scale_nearby_is_better():
    rng = np.random.default_rng(4)
    source = rng.normal(size=(9, 3))
    target = 2 * source @ TURN.T + rng.normal(scale=0.3, size=(9, 3))
    found = align_points(target, source, with_scale=True)

    def squares(scale):
        moved = scale * source @ found.rotation.T
        middle = (target - moved).mean(axis=0)
        return np.sum((target - moved - middle) ** 2)

    assert squares(found.scale) <= min(squares(found.scale * f) for f in (0.99, 0.999, 1.001, 1.01))


@pytest.mark.parametrize("along", [[1, 0, 0], [1, 2, -1]])
def test_on_a_line_orientations_close_the_angle(along):
    source = np.array(walk(8))
    source[:, :3, 3] = np.outer(np.arange(8.0), along) + 0.5
    target = make_transform(TURN, SHIFT) @ source
    found = align_poses(target, source)
    assert np.allclose(found.rotation, TURN, atol=1e-9)
    assert np.allclose(found.poses(source), target, atol=1e-9)
    scaled = target.copy()
    scaled[:, :3, 3] *= 3
    assert align_poses(scaled, source, with_scale=True).scale == pytest.approx(3)


def test_on_a_line_without_orientations_the_rotation_is_the_smallest():
    source = np.outer(np.arange(5.0), [1, 0, 0])
    target = np.outer(np.arange(5.0), [0, 1, 0])
    found = align_points(target, source)
    assert np.allclose(found.points(source), target)
    assert np.allclose(found.rotation @ [0, 0, 1], [0, 0, 1])


def test_who_stands_still_is_aligned_by_orientation():
    source = np.array(walk(6))
    source[:, :3, 3] = [1, 2, 3]
    target = make_transform(TURN, SHIFT) @ source
    found = align_poses(target, source, with_scale=True)
    assert np.allclose(found.poses(source), target, atol=1e-9)
    assert found.scale == 1


def test_one_point_and_none():
    found = align_points([[1, 2, 3]], [[0, 0, 0]], with_scale=True)
    assert np.allclose(found.rotation, np.eye(3))
    assert np.allclose(found.translation, [1, 2, 3])
    nothing = align_points(np.zeros((0, 3)), np.zeros((0, 3)))
    assert np.allclose(nothing.rotation, np.eye(3))
    assert np.allclose(nothing.translation, 0)
    assert np.allclose(align_poses(walk(3) * np.nan, walk(3)).rotation, np.eye(3))


def test_a_collapsed_source_has_no_scale():
    still = np.tile([1.0, 2.0, 3.0], (4, 1))
    moving = np.random.default_rng(0).normal(size=(4, 3))
    for target, source in ((moving, still), (still, moving), (still, still)):
        found = align_points(target, source, with_scale=True)
        assert found.scale == 1
        assert np.isfinite(found.rotation).all()
        assert np.allclose(found.points(source).mean(axis=0), target.mean(axis=0))


def test_frames_without_both_poses_do_not_count():
    source = np.array(walk(10))
    target = np.array(make_transform(TURN, SHIFT) @ source)
    source[[1, 4]] = np.nan
    target[[2]] = np.nan
    source[7, 0, 3] = np.nan  # one number is enough
    source, target = read_only(source), read_only(target)
    assert known(source).tolist() == [i not in {1, 4, 7} for i in range(10)]
    found = align_poses(target, source)
    assert np.allclose(found.rotation, TURN)
    errors = absolute_errors_m(target, source, found)
    assert np.flatnonzero(np.isnan(errors)).tolist() == [1, 2, 4, 7]
    assert summarise(errors).n == 6
    assert len(relative_errors(target, source, 1)[0]) == 2  # from 5 to 6 and from 8 to 9
    assert np.isnan(found.poses(source)[1]).all()


def test_errors_of_known_size():
    """Four corners of a square lifted and lowered in turn: no rigid motion makes that smaller."""
    true = np.tile(np.eye(4), (4, 1, 1))
    true[:, :2, 3] = [[1, 1], [-1, 1], [-1, -1], [1, -1]]
    judged = true.copy()
    judged[:, 2, 3] += [0.1, -0.1, 0.1, -0.1]
    errors = absolute_errors_m(true, judged, align_poses(true, judged))
    assert errors == pytest.approx([0.1] * 4)
    summary = summarise([3.0, np.nan, 4.0, 0.0])
    assert summary.rmse == pytest.approx(np.sqrt(25 / 3))
    assert (summary.median, summary.largest, summary.n) == (3.0, 4.0, 3)
    assert np.isnan(summarise([np.nan]).rmse)
    assert summarise([]).n == 0


def test_relative_errors_are_those_of_the_motion():
    true = walk(12)
    judged = np.array(true)
    slip = exp_twist([0.03, 0, 0.04, 0, 0.02, 0])
    judged[6:] = true[5] @ (invert(true[5]) @ true[6]) @ slip @ invert(true[6]) @ true[6:]
    for delta, spans in ((1, 1), (3, 3)):
        translation_m, rotation_rad = relative_errors(true, judged, delta)
        assert len(translation_m) == 12 - delta
        assert (rotation_rad > 1e-6).sum() == spans
        assert rotation_rad.max() == pytest.approx(0.02)
    translation_m, _ = relative_errors(true, judged, 1)
    assert translation_m.max() == pytest.approx(0.05)
    elsewhere = make_transform(TURN, SHIFT) @ judged
    assert np.allclose(relative_errors(true, elsewhere, 1), relative_errors(true, judged, 1))


@pytest.mark.parametrize("delta", [12, 30])
def test_a_span_longer_than_the_walk_has_no_errors(delta):
    translation_m, rotation_rad = relative_errors(walk(12), walk(12), delta)
    assert translation_m.shape == rotation_rad.shape == (0,)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.1, 3.0, np.pi - 1e-7, np.pi])
def test_angles_of_rotations(angle):
    turned = exp_twist(np.array([0, 0, 0, 0.6, 0.0, 0.8]) * np.repeat([0, angle], 3))
    assert rotation_angle_rad(turned[:3, :3]) == pytest.approx(angle, abs=1e-12)


@given(seed=seeds)
def test_the_nearest_rotation_of_a_rotation_is_itself(seed):
    assert np.allclose(nearest_rotation(3 * rotation(seed)), rotation(seed))
    assert np.linalg.det(nearest_rotation(-rotation(seed))) == pytest.approx(1)
