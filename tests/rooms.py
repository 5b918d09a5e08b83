"""Textured rooms seen by a camera whose path is known: ``from rooms import ...``.

A room is axis-parallel: an outer box seen from inside and smaller boxes seen from outside. Colour
and exact z-depth come ray by ray; x points ahead, y left, z up. All arrays are read-only: an engine
that writes into its input fails.
"""

from dataclasses import dataclass
from functools import cache, partial

import cv2
import numpy as np

from imodbatch.core.alignment import align_poses, rotation_angle_rad
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import invert, make_transform
from imodbatch.poses.rgbd import RgbdFrames

CAMERA = PinholeCamera(320, 240, 270.0, 272.0, 158.0, 121.0)
TEXEL_M = 1 / 160
N_TEXELS = 1024
OUTER = ((-2.0, -2.2, 0.0), (2.4, 1.8, 2.5))
FURNITURE = (
    ((1.0, -0.9, 0.0), (1.7, -0.2, 0.8)),
    ((1.2, 0.4, 0.0), (1.9, 1.0, 1.3)),
    ((-1.4, 0.5, 0.0), (-0.7, 1.2, 0.6)),
    ((-1.5, -1.6, 0.0), (-0.8, -0.8, 0.9)),
)


@dataclass(frozen=True)
class Room:
    """Boxes (lower and upper corner) and what is printed on them; plain = one grey, no print."""

    seed: int = 0
    boxes: tuple = FURNITURE
    outer: tuple = OUTER
    plain: bool = False


EMPTY = Room(boxes=())
PLAIN_CORNER = Room(boxes=(), plain=True)


@cache
def print_of(seed):
    """Grey noise of several grain sizes, (N, N), 0 to 255."""
    rng = np.random.default_rng(seed)
    total = np.zeros((N_TEXELS, N_TEXELS), dtype=np.float32)
    for grains in (32, 64, 128, 256):
        values = rng.normal(size=(grains, grains)).astype(np.float32)
        total += cv2.resize(values, (N_TEXELS, N_TEXELS), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 42 * total, 0, 255)


def look(center, azimuth_deg, pitch_deg=10.0):
    """world_from_cam of a camera that looks along an azimuth, pitched down from the horizon."""
    azimuth, pitch = np.radians([azimuth_deg, pitch_deg])
    ahead = [np.cos(pitch) * np.cos(azimuth), np.cos(pitch) * np.sin(azimuth), -np.sin(pitch)]
    right = [np.sin(azimuth), -np.cos(azimuth), 0.0]
    down = np.cross(ahead, right)
    return make_transform(np.stack([right, down, ahead], axis=1), center)


def render(room, world_from_cam, camera=CAMERA):
    """Grey (H, W) and z-depth (H, W) of a room."""
    rays = camera.unproject(camera.pixel_centers(), 1.0) @ world_from_cam[:3, :3].T
    rays = np.ascontiguousarray(np.moveaxis(rays, -1, 0))
    start = world_from_cam[:3, 3, None, None]
    depth = np.full(rays.shape[1:], np.inf)
    box_of, axis_of = np.zeros(depth.shape, dtype=int), np.zeros(depth.shape, dtype=int)
    for number, (low, high) in enumerate((room.outer, *room.boxes)):
        with np.errstate(divide="ignore"):
            a, b = ((np.reshape(corner, (3, 1, 1)) - start) / rays for corner in (low, high))
        near, far = np.minimum(a, b), np.maximum(a, b)
        enters, leaves = near.max(axis=0), far.min(axis=0)
        if number == 0:
            at, axis = leaves, far.argmin(axis=0)
            hit = np.ones(depth.shape, dtype=bool)
        else:
            at, axis = enters, near.argmax(axis=0)
            hit = (enters < leaves) & (enters > 0.05) & (enters < depth)
        depth[hit], axis_of[hit], box_of[hit] = at[hit], axis[hit], number
    if room.plain:
        gray = np.full(depth.shape, 120.0)
    else:
        gray = _printed(room, start + depth * rays, box_of, axis_of, rays)
    return np.rint(gray).astype(np.uint8), depth.astype(np.float32)


