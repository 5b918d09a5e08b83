"""Hollow round vessels: a wall between an outer and an inner profile, and what stands in it."""

from collections.abc import Callable, Sequence

import numpy as np

from imodbatch.lab.mesh import Surface
from imodbatch.lab.objects.curves import Outline, arc, smooth
from imodbatch.lab.objects.paint import shaded
from imodbatch.lab.objects.part import Part, Picture
from imodbatch.lab.objects.primitives import Strip, lathe

Radius = Callable[[float], float]
"""From a height in centimetres to a radius in centimetres."""


def radius_of(points: Sequence[tuple[float, float]]) -> Radius:
    """A smooth wall through (radius, height) pairs, in order of height."""
    curve = smooth(points, 60)
    return lambda height: float(np.interp(height, curve[:, 1], curve[:, 0]))


def vessel(
    wall: Radius,
    height: float,
    thickness: float,
    pictures: tuple[Picture, Picture, Picture, Picture],
    surface: Surface,
    floor: float = 0.6,
    foot: float = 0.15,
    outline: Outline | None = None,
    n_rings: int = 20,
) -> Part:
    """An open vessel on z = 0.

    Args:
        wall: outer radius.
        height: of the rim.
        thickness: of the wall.
        pictures: bottom, outside, lip and inside; those of the outside and the inside are wrapped.
        surface: how it shines.
        floor: height of the floor inside.
        foot: how far the bottom is set back and rounded.
        outline: what a radius stands for, if not a circle.
        n_rings: rings of the outside and of the inside.
    """
    bottom, outside, lip, inside = pictures
    z_outer = np.linspace(foot, height - thickness / 2, n_rings)
    outer = [(wall(z), float(z)) for z in z_outer]
    r = outer[0][0]
    base = [(0, foot * 0.8), (r * 0.75, foot * 0.8), (r * 0.8, 0.02), (r - foot * 0.8, 0.0)]
    base += [(r - foot * 0.25, foot * 0.3), outer[0]]
    rim_r = outer[-1][0] - thickness / 2
    rim = arc((rim_r, outer[-1][1]), thickness / 2, 0, 180, 7)
    rim[0] = outer[-1]
    corner = min(1.0, 0.3 * wall(floor))
    z_inner = np.linspace(outer[-1][1], floor + corner, n_rings)[1:]
    inner = [rim[-1], *((wall(z) - thickness, float(z)) for z in z_inner)]
    r_floor = inner[-1][0]
    inner += arc((r_floor - corner, floor + corner), corner, 0, -90, 6)[1:]
    inner += [((r_floor - corner) * share, floor) for share in (0.5, 0.0)]
    return lathe(
        [Strip(base, bottom), Strip(outer, outside), Strip(rim, lip), Strip(inner, inside)],
        surface,
        outline,
    )


def disc_part(radius: float, low: float, high: float, picture: Picture, surface: Surface) -> Part:
    """A flat round disc, its picture laid on from above: a drink's surface, a lid."""
    profile = [(0.0, low), (radius, low), (radius, high), (radius * 0.5, high), (0.0, high)]
    return lathe([Strip(profile, picture, "top")], surface)


def deeper_darker(picture: Picture, amount: float) -> Picture:
    """The inside of a vessel: less light reaches its lower part."""
    depth = np.linspace(0, 1, len(picture))[:, None] * np.ones(picture.shape[1])
    return shaded(picture, 1 - amount * depth)


def steel_wall(height: int, width: int, tone: int, seed: int, mirror: float) -> Picture:
    """Steel as it mirrors a room: light and dark streaks from top to bottom, brushed round."""
    random = np.random.default_rng(seed)
    x = np.linspace(0, 2 * np.pi, width, endpoint=False)
    streaks = sum(
        random.normal(0, 1.0 / k) * np.cos(k * x + random.uniform(0, 6.3)) for k in range(1, 9)
    )
    rows = random.normal(0, 0.04, (height, 1))
    light = tone * (1 + mirror * 0.35 * np.asarray(streaks)[None] + rows)
    tint = np.array([1.0, 1.0, 1.02])
    return np.clip(light[..., None] * tint, 10, 250).astype(np.uint8)
