"""Bundle adjustment: on networks whose truth is known, and against dense normal equations."""

import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from rooms import CAMERA, freeze, look

from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.frames import apply, exp_twist, invert
from imodbatch.poses.rgbd import measurement
from imodbatch.poses.rgbd.adjustment import Network, Tie, adjust, among

FIRM = 1e6 * np.eye(6)


def network(seed, n_cameras=6, n_points=80, noise=0.3, off=0.0, n_fixed=1, ties=()):
    """A network in a room, the truth of its cameras and points; cameras and points start off."""
    rng = np.random.default_rng(seed)
    truth = invert(
        np.stack([look([-1 + 0.1 * i, 0.1 * np.sin(i), 1.3], 3.0 * i) for i in range(n_cameras)])
    )
    points = rng.uniform((0.8, -1.5, 0.3), (2.4, 1.5, 2.3), (n_points, 3))
    camera_of, point_of, seen = [], [], []
    for c, pose in enumerate(truth):
        in_camera = apply(pose, points)
        pixels = CAMERA.project(in_camera)
        inside = ((pixels > 0) & (pixels < (320, 240))).all(axis=1)
        rows = np.flatnonzero(inside)
        camera_of.append(np.full(len(rows), c))
        point_of.append(rows)
        seen.append(measurement.measured(pixels[rows], in_camera[rows]))
    measured = np.concatenate(seen)
    sigma = measurement.sigmas(measured, np.zeros(len(measured), dtype=np.int64))
    measured = measured + noise * sigma * rng.normal(size=measured.shape)
    measured[rng.uniform(size=len(measured)) < 0.3, 2] = np.nan
    sigma[~np.isfinite(measured)] = np.nan
    moves = np.arange(n_cameras) >= n_fixed
    start = truth.copy()
    start[moves] = exp_twist(off * rng.uniform(-1, 1, (moves.sum(), 6))) @ truth[moves]
    points_start = points + off * rng.uniform(-1, 1, points.shape)
    made = Network(
        *map(freeze, (start, moves, points_start, np.concatenate(camera_of))),
        *map(freeze, (np.concatenate(point_of), measured, sigma)),
        ties,
    )
    return made, truth, points


def camera_errors(found, truth):
    away = found @ invert(truth)
    return np.linalg.norm(away[:, :3, 3], axis=1), rotation_angle_rad(away[:, :3, :3])


@pytest.mark.parametrize("seed", range(4))
def test_moved_cameras_and_points_come_back(seed):
    made, truth, points = network(seed, off=0.03)
    found = adjust(CAMERA, made, (10, 10))
    metres, radians = camera_errors(found.cam_from_world, truth)
    assert metres.max() < 0.015  # some three standard deviations
    assert radians.max() < 0.008
    several = np.bincount(made.point_of, minlength=len(points)) >= 2
    away = np.linalg.norm(found.points - points, axis=1)[several]
    assert np.median(away) < 0.006
    assert found.fits.mean() > 0.97


def test_without_noise_the_truth_is_found():
    made, truth, _ = network(0, noise=0.0, off=0.02)
    metres, radians = camera_errors(adjust(CAMERA, made, (15,)).cam_from_world, truth)
    assert metres.max() < 1e-4
    assert radians.max() < 1e-4


def test_fixed_cameras_stay_to_the_last_bit():
    made, _, _ = network(1, off=0.03, n_fixed=3)
    found = adjust(CAMERA, made)
    assert np.allclose(found.cam_from_world[:3], made.cam_from_world[:3], rtol=0, atol=1e-14)
    assert not np.allclose(found.cam_from_world[3:], made.cam_from_world[3:])


@pytest.mark.parametrize("seed", range(3))
def test_sightings_of_something_else_are_flagged(seed):
    made, truth, _ = network(seed, off=0.01)
    rng = np.random.default_rng(50 + seed)
    wrong = rng.uniform(size=len(made.camera_of)) < 0.08
    measured = made.measurements.copy()
    measured[wrong, :2] += rng.choice([-1, 1], (wrong.sum(), 2)) * rng.uniform(15, 60)
    found = adjust(CAMERA, replace(made, measurements=freeze(measured)), (6, 6))
    assert found.fits[wrong].mean() < 0.25  # a point seen once cannot be doubted
    assert found.fits[~wrong].mean() > 0.9
    assert camera_errors(found.cam_from_world, truth)[0].max() < 0.025


def chain(truth, information=FIRM):
    """Ties from each camera to the next, as they are in truth."""
    return [
        Tie(i, i + 1, truth[i] @ invert(truth[i + 1]), information) for i in range(len(truth) - 1)
    ]


def test_ties_alone_hold_a_camera():
    made, truth, _ = network(2, off=0.05)
    nothing = np.zeros(0, dtype=np.int64)
    tied = replace(
        made,
        points=np.zeros((0, 3)),
        camera_of=nothing,
        point_of=nothing,
        measurements=np.zeros((0, 3)),
        sigma=np.zeros((0, 3)),
        ties=chain(truth),
    )
    found = adjust(CAMERA, tied, (15,))
    metres, radians = camera_errors(found.cam_from_world, truth)
    assert metres.max() < 1e-5
    assert radians.max() < 1e-5
    assert found.fits.shape == (0,)


