"""Residuals and their derivatives, and one camera's pose from points of known place."""

import numpy as np
import pytest
from rooms import CAMERA, freeze

from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.frames import apply, exp_twist, invert
from imodbatch.poses.rgbd import measurement
from imodbatch.poses.rgbd.resection import Sightings, ransac, refine

CHI2 = measurement.CHI2_PIXEL


def measured_points(rng, n, noise=0.0):
    """Points in the camera and what is measured of them."""
    pixels = rng.uniform((0, 0), (320, 240), (n, 2))
    points = CAMERA.unproject(pixels, rng.uniform(0.5, 4, n))
    seen = measurement.measured(pixels, points)
    sigma = measurement.sigmas(seen, rng.integers(0, 5, n))
    return points, seen + noise * sigma * rng.normal(size=(n, 3)), sigma


def test_sigmas_grow_with_octave_and_distance():
    sigma = measurement.sigmas(np.array([[0, 0, 1.0], [0, 0, 3.0]]), np.array([0, 4]))
    assert sigma[0, 0] == sigma[0, 1] == measurement.PIXEL_SIGMA
    assert sigma[1, 0] == pytest.approx(1.2**4)
    assert sigma[1, 2] - sigma[0, 2] == pytest.approx(8 * measurement.DEPTH_SIGMA_PER_M)


def test_residuals_are_whitened_and_unknown_depth_is_none():
    points, seen, sigma = measured_points(np.random.default_rng(0), 3)
    assert np.abs(measurement.residuals(CAMERA, points, seen, sigma)).max() < 1e-9
    seen = seen - sigma * [[1, 0, 0], [0, -2, 0], [0, 0, 3]]
    found = measurement.residuals(CAMERA, points, seen, sigma)
    assert found == pytest.approx(np.diag([1.0, -2.0, 3.0]), abs=1e-9)
    seen[:, 2] = np.nan
    assert measurement.residuals(CAMERA, points, seen, sigma)[:, 2].tolist() == [0, 0, 0]


@pytest.mark.parametrize("z", [-3.0, -0.01, 0.0, 0.04])
@pytest.mark.parametrize("depth", [2.0, np.nan])
def test_behind_the_camera_never_fits(z, depth):
    seen = np.array([[CAMERA.cx_px, CAMERA.cy_px, depth]])
    error = measurement.residuals(CAMERA, np.array([[0.0, 0.0, z]]), seen, np.ones((1, 3)))
    assert np.isfinite(error).all()
    assert not measurement.fits(error)[0]
    assert not measurement.fits_like_most(error)[0]


@pytest.mark.parametrize("has_depth", [True, False])
def test_jacobians_against_differences(has_depth):
    points, seen, sigma = measured_points(np.random.default_rng(1), 20, noise=1.0)
    if not has_depth:
        seen[:, 2] = np.nan
        sigma[:, 2] = np.nan
    image = measurement.image_jacobian(CAMERA, points, seen, sigma)
    by_pose = measurement.pose_jacobian(image, points)
    step = 1e-6

    def slope(move):
        ends = (
            measurement.residuals(CAMERA, move(s), seen, np.nan_to_num(sigma, nan=1.0))
            for s in (step, -step)
        )
        return np.subtract(*ends) / (2 * step)

    for axis in range(3):
        expected = slope(lambda s, axis=axis: points + s * np.eye(3)[axis])
        assert image[:, :, axis] == pytest.approx(expected, rel=1e-5, abs=1e-4)
    for axis in range(6):
        expected = slope(lambda s, axis=axis: apply(exp_twist(s * np.eye(6)[axis]), points))
        assert by_pose[:, :, axis] == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_huber_weights():
    error = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.1, 0.0, 10.0]])
    weight = measurement.huber_weights(error)
    assert weight[0].tolist() == [1, 1, 1]
    assert weight[1] == pytest.approx([np.sqrt(CHI2) / 5] * 2 + [1])
    assert weight[2] == pytest.approx([1, 1, np.sqrt(measurement.CHI2_DEPTH) / 10])


def test_what_fits():
    error = np.array([[2.0, 1.0, 0], [2.0, 1.5, 0], [0, 0, 3.9], [0, 0, 4.1], [0, 0, -4.1]])
    assert measurement.fits(error).tolist() == [True, False, True, False, False]
    assert measurement.fits(np.zeros((0, 3))).shape == (0,)


