"""What differs between the splits: recipes and colours of surfaces, light, and which furniture.

Training, validation and test houses share no surface recipe, no palette, no kind of table, no
colour temperature of light and no random number: the stream of every choice begins with the
split's own number. What they share is what houses share: walls, things that stand on things.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from imodbatch.core.errors import DataError
from imodbatch.lab.houses import textures as t
from imodbatch.lab.houses.solids import Material
from imodbatch.lab.mesh import Surface

Split = Literal["train", "val", "test"]
Use = Literal["floor", "wall", "furniture", "top", "fabric", "rug", "clutter"]
TableKind = Literal["square_legs", "panel", "sled", "trestle", "pedestal", "round"]
Range = tuple[float, float]
STREAM_OF_SPLIT: dict[str, int] = {"train": 101, "val": 202, "test": 303}

MATT, SATIN, GLOSSY = Surface(0.02, 8.0), Surface(0.08, 25.0), Surface(0.2, 70.0)
SHINE: dict[str, Surface] = {"furniture": SATIN, "top": SATIN, "clutter": GLOSSY}


@dataclass(frozen=True)
class Look:
    """How one use of surfaces looks: recipes, colours, and how many metres a texture spans."""

    recipes: tuple[t.Recipe, ...]
    palette: tuple[tuple[int, int, int], ...]
    size_m: Range


@dataclass(frozen=True)
class Style:
    """One split's houses.

    Attributes:
        split: whose.
        looks: of the surfaces.
        tables: kinds of table.
        kelvin: colour temperatures of lamps.
        lamp: strength of the ceiling lamp at 1 m.
        daylight: strength of a window.
        room_x_m: length of rooms.
        room_y_m: width of rooms.
        height_m: of rooms.
        n_lamps: ceiling lamps, fewest and most.
    """

    split: Split
    looks: Mapping[str, Look]
    tables: tuple[TableKind, ...]
    kelvin: Range
    lamp: Range
    daylight: Range
    room_x_m: Range
    room_y_m: Range
    height_m: Range
    n_lamps: tuple[int, int]

    @cached_property
    def recipes(self) -> frozenset[str]:
        """Names of all recipes but the printed clutter's, which draws what it likes."""
        return frozenset(
            recipe.__name__
            for use, look in self.looks.items()
            if use != "clutter"
            for recipe in look.recipes
        )

    def material(self, rng: np.random.Generator, use: Use) -> Material:
        """A new material for a use."""
        look = self.looks[use]
        recipe = look.recipes[int(rng.integers(len(look.recipes)))]
        texture = recipe(rng, look.palette)
        size_m = float(rng.uniform(*look.size_m))
        return Material(texture, size_m, SHINE.get(use, MATT), is_upright=use == "wall")