def _printed(room, places, box_of, axis_of, rays):
    gray = np.zeros(box_of.shape)
    ahead = np.take_along_axis(rays, axis_of[None], axis=0)[0] > 0
    face_of = 6 * box_of + 2 * axis_of + ahead
    for face in np.unique(face_of):
        here = face_of == face
        number, axis = int(face) // 6, int(face) % 6 // 2
        # a print moves with its box
        low = (room.outer, *room.boxes)[number][0]
        u, v = (
            ((places[k][here] - low[k]) / TEXEL_M + 37.0) % (N_TEXELS - 1)
            for k in range(3)
            if k != axis
        )
        image = print_of(1000 * room.seed + int(face))
        gray[here] = _bilinear(image, u, v)
    return gray


def _bilinear(image, u, v):
    column, row = u.astype(int), v.astype(int)
    a, b = u - column, v - row
    top = image[row, column] * (1 - a) + image[row, column + 1] * a
    bottom = image[row + 1, column] * (1 - a) + image[row + 1, column + 1] * a
    return top * (1 - b) + bottom * b


def freeze(array):
    """The same, read-only."""
    array.setflags(write=False)
    return array


def film(room, poses, camera=CAMERA):
    """Colour images and depth images of a walk through a room."""
    images = [render(room, pose, camera) for pose in poses]
    colors = [freeze(np.repeat(gray[..., None], 3, axis=2)) for gray, _ in images]
    return colors, [freeze(depth) for _, depth in images]


@cache
def filmed(room, path):
    """`film` of a named path, once per room."""
    poses = PATHS[path]()
    return (*film(room, poses), freeze(poses))


def frames_of(colors, depths, camera=CAMERA, sequence_id="walk"):
    """The images as an engine takes them; None among them stands for a damaged file."""
    return RgbdFrames(
        sequence_id,
        np.arange(len(colors)),
        None,
        camera,
        (),
        lambda i: colors[i],
        lambda i: depths[i],
    )


def walk(n=30):
    """Along a curve through the room, turning a little: 2 cm and 1° per frame."""
    t = np.arange(n)
    return np.stack(
        [
            look([-0.9 + 0.02 * i, -0.4 + 0.3 * np.sin(i / 15), 1.3 + 0.03 * np.sin(i / 5)],
                 25 * np.sin(i / 20), 12 + 3 * np.sin(i / 7))
            for i in t
        ]
    )  # fmt: skip


def turn(n=37):
    """On the spot by 90° and back."""
    azimuth = 90 * (1 - np.abs(np.linspace(-1, 1, n)))
    return np.stack([look([-0.2, -0.2, 1.3], a, 12) for a in azimuth])


def corner(n=24):
    """Towards a corner of the room that stays in view with its floor."""
    return np.stack(
        [look([0.9 - 0.008 * i, 0.3 + 0.01 * i, 1.5], 45 + 0.5 * i, 30) for i in range(n)]
    )


def wall(n=20):
    """Along a wall, with nothing but it in view."""
    return np.stack([look([1.2, -0.8 + 0.02 * i, 1.25], 0.0, 0.0) for i in range(n)])


def other(n=30):
    """A walk that looks the other way."""
    return np.stack([look([0.6 - 0.02 * i, 0.2, 1.3], 180 - 0.7 * i, 15) for i in range(n)])


def circle(n=60):
    """Round a circle, once and a bit, looking outwards."""
    angle = np.linspace(0, 400, n)
    return np.stack(
        [
            look([0.3 * np.cos(np.radians(a)), 0.3 * np.sin(np.radians(a)), 1.3], a, 10)
            for a in angle
        ]
    )


PATHS = {f.__name__: f for f in (walk, turn, corner, wall, other, circle)}
PATHS["short"] = partial(walk, 8)


def off(trajectory_poses, truth, by_first=True):
    """Errors in metres and radians (n,) of the poses (F, 4, 4) that are there.

    The worlds are brought together by the first pose that is there, or by all of them.
    """
    known = np.isfinite(trajectory_poses[:, 0, 0])
    found, true = trajectory_poses[known], truth[known]
    if by_first:
        found = true[0] @ invert(found[0]) @ found
    else:
        found = align_poses(true, found).poses(found)
    away = invert(true) @ found
    return np.linalg.norm(away[:, :3, 3], axis=1), rotation_angle_rad(away[:, :3, :3])
