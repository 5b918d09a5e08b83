"""Rotations and transforms against Rodrigues' formula and plain matrix algebra."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from imodbatch.core.frames import (
    adjoint,
    apply,
    exp_twist,
    invert,
    is_rigid,
    make_transform,
    matrix_from_quaternion,
    orthonormal,
    quaternion_from_matrix,
    rotation_between,
    slerp,
    twist_between,
)

HALF = np.sqrt(0.5)
FEW_ROUNDINGS = 8 * np.finfo(float).eps
"""Of numbers about 1: a CPU may round many at once otherwise than one alone."""
AXES = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda a: np.linalg.norm(a) > 1e-3)
SPECIAL = [0.0, 1e-12, 1e-6, np.pi / 2, np.pi - 1e-9, np.pi, np.pi + 1e-9, 1.5 * np.pi]
ANGLES = st.one_of(st.floats(0, 2 * np.pi), st.sampled_from(SPECIAL))


def frozen(values):
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def rodrigues(axis, angle):
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def half_angle_quaternion(axis, angle):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis]


def random_transforms(rng, n):
    rotations = [rodrigues(rng.standard_normal(3), a) for a in rng.uniform(0, 2 * np.pi, n)]
    return frozen(make_transform(frozen(rotations), frozen(rng.uniform(-5, 5, (n, 3)))))


@pytest.mark.parametrize(
    ("quaternion", "x_goes_to", "y_goes_to"),
    [
        ([1, 0, 0, 0], [1, 0, 0], [0, 1, 0]),
        ([HALF, HALF, 0, 0], [1, 0, 0], [0, 0, 1]),
        ([HALF, 0, HALF, 0], [0, 0, -1], [0, 1, 0]),
        ([HALF, 0, 0, HALF], [0, 1, 0], [-1, 0, 0]),
        ([0, 1, 0, 0], [1, 0, 0], [0, -1, 0]),
        ([0, 0, 0, 1], [-1, 0, 0], [0, -1, 0]),
        ([0.5, 0.5, 0.5, 0.5], [0, 1, 0], [0, 0, 1]),
    ],
)
def test_quaternions_by_hand(quaternion, x_goes_to, y_goes_to):
    rotation = matrix_from_quaternion(frozen(quaternion))
    np.testing.assert_allclose(rotation[:, 0], x_goes_to, atol=1e-15)
    np.testing.assert_allclose(rotation[:, 1], y_goes_to, atol=1e-15)
    back = quaternion_from_matrix(rotation)
    assert abs(back @ quaternion) == pytest.approx(1, abs=1e-12)


@given(AXES, ANGLES)
@example((1.0, 0.0, 0.0), np.pi)
@example((0.3, -0.7, 0.2), np.pi)
@settings(max_examples=150)
def test_matrix_and_quaternion_against_rodrigues(axis, angle):
    rotation, quaternion = rodrigues(axis, angle), half_angle_quaternion(axis, angle)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion), rotation, atol=1e-12)
    np.testing.assert_allclose(matrix_from_quaternion(-7 * quaternion), rotation, atol=1e-12)
    found = quaternion_from_matrix(rotation)
    assert found[0] >= 0
    assert np.linalg.norm(found) == pytest.approx(1, abs=1e-12)
    assert min(np.abs(found - quaternion).max(), np.abs(found + quaternion).max()) < 1e-9
    np.testing.assert_allclose(matrix_from_quaternion(found), rotation, atol=1e-12)


def test_many_at_once():
    rng = np.random.default_rng(0)
    quaternions = frozen(rng.standard_normal((4, 5, 4)))
    rotations = matrix_from_quaternion(quaternions)
    assert rotations.shape == (4, 5, 3, 3)
    for i, j in np.ndindex(4, 5):
        alone = matrix_from_quaternion(quaternions[i, j])
        np.testing.assert_allclose(rotations[i, j], alone, rtol=0, atol=FEW_ROUNDINGS)
    back = quaternion_from_matrix(rotations)
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    np.testing.assert_allclose(back, unit * np.sign(unit[..., :1]), atol=1e-12)


def test_a_distorted_matrix_gives_the_nearest_rotation():
    rng = np.random.default_rng(1)
    for _ in range(20):
        rotation = rodrigues(rng.standard_normal(3), rng.uniform(0, 2 * np.pi))
        distorted = rotation + rng.uniform(-0.02, 0.02, (3, 3))
        u, _, vt = np.linalg.svd(distorted)  # nearest in the Frobenius norm (Kabsch)
        found = matrix_from_quaternion(quaternion_from_matrix(distorted))
        np.testing.assert_allclose(found, u @ vt, atol=1e-12)


def test_make_transform_broadcasts():
    single = make_transform(np.eye(3), [1, 2, 3])
    np.testing.assert_array_equal(single, [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    many = make_transform(np.eye(3), frozen([[1, 2, 3], [4, 5, 6]]))
    assert many.shape == (2, 4, 4)
    np.testing.assert_array_equal(many[1, :3, 3], [4, 5, 6])
    turned = make_transform(frozen([rodrigues([0, 0, 1], 0.3)] * 2), np.zeros(3))
    np.testing.assert_array_equal(turned[1, :3, :3], rodrigues([0, 0, 1], 0.3))


def test_invert_and_apply_are_matrix_algebra():
    rng = np.random.default_rng(2)
    transforms = random_transforms(rng, 6)
    np.testing.assert_allclose(invert(transforms), np.linalg.inv(transforms), atol=1e-12)
    points = frozen(rng.uniform(-3, 3, (6, 3)))
    homogeneous = np.concatenate([points, np.ones((6, 1))], axis=1)
    expected = np.stack([t @ p for t, p in zip(transforms, homogeneous, strict=True)])[:, :3]
    np.testing.assert_allclose(apply(transforms, points), expected, atol=1e-12)
    np.testing.assert_allclose(
        apply(transforms[0], points), (transforms[0] @ homogeneous.T).T[:, :3], atol=1e-12
    )
    np.testing.assert_allclose(apply(invert(transforms), expected), points, atol=1e-12)


def test_transforms_chain_by_their_names():
    """world_from_object = world_from_cam @ cam_from_object."""
    world_from_cam = make_transform(rodrigues([0, 0, 1], np.pi / 2), [1, 0, 0])
    cam_from_object = make_transform(np.eye(3), [2, 0, 0])
    origin_world = apply(world_from_cam @ cam_from_object, np.zeros(3))
    np.testing.assert_allclose(origin_world, [1, 2, 0], atol=1e-15)
    np.testing.assert_allclose(
        apply(world_from_cam, apply(cam_from_object, np.zeros(3))), origin_world, atol=1e-15
    )


def test_is_rigid():
    good = random_transforms(np.random.default_rng(3), 4)
    assert is_rigid(good).tolist() == [True] * 4
    assert bool(is_rigid(np.eye(4)))
    np.testing.assert_array_equal(is_rigid(np.round(good, 6), tolerance=1e-5), [True] * 4)
    assert not is_rigid(np.round(good, 2), tolerance=1e-5).any()

    def changed(index, value):
        matrix = good[0].copy()
        matrix[index] = value
        return matrix

    rotation = good[0, :3, :3]
    bad = {
        "nan rotation": changed((0, 0), np.nan),
        "nan translation": changed((1, 3), np.nan),
        "inf translation": changed((1, 3), np.inf),
        "-inf everywhere": np.full((4, 4), -np.inf),
        "zero": np.zeros((4, 4)),
        "reflection": make_transform(rotation @ np.diag([1, 1, -1]), good[0, :3, 3]),
        "scale 1.05": make_transform(1.05 * rotation, good[0, :3, 3]),
        "scale 0.9": make_transform(0.9 * rotation, good[0, :3, 3]),
        "shear": make_transform(rotation @ (np.eye(3) + 0.1 * np.eye(3, k=1)), good[0, :3, 3]),
        "transposed": good[0].T,
    }
    for name, matrix in bad.items():
        assert not is_rigid(matrix), name
    np.testing.assert_array_equal(
        is_rigid(frozen([good[0], bad["nan rotation"], good[1]])), [True, False, True]
    )
    assert bool(is_rigid(make_transform(1.001 * rotation, good[0, :3, 3])))


@given(AXES, AXES)
@example((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
@example((0.3, 0.4, 0.5), (-0.3, -0.4, -0.5))
@example((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))
@example((0.2, 0.0, 0.0), (0.9, 0.0, 0.0))
@settings(max_examples=150)
def test_rotation_between(a, b):
    a, b = frozen(a), frozen(b)
    rotation = rotation_between(a, b)
    unit_a, unit_b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    np.testing.assert_allclose(rotation @ unit_a, unit_b, atol=2e-8)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)
    # smallest: its angle is the angle between the directions
    np.testing.assert_allclose((np.trace(rotation) - 1) / 2, unit_a @ unit_b, atol=1e-9)


def test_rotation_between_equal_and_opposite_directions():
    np.testing.assert_allclose(rotation_between([0, 0, 3], [0, 0, 1]), np.eye(3), atol=1e-15)
    half_turn = rotation_between([0, 0, -1], [0, 0, 1])
    np.testing.assert_allclose(half_turn @ half_turn, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(half_turn @ [0, 0, -1], [0, 0, 1], atol=1e-15)


@pytest.mark.parametrize("angle", [1e-3, 1e-5, 2e-6, 1.2e-6, 1e-7, 1e-9])
def test_rotation_between_nearly_opposite_directions(angle):
    down = np.array([0.6 * np.sin(angle), 0.8 * np.sin(angle), -np.cos(angle)])
    rotation = rotation_between(down, [0, 0, 1])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(rotation @ down, [0, 0, 1], atol=2e-8)


@given(AXES, AXES, st.floats(0, np.pi - 1e-3), ANGLES, st.floats(0, 1))
@settings(max_examples=150)
def test_slerp_turns_evenly_along_the_shorter_arc(axis, start_axis, angle, start_angle, fraction):
    start = half_angle_quaternion(start_axis, start_angle)
    base = rodrigues(start_axis, start_angle)
    end = quaternion_from_matrix(rodrigues(axis, angle) @ base)
    expected = rodrigues(axis, fraction * angle) @ base
    for sign in (1, -1):  # q and −q are the same rotation; the longer arc is never taken
        found = slerp(frozen(start), frozen(sign * end), fraction)
        assert np.linalg.norm(found) == pytest.approx(1, abs=1e-12)
        np.testing.assert_allclose(matrix_from_quaternion(found), expected, atol=1e-6)


def test_slerp_by_hand():
    start, end = frozen([1, 0, 0, 0]), frozen([HALF, 0, 0, HALF])  # 0° and 90° about z
    np.testing.assert_allclose(slerp(start, end, 0.0), start)
    np.testing.assert_allclose(slerp(start, end, 1.0), end)
    middle = half_angle_quaternion([0, 0, 1], np.pi / 4)
    np.testing.assert_allclose(slerp(start, end, 0.5), middle)
    np.testing.assert_allclose(slerp(start, -end, 0.5), middle)
    np.testing.assert_allclose(slerp(start, start, 0.5), start)
    third = half_angle_quaternion([0, 0, 1], np.pi / 6)
    many = slerp(frozen([start] * 2), frozen([end] * 2), frozen([1 / 3, 1.0]))
    np.testing.assert_allclose(many, [third, end])
    np.testing.assert_allclose(slerp(start, [0, 1, 0, 0], 0.5), [HALF, HALF, 0, 0])  # 180°


def matrix_exponential(matrix):
    """By its series, of a matrix halved until it is small, then squared as often."""
    small, power, total = matrix / 2**12, np.eye(len(matrix)), np.eye(len(matrix))
    for n in range(1, 8):
        power = power @ small / n
        total = total + power
    for _ in range(12):
        total = total @ total
    return total


def skew(vector):
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


@given(AXES, ANGLES)
@example((1.0, 0.0, 0.0), 0.0)
@settings(max_examples=100)
def test_exp_twist_is_the_exponential_of_a_rotation(axis, angle):
    vector = angle * np.asarray(axis) / np.linalg.norm(axis)
    found = exp_twist(frozen([0.3, -2.0, 5.0, *vector]))
    np.testing.assert_allclose(found[:3, :3], matrix_exponential(skew(vector)), atol=1e-10)
    np.testing.assert_allclose(found[:3, :3], rodrigues(axis, angle), atol=1e-12)
    np.testing.assert_array_equal(found[:3, 3], [0.3, -2.0, 5.0])
    np.testing.assert_array_equal(found[3], [0, 0, 0, 1])


def test_exp_twist_of_many_and_of_none():
    twists = frozen(np.random.default_rng(4).normal(size=(3, 4, 6)))
    found = exp_twist(twists)
    for i, j in np.ndindex(3, 4):
        np.testing.assert_allclose(found[i, j], exp_twist(twists[i, j]), rtol=0, atol=FEW_ROUNDINGS)
    np.testing.assert_array_equal(exp_twist(np.zeros(6)), np.eye(4))
    assert exp_twist(np.zeros((0, 6))).shape == (0, 4, 4)


@given(AXES, st.one_of(st.floats(0, np.pi - 1e-6), st.sampled_from([1e-14, 1e-12, 1e-9, 1e-6])))
@settings(max_examples=150)
def test_twist_between_inverts_exp_twist(axis, angle):
    twist = frozen([0.5, -1.5, 2.5, *(angle * np.asarray(axis) / np.linalg.norm(axis))])
    pose = random_transforms(np.random.default_rng(5), 1)[0]
    np.testing.assert_allclose(twist_between(exp_twist(twist), np.eye(4)), twist, atol=1e-7)
    found = twist_between(exp_twist(twist) @ pose, pose)
    np.testing.assert_allclose(found, twist, atol=1e-7)


def test_twist_between_takes_the_second_pose_to_the_first():
    a, b = np.split(random_transforms(np.random.default_rng(6), 40), 2)
    np.testing.assert_allclose(exp_twist(twist_between(a, b)) @ b, a, atol=1e-9)
    np.testing.assert_allclose(twist_between(a, a), np.zeros((20, 6)), atol=1e-7)


def test_adjoint_carries_twists_over():
    """A small twist in b, seen from a: exp(Ad ξ) = T exp(ξ) T⁻¹, to first order."""
    rng = np.random.default_rng(7)
    for transform in random_transforms(rng, 10):
        twist = 1e-5 * rng.normal(size=6)
        carried = transform @ exp_twist(twist) @ invert(transform)
        found = exp_twist(adjoint(transform) @ twist)
        np.testing.assert_allclose(found, carried, atol=1e-8)


def test_adjoint_of_products_and_of_many():
    a, b = np.split(random_transforms(np.random.default_rng(8), 12), 2)
    np.testing.assert_allclose(adjoint(a @ b), adjoint(a) @ adjoint(b), atol=1e-10)
    np.testing.assert_allclose(adjoint(invert(a)), np.linalg.inv(adjoint(a)), atol=1e-10)
    np.testing.assert_allclose(adjoint(a)[2], adjoint(a[2]), rtol=0, atol=10 * FEW_ROUNDINGS)


def test_orthonormal_after_a_thousand_products():
    steps = random_transforms(np.random.default_rng(9), 1000).astype(np.float32)
    product = np.eye(4, dtype=np.float32)
    for step in steps:
        product = product @ step
    found = orthonormal(frozen(product))
    defect = found[:3, :3] @ found[:3, :3].T - np.eye(3)
    assert np.abs(defect).max() < 1e-14
    assert np.abs(product[:3, :3] @ product[:3, :3].T - np.eye(3)).max() > 1e-7
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(found, product, atol=1e-4)
    np.testing.assert_allclose(orthonormal(found), found, atol=1e-14)
