"""Camera paths of a small robot: round the furniture, or towards it from afar.

The camera is carried 1.0 to 1.5 m above the floor and is turned to the furniture's middle, with
a slow wander of where exactly it looks.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.frames import make_transform
from imodbatch.core.viewpoint import FULL_TURN_RAD

Array = NDArray[np.float64]
TARGET_WORLD = np.array([0.0, 0.0, 0.55])
LOWEST_M, HIGHEST_M = 1.0, 1.5


def look_at(camera_world: ArrayLike, target_world: ArrayLike) -> Array:
    """Level cameras at (..., 3) that look at targets (..., 3): world_from_cam (..., 4, 4).

    The line of sight must not be vertical.
    """
    center = np.asarray(camera_world, dtype=np.float64)
    forward = np.asarray(target_world, dtype=np.float64) - center
    forward = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right, axis=-1, keepdims=True)
    down = np.cross(forward, right)
    return make_transform(np.stack([right, down, forward], axis=-1), center)


def circle(rng: np.random.Generator, n_frames: int) -> Array:
    """A walk round the furniture, 270° to 360°, in either direction: (F, 4, 4) world_from_cam."""
    time = np.linspace(0, 1, n_frames)
    sweep = np.deg2rad(rng.uniform(270, 360)) * rng.choice([-1.0, 1.0])
    azimuth = rng.uniform(0, FULL_TURN_RAD) + sweep * time
    distance = rng.uniform(1.35, 1.6) + 0.1 * np.sin(FULL_TURN_RAD * (2 * time + rng.random()))
    return _walk(rng, time, azimuth, distance)


def approach(rng: np.random.Generator, n_frames: int) -> Array:
    """A walk from 3.5 m away to about 1 m, weaving by up to 40°: (F, 4, 4) world_from_cam."""
    time = np.linspace(0, 1, n_frames)
    weave = np.deg2rad(rng.uniform(20, 40)) * np.sin(FULL_TURN_RAD * (time + rng.random()))
    azimuth = rng.uniform(0, FULL_TURN_RAD) + weave
    distance = 3.5 + (rng.uniform(0.95, 1.15) - 3.5) * time
    return _walk(rng, time, azimuth, distance)


def _walk(rng: np.random.Generator, time: Array, azimuth: Array, distance: Array) -> Array:
    middle, swing = (LOWEST_M + HIGHEST_M) / 2, (HIGHEST_M - LOWEST_M) / 2
    height = middle + swing * np.sin(FULL_TURN_RAD * (time + rng.random()))
    center = np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth), height], axis=-1)
    wander = 0.08 * np.sin(FULL_TURN_RAD * (time[:, None] * [2, 3, 1] + rng.random(3)))
    return look_at(center, TARGET_WORLD + wander)


PATHS = (circle, approach)
"""Sequences take them in turn."""
