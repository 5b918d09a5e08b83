"""Cereal boxes and their like: upright cartons whose printed front looks along +x."""

from dataclasses import replace

import numpy as np

from imodbatch.lab.mesh import ObjectModel, Surface
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.paint import Colour, plain
from imodbatch.lab.objects.part import Part, Picture
from imodbatch.lab.objects.primitives import rounded_box
from imodbatch.lab.variants.grounds import disc, flat, ground
from imodbatch.lab.variants.lettering import word
from imodbatch.lab.variants.palettes import Rng, brand, mixed, noun, readable_on, scheme, vivid
from imodbatch.lab.variants.prints import burst, cereal_bowl, fruit, mascot, photograph, polygon
from imodbatch.lab.variants.small_print import (
    bar_code,
    fill,
    logo,
    nutrition,
    paragraph,
    puzzle,
    worn,
)

_FRONT_WIDTH, _FRONT_HEIGHT = 246, 340
_SIDE_WIDTH, _SIDE_HEIGHT = 76, 154
Colours = tuple[Colour, Colour, Colour, Colour, Colour]


def make_cereal_box(rng: Rng) -> ObjectModel:
    """A box."""
    kind = rng.random()
    if kind < 0.75:
        width, height, depth = rng.uniform(17, 22), rng.uniform(24, 34), rng.uniform(4.5, 8)
    elif kind < 0.9:
        width, height, depth = rng.uniform(11, 16), rng.uniform(15, 22), rng.uniform(3.5, 6)
    else:
        width, height, depth = rng.uniform(20, 26), rng.uniform(28, 38), rng.uniform(6, 9.5)
    colours = scheme(rng)
    name, second = brand(rng, int(rng.integers(1, 3))), noun(rng)
    front = worn(_front(rng, colours, name, second), rng, 0.025)
    twice = rng.random() < 0.25
    back = front if twice else worn(_back(rng, colours, name), rng, 0.025)
    left = worn(_side(rng, colours, name), rng, 0.025)
    right = left if twice else worn(_side(rng, colours, name), rng, 0.025)
    shell = rounded_box((depth, width, height), 0.12, front, _carton(rng), 2, 6)
    dent = 0.0 if twice else rng.uniform(-0.25, 0.35)
    shell = _bulged(shell, dent, rng.uniform(-0.15, 0.3) * (not twice), width, height)
    top = plain(mixed(colours[0], (255, 255, 255), 0.1)) if twice else _top(rng, colours, name)
    box = box_mapped(
        shell, plain(colours[0]), front=front, back=back, left=left, right=right, top=top
    )
    return assemble("cereal_box", [box], 2 if twice else "none")


def _carton(rng: Rng) -> Surface:
    """Coated board, matt to glossy."""
    return Surface(rng.uniform(0.05, 0.35), rng.uniform(10, 45))


def _bulged(part: Part, front: float, back: float, width: float, height: float) -> Part:
    """The large faces pushed out, or in, towards their middles by some centimetres."""
    v = part.vertices.copy()
    across = np.clip(1 - (2 * v[:, 1] / width) ** 2, 0, 1) * np.clip(
        1 - (2 * v[:, 2] / height) ** 2, 0, 1
    )
    v[:, 0] += np.where(v[:, 0] > 0, front, -back) * across
    return replace(part, vertices=v)


