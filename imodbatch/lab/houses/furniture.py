"""Tables, shelves, sofas, beds and lamps, each in its own frame.

The frame: metres, +z up, on z = 0, the footprint's middle on the origin, the front looks along +x
(a wall is behind, at −x). A piece says which level rectangles things may stand on.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from imodbatch.lab.houses.solids import Material, Solids
from imodbatch.lab.houses.styles import Style, TableKind
from imodbatch.lab.houses.textures import carpet
from imodbatch.lab.mesh import TexturedMesh


@dataclass(frozen=True)
class Support:
    """A level rectangle, in the piece's frame, with sides along its axes.

    Attributes:
        x_m: of the middle.
        y_m: of the middle.
        half_x_m: half the size.
        half_y_m: half the size.
        height_m: above the floor.
        clear_m: free height above it.
        is_round: it is the disc within the rectangle.
    """

    x_m: float
    y_m: float
    half_x_m: float
    half_y_m: float
    height_m: float
    clear_m: float = 1.0
    is_round: bool = False


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of furniture: its meshes, half its footprint, and where things may stand."""

    kind: str
    meshes: tuple[TexturedMesh, ...]
    half_x_m: float
    half_y_m: float
    supports: tuple[Support, ...] = ()


Maker = Callable[[np.random.Generator, Style], Piece]


def table(
    rng: np.random.Generator, style: Style, half_x: float, half_y: float, height: float
) -> Piece:
    """A table of one of the style's kinds."""
    solids = Solids()
    top, wood = style.material(rng, "top"), style.material(rng, "furniture")
    kind: TableKind = style.tables[int(rng.integers(len(style.tables)))]
    thick = float(rng.uniform(0.025, 0.05))
    under = height - thick
    is_round = kind == "round"
    if is_round:
        half_x = half_y = max(half_x, half_y) * 0.85
        edge = [(0.0, under), (half_x - 0.01, under), (half_x, under + 0.01)]
        solids.turned(top, (0, 0), [*edge, (half_x, height), (0.0, height)], 48)
    else:
        solids.box(top, (-half_x, -half_y, under), (half_x, half_y, height))
    if kind in ("round", "pedestal"):
        foot = 0.55 * min(half_x, half_y)
        column = [(0.0, 0.0), (foot, 0.0), (foot, 0.03), (0.06, 0.07), (0.045, 0.5 * under)]
        solids.turned(wood, (0, 0), [*column, (0.07, under)])
    else:
        _legs(solids, wood, kind, half_x, half_y, under)
    return Piece(
        f"table_{kind}",
        tuple(solids.meshes()),
        half_x,
        half_y,
        (Support(0, 0, half_x, half_y, height, is_round=is_round),),
    )


def _legs(
    solids: Solids, wood: Material, kind: TableKind, half_x: float, half_y: float, under: float
) -> None:
    """What carries a rectangular top."""
    inset, leg = 0.05, 0.055
    x, y = half_x - inset, half_y - inset
    if kind == "panel":
        for side in (-1, 1):
            low, high = sorted((side * y, side * (y - 0.03)))
            solids.box(wood, (-x, low, 0), (x, high, under))
        return
    if kind == "square_legs":
        solids.box(wood, (-x, -y, under - 0.08), (x, y, under - 0.001))
    for sx in (-1, 1):
        for sy in (-1, 1):
            lx, ly = sx * (x - leg / 2), sy * (y - leg / 2)
            solids.box(
                wood, (lx - leg / 2, ly - leg / 2, 0), (lx + leg / 2, ly + leg / 2, under - 0.001)
            )
    if kind == "sled":
        for sy in (-1, 1):
            ly = sy * (y - leg / 2)
            solids.box(wood, (-x, ly - leg / 2, 0), (x, ly + leg / 2, leg))
    elif kind == "trestle":
        for sy in (-1, 1):
            ly = sy * (y - leg / 2)
            solids.box(wood, (-x, ly - 0.015, 0.25 * under), (x, ly + 0.015, 0.25 * under + 0.07))
        solids.box(wood, (-0.02, -y, 0.27 * under), (0.02, y, 0.27 * under + 0.06))


def dining_table(rng: np.random.Generator, style: Style) -> Piece:
    """To eat or work at."""
    return table(
        rng, style, rng.uniform(0.36, 0.44), rng.uniform(0.5, 0.65), rng.uniform(0.7, 0.76)
    )


def coffee_table(rng: np.random.Generator, style: Style) -> Piece:
    """Low."""
    return table(rng, style, rng.uniform(0.32, 0.4), rng.uniform(0.45, 0.6), rng.uniform(0.42, 0.5))