def test_nothing_at_all_stays_where_it_is():
    made, _, _ = network(2)
    nothing = np.zeros(0, dtype=np.int64)
    bare = replace(
        made,
        points=np.zeros((0, 3)),
        camera_of=nothing,
        point_of=nothing,
        measurements=np.zeros((0, 3)),
        sigma=np.zeros((0, 3)),
    )
    assert np.allclose(adjust(CAMERA, bare).cam_from_world, made.cam_from_world)


def test_ties_pull_against_sightings():
    """A camera that is tied firmly elsewhere goes there, one tied loosely does not."""
    made, truth, _ = network(3, noise=0.0)
    elsewhere = truth.copy()
    elsewhere[1:] = exp_twist(np.array([0.05, 0, 0, 0, 0, 0])) @ truth[1:]
    off = {}
    for name, weight in (("firm", 1e10), ("loose", 1e-2)):
        tied = replace(made, ties=chain(elsewhere, weight * np.eye(6)))
        off[name] = camera_errors(adjust(CAMERA, tied, (15,)).cam_from_world, elsewhere)[0]
    assert off["firm"].max() < 0.01
    assert off["loose"][1:].min() > 0.03


def whole_residuals(made, weight, cameras, points):
    """All residuals as one vector, scaled so that their squares are the cost."""
    in_camera = apply(cameras[made.camera_of], points[made.point_of])
    error = measurement.residuals(CAMERA, in_camera, made.measurements, made.sigma)
    parts = [(np.sqrt(weight) * error).ravel()]
    for tie in made.ties:
        away = cameras[tie.first] @ invert(cameras[tie.second]) @ invert(tie.first_from_second)
        # a small rotation's vector, and its translation
        vector = 0.5 * np.array(
            [away[2, 1] - away[1, 2], away[0, 2] - away[2, 0], away[1, 0] - away[0, 1]]
        )
        parts.append(np.linalg.cholesky(tie.information).T @ np.r_[away[:3, 3], vector])
    return np.concatenate(parts)


def test_one_step_is_that_of_dense_normal_equations():
    """All unknowns at once, derivatives by differences, no elimination of points."""
    made, truth, _ = network(4, n_cameras=4, n_points=25, noise=0.1, off=1e-4)
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    made = replace(made, ties=chain(truth, 1e4 * root @ root.T))
    cameras, points = made.cam_from_world, made.points
    error = measurement.residuals(
        CAMERA, apply(cameras[made.camera_of], points[made.point_of]), made.measurements, made.sigma
    )
    weight = measurement.huber_weights(error)
    moving = np.flatnonzero(made.moves)

    def at(unknown):
        moved = cameras.copy()
        moved[moving] = exp_twist(unknown[: 6 * len(moving)].reshape(-1, 6)) @ cameras[moving]
        return moved, points + unknown[6 * len(moving) :].reshape(-1, 3)

    size = 6 * len(moving) + 3 * len(points)
    base = whole_residuals(made, weight, cameras, points)
    jacobian = np.stack(
        [
            (whole_residuals(made, weight, *at(1e-7 * row)) - base) / 1e-7 for row in np.eye(size)
        ],
        axis=1,
    )  # fmt: skip
    normal = jacobian.T @ jacobian
    # points that one camera alone sees, without depth, are held by the damping only
    normal += np.diag(1e-4 * np.diag(normal) + 1e-6)
    expected_cameras, expected_points = at(-np.linalg.solve(normal, jacobian.T @ base))
    found = adjust(CAMERA, made, (1,))
    assert np.abs(found.cam_from_world - cameras).max() > 1e-5
    assert np.abs(found.cam_from_world - expected_cameras).max() < 2e-6
    held = np.bincount(made.point_of, minlength=len(points)) >= 2
    assert np.abs(found.points - expected_points)[held].max() < 2e-5


def test_more_rounds_never_fit_worse():
    made, _, _ = network(5, off=0.05)
    costs = []
    for n in (1, 2, 4, 8):
        found = adjust(CAMERA, made, (n,))
        in_camera = apply(found.cam_from_world[made.camera_of], found.points[made.point_of])
        error = measurement.residuals(CAMERA, in_camera, made.measurements, made.sigma)
        costs.append(np.median(error**2))
    # where rounds change nothing any more, roundings may go either way
    assert all(later <= earlier * (1 + 1e-9) for earlier, later in pairwise(costs))


def test_ties_among_some_cameras_go_by_their_places():
    ties = chain(np.tile(np.eye(4), (5, 1, 1)))
    assert [(t.first, t.second) for t in among(ties, [3, 2, 0, 1])] == [(2, 3), (3, 1), (1, 0)]


def test_memory_grows_with_the_sightings_not_with_their_pairs():
    """120 cameras that all see 400 points: every pair of cameras shares every point."""
    made, _, _ = network(6, n_cameras=8, n_points=400, off=0.01)
    of_each = [np.flatnonzero(made.camera_of == 1 + i % 7) for i in range(120)]
    rows = np.concatenate(of_each)
    many = replace(
        made,
        cam_from_world=made.cam_from_world[1 + np.arange(120) % 7],
        moves=np.arange(120) > 0,
        camera_of=np.repeat(np.arange(120), [len(r) for r in of_each]),
        point_of=made.point_of[rows],
        measurements=made.measurements[rows],
        sigma=made.sigma[rows],
    )
    tracemalloc.start()
    found = adjust(CAMERA, many, (1,))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    of_sightings = len(rows) * 8 * 18
    of_system = (6 * 120) ** 2 * 8
    assert peak < 25 * (of_sightings + of_system)
    assert not np.array_equal(found.cam_from_world[1:], many.cam_from_world[1:])
