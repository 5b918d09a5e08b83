"""Depth images of one scene agree under true poses, and say by how much under wrong ones."""

import numpy as np
import pytest
from scene import CAMERA, make_scene

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.consistency import (
    HIDDEN_BEHIND_M,
    DepthConsistency,
    bilinear_depth,
    depth_consistency,
    tolerance_m,
)
from imodbatch.core.frames import exp_twist, invert, make_transform, matrix_from_quaternion
from imodbatch.lab.analytic.render import trace

WALL = PinholeCamera(40, 30, 40.0, 40.0, 20.0, 15.0)


def wall(depth_m, shape=(30, 40)):
    image = np.full(shape, depth_m, dtype=np.float32)
    image.setflags(write=False)
    return image


def ahead(step_m):
    """``b_from_a`` after a step along the axis of view."""
    return make_transform(np.eye(3), [0, 0, -step_m])


def median_m(found):
    return float(np.median(np.abs(found.residual_m)))


def share_within(found):
    return float((np.abs(found.residual_m) <= found.tolerance_m).mean())


def scene_pair(twist=(0.05, -0.02, 0.03, 0.02, 0.05, 0.0)):
    """Exact depth of two views near each other, and their true relative pose."""
    scene = make_scene()
    pose_a = scene.world_from_cam[0]
    pose_b = pose_a @ exp_twist(np.array(twist))
    depths = [
        trace(scene.world, CAMERA, pose).depth_m.astype(np.float32) for pose in (pose_a, pose_b)
    ]
    for depth in depths:
        depth.setflags(write=False)
    return *depths, invert(pose_b) @ pose_a


def test_a_wall_walked_towards():
    found = depth_consistency(wall(3.0), wall(2.5), WALL, ahead(0.5))
    assert median_m(found) == pytest.approx(0, abs=1e-6)
    assert share_within(found) == 1
    assert found.n_points == 4 * 5  # every eighth pixel from the fifth on
    assert 0 < found.overlap < 1


def test_a_step_misjudged_by_5_cm():
    found = depth_consistency(wall(3.0), wall(2.5), WALL, ahead(0.55))
    assert found.residual_m == pytest.approx(-0.05)
    assert median_m(found) == pytest.approx(0.05)
    assert share_within(found) == 0


def test_what_is_hidden_says_nothing_and_what_should_hide_is_a_fault():
    behind = depth_consistency(wall(3.0), wall(3.0 - 1.01 * HIDDEN_BEHIND_M), WALL, np.eye(4))
    assert len(behind.residual_m) == 0
    assert behind.overlap == 0
    before = depth_consistency(wall(3.0), wall(4.0), WALL, np.eye(4))
    assert before.residual_m == pytest.approx(-1.0)
    assert before.overlap == 1
    assert share_within(before) == 0


def test_true_poses_of_an_exact_scene_agree_and_faults_do_not():
    depth_a, depth_b, b_from_a = scene_pair()
    true = depth_consistency(depth_a, depth_b, CAMERA, b_from_a)
    assert median_m(true) < 0.002
    assert share_within(true) > 0.98
    assert true.overlap > 0.5
    for fault in (
        make_transform(np.eye(3), [0, 0, 0.05]) @ b_from_a,  # a pose moved by 5 cm
        make_transform(matrix_from_quaternion([1, 0.02, 0, 0]), np.zeros(3)) @ b_from_a,
        invert(b_from_a),
    ):
        wrong = depth_consistency(depth_a, depth_b, CAMERA, fault)
        assert median_m(wrong) > 5 * median_m(true)
        assert share_within(wrong) < share_within(true) - 0.1


def test_a_wrong_scale_of_depth_shows_when_the_camera_moves():
    depth_a, depth_b, b_from_a = scene_pair((0.1, 0, 0.3, 0, 0, 0))
    true = depth_consistency(depth_a, depth_b, CAMERA, b_from_a)
    scaled = depth_consistency(1.3 * depth_a, 1.3 * depth_b, CAMERA, b_from_a)
    assert median_m(scaled) > 5 * median_m(true)


def test_it_is_worked_out_as_written():
    """Pixel by pixel, without the vectors."""
    depth_a, depth_b, b_from_a = scene_pair()
    found = depth_consistency(depth_a, depth_b, CAMERA, b_from_a, stride_px=16)
    residuals = []
    for row in range(8, 120, 16):
        for col in range(8, 160, 16):
            point = CAMERA.unproject([col + 0.5, row + 0.5], depth_a[row, col])
            moved = b_from_a[:3, :3] @ point + b_from_a[:3, 3]
            u, v = CAMERA.project(moved) - 0.5
            if not (0 <= u < 159 and 0 <= v < 119):
                continue
            i, j = int(v), int(u)
            four = depth_b[i : i + 2, j : j + 2].astype(np.float64)
            weights = np.outer([1 - (v - i), v - i], [1 - (u - j), u - j])
            mean = float((weights * four).sum())
            if np.ptp(four) <= 0.03 * mean and moved[2] - mean <= HIDDEN_BEHIND_M:
                residuals.append(moved[2] - mean)
    assert found.n_points == 7 * 10
    assert found.residual_m == pytest.approx(residuals, abs=1e-9)


@pytest.mark.parametrize("unknown", [np.nan, 0.0])
def test_unknown_depth(unknown):
    nothing = depth_consistency(wall(unknown), wall(2.0), WALL, np.eye(4))
    assert nothing.n_points == 0
    assert nothing.overlap == 0
    if np.isnan(unknown):
        assert len(depth_consistency(wall(2.0), wall(np.nan), WALL, np.eye(4)).residual_m) == 0


def test_points_behind_the_camera():
    turned_round = make_transform(np.diag([-1.0, 1, -1]), np.zeros(3))
    assert depth_consistency(wall(2.0), wall(2.0), WALL, turned_round).overlap == 0


def test_bilinear_depth():
    depth = np.array([[1.0, 1.01, 2.0], [1.02, 1.03, np.nan]], dtype=np.float32)
    pixels = [[0.5, 0.5], [1.0, 1.0], [1.25, 0.75], [2.0, 0.5], [1.6, 1.2], [0.4, 0.5], [9, 9]]
    expected = [1.0, 1.015, 1.0125, np.nan, np.nan, np.nan, np.nan]
    assert bilinear_depth(depth, pixels) == pytest.approx(expected, nan_ok=True, abs=1e-6)
    assert np.isnan(bilinear_depth(depth, [[np.nan, 0.5]])).all()
    assert bilinear_depth(depth, np.zeros((0, 2))).shape == (0,)


def test_tolerance_grows_with_the_sensors_noise():
    assert tolerance_m(np.array([0.5, 2.0])) == pytest.approx(0.03)
    assert tolerance_m(np.array([4.0])) == pytest.approx(3 * (0.0012 + 0.0019 * 3.6**2))


def test_overlap_is_a_share_of_the_points():
    assert DepthConsistency(np.array([0.01, -0.2, 0.03]), np.full(3, 0.03), 6).overlap == 0.5