def test_what_fits_clearly_worse_than_most_is_left_out():
    rng = np.random.default_rng(2)
    fine = 0.3 * rng.normal(size=(60, 3))
    moving = np.tile([1.5, 1.0, 0.0], (20, 1))
    errors = np.concatenate([fine, moving])
    assert measurement.fits(moving).all()
    found = measurement.fits_like_most(errors)
    assert found[:60].mean() > 0.85
    assert not found[60:].any()
    # ordinary noise is judged as ever
    ordinary = 1.5 * rng.normal(size=(50, 3))
    assert (measurement.fits_like_most(ordinary) == measurement.fits(ordinary)).all()
    assert measurement.fits_like_most(np.zeros((0, 3))).shape == (0,)
    assert measurement.fits_like_most(np.zeros((9, 3))).all()  # perfect ones as well


def sightings(seed, n=100, outliers=0.0, noise=0.5, has_depth=True):
    """Sightings of points of the world from a known pose, some of them of something else."""
    rng = np.random.default_rng(seed)
    points, seen, sigma = measured_points(rng, n, noise)
    cam_from_world = exp_twist(rng.normal(size=6))
    wrong = np.arange(n) < outliers * n
    seen[wrong, :2] = rng.uniform((0, 0), (320, 240), (wrong.sum(), 2))
    if not has_depth:
        seen[:, 2] = sigma[:, 2] = np.nan
    world = apply(invert(cam_from_world), points)
    return Sightings(freeze(world), freeze(seen), freeze(sigma)), cam_from_world, wrong


def off_by(a, b):
    away = a @ invert(b)
    return np.linalg.norm(away[:3, 3]), rotation_angle_rad(away[:3, :3])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("has_depth", [True, False])
def test_refine_finds_the_pose_nearby(seed, has_depth):
    seen, truth, _ = sightings(seed, has_depth=has_depth)
    rng = np.random.default_rng(100 + seed)
    guess = exp_twist(rng.uniform(-0.05, 0.05, 6)) @ truth
    found, good = refine(CAMERA, guess, seen)
    metres, radians = off_by(found, truth)
    assert metres < 0.03
    assert radians < 0.015
    assert good.mean() > 0.85


@pytest.mark.parametrize("seed", range(6))
def test_refine_leaves_out_what_is_wrong(seed):
    seen, truth, wrong = sightings(seed, outliers=0.3)
    guess = exp_twist(np.random.default_rng(seed).uniform(-0.01, 0.01, 6)) @ truth
    found, good = refine(CAMERA, guess, seen)
    metres, radians = off_by(found, truth)
    assert metres < 0.02
    assert radians < 0.01
    assert good[wrong].mean() < 0.1
    assert good[~wrong].mean() > 0.8


def test_refine_of_nothing_stays():
    seen, truth, _ = sightings(0, n=5)
    found, good = refine(CAMERA, truth, seen)
    assert found == pytest.approx(truth)
    assert len(good) == 5


@pytest.mark.parametrize("seed", range(6))
def test_ransac_finds_the_pose_among_outliers(seed):
    seen, truth, wrong = sightings(seed, outliers=0.4, noise=0.3)
    found, agrees = ransac(CAMERA, seen.points, seen.measurements[:, :2])
    metres, radians = off_by(found, truth)
    assert metres < 0.1
    assert radians < 0.05
    assert agrees[~wrong].mean() > 0.8
    assert agrees[wrong].mean() < 0.1


def test_ransac_is_the_same_twice():
    seen, _, _ = sightings(0, outliers=0.4)
    first, second = (ransac(CAMERA, seen.points, seen.measurements[:, :2]) for _ in range(2))
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])


@pytest.mark.parametrize("n", [0, 1, 5])
def test_ransac_of_too_few(n):
    assert ransac(CAMERA, np.zeros((n, 3)), np.zeros((n, 2))) is None


def test_ransac_of_chance():
    rng = np.random.default_rng(3)
    points, pixels = rng.normal(size=(60, 3)), rng.uniform((0, 0), (320, 240), (60, 2))
    found = ransac(CAMERA, points, pixels)
    assert found is None or found[1].sum() < 12


@pytest.mark.parametrize("kind", ["one place", "a line", "one pixel"])
def test_ransac_of_degenerate_points_is_none_or_finite(kind):
    rng = np.random.default_rng(4)
    points = np.outer(np.linspace(1, 2, 20), [0.3, 0.2, 1.0])
    pixels = rng.uniform((0, 0), (320, 240), (20, 2))
    if kind == "one place":
        points = np.tile([0.1, 0.2, 1.0], (20, 1))
    if kind == "one pixel":
        pixels = np.tile([100.0, 100.0], (20, 1))
    found = ransac(CAMERA, points, pixels)
    assert found is None or np.isfinite(found[0]).all()
