"""How the robot drives: towards things, round the table, waiting, or from one thing to the next.

A wheeled base with a camera on a pan-tilt head 1.0 to 1.4 m above the floor. The base drives along
its path; the head looks at what is near and of interest, and turns smoothly. Sequences take the
kinds of drive in turn.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.viewpoint import FULL_TURN_RAD
from imodbatch.lab.analytic.path import look_at
from imodbatch.lab.houses.floorplan import Placed
from imodbatch.lab.houses.planner import FreeSpace, smoothed
from imodbatch.lab.houses.world import DRIVE_STREAM, House

Array = NDArray[np.float64]
KINDS = ("circle", "approach", "wait", "tour")
LOWEST_M, HIGHEST_M = 1.0, 1.4
NEAR_M = 0.9
"""Things weigh in where the head looks by a bell of this width behind the nearest."""
HEEDED_M = 1.8
"""Nothing at a wall is looked at from farther away than this."""
SLEWING = 2.5
"""Frames over which the head's aim is averaged."""
WAIT_SHARE = 0.2
"""Of the frames, those in which a robot that waits stands still."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive in a house.

    Attributes:
        kind: one of `KINDS`.
        base_xy_yaw: (F, 3) true place and heading of the base.
        world_from_cam: (F, 4, 4) true.
    """

    kind: str
    base_xy_yaw: Array
    world_from_cam: Array


def kind_of(index: int) -> str:
    """The kind of drive through the index-th house, from 0."""
    return KINDS[index % len(KINDS)]


def make_drive(house: House, n_frames: int) -> Drive:
    """The drive of a house; its kind follows from the house's index."""
    rng = house.random(DRIVE_STREAM)
    kind = kind_of(house.index)
    space = FreeSpace(house)
    route = _route(rng, house, space, kind)
    pause_at = int(len(route) * rng.uniform(0.4, 0.6)) if kind == "wait" else None
    at = _schedule(len(route), n_frames, pause_at)
    index = np.arange(len(route))
    xy = np.stack([np.interp(at, index, column) for column in route.T], axis=-1)
    along = np.gradient(route, axis=0)
    heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    yaw = np.interp(at, index, smoothed(heading[:, None], 4)[:, 0])
    time = np.linspace(0, 1, n_frames)
    low, high = rng.uniform(LOWEST_M, 1.15), rng.uniform(1.3, HIGHEST_M)
    # The mast is raised or lowered slowly, as far as this robot's goes.
    height = low + (high - low) * (0.5 + 0.5 * np.sin(FULL_TURN_RAD * (0.7 * time + rng.random())))
    camera = np.column_stack([xy, height])
    aim = _aim(rng, house, camera)
    return Drive(kind, np.column_stack([xy, yaw]), look_at(camera, aim))


def _route(rng: np.random.Generator, house: House, space: FreeSpace, kind: str) -> Array:
    """The way (P, 2) of a kind of drive."""
    islands = [p for p in house.furniture if p.is_island]
    places = {t.place for t in house.targets} or set(range(len(house.furniture)))
    walls = [p for k, p in enumerate(house.furniture) if k in places and not p.is_island]
    island = islands[0]
    direction = float(rng.choice([-1.0, 1.0]))
    if kind == "circle":
        start = float(rng.uniform(0, FULL_TURN_RAD))
        ring = _ring(rng, space, island, start, direction * np.deg2rad(rng.uniform(300, 340)))
        stops = [space.nearest(ring[0] + 0.9 * _away(ring[0], island)), *ring]
    elif kind == "approach":
        far = _far_from(rng, space, island)
        start = float(np.arctan2(far[1] - island.y_m, far[0] - island.x_m))
        ring = _ring(rng, space, island, start, direction * np.deg2rad(rng.uniform(150, 210)))
        stops = [far, *ring, *(_before(rng, space, p) for p in walls[:1])]
    elif kind == "wait":
        first = [_before(rng, space, p) for p in walls[:1]]
        begin = first[-1] if first else _far_from(rng, space, island)
        start = float(np.arctan2(begin[1] - island.y_m, begin[0] - island.x_m))
        ring = _ring(rng, space, island, start, direction * np.deg2rad(rng.uniform(200, 260)))
        stops = [_far_from(rng, space, island), *first, *ring]
    else:
        fronts = [_before(rng, space, p) for p in walls]
        begin = fronts[-1] if fronts else _far_from(rng, space, island)
        start = float(np.arctan2(begin[1] - island.y_m, begin[0] - island.x_m))
        ring = _ring(rng, space, island, start, direction * np.deg2rad(rng.uniform(230, 290)))
        stops = [*fronts, *ring]
    return space.path([space.nearest(stop) for stop in stops])


