"""Images of a rendered scene agree with its true poses, and faults in poses or depth show."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import exp_twist, invert, make_transform
from imodbatch.core.pairs import neighbours
from imodbatch.lab.analytic.path import look_at
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.rgbd.trajectory_checks import loop_errors, reprojection_errors_px

CAMERA = PinholeCamera(320, 240, 290.0, 290.0, 160.0, 120.0)
N_FRAMES = 8
NEXT = neighbours(np.ones(N_FRAMES, dtype=np.bool_))
MOVED = 4


# floor, back wall, side wall: (axis that is constant, its value in metres)
PLANES = ((2, 0.0), (0, -1.0), (1, -1.2))
STAIN_M = 0.03


@cache
def walk():
    """Poses (F, 4, 4), colour images and exact depth in a stained corner; all read-only."""
    angle = 0.5 + 0.03 * np.arange(N_FRAMES)
    center = np.stack([1.3 * np.cos(angle), 1.3 * np.sin(angle), 1.3 + 0.02 * angle], axis=-1)
    poses = look_at(center, np.array([-0.5, -0.6, 0.4]))
    color, depth = (np.stack(images) for images in zip(*map(render, poses), strict=True))
    for array in (poses, color, depth):
        array.setflags(write=False)
    return poses, color, depth


def render(world_from_cam):
    """Colour and z-depth of three planes with smooth random stains, ray by ray."""
    rays = CAMERA.unproject(CAMERA.pixel_centers(), 1.0) @ world_from_cam[:3, :3].T
    start = world_from_cam[:3, 3]
    with np.errstate(divide="ignore"):
        depths = np.stack([(at - start[axis]) / rays[..., axis] for axis, at in PLANES])
    depths = np.where(depths > 0, depths, np.inf)
    depth = depths.min(axis=0)
    hit = start + depth[..., None] * rays
    grey = np.zeros(depth.shape)
    for number, (axis, _) in enumerate(PLANES):
        here = depths.argmin(axis=0) == number
        grey[here] = stains(number, np.delete(hit[here], axis, axis=1))
    return np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8), depth.astype(np.float32)


def stains(seed, places):
    """Brightness (n,) at places (n, 2) in metres: random values on a grid, smooth in between."""
    values = np.random.default_rng(seed).uniform(20, 235, size=(400, 400))
    at = places / STAIN_M + 200
    cell = np.floor(at).astype(int)
    part = at - cell
    smooth = part * part * (3 - 2 * part)
    x, y = smooth.T
    i, j = cell.T
    top = values[i, j] * (1 - y) + values[i, j + 1] * y
    return top * (1 - x) + (values[i + 1, j] * (1 - y) + values[i + 1, j + 1] * y) * x


def frames(color=None, depth=None):
    _, colors, depths = walk()
    return RgbdFrames(
        "walk",
        np.arange(N_FRAMES),
        None,
        CAMERA,
        tuple(Path(f"{i}.png") for i in range(N_FRAMES)),
        (lambda i: colors[i]) if color is None else color,
        (lambda i: depths[i]) if depth is None else depth,
    )


def with_one_moved(twist):
    poses = np.array(walk()[0])
    poses[MOVED] = poses[MOVED] @ exp_twist(np.array(twist))
    poses.setflags(write=False)
    return poses


def test_true_poses_put_features_where_they_are_found():
    errors = reprojection_errors_px(frames(), walk()[0], NEXT)
    assert len(errors) == len(NEXT)
    assert errors.max() < 0.25  # half a pixel would be a mistaken convention


def test_a_pose_moved_by_5_cm_shows_in_its_two_pairs():
    true = reprojection_errors_px(frames(), walk()[0], NEXT)
    moved = reprojection_errors_px(frames(), with_one_moved([0.05, 0, 0, 0, 0, 0]), NEXT)
    touched = (NEXT == MOVED).any(axis=1)
    assert moved[~touched] == pytest.approx(true[~touched])
    assert (moved[touched] > 5).all()  # 290 px · 0.05 m / 1.5 m is 10 px


def test_inverse_poses_show():
    errors = reprojection_errors_px(frames(), invert(walk()[0]), NEXT)
    assert np.median(errors) > 10 * reprojection_errors_px(frames(), walk()[0], NEXT).max()


def test_a_wrong_scale_of_depth_shows():
    depths = walk()[2]
    errors = reprojection_errors_px(frames(depth=lambda i: 1.3 * depths[i]), walk()[0], NEXT)
    assert np.median(errors) > 1


def test_without_depth_nothing_is_said():
    nothing = np.full((240, 320), np.nan, dtype=np.float32)
    assert len(reprojection_errors_px(frames(depth=lambda _: nothing), walk()[0], NEXT)) == 0
    assert len(reprojection_errors_px(frames(depth=lambda _: None), walk()[0], NEXT)) == 0


def test_images_without_texture_or_missing_ones_are_passed_over():
    colors = walk()[1]
    grey = np.full_like(colors[0], 90)
    for absent in (None, grey):
        some = frames(color=lambda i, absent=absent: absent if i == 2 else colors[i])
        assert len(reprojection_errors_px(some, walk()[0], NEXT)) == len(NEXT) - 2
        translation_m, _ = loop_errors(some, walk()[0], np.array([[0, 2], [2, 3], [0, 1]]))
        assert len(translation_m) == 1


def test_the_same_twice():
    first, second = (reprojection_errors_px(frames(), walk()[0], NEXT) for _ in range(2))
    assert (first == second).all()
    pairs = np.array([[0, 3], [1, 5]])
    assert np.array_equal(
        loop_errors(frames(), walk()[0], pairs), loop_errors(frames(), walk()[0], pairs)
    )


def test_the_images_tell_the_true_relative_pose():
    pairs = np.array([[0, 2], [1, 3], [2, 4], [3, 5], [4, 6], [7, 5]])
    translation_m, rotation_rad = loop_errors(frames(), walk()[0], pairs)
    assert len(translation_m) >= 5
    assert np.median(translation_m) < 0.01
    assert np.degrees(np.median(rotation_rad)) < 0.4


def test_drift_shows_by_its_size():
    pairs = np.array([[2, MOVED], [3, MOVED]])
    translation_m, rotation_rad = loop_errors(
        frames(), with_one_moved([0, 0, 0.2, 0, 0.1, 0]), pairs
    )
    assert translation_m == pytest.approx(0.2, abs=0.02)
    assert rotation_rad == pytest.approx(0.1, abs=0.01)


def test_a_rigid_motion_of_the_world_changes_nothing():
    elsewhere = make_transform(np.diag([-1.0, -1.0, 1.0]), [5, 6, 7]) @ walk()[0]
    assert reprojection_errors_px(frames(), elsewhere, NEXT) == pytest.approx(
        reprojection_errors_px(frames(), walk()[0], NEXT), abs=1e-6
    )


def test_no_pairs():
    none = np.zeros((0, 2), dtype=np.int64)
    assert reprojection_errors_px(frames(), walk()[0], none).shape == (0,)
    assert [len(errors) for errors in loop_errors(frames(), walk()[0], none)] == [0, 0]


@pytest.mark.parametrize("shape", [(3, 4), (12, 16), (40, 60)])
def test_tiny_images(shape):
    color = np.random.default_rng(0).integers(0, 255, (*shape, 3), dtype=np.uint8)
    depth = np.full(shape, 2.0, dtype=np.float32)
    camera = PinholeCamera(shape[1], shape[0], 50.0, 50.0, shape[1] / 2, shape[0] / 2)
    tiny = replace(frames(lambda _: color, lambda _: depth), camera=camera)
    assert len(reprojection_errors_px(tiny, walk()[0], NEXT)) in {0, len(NEXT)}
    assert len(loop_errors(tiny, walk()[0], NEXT)[0]) in {0, len(NEXT)}