TRAIN = Style(
    "train",
    {
        "floor": Look(
            (t.planks, t.tiles, t.carpet),
            ((176, 134, 92), (138, 98, 66), (196, 190, 182), (120, 122, 130), (150, 132, 110)),
            (1.0, 1.8),
        ),
        "wall": Look(
            (t.plaster, t.stripes, t.dots),
            ((226, 220, 208), (205, 214, 222), (222, 208, 190), (200, 208, 190)),
            (1.2, 2.0),
        ),
        "furniture": Look(
            (t.wood, t.laminate), ((166, 116, 72), (104, 70, 46), (206, 172, 128)), (0.7, 1.1)
        ),
        "top": Look(
            (t.wood, t.marble), ((172, 124, 80), (210, 180, 140), (208, 204, 198)), (0.6, 1.0)
        ),
        "fabric": Look(
            (t.melange, t.carpet), ((74, 92, 120), (134, 66, 60), (160, 152, 138)), (0.4, 0.7)
        ),
        "rug": Look((t.rug,), ((140, 50, 46), (44, 58, 96), (196, 170, 120), (90, 90, 80)), (1, 2)),
        "clutter": Look(
            (t.print_of,),
            ((190, 60, 50), (50, 90, 160), (235, 225, 200), (60, 130, 80), (230, 180, 60)),
            (0.2, 0.3),
        ),
    },
    ("square_legs", "panel"),
    (2700, 3600),
    (1.1, 1.7),
    (1.0, 2.2),
    (4.8, 5.8),
    (4.4, 5.2),
    (2.4, 2.5),
    (1, 2),
)
VAL = Style(
    "val",
    {
        "floor": Look(
            (t.mosaic, t.bricks), ((160, 108, 64), (126, 96, 84), (168, 160, 146)), (0.9, 1.5)
        ),
        "wall": Look(
            (t.lattice, t.panels), ((230, 226, 196), (196, 204, 200), (214, 200, 206)), (1.0, 1.6)
        ),
        "furniture": Look(
            (t.brushed,), ((186, 174, 156), (96, 78, 68), (150, 112, 84)), (0.8, 1.2)
        ),
        "top": Look((t.terrazzo, t.brushed), ((190, 172, 150), (150, 140, 136)), (0.8, 1.2)),
        "fabric": Look((t.cord,), ((110, 124, 96), (170, 120, 60)), (0.4, 0.7)),
        "rug": Look((t.bricks,), ((96, 110, 120), (150, 110, 84)), (1, 2)),
        "clutter": Look(
            (t.print_of,),
            ((150, 40, 90), (40, 120, 130), (214, 214, 220), (120, 84, 40), (240, 140, 90)),
            (0.2, 0.3),
        ),
    },
    ("sled", "trestle"),
    (3700, 4200),
    (1.3, 1.8),
    (0.8, 1.6),
    (5.8, 6.2),
    (5.2, 5.6),
    (2.5, 2.6),
    (1, 2),
)
TEST = Style(
    "test",
    {
        "floor": Look(
            (t.herringbone, t.diamonds, t.woven),
            ((150, 116, 84), (186, 150, 108), (206, 200, 188), (108, 104, 100)),
            (1.1, 1.6),
        ),
        "wall": Look(
            (t.damask, t.roughcast),
            (
                (216, 216, 210),
                (196, 200, 214),
                (226, 212, 178),
                (202, 212, 194),
                (230, 222, 214),
            ),
            (1.0, 1.8),
        ),
        "furniture": Look((t.burl,), ((140, 94, 60), (92, 66, 52), (192, 158, 118)), (0.9, 1.3)),
        "top": Look(
            (t.burl, t.granite, t.gingham),
            ((150, 100, 62), (140, 138, 140), (188, 156, 118), (196, 188, 176)),
            (0.8, 1.2),
        ),
        "fabric": Look((t.woven,), ((92, 116, 112), (150, 100, 96), (120, 112, 140)), (0.5, 0.9)),
        "rug": Look((t.diamonds,), ((110, 60, 70), (176, 160, 130), (70, 90, 80)), (1, 2)),
        "clutter": Look(
            (t.print_of,),
            ((110, 50, 130), (30, 60, 90), (244, 240, 226), (160, 170, 70), (200, 90, 40)),
            (0.2, 0.3),
        ),
    },
    ("pedestal", "round"),
    (4300, 5200),
    (1.2, 1.8),
    (1.0, 2.0),
    (6.2, 6.8),
    (5.6, 6.2),
    (2.6, 2.8),
    (1, 3),
)
STYLES: dict[str, Style] = {"train": TRAIN, "val": VAL, "test": TEST}


def check_split(split: str) -> None:
    """Refuse what is no split.

    Raises:
        DataError: no split has that name.
    """
    if split not in STYLES:
        raise DataError(f"No split is called {split!r}; there are {', '.join(STYLES)}.")


def white_of(kelvin: float) -> tuple[float, float, float]:
    """Linear RGB of a lamp, green = 1, as a camera balanced for 5000 K sees half of it."""
    warmth = (5000 - kelvin) / 5000
    return 1 + 0.5 * warmth, 1.0, 1 - 0.75 * warmth
