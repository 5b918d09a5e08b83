"""Levelling: up from floor, table and walls of rooms whose truth is known."""

import numpy as np
import pytest

from imodbatch.core.frames import (
    apply,
    invert,
    make_transform,
    matrix_from_quaternion,
    rotation_between,
)
from imodbatch.engines.levelling import estimate_up
from imodbatch.errors import DataError

NOISE_M = 0.003


def rectangle(origin, side_a, side_b, n, rng):
    a, b = rng.uniform(size=(2, n, 1))
    points = np.array(origin) + a * np.array(side_a) + b * np.array(side_b)
    return points + rng.normal(0, NOISE_M, points.shape)


def room(rng, floor=True):
    """Points of a room in metres, +z up: floor, a table, two walls."""
    walls = [
        rectangle([2, -2, 0], [0, 4, 0], [0, 0, 2.5], 9000, rng),
        rectangle([-1, 2, 0], [3, 0, 0], [0, 0, 2.5], 7000, rng),
    ]
    level = [
        rectangle([-1, -2, 0], [3, 0, 0], [0, 4, 0], 9000, rng),
        rectangle([0.6, -0.5, 0.7], [0.8, 0, 0], [0, 1.2, 0], 3000, rng),
    ]
    return np.concatenate(walls + (level if floor else []))


def camera(center, azimuth_deg, pitch_deg):
    """room_from_cam of a camera pitched down from the horizon."""
    azimuth, pitch = np.radians([azimuth_deg, pitch_deg])
    z = np.array([np.cos(pitch) * np.cos(azimuth), np.cos(pitch) * np.sin(azimuth), -np.sin(pitch)])
    x = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    return make_transform(np.stack([x, np.cross(z, x), z], axis=1), center)


def scene(tilt, pitch_deg=30.0, floor=True, seed=0):
    """Points per camera, world_from_cam, and true up in a world tilted by a rotation."""
    rng = np.random.default_rng(seed)
    world_from_room = make_transform(tilt, [0.3, -0.2, 0.9])
    poses, clouds = [], []
    for azimuth_deg in (-20, 0, 20, 40):
        room_from_cam = camera([-1.5, -0.5, 1.5], azimuth_deg, pitch_deg)
        points = room(rng, floor)
        clouds.append(apply(invert(room_from_cam), points[rng.random(len(points)) < 0.5]))
        poses.append(world_from_room @ room_from_cam)
    return clouds, poses, tilt @ np.array([0.0, 0.0, 1.0])


def off_deg(direction, truth):
    return np.degrees(np.arccos(np.clip(direction @ truth, -1, 1)))


TILTS = {
    "none": np.eye(3),
    "20 degrees": matrix_from_quaternion([np.cos(0.1745), np.sin(0.1745), 0, 0]),
    "y down, as SLAM gives it": rotation_between([0, 0, 1], [0.1, -1, 0.2]),
    "upside down": rotation_between([0, 0, 1], [0.05, 0.1, -1]),
    "any": matrix_from_quaternion([0.3, -0.7, 0.5, 0.2]),
}


@pytest.mark.parametrize("tilt", TILTS.values(), ids=TILTS)
def test_up_is_found_in_a_tilted_world(tilt):
    clouds, poses, truth = scene(tilt)
    up = estimate_up(clouds, poses, "s")
    assert np.linalg.norm(up.direction) == pytest.approx(1)
    assert off_deg(up.direction, truth) < 1
    mean_up = np.mean([-pose[:3, 1] for pose in poses], axis=0)
    tilt_deg = off_deg(mean_up / np.linalg.norm(mean_up), truth)
    assert 25 < tilt_deg < 30
    assert up.tilt_deg == pytest.approx(tilt_deg, abs=1)
    assert 0.2 < up.plane_share < 0.8
    assert f"{up.tilt_deg:.0f}° from the cameras' mean up" in str(up)


@pytest.mark.parametrize("pitch_deg", [0.0, 15.0, 40.0])
def test_the_cameras_pitch_does_not_turn_up(pitch_deg):
    clouds, poses, truth = scene(TILTS["any"], pitch_deg)
    assert off_deg(estimate_up(clouds, poses, "s").direction, truth) < 1


def test_a_table_alone_is_enough():
    rng = np.random.default_rng(0)
    room_from_cam = camera([-1.0, 0, 1.4], 0, 30)
    table = rectangle([0, -0.6, 0.7], [0.8, 0, 0], [0, 1.2, 0], 6000, rng)
    world_from_room = make_transform(TILTS["20 degrees"], np.zeros(3))
    up = estimate_up([apply(invert(room_from_cam), table)], [world_from_room @ room_from_cam], "s")
    assert off_deg(up.direction, TILTS["20 degrees"] @ [0, 0, 1]) < 1


def test_the_same_input_gives_the_same_direction():
    clouds, poses, _ = scene(TILTS["any"])
    directions = [estimate_up(clouds, poses, "s").direction for _ in range(3)]
    assert all(np.array_equal(direction, directions[0]) for direction in directions)


def test_inputs_are_not_written_into():
    clouds, poses, _ = scene(np.eye(3))
    copies = [cloud.copy() for cloud in clouds]
    for array in (*clouds, *poses):
        array.setflags(write=False)
    estimate_up(clouds, poses, "s")
    assert all(np.array_equal(a, b) for a, b in zip(clouds, copies, strict=True))


def fault(action, *mentions):
    with pytest.raises(DataError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in ("seq-07: ", "Give world.up in the manifest", *mentions):
        assert mention in text


def test_walls_alone_do_not_tell_up():
    clouds, poses, _ = scene(TILTS["any"], pitch_deg=20, floor=False)
    fault(lambda: estimate_up(clouds, poses, "seq-07"), "no floor or table plane")


def test_a_cloud_without_planes_does_not_tell_up():
    rng = np.random.default_rng(0)
    cloud = rng.uniform([-1.5, -1.5, 0.5], [1.5, 1.5, 3.5], (4000, 3))
    fault(
        lambda: estimate_up([cloud], [np.eye(4)], "seq-07"), "no floor or table plane", "5 % needed"
    )


def test_no_depth_does_not_tell_up():
    fault(lambda: estimate_up([], [], "seq-07"), "no depth")
    none = [np.zeros((0, 3))] * 2
    fault(lambda: estimate_up(none, [np.eye(4)] * 2, "seq-07"), "no depth")


def test_frames_without_depth_do_not_disturb_the_others():
    clouds, poses, truth = scene(TILTS["20 degrees"])
    clouds[1] = np.zeros((0, 3))
    assert off_deg(estimate_up(clouds, poses, "s").direction, truth) < 1
