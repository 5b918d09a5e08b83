"""Colours that go together, drawn at random; and made-up words to print."""

import colorsys

import numpy as np

from imodbatch.lab.objects.paint import Colour

Rng = np.random.Generator

_SYLLABLES = (
    "ba", "bel", "bri", "cho", "co", "cru", "da", "del", "fi", "fro", "ga", "glo", "hon", "jo",
    "ka", "kel", "lu", "ma", "mi", "nu", "or", "pa", "pep", "qui", "ra", "ro", "sun", "ta", "tri",
    "va", "vol", "wa", "xo", "yum", "za", "zin",
)  # fmt: skip
_ENDINGS = ("", "o", "a", "ix", "ly", "ee", "os", "ins", "ies", "up", "ette", "max", "on", "ers")
_NOUNS = (
    "FLAKES", "CRUNCH", "PUFFS", "RINGS", "O's", "OATS", "BRAN", "LOOPS", "SQUARES", "CLUSTERS",
    "MUESLI", "POPS", "CRISPS", "HONEY", "COCOA", "BERRY", "WHEAT", "GRAIN", "COLA", "LEMON",
    "ORANGE", "SODA", "CHERRY", "GINGER", "TONIC", "LIME", "ROOT", "ZERO", "DIET", "FRESH",
)  # fmt: skip


Range = tuple[float, float]
Shades = tuple[tuple[float, Range, Range, Range], ...]
"""Rows of a share and the ranges of hue, saturation and value; the shares sum to 1."""

_ANY: Shades = (
    (0.12, (0.0, 1.0), (0.04, 0.04), (0.88, 0.97)),
    (0.18, (0.0, 1.0), (0.08, 0.08), (0.06, 0.75)),
    (0.15, (0.0, 1.0), (0.15, 0.4), (0.75, 0.95)),
    (0.2, (0.0, 1.0), (0.5, 0.95), (0.15, 0.45)),
    (0.35, (0.0, 1.0), (0.65, 1.0), (0.5, 1.0)),
)
_PACK_HUES = (0.0, 0.98, 0.04, 0.09, 0.13, 0.16, 0.33, 0.4, 0.55, 0.6, 0.63, 0.75)
"""Reds, oranges, yellows, greens and blues, which most packages are printed in."""


def hsv(hue: float, saturation: float, value: float) -> Colour:
    """A colour from hue (turns), saturation and value (0 to 1)."""
    red, green, blue = colorsys.hsv_to_rgb(
        hue % 1.0, min(max(saturation, 0), 1), min(max(value, 0), 1)
    )
    return round(255 * red), round(255 * green), round(255 * blue)


def mixed(one: Colour, other: Colour, share: float) -> Colour:
    """A colour between two; share 0 is the first."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(one, other, strict=True))
    return red, green, blue


def vivid(rng: Rng) -> Colour:
    """A strong colour."""
    return hsv(rng.random(), rng.uniform(0.65, 1.0), rng.uniform(0.5, 1.0))


def from_shades(rng: Rng, shades: Shades) -> Colour:
    """A colour from a table of shades."""
    _, hue, saturation, value = shades[rng.choice(len(shades), p=[row[0] for row in shades])]
    return hsv(rng.uniform(*hue), rng.uniform(*saturation), rng.uniform(*value))


def any_colour(rng: Rng) -> Colour:
    """A colour of any strength: white, greys, pastels, dark and strong ones."""
    return from_shades(rng, _ANY)


def scheme(rng: Rng) -> tuple[Colour, Colour, Colour, Colour, Colour]:
    """Ground, contrast, accent, a light and a dark colour that suit each other."""
    hue = rng.choice(_PACK_HUES) + rng.normal(0, 0.02) if rng.random() < 0.7 else rng.random()
    apart = rng.choice([0.08, -0.08, 0.33, 0.5, 0.45, 0.16])
    ground = hsv(hue, rng.uniform(0.6, 1.0), rng.uniform(0.4, 0.95))
    style = rng.random()
    if style < 0.15:
        ground = hsv(hue, rng.uniform(0, 0.12), rng.uniform(0.9, 1.0))
    elif style < 0.25:
        ground = hsv(hue, rng.uniform(0, 0.4), rng.uniform(0.05, 0.2))
    contrast = hsv(hue + apart, rng.uniform(0.6, 1.0), rng.uniform(0.6, 1.0))
    accent = hsv(hue + apart + 0.4 * rng.random(), rng.uniform(0.5, 1.0), rng.uniform(0.6, 1.0))
    light = hsv(hue + 0.1, rng.uniform(0.0, 0.2), rng.uniform(0.93, 1.0))
    dark = hsv(hue + rng.choice([0, 0.5]), rng.uniform(0.4, 1.0), rng.uniform(0.08, 0.35))
    return ground, contrast, accent, light, dark


def brightness(colour: Colour) -> float:
    """Luma, 0 to 1."""
    return (0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]) / 255


def readable_on(ground: Colour, candidates: tuple[Colour, ...], rng: Rng) -> Colour:
    """One of the candidates that stands out from the ground; black or white if none does."""
    good = [c for c in candidates if abs(brightness(c) - brightness(ground)) > 0.3]
    if good:
        return good[rng.integers(len(good))]
    return (20, 20, 24) if brightness(ground) > 0.5 else (248, 248, 244)


def brand(rng: Rng, n_syllables: int = 2) -> str:
    """A made-up name."""
    name = "".join(rng.choice(_SYLLABLES, n_syllables)) + str(rng.choice(_ENDINGS))
    return name.upper() if rng.random() < 0.5 else name.capitalize()


def noun(rng: Rng) -> str:
    """A plain word of food and drink."""
    return str(rng.choice(_NOUNS))
