"""A cloud's box, and how much of its front a depth image confirms."""

import numpy as np
import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.cloud_boxes import box_of_points, is_in_front, sight_of_points
from imodbatch.core.frames import invert, make_transform, matrix_from_quaternion

CAMERA = PinholeCamera(160, 120, 140.0, 140.0, 80.0, 60.0)
STRAIGHT = np.eye(4)
SPACING_M = 0.006


def plate(z=1.0, half=0.15):
    """A square across the view."""
    x, y = np.meshgrid(*[np.arange(-half, half, SPACING_M)] * 2)
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=-1)


def ball(center=(0, 0, 1.0), radius=0.1, count=3500):
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    height = np.linspace(-1, 1, count)
    ring = np.sqrt(1 - height**2)
    unit = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=-1)
    return np.asarray(center) + radius * unit


def depth_image(value):
    return np.full((120, 160), value, dtype=np.float32)


def sight(points, depth_m, pose=STRAIGHT, tolerance_m=0.02, tolerance_share=0.0):
    return sight_of_points(points, SPACING_M, pose, CAMERA, depth_m, tolerance_m, tolerance_share)


def test_the_box_is_that_of_all_points_and_not_cut():
    points = np.array([[-1.0, -0.2, 1.0], [0.1, 0.3, 2.0], [0.0, 0.0, 1.5]])
    assert np.allclose(box_of_points(points, STRAIGHT, CAMERA), [-60, 32, 87, 81])
    pose = make_transform(matrix_from_quaternion([0.9, 0.1, -0.3, 0.2]), [0.5, -1, 2])
    moved = points @ pose[:3, :3].T + pose[:3, 3]
    assert np.allclose(box_of_points(moved, invert(pose), CAMERA), [-60, 32, 87, 81])


def test_points_behind_the_camera():
    points = np.array([[0.0, 0.0, 1.0], [5.0, 0.0, -1.0]])
    assert np.allclose(box_of_points(points, STRAIGHT, CAMERA), [80, 60, 80, 60])
    assert not is_in_front(points, STRAIGHT)
    assert is_in_front(points[:1], STRAIGHT)
    assert box_of_points(points[1:], STRAIGHT, CAMERA) is None
    assert sight(points[1:], depth_image(1.0)).share == 0


@pytest.mark.parametrize(("depth", "share"), [(1.0, 1.0), (0.9, 0.0), (1.1, 0.0), (np.nan, 0.0)])
def test_seen_is_what_has_its_own_depth(depth, share):
    """Too near is something in front; too far is a place where the thing is not."""
    assert sight(plate(), depth_image(depth)).share == share


def test_a_half_covered_plate_is_half_seen():
    depth = depth_image(1.0)
    depth[:, :80] = 0.6
    assert sight(plate(), depth).share == pytest.approx(0.5, abs=0.03)


def test_a_half_outside_plate_is_half_seen():
    aside = plate() + np.array([80 / 140, 0, 0])
    assert sight(aside, depth_image(1.0)).share == pytest.approx(0.5, abs=0.03)


def test_its_own_far_side_hides_nothing_of_a_thing():
    """Half the points of a ball can never be seen; a ball in full view is seen all the same."""
    rays = CAMERA.unproject(CAMERA.pixel_centers(), np.ones((120, 160)))
    a, b = (rays**2).sum(-1), rays @ [0, 0, 1.0]
    root = b**2 - a * (1 - 0.1**2)
    depth = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, 3.0).astype(np.float32)
    seen = sight(ball(), depth)
    assert seen.share > 0.85
    assert 0.3 * 3500 < seen.n_front < 0.7 * 3500


def test_the_tolerance_grows_with_distance():
    off = depth_image(2.05)
    assert sight(plate(2.0), off, tolerance_m=0.02).share == 0
    assert sight(plate(2.0), off, tolerance_m=0.02, tolerance_share=0.02).share == 1


def test_ratios_tell_another_unit():
    ratios = sight(plate(), depth_image(10.0)).depth_ratios
    assert np.allclose(ratios, 10.0)
    assert len(ratios) == len(plate())


def test_nothing_is_written_into():
    points, depth = plate(), depth_image(1.0)
    points.setflags(write=False)
    depth.setflags(write=False)
    sight(points, depth)
    box_of_points(points, STRAIGHT, CAMERA)
