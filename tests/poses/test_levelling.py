"""Levelling: up from rooms whose truth is known, of which each camera sees what it would see."""

import numpy as np
import pytest

from imodbatch.core.errors import DataError
from imodbatch.core.frames import make_transform, matrix_from_quaternion, rotation_between
from imodbatch.poses.levelling import estimate_up

NOISE = 0.004  # of depth, times its square


def rising(start, width, length, slope_deg):
    """A rectangle from the middle of its lower edge along +x, rising."""
    slope = np.radians(slope_deg)
    along = length * np.array([np.cos(slope), 0, np.sin(slope)])
    return np.array(start) - [0, width / 2, 0], [0, width, 0], along


# rectangles of a room in metres, +z up: a corner and two sides
FLOOR = ([-1, -3, 0], [5, 0, 0], [0, 6, 0])
CEILING = ([-1, -3, 2.5], [5, 0, 0], [0, 6, 0])
FRONT_WALL = ([3, -3, 0], [0, 6, 0], [0, 0, 2.5])
LEFT_WALL = ([-1, 2, 0], [4, 0, 0], [0, 0, 2.5])
TABLE = ([0.6, -0.5, 0.7], [0.8, 0, 0], [0, 1.2, 0])
ROOM = (FLOOR, FRONT_WALL, LEFT_WALL, TABLE)


def camera(center, azimuth_deg, pitch_deg, roll_deg=0.0):
    """room_from_cam of a camera pitched down from the horizon."""
    azimuth, pitch, roll = np.radians([azimuth_deg, pitch_deg, roll_deg])
    z = np.array([np.cos(pitch) * np.cos(azimuth), np.cos(pitch) * np.sin(azimuth), -np.sin(pitch)])
    x = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    y = np.cross(z, x)
    x, y = np.cos(roll) * x + np.sin(roll) * y, -np.sin(roll) * x + np.cos(roll) * y
    return make_transform(np.stack([x, y, z], axis=1), center)


def cameras(pitch_deg, roll_deg=0.0, center=(-0.8, -0.5, 1.5), azimuths_deg=(-20, 0, 20, 40)):
    return [camera(center, azimuth_deg, pitch_deg, roll_deg) for azimuth_deg in azimuths_deg]


def seen(rectangles, room_from_cam, rng):
    """Points (P, 3) in the camera that a depth sensor would give: the nearest, up to 4 m."""
    u, v = np.meshgrid((np.arange(120) - 59.5) / 98, (np.arange(90) - 44.5) / 98)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    directions, origin = rays @ room_from_cam[:3, :3].T, room_from_cam[:3, 3]
    depth = np.full(len(rays), np.inf)
    for corner, side_a, side_b in (map(np.array, rectangle) for rectangle in rectangles):
        normal = np.cross(side_a, side_b)
        slant = directions @ normal
        slant[slant == 0] = np.nan
        z = (corner - origin) @ normal / slant
        hit = origin + z[:, None] * directions - corner
        a, b = hit @ side_a / (side_a @ side_a), hit @ side_b / (side_b @ side_b)
        inside = (z > 0.3) & (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1)
        depth = np.where(inside & (z < depth), z, depth)
    near = depth < 4.0
    noisy = depth[near] + rng.normal(0, NOISE, near.sum()) * depth[near] ** 2
    return rays[near] * noisy[:, None]


def scene(tilt, rectangles=ROOM, views=None, seed=0):
    """Points per camera, world_from_cam, and true up in a world tilted by a rotation."""
    rng = np.random.default_rng(seed)
    world_from_room = make_transform(tilt, [0.3, -0.2, 0.9])
    views = cameras(30.0) if views is None else views
    clouds = [seen(rectangles, room_from_cam, rng) for room_from_cam in views]
    return clouds, [world_from_room @ view for view in views], tilt @ np.array([0.0, 0.0, 1.0])


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
    assert off_deg(up.direction, truth) < 1.5
    mean_up = np.mean([-pose[:3, 1] for pose in poses], axis=0)
    tilt_deg = off_deg(mean_up / np.linalg.norm(mean_up), truth)
    assert up.tilt_deg == pytest.approx(tilt_deg, abs=1.5)
    assert up.n_level >= 2
    assert up.n_upright >= 1
    assert 0.5 < up.plane_share <= 1
    assert 0.5 < up.uncertainty_deg < 1.5
    assert up.margin > 0.8
    assert f"± {up.uncertainty_deg:.1f}° from {up.n_level} level and {up.n_upright} upright" in str(
        up
    )
    assert f"{up.tilt_deg:.0f}° from the cameras' mean up" in str(up)
    assert up.figures() == {
        "up_uncertainty_deg": up.uncertainty_deg,
        "up_plane_share": up.plane_share,
        "up_margin": up.margin,
    }


