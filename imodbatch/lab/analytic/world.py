"""A room with a table, a lower sideboard and a handful of objects on them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import make_transform
from imodbatch.core.viewpoint import FULL_TURN_RAD
from imodbatch.lab.analytic.catalogue import CLASSES, COMPONENTS, Paint, half_height_m
from imodbatch.lab.analytic.shapes import Box, Room, Shape

Array = NDArray[np.float64]
BACKGROUND = -1
"""Owner of a part that belongs to no object."""

ROOM_HALF_M = (4.0, 4.0, 1.3)
TABLE_TOP_THICKNESS_M = 0.04
MIN_GAP_M = 0.28
"""Least distance between the middles of two objects that stand on the same level."""
BORDER_M = 0.09
"""Least distance of an object's middle from the edge of what it stands on."""

ROOM_PAINT = Paint((0.72, 0.7, 0.66), (0.62, 0.62, 0.6), size_m=0.5)
WOOD = Paint((0.55, 0.4, 0.26), (0.5, 0.36, 0.23), size_m=0.12)
DARK_WOOD = Paint((0.35, 0.27, 0.2), (0.32, 0.24, 0.18), size_m=0.15)


@dataclass(frozen=True, eq=False)
class Part:
    """A painted solid at its place in the world.

    Attributes:
        shape: the solid.
        world_from_part: 4x4.
        paint: its colours, in its own frame.
        owner: ordinal of the object it belongs to, or `BACKGROUND`.
    """

    shape: Shape
    world_from_part: Array
    paint: Paint
    owner: int = BACKGROUND


@dataclass(frozen=True)
class PlacedObject:
    """An object: its class, its middle in the world (metres) and its turn about +z (radians)."""

    class_id: int
    instance_id: str
    xyz_world: tuple[float, float, float]
    yaw_rad: float


@dataclass(frozen=True)
class Surface:
    """A level rectangle that objects stand on, metres, sides along the world's x and y."""

    center_x_m: float
    center_y_m: float
    size_x_m: float
    size_y_m: float
    height_m: float

    def point(self, fraction_x: float, fraction_y: float, border_m: float) -> tuple[float, float]:
        """A place (x, y) on it by fractions in 0..1 of what lies within the border."""
        return (
            self.center_x_m + (fraction_x - 0.5) * (self.size_x_m - 2 * border_m),
            self.center_y_m + (fraction_y - 0.5) * (self.size_y_m - 2 * border_m),
        )


@dataclass(frozen=True)
class World:
    """All solids, and which objects they form. The floor is z = 0."""

    parts: tuple[Part, ...]
    objects: tuple[PlacedObject, ...]


TABLE = Surface(-0.2, 0.0, 1.2, 0.8, 0.6)
SIDEBOARD = Surface(0.65, 0.0, 0.5, 0.8, 0.35)


def random_world(rng: np.random.Generator, n_objects: int) -> World:
    """Objects of random classes, places and turns on the table and on the sideboard.

    Classes come in a random order and repeat only when all have been used.
    """
    rounds = -(-n_objects // len(CLASSES))
    order = np.concatenate([rng.permutation(len(CLASSES)) for _ in range(rounds)])[:n_objects]
    objects: list[PlacedObject] = []
    for class_id in order.tolist():
        surface = TABLE if rng.random() < 0.7 else SIDEBOARD
        x, y = _free_place(rng, surface, objects)
        z = surface.height_m + half_height_m(class_id)
        count = sum(other.class_id == class_id for other in objects)
        name = f"{CLASSES[class_id]}_{count + 1}"
        yaw_rad = float(rng.uniform(0, FULL_TURN_RAD))
        objects.append(PlacedObject(class_id, name, (x, y, z), yaw_rad))
    return build_world(objects, [TABLE, SIDEBOARD])


def build_world(objects: Sequence[PlacedObject], surfaces: Sequence[Surface]) -> World:
    """A room with a table under each surface, and the objects."""
    room_center = np.array([0.0, 0.0, ROOM_HALF_M[2]])
    parts = [Part(Room(ROOM_HALF_M), make_transform(np.eye(3), room_center), ROOM_PAINT)]
    for surface in surfaces:
        parts += _table(surface)
    for index, placed in enumerate(objects):
        parts += object_parts(placed, index)
    return World(tuple(parts), tuple(objects))


def object_parts(placed: PlacedObject, index: int) -> list[Part]:
    """The solids of an object in the world."""
    cosine, sine = np.cos(placed.yaw_rad), np.sin(placed.yaw_rad)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    world_from_object = make_transform(turn, placed.xyz_world)
    return [
        Part(
            component.shape,
            world_from_object @ make_transform(np.eye(3), component.offset_m),
            component.paint,
            index,
        )
        for component in COMPONENTS[placed.class_id]
    ]


def _table(surface: Surface) -> list[Part]:
    """A top and a foot below it, a third as wide."""
    half_x, half_y, half_top = surface.size_x_m / 2, surface.size_y_m / 2, TABLE_TOP_THICKNESS_M / 2
    half_foot = (surface.height_m - TABLE_TOP_THICKNESS_M) / 2
    x, y = surface.center_x_m, surface.center_y_m
    top = make_transform(np.eye(3), [x, y, surface.height_m - half_top])
    foot = make_transform(np.eye(3), [x, y, half_foot])
    return [
        Part(Box((half_x, half_y, half_top)), top, WOOD),
        Part(Box((half_x / 3, half_y / 3, half_foot)), foot, DARK_WOOD),
    ]


def _free_place(
    rng: np.random.Generator, surface: Surface, objects: Sequence[PlacedObject]
) -> tuple[float, float]:
    """A place at least `MIN_GAP_M` from the others; the roomiest of 200 when there is none."""
    best, best_gap = (0.0, 0.0), -1.0
    for _ in range(200):
        x, y = surface.point(float(rng.random()), float(rng.random()), BORDER_M)
        gap = min(
            (float(np.hypot(x - o.xyz_world[0], y - o.xyz_world[1])) for o in objects),
            default=np.inf,
        )
        if gap > best_gap:
            best, best_gap = (x, y), gap
        if gap >= MIN_GAP_M:
            break
    return best
