"""What mugs carry outside: nothing, marks, words, bands, pictures, two glazes, speckles."""

from collections.abc import Callable

import numpy as np

from imodbatch.lab.objects.paint import Colour, noise, speckled
from imodbatch.lab.objects.part import Picture
from imodbatch.lab.variants.grounds import blend, disc, flat, ground, seed
from imodbatch.lab.variants.lettering import word
from imodbatch.lab.variants.palettes import (
    Rng,
    Shades,
    any_colour,
    brand,
    from_shades,
    hsv,
    mixed,
    noun,
    readable_on,
    scheme,
)
from imodbatch.lab.variants.prints import fruit, mascot, photograph
from imodbatch.lab.variants.small_print import logo

WIDTH_PX, HEIGHT_PX = 480, 170
_GLAZES: Shades = (
    (0.36, (0.05, 0.17), (0.0, 0.1), (0.88, 1.0)),  # White.
    (0.11, (0.0, 1.0), (0.0, 0.2), (0.05, 0.16)),
    (0.13, (0.54, 0.68), (0.5, 1.0), (0.25, 0.85)),
    (0.1, (0.96, 1.03), (0.7, 1.0), (0.4, 0.85)),
    (0.07, (0.3, 0.48), (0.3, 0.9), (0.2, 0.6)),
    (0.07, (0.04, 0.1), (0.3, 0.75), (0.2, 0.65)),
    (0.06, (0.08, 0.16), (0.5, 0.95), (0.8, 1.0)),
    (0.1, (0.0, 1.0), (0.0, 0.9), (0.3, 1.0)),
)


def glaze(rng: Rng) -> Colour:
    """White most often; then black, blue, red, green, brown, yellow and others."""
    return from_shades(rng, _GLAZES)


def decorated(rng: Rng, body: Colour) -> Picture:
    """The outside of a mug of a colour; the middle is its front."""
    kind = rng.choice(len(_KINDS), p=[share for share, _ in _KINDS])
    return _KINDS[kind][1](rng, body)


def _ink(rng: Rng, body: Colour) -> Colour:
    """A colour that shows on the body."""
    return readable_on(body, (*scheme(rng), any_colour(rng)), rng)


def _middle(rng: Rng) -> tuple[float, float]:
    """About the middle of the front."""
    return WIDTH_PX / 2 + rng.normal(0, 6), HEIGHT_PX * rng.uniform(0.42, 0.55)


def _plain(_: Rng, body: Colour) -> Picture:
    return flat(HEIGHT_PX, WIDTH_PX, body)


def _mark(rng: Rng, body: Colour) -> Picture:
    """A mark in front; half of the time the same one behind, for the left-handed."""
    wall = flat(HEIGHT_PX, WIDTH_PX, body)
    logo(wall, rng, _middle(rng), rng.uniform(22, 60), _ink(rng, body))
    if rng.random() < 0.5:
        quarter = WIDTH_PX // 4
        front = wall[:, quarter:-quarter]
        wall = np.roll(np.concatenate([front, front], axis=1), quarter, axis=1)
    return wall


def _words(rng: Rng, body: Colour) -> Picture:
    wall, (x, y), ink = flat(HEIGHT_PX, WIDTH_PX, body), _middle(rng), _ink(rng, body)
    for row in range(rng.integers(1, 4)):
        text = noun(rng) if row else brand(rng)
        word(wall, rng, text, (x, y + 34 * (row - 1)), (rng.uniform(60, 130), 32), ink)
    return wall


def _bands(rng: Rng, body: Colour) -> Picture:
    wall, colours = flat(HEIGHT_PX, WIDTH_PX, body), scheme(rng)
    for _ in range(rng.integers(1, 5)):
        at, wide = int(rng.random() * HEIGHT_PX), int(rng.choice([3, 5, 10, 30, 60]))
        wall[at : at + wide] = colours[rng.integers(5)]
    return wall


def _photograph(rng: Rng, body: Colour) -> Picture:
    wall = flat(HEIGHT_PX, WIDTH_PX, body)
    high, wide = int(rng.uniform(70, 130)), int(rng.uniform(80, 170))
    x, y = WIDTH_PX // 2 - wide // 2, (HEIGHT_PX - high) // 2
    wall[y : y + high, x : x + wide] = photograph(rng, high, wide)
    return wall


def _two_glazes(rng: Rng, body: Colour) -> Picture:
    x = np.linspace(0, 2 * np.pi, WIDTH_PX)[None]
    edge = rng.uniform(0.25, 0.75) + 0.02 * np.sin(rng.integers(1, 6) * x)
    below = (np.linspace(0, 1, HEIGHT_PX)[:, None] - edge) * HEIGHT_PX
    return blend(body, glaze(rng), below * rng.choice([0.5, 0.06]))


def _all_over(rng: Rng, _: Colour) -> Picture:
    return ground(rng, HEIGHT_PX, WIDTH_PX, scheme(rng))


def _speckled(rng: Rng, body: Colour) -> Picture:
    wall = flat(HEIGHT_PX, WIDTH_PX, body)
    spots = noise(HEIGHT_PX, WIDTH_PX, seed(rng), (1.0, 1.0)) > rng.uniform(1.8, 2.6)
    wall[spots] = readable_on(body, (hsv(0.07, 0.6, 0.25), (30, 30, 30)), rng)
    return speckled(wall, seed(rng), 0.04)


def _mark_on_pattern(rng: Rng, body: Colour) -> Picture:
    wall = ground(rng, HEIGHT_PX, WIDTH_PX, (body, *scheme(rng)[1:]))
    logo(wall, rng, _middle(rng), rng.uniform(30, 55), _ink(rng, body))
    return wall


def _scattered(rng: Rng, body: Colour) -> Picture:
    wall, colours, motif = flat(HEIGHT_PX, WIDTH_PX, body), scheme(rng), rng.integers(3)
    for _ in range(rng.integers(8, 26)):
        at = (float(rng.random() * WIDTH_PX), float(rng.random() * HEIGHT_PX))
        size = rng.uniform(6, 16)
        if motif == 0:
            disc(wall, at, size, colours[rng.integers(1, 5)])
        else:
            (fruit if motif == 1 else mascot)(wall, rng, at, size)
    return wall


def _tone_on_tone(rng: Rng, body: Colour) -> Picture:
    return ground(rng, HEIGHT_PX, WIDTH_PX, (body, mixed(body, (0, 0, 0), 0.6)))


_KINDS: tuple[tuple[float, Callable[[Rng, Colour], Picture]], ...] = (
    (0.27, _plain), (0.2, _mark), (0.1, _words), (0.07, _bands), (0.07, _photograph),
    (0.06, _two_glazes), (0.06, _all_over), (0.05, _speckled), (0.04, _mark_on_pattern),
    (0.04, _scattered), (0.04, _tone_on_tone),
)  # fmt: skip
