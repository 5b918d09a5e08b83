"""The five classes: what they are made of, how they are painted, and what they are taken for.

An object's own frame has its origin in the object's middle, z up, and its front along +x: azimuth 0
looks at the label or at the mug's handle. A ball and a can look the same from everywhere.

What an object is taken for follows from where the part that tells it apart is out of sight: a mug
seen from behind hides its handle and looks like a can; so does a bottle from behind, without its
label; a carton seen on its narrow side is a slender upright thing like a bottle. The can in turn
resembles both a little, from everywhere.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.analytic.shapes import Box, Capsule, Cylinder, Shape, Sphere

Array = NDArray[np.float64]
Colour = tuple[float, float, float]

CLASSES = ("ball", "can", "carton", "bottle", "mug")
BALL, CAN, CARTON, BOTTLE, MUG = range(len(CLASSES))
SYMMETRIC = frozenset({BALL, CAN})
"""Classes that look the same from every azimuth."""


@dataclass(frozen=True)
class Paint:
    """A surface's colour: one colour with a pattern of another.

    Attributes:
        colour: RGB in 0..1.
        second: RGB in 0..1.
        pattern: ``checker``: cubes of `size_m`; ``rings``: layers of `size_m`; ``front``: the
            part within 50° of azimuth 0.
        size_m: size of the pattern.
    """

    colour: Colour
    second: Colour
    pattern: Literal["checker", "rings", "front"] = "checker"
    size_m: float = 0.1

    def at(self, points: Array) -> Array:
        """Colours (P, 3) at points (P, 3) of the painted part's own frame."""
        if self.pattern == "front":
            is_second = np.abs(np.arctan2(points[:, 1], points[:, 0])) < np.deg2rad(50)
        else:
            # A shift by a third keeps faces off the borders of the pattern's cubes.
            cells = np.floor(points / self.size_m + 1 / 3).astype(np.int64)
            is_second = (cells[:, 2] if self.pattern == "rings" else cells.sum(axis=-1)) % 2 == 1
        return np.where(is_second[:, None], self.second, self.colour)


@dataclass(frozen=True)
class Component:
    """One solid of an object, with its place in the object's frame in metres."""

    shape: Shape
    paint: Paint
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


COMPONENTS: tuple[tuple[Component, ...], ...] = (
    (Component(Sphere(0.06), Paint((0.9, 0.45, 0.1), (0.95, 0.85, 0.3), "rings", 0.03)),),
    (Component(Cylinder(0.04, 0.065), Paint((0.75, 0.1, 0.1), (0.9, 0.9, 0.9), "rings", 0.045)),),
    (Component(Box((0.035, 0.07, 0.11)), Paint((0.2, 0.35, 0.75), (0.95, 0.9, 0.6), "front")),),
    (Component(Capsule(0.04, 0.08), Paint((0.1, 0.45, 0.25), (0.95, 0.95, 0.85), "front")),),
    (
        Component(Cylinder(0.045, 0.05), Paint((0.85, 0.85, 0.9), (0.4, 0.2, 0.5), "front")),
        Component(
            Box((0.022, 0.01, 0.035)), Paint((0.4, 0.2, 0.5), (0.4, 0.2, 0.5)), (0.062, 0, 0)
        ),
    ),
)
"""The solids of each class, in the order of `CLASSES`."""


def half_height_m(class_id: int) -> float:
    """Half the height of a class: its middle's height above what it stands on."""
    return max(part.shape.half_extents_m[2] + part.offset_m[2] for part in COMPONENTS[class_id])


def resemblance(class_id: int, azimuth_rad: float) -> Array:
    """How much an object looks like each class, (K,) in 0..1, beyond being what it is.

    Args:
        class_id: what it is.
        azimuth_rad: from where it is seen, in its own frame.
    """
    from_behind = max(0.0, -float(np.cos(azimuth_rad)))
    from_the_side = float(np.sin(azimuth_rad)) ** 4
    looks_like = {
        BALL: {CAN: 0.3},
        CAN: {MUG: 0.45, BOTTLE: 0.3},
        CARTON: {BOTTLE: 0.8 * from_the_side},
        BOTTLE: {CAN: 0.9 * from_behind},
        MUG: {CAN: from_behind},
    }[class_id]
    return np.array([looks_like.get(other, 0.0) for other in range(len(CLASSES))])