def sideboard(rng: np.random.Generator, style: Style) -> Piece:
    """A cupboard with doors and a free top."""
    solids, wood, top = Solids(), style.material(rng, "furniture"), style.material(rng, "top")
    half_x, half_y = rng.uniform(0.2, 0.24), rng.uniform(0.55, 0.8)
    height = float(rng.uniform(0.6, 0.85))
    solids.box(wood, (-half_x, -half_y, 0.08), (half_x - 0.02, half_y, height - 0.03))
    solids.box(top, (-half_x, -half_y - 0.01, height - 0.03), (half_x, half_y + 0.01, height))
    solids.box(wood, (-half_x + 0.04, -half_y + 0.04, 0), (half_x - 0.06, half_y - 0.04, 0.08))
    front = style.material(rng, "furniture")
    n = int(rng.integers(2, 5))
    for k in range(n):
        left = -half_y + 2 * half_y * k / n + 0.008
        right = -half_y + 2 * half_y * (k + 1) / n - 0.008
        solids.box(front, (half_x - 0.02, left, 0.1), (half_x - 0.003, right, height - 0.05))
        knob = (left + right) / 2
        solids.box(
            top,
            (half_x - 0.003, knob - 0.04, height - 0.16),
            (half_x + 0.015, knob + 0.04, height - 0.145),
        )
    support = Support(0, 0, half_x, half_y, height)
    return Piece("sideboard", tuple(solids.meshes()), half_x + 0.02, half_y + 0.01, (support,))


def shelf(rng: np.random.Generator, style: Style) -> Piece:
    """Open boards between two sides."""
    solids, wood = Solids(), style.material(rng, "furniture")
    half_x, half_y, height = 0.16, float(rng.uniform(0.4, 0.55)), float(rng.uniform(1.5, 1.9))
    levels = np.linspace(0.06, height - 0.02, int(rng.integers(4, 6)))
    for side in (-1, 1):
        low, high = sorted((side * half_y, side * (half_y - 0.02)))
        solids.box(wood, (-half_x, low, 0), (half_x, high, height))
    solids.box(
        wood, (-half_x, -half_y + 0.02, 0.06), (-half_x + 0.008, half_y - 0.02, height - 0.03)
    )
    supports = []
    for k, level in enumerate(levels):
        solids.box(wood, (-half_x, -half_y + 0.02, level - 0.02), (half_x, half_y - 0.02, level))
        clear = levels[k + 1] - level - 0.03 if k + 1 < len(levels) else 0.5
        supports.append(Support(0.01, 0, half_x - 0.02, half_y - 0.03, float(level), float(clear)))
    return Piece("shelf", tuple(solids.meshes()), half_x, half_y, tuple(supports))


def sofa(rng: np.random.Generator, style: Style) -> Piece:
    """With cushions."""
    solids, cloth = Solids(), style.material(rng, "fabric")
    half_y = float(rng.uniform(0.75, 1.0))
    seat, back, arm = rng.uniform(0.38, 0.45), rng.uniform(0.7, 0.85), rng.uniform(0.12, 0.2)
    solids.box(cloth, (-0.42, -half_y, 0.1), (0.4, half_y, seat - 0.13))
    solids.box(cloth, (-0.42, -half_y, 0.1), (-0.2, half_y, back))
    for side in (-1, 1):
        low, high = sorted((side * half_y, side * (half_y - arm)))
        solids.box(cloth, (-0.42, low, 0.1), (0.41, high, seat + 0.17))
    n = 2 if half_y < 0.85 else 3
    width = 2 * (half_y - arm) / n
    for k in range(n):
        left = -half_y + arm + k * width + 0.008
        solids.box(cloth, (-0.2, left, seat - 0.13), (0.42, left + width - 0.016, seat))
        pillow = style.material(rng, "fabric")
        if rng.random() < 0.6:
            y = left + rng.uniform(0.02, width - 0.45) if width > 0.48 else left + 0.02
            solids.box(pillow, (-0.2, y, seat), (-0.07, y + 0.38, seat + 0.34))
    return Piece("sofa", tuple(solids.meshes()), 0.44, half_y)


def bed(rng: np.random.Generator, style: Style) -> Piece:
    """Single, its head towards the wall."""
    solids, wood, cloth = Solids(), style.material(rng, "furniture"), style.material(rng, "fabric")
    linen = style.material(rng, "wall")
    half_y = float(rng.uniform(0.45, 0.6))
    solids.box(wood, (-1.0, -half_y, 0.12), (1.0, half_y, 0.32))
    solids.box(wood, (-1.03, -half_y, 0.0), (-0.99, half_y, 0.85))
    solids.box(linen, (-0.98, -half_y + 0.02, 0.32), (0.98, half_y - 0.02, 0.48))
    solids.box(cloth, (-0.45, -half_y - 0.01, 0.3), (0.99, half_y + 0.01, 0.52))
    solids.box(linen, (-0.95, -0.35, 0.48), (-0.6, 0.35, 0.58))
    return Piece("bed", tuple(solids.meshes()), 1.03, half_y + 0.01)