BOOK_SHELF = rising([1.4, 0.3, 0.0], 1.6, 2.0, 75)
SOFA = (([0.8, -1, 0.42], [0.6, 0, 0], [0, 2, 0]), rising([1.4, 0, 0.4], 2, 0.7, 70))
LAPTOP = (TABLE, rising([1.1, 0, 0.7], 0.5, 0.35, 65), rising([0.8, 0.3, 0.7], 0.3, 0.3, 30))
AHEAD = {"center": (0.5, -0.5, 1.2), "azimuths_deg": (-10, 0, 10)}
BEARABLE = {
    "level cameras": (ROOM, cameras(0)),
    "cameras pitched down by 15°": (ROOM, cameras(15)),
    "cameras pitched down by 60°": (ROOM, cameras(60)),
    "a floor alone under cameras pitched down by 60°": ((FLOOR,), cameras(60)),
    "a table alone": ((TABLE,), [camera([-0.2, 0, 1.4], 0, 30)]),
    "cameras rolled by 30°": (ROOM, cameras(25, 30)),
    "a wall and some floor seen by rolled cameras": ((FLOOR, FRONT_WALL), cameras(10, 30, **AHEAD)),
    "a sofa's back": ((FLOOR, LEFT_WALL, *SOFA), cameras(20, center=(-0.5, -0.3, 1.3))),
    "a leaning book shelf": ((FLOOR, FRONT_WALL, BOOK_SHELF), cameras(15)),
    "a laptop's lid": (LAPTOP, cameras(35, center=(0.2, 0, 1.2), azimuths_deg=(-5, 5))),
    "two walls that meet": ((FRONT_WALL, LEFT_WALL), cameras(0, center=(-0.5, -0.5, 1.2))),
}


@pytest.mark.parametrize("name", BEARABLE)
def test_up_is_found_with(name):
    clouds, poses, truth = scene(TILTS["any"], *BEARABLE[name])
    up = estimate_up(clouds, poses, "s")
    assert off_deg(up.direction, truth) < 2
    assert up.uncertainty_deg < 4


RAMP = rising([0.3, -0.2, 0], 2.4, 2.2, 25)
VALLEY = (
    ([0, -1.5, 0.5], [3, 0, 0], [0, 1.5, -0.5]),
    ([0, 0, 0], [3, 0, 0], [0, 1.5, 0.5]),
)
MISLEADING = {
    "a ramp larger than the floor": ((FLOOR, RAMP), cameras(35)),
    "a ramp larger than the floor, and walls": ((FLOOR, FRONT_WALL, LEFT_WALL, RAMP), cameras(25)),
    "two slopes that face each other": (VALLEY, [camera([-0.8, 0, 1.2], 0, 30)]),
    "a wall alone seen from below": ((FRONT_WALL,), cameras(-20, **AHEAD)),
    "walls and a ceiling": ((FRONT_WALL, LEFT_WALL, CEILING), cameras(-25)),
}


@pytest.mark.parametrize("name", MISLEADING)
def test_what_misleads_is_refused_rather_than_levelled_askew(name):
    clouds, poses, truth = scene(TILTS["20 degrees"], *MISLEADING[name])
    try:
        off = off_deg(estimate_up(clouds, poses, "seq-07").direction, truth)
    except DataError as error:
        off, refusal = 0.0, str(error)
    else:
        refusal = "ambiguous"
    assert off < 2
    assert "ambiguous" in refusal


def test_more_surfaces_make_up_surer():
    def uncertainty(*rectangles):
        clouds, poses, _ = scene(np.eye(3), rectangles)
        return estimate_up(clouds, poses, "s").uncertainty_deg

    assert uncertainty(*ROOM) < uncertainty(FLOOR, FRONT_WALL, TABLE) < uncertainty(FLOOR)


def test_surfaces_that_disagree_make_up_less_sure():
    """A floor and a large platform on it, level or leaning by 5°."""

    def uncertainty(slope_deg):
        platform = rising([0.6, -0.3, 0.3], 2.4, 2.0, slope_deg)
        clouds, poses, _ = scene(np.eye(3), (FLOOR, platform), cameras(35))
        return estimate_up(clouds, poses, "s").uncertainty_deg

    assert uncertainty(5) > 1.3 * uncertainty(0)


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


def test_a_wall_alone_does_not_tell_up():
    clouds, poses, _ = scene(TILTS["any"], (FRONT_WALL,), cameras(0, **AHEAD))
    fault(
        lambda: estimate_up(clouds, poses, "seq-07"),
        "no floor or table plane",
        "walls that face one way do not tell up",
    )


def test_the_setting_that_cures_is_the_one_of_the_poses_source():
    setting = "world.first_camera_up"
    with pytest.raises(DataError, match=f"Give {setting} in the manifest"):
        estimate_up([], [], "s", setting)


def test_two_directions_that_do_as_well_are_both_named():
    clouds, poses, _ = scene(np.eye(3), *MISLEADING["two slopes that face each other"])
    mentions = ("ambiguous: two directions", " 0.3", "-0.3", "0.95)")
    fault(lambda: estimate_up(clouds, poses, "seq-07"), *mentions)


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
