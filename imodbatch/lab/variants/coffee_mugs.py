"""Coffee mugs: many walls, handles and decorations; the handle on the left (+y), print in front."""

from dataclasses import replace

import numpy as np

from imodbatch.lab.mesh import ObjectModel, Surface
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.paint import Colour, noise, plain
from imodbatch.lab.objects.part import Part, Picture
from imodbatch.lab.objects.primitives import tube
from imodbatch.lab.variants.grounds import blend, flat, seed
from imodbatch.lab.variants.mug_prints import HEIGHT_PX, WIDTH_PX, decorated, glaze
from imodbatch.lab.variants.palettes import Rng, any_colour, brightness, mixed
from imodbatch.lab.variants.small_print import worn
from imodbatch.lab.variants.vessels import (
    Radius,
    deeper_darker,
    disc_part,
    radius_of,
    steel_wall,
    vessel,
)

_DRINKS = ((34, 18, 10), (58, 32, 16), (150, 104, 66), (196, 160, 118), (120, 60, 20))


def make_coffee_mug(rng: Rng) -> ObjectModel:
    """A mug."""
    height, radius = rng.uniform(8.0, 11.8), rng.uniform(3.6, 4.5)
    wall = _wall(rng, height, radius)
    thickness = rng.uniform(0.28, 0.55)
    floor = rng.uniform(0.5, 0.9)
    steel = rng.random() < 0.08
    if steel:
        tone, mirror = int(rng.integers(120, 200)), rng.uniform(0.3, 1.0)
        outside = steel_wall(HEIGHT_PX, WIDTH_PX, tone, seed(rng), mirror)
        if rng.random() < 0.5:
            outside[HEIGHT_PX // 5 : -HEIGHT_PX // 6] = any_colour(rng)
        inside = steel_wall(64, 128, tone, seed(rng), mirror)
        base = handle_paint = plain((tone,) * 3)
        lip, thickness = base, 0.25
        surface = Surface(rng.uniform(0.5, 0.9), rng.uniform(40, 120))
    else:
        body = glaze(rng)
        outside = worn(decorated(rng, body), rng, 0.02)
        two_tone = rng.random() < 0.25
        inner = glaze(rng) if two_tone else (body if rng.random() < 0.6 else (240, 238, 232))
        inside = worn(flat(64, 64, inner), rng, 0.015)
        lip = plain(inner if rng.random() < 0.7 else glaze(rng))
        base = plain(mixed(body, (225, 215, 200), 0.5 * (rng.random() < 0.4)))
        handle_paint = plain(_printed(inner if two_tone and rng.random() < 0.5 else body))
        matt = rng.random() < 0.25
        surface = (
            Surface(rng.uniform(0.05, 0.2), 15)
            if matt
            else Surface(rng.uniform(0.3, 0.6), rng.uniform(50, 120))
        )
    inside = deeper_darker(inside, rng.uniform(0.1, 0.35))
    pictures = (base, outside, lip, inside)
    parts = [vessel(wall, height, thickness, pictures, surface, floor)]
    parts.append(_handle(rng, wall, height, thickness, handle_paint, surface))
    if rng.random() < 0.3:
        level = rng.uniform(0.35, 0.92) * height
        parts.append(_drink(rng, wall(level) - thickness + 0.08, level))
    return assemble("coffee_mug", parts)


def _wall(rng: Rng, height: float, radius: float) -> Radius:
    """Straight (most often), tapered, barrel, flared, bell, conical, or waisted."""
    h, r = height, radius
    kind = rng.choice(7, p=[0.4, 0.16, 0.12, 0.1, 0.08, 0.08, 0.06])
    cut = rng.uniform(0.1, 0.7)
    shapes = (
        [(r - cut * 0.4, 0), (r, 0.08 * h), (r, 0.5 * h), (r, h)],
        [(r * rng.uniform(0.72, 0.9), 0), (r * 0.93, 0.5 * h), (r, h)],
        [(r * 0.8, 0), (r * 1.02, 0.4 * h), (r * 1.0, 0.65 * h), (r * 0.88, h)],
        [(r * 0.72, 0), (r * 0.82, 0.3 * h), (r * 0.88, 0.65 * h), (r * 1.06, h)],
        [(r * 0.6, 0), (r * 0.86, 0.18 * h), (r * 0.94, 0.55 * h), (r * 1.04, h)],
        [(r * 1.08, 0), (r * 0.98, 0.5 * h), (r * 0.86, h)],
        [(r, 0), (r * 0.9, 0.45 * h), (r, h)],
    )
    return radius_of(shapes[kind])


def _printed(colour: Colour) -> Colour:
    """As `worn` lifts it."""
    red, green, blue = (round(14 + c * 226 / 255) for c in colour)
    return red, green, blue


def _handle(
    rng: Rng, wall: Radius, height: float, thickness: float, paint: Picture, surface: Surface
) -> Part:
    """A handle: D, C, ear, or angular."""
    top = height * rng.uniform(0.74, 0.92)
    low = height * rng.uniform(0.12, 0.34)
    reach = rng.uniform(2.3, 3.6)
    thick = rng.uniform(0.36, 0.62)
    wide = rng.uniform(1.0, 1.9)
    kind = rng.integers(5)
    middle, half = (top + low) / 2, (top - low) / 2
    if kind <= 1:  # D or C.
        angles = np.linspace(np.pi / 2, -np.pi / 2, 9)
        power = 0.55 if kind == 0 else 1.0
        out = np.abs(np.cos(angles)) ** power * reach
        heights = middle + half * np.sin(angles)
    elif kind == 2:  # An ear: fullest above, long below.
        out = np.array([0, 0.55, 0.92, 1.0, 0.85, 0.5, 0.2, 0]) * reach
        heights = middle + half * np.array([0.92, 1.05, 0.85, 0.45, 0, -0.45, -0.8, -1])
    else:  # Angular: square, or slanting inwards.
        inward = 1.0 if kind == 3 else rng.uniform(0.4, 0.7)
        out = np.array([0, 0.5, 0.85, 0.98, 1.0, 0.97, 0.9, 0.8, 0.4, 0]) * reach
        out[5:] *= np.linspace(1, inward, 5)
        heights = middle + half * np.array([1, 1, 0.98, 0.85, 0.5, -0.5, -0.85, -0.98, -1, -1])
    foot = [wall(z) - 0.12 for z in (heights[0], heights[-1])]
    start = np.linspace(foot[0], foot[1], len(out))
    path = [(0.0, float(s + o), float(z)) for s, o, z in zip(start, out, heights, strict=True)]
    radii = [thick * (1.15 if k in (0, len(out) - 1) else 1.0) for k in range(len(out))]
    part = tube(path, radii, paint, surface, 18, 36).scaled(x=wide)
    # What would show inside the mug is pushed back into its wall.
    v = part.vertices
    least = np.array([wall(z) for z in v[:, 2]]) - 0.6 * thickness
    radial = np.hypot(v[:, 0], v[:, 1])
    push = np.maximum(1.0, least / np.maximum(radial, 1e-6))
    return replace(part, vertices=v * np.stack([push, push, np.ones_like(push)], axis=1))


def _drink(rng: Rng, radius: float, level: float) -> Part:
    """Coffee, with or without milk, or tea; sometimes froth."""
    colour = _DRINKS[rng.integers(len(_DRINKS))]
    surface = flat(64, 64, colour)
    if rng.random() < 0.3:
        y, x = np.mgrid[:64, :64] / 31.5 - 1
        froth = np.hypot(x, y) + 0.1 * noise(64, 64, seed(rng), (5, 5)) - rng.uniform(0.5, 0.9)
        surface = blend(colour, (214, 178, 130), froth * 6)
    shine = Surface(0.5, 150) if brightness(colour) < 0.5 else Surface(0.25, 60)
    return disc_part(radius, level - 0.3, level, surface, shine)
