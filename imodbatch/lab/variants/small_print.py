"""What packages carry on their sides and backs: tables, paragraphs, bar codes, puzzles, logos."""

import cv2
import numpy as np

from imodbatch.lab.objects.paint import Colour, noise, shaded
from imodbatch.lab.objects.part import Picture
from imodbatch.lab.variants.grounds import disc, seed
from imodbatch.lab.variants.lettering import word
from imodbatch.lab.variants.palettes import Rng, brand, noun, vivid
from imodbatch.lab.variants.prints import burst, fruit, mascot, polygon

_BLACK, _WHITE = (24, 24, 26), (250, 250, 248)
Box = tuple[int, int, int, int]
"""x0, y0, x1, y1 in pixels."""


def fill(picture: Picture, box: Box, colour: Colour) -> None:
    """A rectangle."""
    picture[max(box[1], 0) : box[3], max(box[0], 0) : box[2]] = colour


def paragraph(picture: Picture, rng: Rng, box: Box, colour: Colour, step: float = 5.0) -> None:
    """Lines of text too small to read."""
    for y in np.arange(box[1], box[3] - 1, step):
        x = float(box[0])
        end = box[2] - (rng.random() < 0.2) * rng.uniform(0, 0.6) * (box[2] - box[0])
        while x < end - 3:
            length = min(rng.uniform(4, 16), end - x)
            a, b = (round(x), round(y)), (round(x + length), round(y))
            cv2.line(picture, a, b, colour, max(1, round(step / 3.5)))
            x += length + 3


def nutrition(picture: Picture, rng: Rng, box: Box) -> None:
    """A table of nutrition facts."""
    x0, y0, x1, y1 = box
    fill(picture, box, _WHITE)
    cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), _BLACK, 1)
    heading = ((x0 + x1) / 2, y0 + 9)
    word(picture, rng, "Nutrition Facts", heading, (x1 - x0 - 6, 11), _BLACK)
    fill(picture, (x0 + 2, y0 + 17, x1 - 2, y0 + 20), _BLACK)
    for y in np.arange(y0 + 25, y1 - 4, 7):
        paragraph(picture, rng, (x0 + 3, int(y), x0 + (x1 - x0) * 6 // 10, int(y) + 3), _BLACK)
        paragraph(picture, rng, (x1 - 14, int(y), x1 - 4, int(y) + 3), _BLACK)
        fill(picture, (x0 + 2, int(y) + 3, x1 - 2, int(y) + 4), (120, 120, 120))


def bar_code(picture: Picture, rng: Rng, box: Box) -> None:
    """A bar code on white."""
    x0, y0, x1, y1 = box
    fill(picture, box, _WHITE)
    bars = rng.random(max(x1 - x0 - 6, 1)) < 0.5
    picture[y0 + 3 : y1 - 6, x0 + 3 : x1 - 3][:, bars] = _BLACK


def puzzle(picture: Picture, rng: Rng, box: Box) -> None:
    """A game for breakfast: a maze, a crossword, or things to spot."""
    x0, y0, x1, y1 = box
    fill(picture, box, (252, 248, 236))
    kind = rng.integers(3)
    step = 12
    for y in range(y0 + 4, y1 - step, step):
        for x in range(x0 + 4, x1 - step, step):
            if kind == 0:
                end = (x + step, y) if rng.random() < 0.5 else (x, y + step)
                cv2.line(picture, (x, y), end, (40, 50, 110), 2)
            elif kind == 1 and rng.random() < 0.6:
                cv2.rectangle(picture, (x, y), (x + step, y + step), (60, 60, 60), 1)
    if kind == 2:
        for _ in range(8):
            at = (rng.uniform(x0 + 14, x1 - 14), rng.uniform(y0 + 14, y1 - 14))
            (fruit if rng.random() < 0.5 else mascot)(picture, rng, at, 12)


def logo(picture: Picture, rng: Rng, centre: tuple[float, float], size: float, ink: Colour) -> None:
    """A mark: a shape, a word, a letter, a heart, or a word on a badge.

    Args:
        picture: changed in place.
        rng: decides.
        centre: (x, y).
        size: about half its width, in pixels.
        ink: main colour.
    """
    kind = rng.integers(8)
    x, y = centre
    other = vivid(rng)
    edge = other if rng.random() < 0.4 else None
    if kind == 0:
        word(picture, rng, brand(rng), centre, (2.4 * size, 1.1 * size), ink, edge)
    elif kind == 1:
        word(picture, rng, brand(rng), (x, y - 0.4 * size), (2.2 * size, 0.8 * size), ink, edge)
        word(picture, rng, noun(rng), (x, y + 0.5 * size), (1.8 * size, 0.6 * size), ink)
    elif kind == 2:
        letters = brand(rng)[: rng.integers(1, 3)].upper()
        word(picture, rng, letters, centre, (1.7 * size, 1.7 * size), ink, edge)
    elif kind == 3:
        disc(picture, centre, size, ink)
        disc(picture, centre, size * 0.86, other)
        word(picture, rng, brand(rng, 1), centre, (1.3 * size, 0.8 * size), ink)
    elif kind == 4:
        t = np.linspace(0, 2 * np.pi, 60)
        heart = np.stack([16 * np.sin(t) ** 3, -13 * np.cos(t) + 5 * np.cos(2 * t)
                          + 2 * np.cos(3 * t)], 1)  # fmt: skip
        polygon(picture, heart * size / 17 + np.array([x, y]), ink)
    elif kind == 5:
        burst(picture, rng, centre, size, ink)
        word(picture, rng, brand(rng, 1), centre, (1.1 * size, 0.6 * size), other)
    elif kind == 6:
        mascot(picture, rng, (x, y - 0.2 * size), 0.6 * size)
    else:
        t = np.linspace(0, 2 * np.pi, int(rng.integers(3, 7)) + 1)[:-1] - np.pi / 2
        for shrink, colour in ((1.0, ink), (0.6, other)):
            shape = np.stack([np.cos(t), np.sin(t)], 1) * size * shrink
            polygon(picture, shape + np.array([x, y]), colour)


def worn(picture: Picture, rng: Rng, amount: float = 0.03) -> Picture:
    """A picture as printed and handled: slightly uneven, its tones not quite pure."""
    height, width = picture.shape[:2]
    uneven = 0.5 * noise(height, width, seed(rng), (0.8, 0.8))
    uneven = uneven + 0.5 * noise(height, width, seed(rng), (width / 10, height / 10))
    lifted = 14 + picture.astype(np.float64) * (226 / 255)
    return shaded(lifted, 1 + amount * uneven)  # type: ignore[arg-type]