def _front(rng: Rng, colours: Colours, name: str, second: str) -> Picture:
    """Name above, something to eat below."""
    w, h = _FRONT_WIDTH, _FRONT_HEIGHT
    picture = ground(rng, h, w, colours)
    title_y = h * rng.uniform(0.14, 0.34)
    behind = picture[: h // 2].reshape(-1, 3).mean(axis=0)
    under: Colour = (int(behind[0]), int(behind[1]), int(behind[2]))
    ink = readable_on(under, colours[1:], rng)
    edge = readable_on(ink, colours, rng) if rng.random() < 0.7 else None
    if rng.random() < 0.3:  # A patch under the name.
        patch = readable_on(ink, colours, rng)
        high = int(rng.uniform(40, 60))
        if rng.random() < 0.5:
            fill(picture, (0, int(title_y) - high, w, int(title_y) + high), patch)
        else:
            points = np.linspace(0, 2 * np.pi, 40)[:, None]
            oval = np.hstack([120 * np.cos(points), high * np.sin(points)]) + np.array(
                [w / 2, title_y]
            )
            polygon(picture, oval, patch)
    _scene(rng, picture, colours)
    size = (w * rng.uniform(0.75, 0.96), rng.uniform(50, 105))
    turn = rng.normal(0, 6) if rng.random() < 0.5 else 0.0
    word(picture, rng, name, (w / 2, title_y), size, ink, edge, turn)
    word(picture, rng, second, (w / 2, title_y + size[1] * 0.55), (w * 0.7, 34), ink, edge, turn)
    if rng.random() < 0.6:
        logo(
            picture,
            rng,
            (rng.choice([34, w / 2, w - 34]), 20),
            22,
            readable_on(under, colours, rng),
        )
    if rng.random() < 0.5:
        at = (rng.choice([42, w - 42]), h * rng.uniform(0.42, 0.6))
        burst(picture, rng, at, rng.uniform(24, 40), vivid(rng))
        word(
            picture,
            rng,
            str(rng.choice(["NEW", "FREE", "50%", "BIG", "LOW FAT"])),
            at,
            (44, 22),
            (255, 255, 255),
            (30, 20, 30),
        )
    if rng.random() < 0.6:
        paragraph(picture, rng, (12, h - 22, w - 100, h - 8), ink, 5)
        word(picture, rng, f"{rng.integers(8, 30)} OZ", (w - 40, h - 14), (50, 14), ink)
    if rng.random() < 0.3:
        for k in range(rng.integers(2, 5)):
            x = 12 + 30 * k
            fill(picture, (x, h - 46, x + 25, h - 26), (250, 250, 250))
            paragraph(picture, rng, (x + 3, h - 42, x + 22, h - 28), (40, 60, 120), 5)
    return picture


def _scene(rng: Rng, picture: Picture, colours: Colours) -> None:
    """The lower part of the front: bowl, mascot, fruit, photograph, pile of cereal."""
    w, h = _FRONT_WIDTH, _FRONT_HEIGHT
    kind = rng.integers(7)
    if kind in (0, 1, 2):
        if rng.random() < 0.4:
            mascot(picture, rng, (w * rng.uniform(0.25, 0.75), h * 0.55), rng.uniform(34, 52))
        at = (w * rng.uniform(0.42, 0.58), h * rng.uniform(0.66, 0.78))
        cereal_bowl(picture, rng, at, rng.uniform(75, 112))
    elif kind == 3:
        mascot(picture, rng, (w * rng.uniform(0.35, 0.65), h * 0.62), rng.uniform(45, 70))
        cereal_bowl(picture, rng, (w * rng.uniform(0.3, 0.7), h * 0.82), rng.uniform(50, 70))
    elif kind == 4:
        for _ in range(rng.integers(4, 16)):
            at = (w * rng.random(), h * rng.uniform(0.5, 0.98))
            fruit(picture, rng, at, rng.uniform(18, 42))
    elif kind == 5:
        high = int(h * rng.uniform(0.4, 0.6))
        picture[h - high :] = photograph(rng, high, w)
        if rng.random() < 0.6:
            cereal_bowl(picture, rng, (w / 2, h * 0.74), rng.uniform(60, 100))
    else:
        disc(picture, (w / 2, h * 0.68), rng.uniform(60, 100), colours[rng.integers(1, 5)])
        for _ in range(rng.integers(1, 4)):
            at = (w * rng.uniform(0.3, 0.7), h * rng.uniform(0.6, 0.8))
            fruit(picture, rng, at, rng.uniform(25, 60))


def _back(rng: Rng, colours: Colours, name: str) -> Picture:
    """A game, text, a second title, sometimes a photograph."""
    w, h = _FRONT_WIDTH, _FRONT_HEIGHT
    picture = ground(rng, h, w, colours) if rng.random() < 0.5 else flat(h, w, colours[0])
    ink = readable_on(colours[0], colours[1:], rng)
    edge = readable_on(ink, colours, rng)
    word(picture, rng, name, (w / 2, 36), (w * 0.8, 48), ink, edge)
    y = 70
    while y < h - 60:
        high = int(rng.uniform(50, 130))
        box = (16, y, w - 16, min(y + high, h - 14))
        kind = rng.integers(4)
        if kind == 0:
            puzzle(picture, rng, box)
        elif kind == 1:
            fill(picture, box, (250, 248, 238))
            paragraph(picture, rng, (22, y + 8, w - 22, box[3] - 4), (40, 40, 50), 6)
        elif kind == 2:
            picture[box[1] : box[3], 16 : w - 16] = photograph(rng, box[3] - y, w - 32)
        else:
            logo(picture, rng, (w / 2, (y + box[3]) / 2), high * 0.45, ink)
        y += high + 12
    return picture


def _side(rng: Rng, colours: Colours, name: str) -> Picture:
    """Nutrition facts, ingredients, bar code; or the name, upright."""
    w, h = _SIDE_WIDTH, _SIDE_HEIGHT
    ground_colour = colours[0] if rng.random() < 0.75 else colours[3]
    picture = flat(h, w, ground_colour)
    ink = readable_on(ground_colour, colours[1:], rng)
    if rng.random() < 0.6:
        word(picture, rng, name, (w / 2, 15), (w - 10, 20), ink)
        nutrition(picture, rng, (7, 30, w - 7, int(rng.uniform(85, 115))))
        paragraph(picture, rng, (8, 120, w - 8, h - 6), ink, 4)
        if rng.random() < 0.4:
            bar_code(picture, rng, (20, h - 34, w - 20, h - 6))
    else:
        word(picture, rng, name, (w / 2, h / 2), (h * 0.85, w * 0.6), ink, None, 90.0)
    return picture


def _top(rng: Rng, colours: Colours, name: str) -> Picture:
    """The flaps: plain, with the name, and the line where one is tucked under the other."""
    picture = flat(60, 150, colours[0])
    ink = readable_on(colours[0], colours[1:], rng)
    word(picture, rng, name, (75, 30), (100, 26), ink)
    picture[int(rng.uniform(18, 42)) :][:2] = mixed(colours[0], (0, 0, 0), 0.4)
    return picture
