"""Motion by brightness and depth as a whole, and when it says nothing."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import CAMERA, PLAIN_CORNER, Room, filmed, look, off, render

from imodbatch.core.frames import invert
from imodbatch.poses.rgbd.features import FeatureExtractor
from imodbatch.poses.rgbd.surfaces import surface
from imodbatch.poses.slam.dense import dense_motion
from imodbatch.poses.slam.frame import Frame, Seen


def seen(gray, depth_m):
    features = FeatureExtractor(CAMERA, 100).extract(gray, depth_m)
    return Seen(gray, depth_m, Frame(features, surface(depth_m, CAMERA), CAMERA))


def images(room, path, i, j):
    """Two frames of a walk, and new_from_old in truth."""
    colors, depths, poses = filmed(room, path)
    old, new = (seen(np.ascontiguousarray(colors[k][..., 0]), depths[k]) for k in (i, j))
    return old, new, invert(poses[j]) @ poses[i]


@pytest.mark.parametrize("step", [1, 2])
def test_dense_motion_in_a_corner_without_texture(step):
    old, new, truth = images(PLAIN_CORNER, "corner", 5, 5 + step)
    found = dense_motion(old, new)
    metres, radians = off(np.stack([np.eye(4), found]), np.stack([np.eye(4), truth]))
    assert metres.max() < 0.004
    assert radians.max() < 0.003


def test_dense_motion_along_a_bare_wall_is_none():
    old, new, _ = images(Room(boxes=(), plain=True), "wall", 3, 4)
    assert dense_motion(old, new) is None


def test_dense_motion_between_different_shapes_is_none():
    old, _, _ = images(PLAIN_CORNER, "corner", 0, 1)
    other = seen(*render(PLAIN_CORNER, look([-1.0, -1.0, 1.2], 200, 30)))
    assert dense_motion(old, other) is None


def test_dense_motion_needs_the_same_print():
    """The same shape, but another wallpaper: depth alone would say that nothing moved."""
    old, new, _ = images(Room(boxes=()), "corner", 0, 0)
    other = images(Room(seed=5, boxes=()), "corner", 0, 0)[0]
    assert dense_motion(old, replace(new, gray=other.gray)) is None
    assert dense_motion(old, new) == pytest.approx(np.eye(4), abs=1e-3)
