"""Where furniture stands: layouts of each split, and rectangles that keep apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import make_transform
from imodbatch.lab.houses import furniture
from imodbatch.lab.houses.furniture import Maker, Piece, Support
from imodbatch.lab.houses.shell import WALLS, Shell, Window
from imodbatch.lab.houses.styles import Style

Array = NDArray[np.float64]
AISLE_M = 0.85
"""Free width round an island, so that the robot can drive round it."""
LOW_PIECES = frozenset({"sofa", "desk", "bed", "sideboard", "chair", "plant"})
"""What may stand under a window."""


@dataclass(frozen=True)
class Layout:
    """What a house holds: islands that can be circled, and pieces along the walls."""

    islands: tuple[Maker, ...]
    walls: tuple[Maker, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The pieces' names, to compare layouts by."""
        return tuple(maker.__name__ for maker in (*self.islands, *self.walls))


def _layout(island: Maker, *walls: Maker) -> Layout:
    return Layout((island,), walls)


f = furniture
LAYOUTS: dict[str, tuple[Layout, ...]] = {
    "train": (
        _layout(f.dining_table, f.cabinet, f.sideboard, f.bed, f.chair),
        _layout(f.coffee_table, f.sofa, f.desk, f.floor_lamp, f.chair),
        _layout(f.dining_table, f.shelf, f.desk, f.chair, f.plant, f.floor_lamp),
        _layout(f.coffee_table, f.bed, f.shelf, f.sideboard, f.plant),
    ),
    "val": (
        _layout(f.dining_table, f.sideboard, f.shelf, f.sofa, f.chair, f.plant),
        _layout(f.coffee_table, f.sideboard, f.cabinet, f.bed, f.floor_lamp),
        _layout(f.dining_table, f.desk, f.sofa, f.cabinet, f.chair),
    ),
    "test": (
        _layout(f.dining_table, f.sideboard, f.sofa, f.plant, f.cabinet, f.chair, f.chair),
        _layout(f.coffee_table, f.sofa, f.sideboard, f.shelf, f.floor_lamp, f.chair),
        _layout(f.dining_table, f.desk, f.shelf, f.bed, f.chair, f.plant),
        _layout(f.coffee_table, f.sideboard, f.desk, f.sofa, f.cabinet, f.floor_lamp),
    ),
}


@dataclass(frozen=True, eq=False)
class Placed:
    """A piece in the room."""

    piece: Piece
    x_m: float
    y_m: float
    yaw_rad: float
    is_island: bool = False

    @property
    def world_from_piece(self) -> Array:
        """(4, 4)."""
        return standing(self.x_m, self.y_m, 0.0, self.yaw_rad)

    @property
    def front(self) -> Array:
        """Unit vector (2,) that the piece looks along."""
        return np.array([np.cos(self.yaw_rad), np.sin(self.yaw_rad)])

    def corners(self, margin_m: float = 0.0) -> Array:
        """The footprint's corners (4, 2), grown on all sides."""
        hx, hy = self.piece.half_x_m + margin_m, self.piece.half_y_m + margin_m
        local = np.array([[hx, hy], [-hx, hy], [-hx, -hy], [hx, -hy]])
        return local @ self.world_from_piece[:2, :2].T + [self.x_m, self.y_m]

    def distance_m(self, points: Array) -> Array:
        """How far points (..., 2) lie from the footprint; 0 inside."""
        local = (points - np.array([self.x_m, self.y_m])) @ self.world_from_piece[:2, :2]
        beyond = np.abs(local) - [self.piece.half_x_m, self.piece.half_y_m]
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0), axis=-1))


def standing(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Array:
    """``world_from_object`` (4, 4) of something upright."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return make_transform([[c, -s, 0], [s, c, 0], [0, 0, 1]], [x_m, y_m, z_m])


def furnish(rng: np.random.Generator, style: Style, shell: Shell, index: int) -> list[Placed]:
    """The furniture of the index-th house; what finds no place is left out."""
    layouts = LAYOUTS[style.split]
    layout = layouts[index % len(layouts)]
    placed: list[Placed] = []
    for maker in layout.islands:
        piece = maker(rng, style)
        x, y = rng.uniform(-0.25, 0.25, 2)
        yaw = np.deg2rad(rng.uniform(-20, 20)) + np.pi / 2 * float(rng.integers(2))
        placed.append(Placed(piece, float(x), float(y), float(yaw), is_island=True))
    for maker in layout.walls:
        piece = maker(rng, style)
        for _ in range(60):
            candidate = _at_wall(rng, piece, shell)
            if candidate is not None and all(_apart(candidate, other) for other in placed):
                placed.append(candidate)
                break
    return placed


def supports_of(placed: Placed) -> list[Support]:
    """Levels that the robot's camera can look at."""
    return [s for s in placed.piece.supports if 0.3 <= s.height_m <= 1.2 and s.clear_m > 0.2]


def _at_wall(rng: np.random.Generator, piece: Piece, shell: Shell) -> Placed | None:
    """A random place with the back to a wall; None where a window would be covered."""
    wall = str(rng.choice(WALLS))
    side = 1.0 if wall[1] == "+" else -1.0
    length = (shell.half_y_m if wall[0] == "x" else shell.half_x_m) - piece.half_y_m - 0.03
    along = float(rng.uniform(-length, length))
    covered = any(_overlaps(w, wall, along, piece.half_y_m) for w in shell.windows)
    if covered and piece.kind not in LOW_PIECES:
        return None
    depth = piece.half_x_m + 0.03
    if wall[0] == "x":
        yaw = np.pi if side > 0 else 0.0
        return Placed(piece, side * (shell.half_x_m - depth), along, float(yaw))
    return Placed(piece, along, side * (shell.half_y_m - depth), float(-side * np.pi / 2))


def _overlaps(window: Window, wall: str, along: float, half: float) -> bool:
    return window.wall == wall and window.low_m < along + half and along - half < window.high_m


def _apart(a: Placed, b: Placed) -> bool:
    """Whether two footprints keep their distance: an aisle from islands, else a hand's breadth."""
    margin = AISLE_M if a.is_island or b.is_island else 0.06
    first, second = a.corners(margin / 2), b.corners(margin / 2)
    for corners in (first, second):
        for edge in np.roll(corners, -1, axis=0)[:2] - corners[:2]:
            one, other = first @ edge, second @ edge
            if one.max() < other.min() or other.max() < one.min():
                return True
    return False
