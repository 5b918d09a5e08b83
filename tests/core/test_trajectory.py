"""Poses for frames: association against a plain loop, interpolation of a known motion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imodbatch.core.frames import apply, invert, is_rigid, make_transform, matrix_from_quaternion
from imodbatch.core.trajectory import FramePoses, associate, interpolate, level


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def about_z(angle_rad):
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def random_poses(rng, n):
    rotations = matrix_from_quaternion(rng.standard_normal((n, 4)))
    return frozen(make_transform(rotations, rng.uniform(-3, 3, (n, 3))))


def plain_associate(a, b, max_gap):
    """All pairs within the gap, the closest first, each stamp once."""
    pairs = sorted(
        (abs(x - y), i, j)
        for i, x in enumerate(a)
        for j, y in enumerate(b)
        if abs(x - y) <= max_gap
    )
    partner, taken = [-1] * len(a), set()
    for _, i, j in pairs:
        if partner[i] < 0 and j not in taken:
            partner[i] = j
            taken.add(j)
    return partner


def stamps(values):
    return frozen(values, np.int64)


@pytest.mark.parametrize(
    ("a", "b", "max_gap", "expected"),
    [
        ([0, 10, 20], [1, 11, 21], 2, [0, 1, 2]),
        ([0, 10, 20], [11, 21, 1], 2, [2, 0, 1]),  # unsorted b
        ([20, 0, 10], [1, 11, 21], 2, [2, 0, 1]),  # unsorted a
        ([0, 10], [5], 4, [-1, -1]),  # the gap
        ([0, 10], [5], 5, [0, -1]),  # a gap of just max_gap still counts; one of two gets it
        ([0, 3], [2], 9, [-1, 0]),  # two frames, one pose: the closer one gets it
        ([3, 0], [2], 9, [0, -1]),
        ([0, 4], [3, 9], 9, [1, 0]),  # the closest pair first; the other takes what is left
        ([0, 4], [3, 9], 8, [-1, 0]),
        ([7], [7, 7], 0, [0]),
        ([], [1, 2], 5, []),
        ([1, 2], [], 5, [-1, -1]),
    ],
)
def test_associate_by_hand(a, b, max_gap, expected):
    assert associate(stamps(a), stamps(b), max_gap).tolist() == expected


@given(st.integers(0, 2**32 - 1), st.integers(0, 30), st.integers(0, 30), st.integers(0, 300_000))
@settings(max_examples=150)
def test_associate_against_a_plain_loop(seed, n_a, n_b, max_gap):
    rng = np.random.default_rng(seed)
    # nanoseconds of 2020, where float64 could not tell neighbours apart; all gaps are different
    a, b = (1_600_000_000_000_000_000 + rng.integers(0, 1_000_000, n) for n in (n_a, n_b))
    gaps = np.abs(a[:, None] - b).ravel()
    if len(np.unique(gaps)) < len(gaps):
        a, b = a[:1], b[:1]
    found = associate(stamps(a), stamps(b), max_gap)
    assert found.tolist() == plain_associate(a.tolist(), b.tolist(), max_gap)


@given(
    st.lists(st.integers(0, 20), max_size=15),
    st.lists(st.integers(0, 20), max_size=15),
    st.integers(0, 6),
)
@settings(max_examples=150)
def test_associate_is_one_to_one_and_leaves_no_pair_out(a, b, max_gap):
    found = associate(stamps(a), stamps(b), max_gap)
    used = found[found >= 0]
    assert len(np.unique(used)) == len(used)
    gap_of = {i: abs(a[i] - b[j]) for i, j in enumerate(found.tolist()) if j >= 0}
    assert all(gap <= max_gap for gap in gap_of.values())
    owner = {j: i for i, j in enumerate(found.tolist()) if j >= 0}
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            if abs(x - y) <= max_gap:  # a pair not made has a partner at least as close
                rivals = [gap_of.get(i, np.inf), gap_of.get(owner.get(j, -1), np.inf)]
                assert min(rivals) <= abs(x - y)


def turning_camera(stamps_ns):
    """1 m and 90° about z in 100 ns, at an even speed."""
    fraction = np.asarray(stamps_ns) / 100
    rotations = np.stack([about_z(f * np.pi / 2) for f in fraction])
    return frozen(make_transform(rotations, fraction[:, None] * [1.0, -2.0, 0.5]))


def test_interpolate_a_known_motion():
    known = stamps([0, 100, 160, 250])
    at = stamps([50, 25, 130, 205, 249, 1])
    found = interpolate(known, turning_camera(known), at, max_gap=100)
    np.testing.assert_allclose(found, turning_camera(at), atol=1e-12)


def test_interpolate_gives_known_moments_their_own_pose():
    known = stamps([0, 100, 300])
    poses = random_poses(np.random.default_rng(0), 3)
    np.testing.assert_allclose(interpolate(known, poses, known, 1000), poses, atol=1e-12)
    # also on the border of a gap too large to bridge, and where there is but one pose
    np.testing.assert_allclose(interpolate(known, poses, known, 150), poses, atol=1e-12)
    np.testing.assert_allclose(interpolate(known, poses, known, 1), poses, atol=1e-12)
    alone = interpolate(known[:1], poses[:1], stamps([-1, 0, 1]), 1000)
    np.testing.assert_allclose(alone[1], poses[0], atol=1e-12)
    assert np.isnan(alone[[0, 2]]).all()


def test_interpolate_invents_nothing():
    known = stamps([0, 100, 300])
    poses = turning_camera(known)
    at = stamps([-1, 50, 150, 299, 301, 10_000])
    found = interpolate(known, poses, at, max_gap=150)
    np.testing.assert_array_equal(
        np.isnan(found).all(axis=(1, 2)), [True, False, True, True, True, True]
    )
    assert np.isfinite(found[1]).all()
    outside = interpolate(known, poses, stamps([-1, 301, 10_000]), max_gap=20_000)
    assert np.isnan(outside).all()
    # a gap of just max_gap is bridged
    assert np.isfinite(interpolate(known, poses, stamps([150]), max_gap=200)).all()
    assert np.isnan(interpolate(known, poses, stamps([150]), max_gap=199)).all()
    nothing = interpolate(stamps([]), np.zeros((0, 4, 4)), at, 100)
    assert nothing.shape == (6, 4, 4)
    assert np.isnan(nothing).all()
    assert interpolate(known, poses, stamps([]), 100).shape == (0, 4, 4)


def test_interpolate_is_exact_with_stamps_of_nanoseconds_since_1970():
    start = 1_600_000_000_000_000_000
    offsets = np.array([0, 100])
    found = interpolate(stamps(start + offsets), turning_camera(offsets), stamps([start + 25]), 100)
    np.testing.assert_allclose(found, turning_camera([25]), atol=1e-12)


@pytest.mark.parametrize("up", [[0, 0, 2], [0, -1, 0], [0, 0, -1], [0.1, -3, 0.4], [1, 0, 0]])
def test_level_turns_up_to_z_and_keeps_distances(up):
    poses = random_poses(np.random.default_rng(1), 5)
    levelled = level(poses, frozen(up))
    # a point 1 m further "up" in the old world is 1 m higher in the new one
    unit = np.array(up) / np.linalg.norm(up)
    low = frozen([0.3, -0.2, 0.9])
    old = np.stack([low, low + unit])
    new = apply(levelled[0], apply(invert(poses[0]), old))
    np.testing.assert_allclose(new[1] - new[0], [0, 0, 1], atol=1e-12)
    assert is_rigid(levelled, tolerance=1e-9).all()
    np.testing.assert_allclose(
        invert(levelled[:-1]) @ levelled[1:], invert(poses[:-1]) @ poses[1:], atol=1e-12
    )
    np.testing.assert_allclose(
        np.linalg.norm(levelled[:, :3, 3], axis=1), np.linalg.norm(poses[:, :3, 3], axis=1)
    )


def test_level_leaves_a_level_world_and_lost_poses_alone():
    poses = random_poses(np.random.default_rng(2), 3).copy()
    poses[1] = np.nan
    levelled = level(frozen(poses), [0, 0, 1])
    np.testing.assert_array_equal(np.isnan(levelled).all(axis=(1, 2)), [False, True, False])
    np.testing.assert_allclose(levelled[[0, 2]], poses[[0, 2]], atol=1e-12)


def test_from_matrices_tells_what_is_lost():
    good = random_poses(np.random.default_rng(3), 6)
    given_ = good.copy()
    given_[1, 0, 3] = np.nan
    given_[2] = -np.inf  # ScanNet
    given_[3] = 0.0
    given_[4, :3, :3] *= 1.2
    given_[5, :3, 0] *= -1  # a mirror image
    poses = FramePoses.from_matrices(frozen(given_))
    assert poses.status.tolist() == ["tracked"] + ["lost"] * 5
    np.testing.assert_allclose(poses.world_from_cam[0], good[0], atol=1e-12)
    assert np.isnan(poses.world_from_cam[1:]).all()


def test_from_matrices_makes_printed_poses_orthonormal():
    good = random_poses(np.random.default_rng(4), 5)
    printed = np.round(good, 3)
    defect = np.abs(printed[:, :3, :3] @ printed[:, :3, :3].swapaxes(1, 2) - np.eye(3)).max()
    assert defect > 1e-4
    poses = FramePoses.from_matrices(frozen(printed))
    assert poses.status.tolist() == ["tracked"] * 5
    assert is_rigid(poses.world_from_cam, tolerance=1e-12).all()
    np.testing.assert_allclose(poses.world_from_cam, good, atol=2e-3)
    np.testing.assert_array_equal(poses.world_from_cam[:, :3, 3], printed[:, :3, 3])


def test_from_matrices_of_nothing():
    poses = FramePoses.from_matrices(np.zeros((0, 4, 4)))
    assert poses.world_from_cam.shape == (0, 4, 4)
    assert poses.status.shape == (0,)
