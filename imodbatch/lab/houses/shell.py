"""A room without furniture: floor, ceiling, walls with windows and a door, skirting, pictures.

The room spans x in ±half length, y in ±half width, z from 0. Outside the windows is the sky.
"""

from dataclasses import dataclass

import numpy as np

from imodbatch.lab.houses.solids import Material, Solids
from imodbatch.lab.houses.styles import GLOSSY, Style
from imodbatch.lab.mesh import TexturedMesh
from imodbatch.lab.render.raycast import PanelLight

THICK_M = 0.12
SILL_M, LINTEL_M = 0.95, 2.05
WALLS = ("x+", "x-", "y+", "y-")


@dataclass(frozen=True)
class Window:
    """An opening in a wall, between two places along it."""

    wall: str
    low_m: float
    high_m: float


@dataclass(frozen=True, eq=False)
class Shell:
    """The empty room.

    Attributes:
        meshes: in the world.
        half_x_m: half its length.
        half_y_m: half its width.
        height_m: of the ceiling.
        windows: openings.
    """

    meshes: tuple[TexturedMesh, ...]
    half_x_m: float
    half_y_m: float
    height_m: float
    windows: tuple[Window, ...]


def make_shell(rng: np.random.Generator, style: Style) -> Shell:
    """A room of a style."""
    half_x, half_y = rng.uniform(*style.room_x_m) / 2, rng.uniform(*style.room_y_m) / 2
    height = float(rng.uniform(*style.height_m))
    solids = Solids()
    floor, wall = style.material(rng, "floor"), style.material(rng, "wall")
    white = Material(np.full((4, 4, 3), 236, np.uint8), 1.0)
    trim = Material(np.full((4, 4, 3), 222, np.uint8), 1.0, GLOSSY)
    wood = style.material(rng, "furniture")
    outer_x, outer_y = half_x + THICK_M, half_y + THICK_M
    solids.box(floor, (-outer_x, -outer_y, -0.1), (outer_x, outer_y, 0))
    solids.box(white, (-outer_x, -outer_y, height), (outer_x, outer_y, height + 0.1))
    with_window = [str(name) for name in rng.permutation(WALLS)[: int(rng.integers(1, 3))]]
    door_wall = str(rng.choice([name for name in WALLS if name not in with_window]))
    windows = []
    for name in WALLS:
        length = half_y if name[0] == "x" else half_x
        window = None
        if name in with_window:
            middle = rng.uniform(-0.4, 0.4) * length
            half = rng.uniform(0.5, 0.8)
            window = Window(name, float(middle - half), float(middle + half))
            windows.append(window)
        _wall(solids, wall, trim, name, (half_x, half_y, height), window)
        if name == door_wall:
            at = float(rng.choice([-1, 1])) * (length - 0.6)
            _on_wall(solids, trim, name, (half_x, half_y), (at - 0.5, 0, 0), (at + 0.5, 2.08, 0.03))
            _on_wall(
                solids, wood, name, (half_x, half_y), (at - 0.43, 0, 0), (at + 0.43, 2.0, 0.04)
            )
        for _ in range(int(rng.integers(0, 3))):
            if window is None:
                at, z = rng.uniform(-0.7, 0.5) * length, rng.uniform(1.35, 1.6)
                wide, high = rng.uniform(0.3, 0.7), rng.uniform(0.3, 0.6)
                low, top = (at, z, 0.0), (at + wide, z + high, 0.02)
                if name != door_wall:
                    _on_wall(solids, wood, name, (half_x, half_y), low, top)
                    inner = (at + 0.03, z + 0.03, 0.01), (at + wide - 0.03, z + high - 0.03, 0.025)
                    art = style.material(rng, "clutter")
                    _on_wall(solids, art, name, (half_x, half_y), *inner, fit=True)
    if rng.random() < 0.6:
        rug, x, y = style.material(rng, "rug"), rng.uniform(0.8, 1.2), rng.uniform(0.9, 1.5)
        solids.box(rug, (-x, -y, 0), (x, y, 0.004), fit=True)
    return Shell(tuple(solids.meshes()), half_x, half_y, height, tuple(windows))


def window_light(shell: Shell, window: Window, strength: float) -> PanelLight:
    """Daylight through a window, into the room."""
    middle, half = (window.low_m + window.high_m) / 2, (window.high_m - window.low_m) / 2
    z, half_z = (SILL_M + LINTEL_M) / 2, (LINTEL_M - SILL_M) / 2
    side = 1.0 if window.wall[1] == "+" else -1.0
    # The panel shines along u × v, which must point into the room; it lies just inside.
    inside = 0.02
    if window.wall[0] == "x":
        center = (side * (shell.half_x_m - inside), middle, z)
        half_u = (0.0, -side * half, 0.0)
    else:
        center = (middle, side * (shell.half_y_m - inside), z)
        half_u = (side * half, 0.0, 0.0)
    blue = (0.92 * strength, 1.0 * strength, 1.12 * strength)
    return PanelLight(center, half_u, (0.0, 0.0, half_z), blue)


def _wall(
    solids: Solids,
    wall: Material,
    trim: Material,
    name: str,
    size: tuple[float, float, float],
    window: Window | None,
) -> None:
    """A wall with its skirting and perhaps a window."""
    half_x, half_y, height = size
    end = (half_y if name[0] == "x" else half_x) + THICK_M
    around = [((-end, 0.0), (end, height))]
    if window is not None:
        low, high = window.low_m, window.high_m
        around = [
            ((-end, 0.0), (low, height)),
            ((high, 0.0), (end, height)),
            ((low, 0.0), (high, SILL_M)),
            ((low, LINTEL_M), (high, height)),
        ]
        middle, bar = (low + high) / 2, 0.03
        for a, b, c, d in (
            (low, low + bar, SILL_M, LINTEL_M),
            (high - bar, high, SILL_M, LINTEL_M),
            (middle - bar, middle + bar, SILL_M, LINTEL_M),
            (low, high, SILL_M, SILL_M + bar),
            (low, high, LINTEL_M - bar, LINTEL_M),
        ):
            _on_wall(solids, trim, name, (half_x, half_y), (a, c, -0.08), (b, d, -0.04))
        _on_wall(
            solids,
            trim,
            name,
            (half_x, half_y),
            (low - 0.05, SILL_M - 0.03, -0.1),
            (high + 0.05, SILL_M, 0.06),
        )
    for (a, c), (b, d) in around:
        _on_wall(solids, wall, name, (half_x, half_y), (a, c, -THICK_M), (b, d, 0.0))
    _on_wall(solids, trim, name, (half_x, half_y), (-end, 0, 0), (end, 0.08, 0.012))


def _on_wall(
    solids: Solids,
    material: Material,
    name: str,
    half: tuple[float, float],
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    fit: bool = False,
) -> None:
    """A box given by (along the wall, up, into the room)."""
    side = 1.0 if name[1] == "+" else -1.0
    across = 0 if name[0] == "x" else 1
    near, far = sorted(side * (half[across] - into) for into in (low[2], high[2]))
    corners = np.empty((2, 3))
    corners[:, across], corners[:, 1 - across] = (near, far), (low[0], high[0])
    corners[:, 2] = low[1], high[1]
    solids.box(material, corners[0].tolist(), corners[1].tolist(), fit)
