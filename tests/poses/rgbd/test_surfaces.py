"""Depth as surfaces: normals, contact, and poses from surfaces with and without features."""

import numpy as np
import pytest
from rooms import CAMERA, PLAIN_CORNER, filmed, freeze, off

from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import exp_twist, invert
from imodbatch.poses.rgbd.registration import bind, settle
from imodbatch.poses.rgbd.resection import Sightings
from imodbatch.poses.rgbd.surfaces import MAX_DEPTH_M, SOURCE_STEP, contact, surface

ODD = PinholeCamera(331, 247, 270.0, 272.0, 160.0, 121.0)


def plane(normal, distance, camera=CAMERA):
    """Depth of a plane {p: n·p = −distance} in front of the camera."""
    rays = camera.unproject(camera.pixel_centers(), 1.0)
    return freeze((-distance / (rays @ np.asarray(normal))).astype(np.float32))


def unit(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


TILTS = [(0, 0, -1), (0.3, 0, -1), (0, -0.5, -1), (-0.6, 0.4, -1)]


@pytest.mark.parametrize("normal", TILTS)
@pytest.mark.parametrize("camera", [CAMERA, ODD], ids=["even", "odd"])
def test_normals_and_points_of_a_plane(normal, camera):
    normal = unit(normal)
    found = surface(plane(normal, 1.5, camera), camera)
    known = np.isfinite(found.normals).all(axis=-1)
    assert known.mean() > 0.5
    assert np.abs(found.normals[known] - normal).max() < 2e-3
    assert np.median(np.abs(found.normals[known] - normal)) < 1e-3
    near = np.isfinite(found.points).all(axis=-1) & (found.points[..., 2] < 0.98 * MAX_DEPTH_M)
    assert np.abs(found.points[near] @ normal + 1.5).max() < 2e-3
    assert np.abs(found.samples @ normal + 1.5).max() < 1e-5


def test_an_edge_has_no_normal():
    depth = np.full((240, 320), 2.0, dtype=np.float32)
    depth[:, 160:] = 3.0
    normals = surface(depth, CAMERA).normals
    assert np.isnan(normals[:, 39:41]).all()
    assert np.isfinite(normals[1:-1, 2:38]).all()


def test_what_is_unknown_or_far_is_left_out():
    depth = np.full((240, 320), 2.0, dtype=np.float32)
    depth[:120] = np.nan
    depth[:, 160:] = MAX_DEPTH_M + 1
    found = surface(freeze(depth), CAMERA)
    assert np.isnan(found.points[:30]).all()
    assert np.isnan(found.points[:, 40:]).all()
    assert len(found.samples) == 320 * 240 / SOURCE_STEP**2 / 4
    assert np.isfinite(found.samples).all()
    nothing = surface(np.full((240, 320), np.nan, dtype=np.float32), CAMERA)
    assert nothing.samples.shape == (0, 3)
    assert not contact(found, nothing.samples, np.eye(4)).met.any()


def corner_surface(i=0):
    return surface(filmed(PLAIN_CORNER, "corner")[1][i], CAMERA)


def test_contact_with_itself_is_perfect():
    one = corner_surface()
    lies = contact(one, one.samples, np.eye(4))
    assert lies.met.mean() > 0.85
    assert np.abs(lies.error[lies.met]).max() < 0.5  # in standard deviations, of 4 mm and more
    assert np.median(np.abs(lies.error[lies.met])) < 0.02
    assert (lies.weight[~lies.met] == 0).all()
    assert (lies.error[~lies.met] == 0).all()
    assert np.isfinite(lies.jacobian).all()


def test_contact_away_from_it_is_none():
    one = corner_surface()
    behind = exp_twist(np.array([0, 0, -20.0, 0, 0, 0]))
    assert not contact(one, one.samples, behind).met.any()
    assert not contact(one, one.samples, exp_twist(np.array([0, 0, 0.5, 0, 0, 0]))).met.any()


def test_jacobian_of_contact_against_differences():
    one, other = corner_surface(), corner_surface(3)
    truth = filmed(PLAIN_CORNER, "corner")[2]
    guess = invert(truth[0]) @ truth[3] @ exp_twist(np.full(6, 0.004))
    lies = contact(one, other.samples, guess)
    for axis in range(6):
        ends = [
            contact(one, other.samples, exp_twist(step * np.eye(6)[axis]) @ guess)
            for step in (1e-6, -1e-6)
        ]
        same = lies.met & ends[0].met & ends[1].met
        # the standard deviation depends on z, too; its derivative is left out
        slope = (ends[0].error - ends[1].error)[same] / 2e-6
        difference = np.abs(slope - lies.jacobian[same, axis])
        # samples that change their pixel jump
        assert np.quantile(difference, 0.9) < 0.05 * np.abs(lies.jacobian[same]).max()


OFFSETS = [
    [0.03, 0, 0, 0, 0, 0], [0, -0.03, 0.02, 0, 0, 0], [0, 0, 0, 0.02, 0, 0],
    [0, 0, 0, 0, -0.02, 0.015], [0.02, 0.02, -0.02, 0.012, -0.01, 0.01],
]  # fmt: skip


@pytest.mark.parametrize("offset", OFFSETS)
def test_settle_recovers_an_offset_in_a_corner(offset):
    poses = filmed(PLAIN_CORNER, "corner")[2]
    one, other = corner_surface(), corner_surface(2)
    truth = invert(poses[2]) @ poses[0]
    guess = exp_twist(np.array(offset)) @ truth
    settled = settle(CAMERA, guess, None, other.samples, [(one, np.eye(4))])
    away = settled.cam_from_world @ invert(truth)
    assert np.linalg.norm(away[:3, 3]) < 0.004
    assert rotation_angle_rad(away[:3, :3]) < 0.002
    assert settled.met > 0.8
    assert settled.fitting > 0.95
    assert np.linalg.eigvalsh(settled.information)[0] > 1e3


def test_settle_takes_targets_of_any_world():
    poses = filmed(PLAIN_CORNER, "corner")[2]
    targets = [(corner_surface(i), invert(poses[i])) for i in (0, 4)]
    guess = exp_twist(np.array([0.02, 0, -0.02, 0.01, 0, 0])) @ invert(poses[2])
    settled = settle(CAMERA, guess, None, corner_surface(2).samples, targets)
    metres, radians = off(np.stack([poses[0], invert(settled.cam_from_world)]), poses[[0, 2]])
    assert metres.max() < 0.004
    assert radians.max() < 0.002


def bare_wall():
    return surface(plane([0, 0, -1], 1.5), CAMERA)


def test_a_bare_wall_says_nothing_along_itself():
    one = bare_wall()
    settled = settle(CAMERA, np.eye(4), None, one.samples, [(one, np.eye(4))])
    information = settled.information
    for free in (0, 1, 5):  # along the wall and about its normal
        assert information[free, free] < 1e-6 * information[2, 2]
    assert information[2, 2] > 1e5
    assert information[3, 3] > 1e4


def test_a_bare_wall_holds_its_distance_and_leaves_the_rest():
    one = bare_wall()
    guess = exp_twist(np.array([0.03, -0.02, 0.03, 0.01, 0.01, 0]))
    settled = settle(CAMERA, guess, None, one.samples, [(one, np.eye(4))])
    normal = settled.cam_from_world[:3, 2]
    assert normal == pytest.approx([0, 0, 1], abs=1e-4)
    assert settled.cam_from_world[2, 3] == pytest.approx(0, abs=1e-4)
    assert np.linalg.norm(settled.cam_from_world[:2, 3]) > 0.01  # as guessed, about


def test_features_hold_what_a_wall_leaves_open():
    one = bare_wall()
    rng = np.random.default_rng(0)
    points = CAMERA.unproject(rng.uniform((0, 0), (320, 240), (60, 2)), np.full(60, 1.5))
    seen = Sightings(
        points,
        np.concatenate([CAMERA.project(points), points[:, 2:]], axis=1),
        np.tile([1.0, 1.0, 0.01], (60, 1)),
    )
    guess = exp_twist(np.array([0.03, -0.02, 0.03, 0.01, 0.01, 0.01]))
    settled = settle(CAMERA, guess, seen, one.samples, [(one, np.eye(4))])
    assert settled.cam_from_world == pytest.approx(np.eye(4), abs=1e-4)


def test_nothing_to_settle_on():
    one, nothing = bare_wall(), np.zeros((0, 3))
    for samples, targets in ((nothing, [(one, np.eye(4))]), (one.samples, [])):
        settled = settle(CAMERA, np.eye(4), None, samples, targets)
        assert settled.cam_from_world == pytest.approx(np.eye(4))
        assert settled.met == settled.fitting == 0


def test_a_tie_is_a_relative_pose_with_its_certainty():
    poses = filmed(PLAIN_CORNER, "corner")[2]
    cam_from_world = invert(poses[[0, 4]])
    guess = [cam_from_world[0], invert(exp_twist(np.full(6, 0.01))) @ cam_from_world[1]]
    found = bind([corner_surface(), corner_surface(4)], guess, 0, 1)
    assert (found.first, found.second) == (1, 0)
    away = found.first_from_second @ cam_from_world[0] @ poses[4]
    assert np.linalg.norm(away[:3, 3]) < 0.005
    sigma = np.sqrt(np.diag(np.linalg.inv(found.information)))
    assert (sigma[:3] >= 0.002).all()  # never surer than the sensor's systematic errors
    assert (sigma[:3] < 0.02).all()
    on_wall = bind([bare_wall()] * 2, [np.eye(4)] * 2, 0, 1).information
    assert on_wall[0, 0] < 1 < on_wall[2, 2]


def test_surfaces_that_hardly_meet_are_not_tied():
    away = [np.eye(4), exp_twist(np.array([0, 0, -1.0, 0, 0, 0]))]
    assert bind([bare_wall()] * 2, away, 0, 1) is None
