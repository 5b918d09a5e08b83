"""How the camera moved between two frames: by points and pixels, and by images."""

import numpy as np
import pytest
from rooms import CAMERA, Room, filmed, freeze

from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.frames import apply, exp_twist, invert
from imodbatch.poses.rgbd.features import FeatureExtractor
from imodbatch.poses.rgbd.motion import FEWEST_INLIERS, motion_between, motion_of

TRUTH = exp_twist(np.array([0.1, -0.03, 0.05, 0.02, 0.1, -0.01]))


def seen(n, n_wrong=0, unit=1.0, noise_px=0.3):
    """Points before camera a in some unit, and where b shows them; some elsewhere."""
    rng = np.random.default_rng(n)
    points = CAMERA.unproject(rng.uniform((40, 40), (280, 200), (n, 2)), rng.uniform(1, 3, n))
    pixels = CAMERA.project(apply(TRUTH, points)) + noise_px * rng.normal(size=(n, 2))
    pixels[:n_wrong] = rng.uniform((0, 0), (320, 240), (n_wrong, 2))
    return freeze(unit * points), freeze(pixels)


@pytest.mark.parametrize("unit", [0.001, 1.0, 1000.0])
def test_points_tell_the_motion_in_their_own_unit(unit):
    points, pixels = seen(80, 20, unit)
    motion = motion_of(points, pixels, CAMERA)
    away = motion.b_from_a @ invert(TRUTH)
    assert rotation_angle_rad(away[:3, :3]) < 0.003
    assert motion.b_from_a[:3, 3] / unit == pytest.approx(TRUTH[:3, 3], abs=0.005)
    assert len(motion.points_a) == len(motion.pixels_b) == pytest.approx(60, abs=3)


def test_points_without_a_place_do_not_count():
    points, pixels = (np.array(x) for x in seen(80))
    points[::2] = np.nan
    motion = motion_of(points, pixels, CAMERA)
    assert np.isfinite(motion.points_a).all()
    assert np.linalg.norm(motion.b_from_a[:3, 3] - TRUTH[:3, 3]) < 0.01


def test_too_few_points_or_too_few_that_agree_tell_nothing():
    assert motion_of(*seen(FEWEST_INLIERS - 1), CAMERA) is None
    assert motion_of(*seen(100, 75), CAMERA) is None


def test_images_tell_the_motion():
    colors, depths, poses = filmed(Room(), "walk")
    extractor = FeatureExtractor(CAMERA, 600)
    for i, j in ((0, 2), (3, 6), (9, 5)):
        a, b = (
            extractor.extract(np.ascontiguousarray(colors[k][..., 0]), depths[k]) for k in (i, j)
        )
        away = motion_between(a, b, CAMERA).b_from_a @ invert(invert(poses[j]) @ poses[i])
        assert np.linalg.norm(away[:3, 3]) < 0.01
        assert rotation_angle_rad(away[:3, :3]) < 0.004
