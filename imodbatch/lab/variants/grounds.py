"""Grounds of prints: gradients, stripes, waves, rays, dots, mosaics, marble.

They fit together at the left and the right edge, to wrap round a can without a seam.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from imodbatch.lab.objects.paint import Colour, Floats, noise
from imodbatch.lab.objects.part import Picture
from imodbatch.lab.variants.palettes import Rng, mixed

Ground = Callable[[Rng, int, int, Sequence[Colour]], Picture]


def ground(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    """A ground of a random kind, (height, width, 3).

    Args:
        rng: decides the kind.
        height: in pixels.
        width: in pixels.
        colours: two or more; the first is the main one.
    """
    return _KINDS[rng.integers(len(_KINDS))](rng, height, width, colours)


def flat(height: int, width: int, colour: Colour) -> Picture:
    """One colour."""
    return np.full((height, width, 3), colour, np.uint8)


def seed(rng: Rng) -> int:
    """A seed for `noise`."""
    return int(rng.integers(1 << 30))


def blend(one: Colour, other: Colour, share: Floats) -> Picture:
    """Between two colours by a share (H, W), cut to 0 to 1."""
    weight = np.clip(share, 0, 1)[..., None]
    return np.round(np.array(one) * (1 - weight) + np.array(other) * weight).astype(np.uint8)


def disc(picture: Picture, centre: tuple[float, float], radius: float, colour: Colour) -> None:
    """A filled circle with a smooth edge."""
    at = (round(centre[0] * 16), round(centre[1] * 16))
    cv2.circle(picture, at, max(1, round(radius * 16)), colour, -1, cv2.LINE_AA, 4)


def cells(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    """A mosaic of the colours."""
    points = rng.random((rng.integers(12, 70), 2)) * [width, height]
    y, x = np.mgrid[:height:2, :width:2]
    dx = np.abs(x[..., None] - points[:, 0])
    distance = np.minimum(dx, width - dx) ** 2 + (y[..., None] - points[:, 1]) ** 2
    ink = np.array([colours[k % len(colours)] for k in range(len(points))], np.uint8)
    mosaic = ink[distance.argmin(axis=-1)]
    return np.asarray(cv2.resize(mosaic, (width, height), interpolation=cv2.INTER_LINEAR))


def _grid(height: int, width: int) -> tuple[Floats, Floats]:
    """Rows and columns (H, W) as fractions."""
    y, x = np.mgrid[:height, :width]
    return y / height, x / width


def _plain(_: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    return flat(height, width, colours[0])


def _gradient(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    y, _ = _grid(height, width)
    end = mixed(colours[0], colours[1], rng.uniform(0.4, 1))
    return blend(colours[0], end, y if rng.random() < 0.5 else 1 - y)


def _stripes(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    y, x = _grid(height, width)
    slope, count = rng.integers(0, 4), rng.integers(2, 9)
    phase = slope * x + count * y if rng.random() < 0.6 else count * x
    return blend(colours[0], colours[1], (np.sin(2 * np.pi * phase) - rng.uniform(-0.8, 0.8)) * 12)


def _swoosh(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    y, x = _grid(height, width)
    wave = rng.uniform(0.05, 0.25) * np.sin(2 * np.pi * (rng.integers(1, 3) * x + rng.random()))
    border = y - rng.uniform(0.3, 0.7) - wave
    picture = blend(colours[0], colours[1], border * height / 2)
    picture[np.abs(border + 0.04) < rng.uniform(0.008, 0.025)] = colours[3 % len(colours)]
    return picture


def _rays(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    y, x = _grid(height, width)
    angle = np.arctan2((y - 0.5) * height / width, x - 0.5)
    return blend(
        colours[0], mixed(colours[0], colours[1], 0.6), np.sin(rng.integers(6, 14) * angle) * 8
    )


def _dots(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    picture = flat(height, width, colours[0])
    step = width / rng.integers(5, 14)
    for row in range(int(height / step) + 2):
        for column in range(int(width / step) + 2):
            disc(picture, ((column + 0.5 * (row % 2)) * step, row * step), step * 0.24, colours[1])
    return picture


def _marble(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    field = noise(height, width, seed(rng), (width / 9, height / 9))
    return blend(colours[0], colours[1], 0.5 + (field - rng.normal()) * rng.choice([0.4, 6]))


def _zones(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    picture = flat(height, width, colours[0])
    for _ in range(rng.integers(1, 4)):
        at = int(rng.random() * height)
        end = at + int(height * rng.uniform(0.02, 0.35))
        picture[at:end] = colours[int(rng.integers(1, len(colours)))]
    return picture


def _glow(rng: Rng, height: int, width: int, colours: Sequence[Colour]) -> Picture:
    y, x = _grid(height, width)
    radius = np.hypot(x - 0.5, (y - 0.5) * height / width)
    middle = mixed(colours[0], (255, 255, 255), rng.uniform(0, 0.6))
    return blend(middle, colours[0], radius * 2)


_KINDS: tuple[Ground, ...] = (
    _plain, _plain, _gradient, _stripes, _swoosh, _rays, _dots, cells, _marble, _zones, _glow,
)  # fmt: skip
