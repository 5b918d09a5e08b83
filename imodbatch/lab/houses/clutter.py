"""Things that stand about and are no target: books, cartons, vases, bottles, pots, frames."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from imodbatch.lab.houses.furniture import leaves
from imodbatch.lab.houses.solids import Solids
from imodbatch.lab.houses.styles import Style
from imodbatch.lab.mesh import TexturedMesh


@dataclass(frozen=True, eq=False)
class Item:
    """A thing in its own frame, standing on z = 0 about the origin."""

    kind: str
    meshes: tuple[TexturedMesh, ...]
    radius_m: float
    height_m: float


def books(rng: np.random.Generator, style: Style) -> Item:
    """A pile of two to five."""
    solids, z = Solids(), 0.0
    for _ in range(int(rng.integers(2, 6))):
        half_x, half_y = rng.uniform(0.06, 0.08), rng.uniform(0.085, 0.11)
        thick = rng.uniform(0.015, 0.035)
        shift = rng.uniform(-0.012, 0.012, 2)
        low = (shift[0] - half_x, shift[1] - half_y, z)
        high = (shift[0] + half_x, shift[1] + half_y, z + thick)
        solids.box(style.material(rng, "clutter"), low, high, fit=True)
        z += thick
    return Item("books", tuple(solids.meshes()), 0.15, float(z))


def carton(rng: np.random.Generator, style: Style) -> Item:
    """A printed box."""
    solids = Solids()
    half_x, half_y = rng.uniform(0.025, 0.05), rng.uniform(0.04, 0.08)
    height = float(rng.uniform(0.12, 0.24))
    low, high = (-half_x, -half_y, 0), (half_x, half_y, height)
    solids.box(style.material(rng, "clutter"), low, high, fit=True)
    return Item("carton", tuple(solids.meshes()), float(np.hypot(half_x, half_y)), height)


def vase(rng: np.random.Generator, style: Style) -> Item:
    """A turned vase, sometimes with a twig."""
    solids, clay = Solids(), style.material(rng, "clutter")
    height = float(rng.uniform(0.14, 0.26))
    wide, neck = rng.uniform(0.045, 0.07), rng.uniform(0.015, 0.03)
    s = np.linspace(0, 1, 14)
    radius = neck + (wide - neck) * np.sin(np.pi * np.clip(s * 1.25, 0, 1)) ** 0.8
    solids.turned(clay, (0, 0), [(0, 0), *zip(radius.tolist(), (s * height).tolist(), strict=True)])
    if rng.random() < 0.5:
        leaves(rng, style, solids, (0.0, 0.0), height * 0.9, height * 1.8, 0.09)
        height *= 1.9
    return Item("vase", tuple(solids.meshes()), float(wide) + 0.005, height)


def bottle(rng: np.random.Generator, style: Style) -> Item:
    """With a label."""
    solids, glass, label = Solids(), style.material(rng, "clutter"), style.material(rng, "clutter")
    height, r = float(rng.uniform(0.2, 0.3)), float(rng.uniform(0.032, 0.042))
    low, high = 0.2 * height, 0.5 * height
    solids.turned(glass, (0, 0), [(0, 0), (r, 0), (r, low)])
    solids.turned(label, (0, 0), [(r * 1.01, low), (r * 1.01, high)])
    neck = [(r, high), (r, 0.6 * height), (0.4 * r, 0.78 * height), (0.35 * r, height), (0, height)]
    solids.turned(glass, (0, 0), neck)
    return Item("bottle", tuple(solids.meshes()), r * 1.02, height)


def tin(rng: np.random.Generator, style: Style) -> Item:
    """A wide printed tin or jar."""
    solids, height = Solids(), float(rng.uniform(0.08, 0.16))
    r = float(rng.uniform(0.045, 0.065))
    body, lid = style.material(rng, "clutter"), style.material(rng, "furniture")
    solids.turned(body, (0, 0), [(0, 0), (r, 0), (r, 0.85 * height)])
    lid_profile = [(r * 1.04, 0.82 * height), (r * 1.04, height), (0, height)]
    solids.turned(lid, (0, 0), lid_profile)
    return Item("tin", tuple(solids.meshes()), r * 1.04, height)


def pot_plant(rng: np.random.Generator, style: Style) -> Item:
    """A small plant."""
    solids, pot = Solids(), style.material(rng, "clutter")
    solids.turned(
        pot, (0, 0), [(0, 0), (0.045, 0), (0.06, 0.1), (0.05, 0.1), (0.05, 0.09), (0, 0.09)]
    )
    top = float(rng.uniform(0.18, 0.3))
    leaves(rng, style, solids, (0.0, 0.0), 0.09, top, 0.09)
    return Item("pot_plant", tuple(solids.meshes()), 0.075, top + 0.04)


def frame(rng: np.random.Generator, style: Style) -> Item:
    """A standing picture."""
    solids, wood = Solids(), style.material(rng, "furniture")
    half_y, height = float(rng.uniform(0.06, 0.1)), float(rng.uniform(0.14, 0.22))
    solids.box(wood, (-0.012, -half_y, 0), (0.008, half_y, height))
    inner = ((0.008, -half_y + 0.015, 0.015), (0.0095, half_y - 0.015, height - 0.015))
    solids.box(style.material(rng, "clutter"), *inner, fit=True)
    return Item("frame", tuple(solids.meshes()), half_y + 0.005, height)


def lamp(rng: np.random.Generator, style: Style) -> Item:
    """A table lamp."""
    solids, foot, cloth = Solids(), style.material(rng, "clutter"), style.material(rng, "wall")
    height = float(rng.uniform(0.3, 0.42))
    solids.turned(foot, (0, 0), [(0, 0), (0.06, 0), (0.05, 0.02), (0.012, 0.06), (0.01, height)])
    solids.turned(cloth, (0, 0), [(0.1, 0.6 * height), (0.06, height)])
    return Item("lamp", tuple(solids.meshes()), 0.1, height)


ITEMS: tuple[Callable[[np.random.Generator, Style], Item], ...] = (
    books, carton, vase, bottle, tin, pot_plant, frame, lamp, carton, books, bottle, tin,
)  # fmt: skip


def random_item(rng: np.random.Generator, style: Style, clear_m: float = 1.0) -> Item:
    """Something that fits below a height."""
    while True:
        item = ITEMS[int(rng.integers(len(ITEMS)))](rng, style)
        if item.height_m < clear_m - 0.02:
            return item
