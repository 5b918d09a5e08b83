"""How a person carries a camera about a table: an arc, at arm's length, with an unsteady hand.

Each kind of place is walked round as far as such a place allows: a desk from its front, a free
table almost all the way.
"""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import make_transform
from imodbatch.core.viewpoint import FULL_TURN_RAD
from imodbatch.lab.analytic.path import look_at
from imodbatch.lab.houses.planner import smoothed
from imodbatch.lab.houses.world import House
from imodbatch.lab.tabletop.world import middle_of, walk_random

Array = NDArray[np.float64]
SWEEP_DEG: dict[str, tuple[float, float]] = {
    "desk": (90, 150),
    "kitchen_small": (100, 170),
    "meeting_small": (150, 240),
    "table": (200, 300),
    "table_small": (200, 320),
}
"""Least and most, by kind of place."""
NEAREST_M, FARTHEST_M = 0.8, 2.2
LOWEST_DEG, HIGHEST_DEG = 22.0, 58.0
HIGHEST_M = 1.95
CLEAR_M = 0.25
"""From tall furniture and walls."""
TALL = frozenset({"cabinet", "shelf", "floor_lamp", "plant"})
HAND_M, HAND_DEG, HAND_FRAMES = 0.006, 0.8, 2.5
"""How far the hand strays, and over how many frames it takes to."""
ROLL_DEG = 4.0


def make_walk(house: House, kind: str, n_frames: int) -> Array:
    """True poses of the camera.

    Args:
        house: of `make_tabletop`.
        kind: of place, a key of `SWEEP_DEG`.
        n_frames: at least 4.

    Returns:
        (F, 4, 4) world_from_cam.
    """
    rng = walk_random(house)
    time = np.linspace(0, 1, n_frames)
    sweep = np.deg2rad(rng.uniform(*SWEEP_DEG[kind])) * float(rng.choice([-1.0, 1.0]))
    pace = time + 0.08 * np.sin(FULL_TURN_RAD * (2 * time + rng.random()))
    azimuth = rng.uniform(0, FULL_TURN_RAD) + sweep * pace
    elevation = np.deg2rad(_slow(rng, time, LOWEST_DEG, HIGHEST_DEG))
    distance = _slow(rng, time, NEAREST_M, FARTHEST_M)
    middle = middle_of(house)
    across = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    reach = _clear_reach(house, middle[:2], across, distance * np.cos(elevation))
    height = np.minimum(middle[2] + distance * np.sin(elevation), HIGHEST_M)
    eye = np.column_stack([middle[:2] + reach[:, None] * across, height])
    eye += HAND_M * _tremor(rng, n_frames, 3)
    aim = middle + np.stack([_slow(rng, time, -0.22, 0.22) for _ in range(3)], axis=-1) * [
        1,
        1,
        0.3,
    ]
    steady = look_at(eye, aim)
    angles = np.deg2rad(HAND_DEG) * _tremor(rng, n_frames, 3)
    angles[:, 2] += np.deg2rad(_slow(rng, time, -ROLL_DEG, ROLL_DEG))
    return np.asarray(steady @ _turns(angles))


def _slow(rng: np.random.Generator, time: Array, low: float, high: float) -> Array:
    """A value (F,) that wanders slowly within a range."""
    waves = sum(
        weight * np.sin(FULL_TURN_RAD * (rng.uniform(0.4, 1.2) * n * time + rng.random()))
        for n, weight in ((1, 0.65), (2, 0.35))
    )
    return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * waves)


def _tremor(rng: np.random.Generator, n_frames: int, n_axes: int) -> Array:
    """Smooth noise (F, A) of standard deviation about 1."""
    rough = smoothed(rng.standard_normal((n_frames + 20, n_axes)), HAND_FRAMES)[10:-10]
    return np.asarray(rough * np.sqrt(2 * np.sqrt(np.pi) * HAND_FRAMES))


def _turns(angles_rad: Array) -> Array:
    """Small rotations (F, 4, 4) about the camera's axes, one after the other."""
    result = np.broadcast_to(np.eye(4), (len(angles_rad), 4, 4))
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        turn = np.broadcast_to(np.eye(3), (len(angles_rad), 3, 3)).copy()
        cosine, sine = np.cos(angles_rad[:, axis]), np.sin(angles_rad[:, axis])
        turn[:, a, a] = turn[:, b, b] = cosine
        turn[:, a, b], turn[:, b, a] = -sine, sine
        result = result @ make_transform(turn, np.zeros((len(angles_rad), 3)))
    return np.asarray(result)


def _clear_reach(house: House, middle: Array, across: Array, wanted_m: Array) -> Array:
    """How far (F,) from the middle the camera may be: as wanted, or less by something tall."""
    share = np.linspace(1, 0.3, 29)
    points = middle + (share[:, None] * wanted_m)[..., None] * across
    half = np.array([house.shell.half_x_m, house.shell.half_y_m]) - CLEAR_M
    is_free = (np.abs(points) < half).all(axis=-1)
    for placed in house.furniture:
        if placed.piece.kind in TALL:
            is_free &= placed.distance_m(points) > CLEAR_M
    first = np.where(is_free.any(axis=0), is_free.argmax(axis=0), len(share) - 1)
    return np.asarray(smoothed((share[first] * wanted_m)[:, None], 3)[:, 0])