def chair(rng: np.random.Generator, style: Style) -> Piece:
    """Four legs, seat and back."""
    solids, wood, seat = Solids(), style.material(rng, "furniture"), style.material(rng, "fabric")
    for x in (-0.2, 0.16):
        for y in (-0.2, 0.16):
            solids.box(wood, (x, y, 0), (x + 0.04, y + 0.04, 0.43))
    solids.box(seat, (-0.2, -0.21, 0.43), (0.21, 0.21, 0.47))
    for y in (-0.2, 0.16):
        solids.box(wood, (-0.2, y, 0.47), (-0.16, y + 0.04, 0.9))
    for z in (0.62, 0.8):
        solids.box(wood, (-0.19, -0.16, z), (-0.17, 0.16, z + 0.08))
    return Piece("chair", tuple(solids.meshes()), 0.21, 0.21)


def cabinet(rng: np.random.Generator, style: Style) -> Piece:
    """A tall cupboard with two doors."""
    solids, wood, door = (
        Solids(),
        style.material(rng, "furniture"),
        style.material(rng, "furniture"),
    )
    half_y, height = float(rng.uniform(0.4, 0.6)), float(rng.uniform(1.8, 2.1))
    solids.box(wood, (-0.28, -half_y, 0), (0.26, half_y, height))
    for left, right in ((-half_y + 0.01, -0.004), (0.004, half_y - 0.01)):
        solids.box(door, (0.26, left, 0.06), (0.28, right, height - 0.03))
        inner = min(abs(left), abs(right)) * np.sign(left) + 0.03 * np.sign(left)
        solids.box(wood, (0.28, inner - 0.01, 0.95), (0.305, inner + 0.01, 1.15))
    return Piece("cabinet", tuple(solids.meshes()), 0.3, half_y)


def desk(rng: np.random.Generator, style: Style) -> Piece:
    """A table against the wall with drawers on one side."""
    solids, wood, top = Solids(), style.material(rng, "furniture"), style.material(rng, "top")
    half_y = float(rng.uniform(0.55, 0.7))
    solids.box(top, (-0.32, -half_y, 0.7), (0.32, half_y, 0.73))
    solids.box(wood, (-0.3, -half_y + 0.02, 0), (0.28, -half_y + 0.05, 0.7))
    solids.box(wood, (-0.3, half_y - 0.42, 0.05), (0.27, half_y - 0.02, 0.7))
    for z in (0.08, 0.29, 0.5):
        solids.box(top, (0.27, half_y - 0.41, z), (0.285, half_y - 0.03, z + 0.19))
    support = Support(0, 0, 0.32, half_y, 0.73)
    return Piece("desk", tuple(solids.meshes()), 0.32, half_y, (support,))


def floor_lamp(rng: np.random.Generator, style: Style) -> Piece:
    """A shade on a pole."""
    solids, pole, cloth = Solids(), style.material(rng, "furniture"), style.material(rng, "wall")
    height = float(rng.uniform(1.4, 1.7))
    solids.turned(pole, (0, 0), [(0, 0), (0.15, 0), (0.15, 0.02), (0.015, 0.04), (0.012, height)])
    solids.turned(cloth, (0, 0), [(0.2, height - 0.1), (0.13, height + 0.2)])
    return Piece("floor_lamp", tuple(solids.meshes()), 0.2, 0.2)


def plant(rng: np.random.Generator, style: Style) -> Piece:
    """A pot with leaves."""
    solids, pot = Solids(), style.material(rng, "clutter")
    height = float(rng.uniform(0.5, 1.1))
    solids.turned(
        pot, (0, 0), [(0, 0), (0.12, 0), (0.17, 0.3), (0.15, 0.3), (0.14, 0.27), (0, 0.27)]
    )
    leaves(rng, style, solids, (0.0, 0.0), 0.27, 0.27 + height, 0.2)
    return Piece("plant", tuple(solids.meshes()), 0.2, 0.2)


def leaves(
    rng: np.random.Generator,
    style: Style,
    solids: Solids,
    center: tuple[float, float],
    low: float,
    high: float,
    reach: float,
) -> None:
    """Tufts of leaves: small spindles about a stem."""
    greens = {"train": (62, 104, 50), "val": (84, 110, 62), "test": (44, 88, 62)}
    green = Material(carpet(rng, (greens[style.split],)), 0.3)
    solids.turned(green, center, [(0.012, low), (0.008, high - 0.05)], 6)
    for _ in range(14):
        angle, out = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 0.75) * reach
        x, y = center[0] + out * np.cos(angle), center[1] + out * np.sin(angle)
        middle, half = rng.uniform(low + 0.3 * (high - low), high), rng.uniform(0.3, 0.6) * reach
        wide = 0.25 * reach
        profile = [(0, middle - half), (wide, middle), (0.6 * wide, middle + 0.5 * half)]
        solids.turned(green, (x, y), [*profile, (0, middle + half)], 6)