def _ring(
    rng: np.random.Generator, space: FreeSpace, island: Placed, start: float, sweep: float
) -> list[Array]:
    """Stops round an island, at about the same distance from its edge."""
    gap = float(rng.uniform(0.31, 0.42))
    stops = []
    for angle in start + sweep * np.linspace(0, 1, 12):
        ray = np.array([np.cos(angle), np.sin(angle)])
        reach = np.linspace(0.2, 2.5, 116)
        points = np.array([island.x_m, island.y_m]) + reach[:, None] * ray
        stops.append(points[int(np.argmax(island.distance_m(points) >= gap))])
    return [space.nearest(stop) for stop in stops]


def _before(rng: np.random.Generator, space: FreeSpace, placed: Placed) -> Array:
    """A stop in front of a piece at a wall."""
    away = placed.piece.half_x_m + rng.uniform(0.55, 0.8)
    side = np.array([-placed.front[1], placed.front[0]]) * rng.uniform(-0.3, 0.3)
    return space.nearest(np.array([placed.x_m, placed.y_m]) + away * placed.front + side)


def _far_from(rng: np.random.Generator, space: FreeSpace, island: Placed) -> Array:
    """A free place 3 to 4 m from an island, or as far as the room goes."""
    away = np.linalg.norm(space.points - [island.x_m, island.y_m], axis=1)
    limit = min(3.0, float(np.quantile(away, 0.97)))
    chosen = space.points[(away >= limit) & (away <= 4.0)]
    return np.asarray(chosen[int(rng.integers(len(chosen)))])


def _away(point: Array, island: Placed) -> Array:
    ray = point - np.array([island.x_m, island.y_m])
    return np.asarray(ray / np.linalg.norm(ray))


def _schedule(n_points: int, n_frames: int, pause_at: int | None) -> Array:
    """Where along the way (F,) each frame is: starts and stops gently, may wait once."""
    time = np.linspace(0, 1, n_frames)
    if pause_at is None:
        return (n_points - 1) * _eased(time)
    n_wait = round(WAIT_SHARE * n_frames)
    share = pause_at / (n_points - 1)
    n_first = round((n_frames - n_wait) * share)
    n_last = n_frames - n_wait - n_first
    first = pause_at * _eased(np.linspace(0, 1, n_first))
    last = pause_at + (n_points - 1 - pause_at) * _eased(np.linspace(0, 1, n_last + 1)[1:])
    return np.concatenate([first, np.full(n_wait, float(pause_at)), last])


def _eased(time: Array) -> Array:
    """0..1 to 0..1 with a slower start and end."""
    return np.asarray(0.75 * time + 0.25 * time**2 * (3 - 2 * time))


def _aim(rng: np.random.Generator, house: House, camera: Array) -> Array:
    """Where the head looks (F, 3): amid the things on one piece of furniture, wandering."""
    groups = _groups(house)
    centers = []
    for things, camera_world in zip(_attended(groups, camera), camera, strict=True):
        away = np.linalg.norm(things - camera_world, axis=1)
        weight = np.exp(-0.5 * ((away - away.min()) / NEAR_M) ** 2)
        centers.append(weight @ things / weight.sum())
    time = np.linspace(0, 1, len(camera))[:, None]
    swing = np.array([0.1, 0.1, 0.06])
    aim = centers + swing * np.sin(FULL_TURN_RAD * (time * [3, 2, 2.5] + rng.random(3)))
    return smoothed(aim, SLEWING)


def _groups(house: House) -> list[tuple[Array, float]]:
    """Targets (n, 3) that stand together, and from how far the robot heeds them."""
    places = sorted({target.place for target in house.targets})
    groups = []
    for place in places:
        things = [t.middle_world for t in house.targets if t.place == place]
        is_island = place >= 0 and house.furniture[place].is_island
        groups.append((np.array(things), np.inf if is_island else HEEDED_M))
    if all(np.isfinite(reach) for _, reach in groups):
        middles = [[p.x_m, p.y_m, 0.6] for p in house.furniture if p.is_island]
        groups.append((np.array(middles), np.inf))
    return groups


def _attended(groups: list[tuple[Array, float]], camera: Array) -> list[Array]:
    """The group that each frame looks at: the nearest, kept until another is much nearer."""
    attended, current = [], -1
    for camera_world in camera:
        away = np.array(
            [np.linalg.norm(things - camera_world, axis=1).min() for things, _ in groups]
        )
        away[away > [reach for _, reach in groups]] = np.inf
        best = int(np.argmin(away))
        if current < 0 or away[best] < 0.75 * away[current]:
            current = best
        attended.append(groups[current][0])
    return attended
