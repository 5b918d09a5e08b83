"""Pictures to put on shapes: drawn ones, and the grain of materials.

Everything random is seeded by the caller, so a picture is the same in every run.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from imodbatch.lab.objects.part import Picture

Colour = tuple[int, int, int]
Point = tuple[float, float]
Floats = NDArray[np.float64]

BEECH: tuple[Colour, Colour] = ((226, 190, 142), (190, 146, 98))
"""Early and late wood of the toys."""
OVERSAMPLING = 4
"""Drawings are made this much larger and reduced, for smooth edges."""


class Sketch:
    """A drawing in pixels of the finished picture, (0, 0) at its top-left corner."""

    def __init__(self, width_px: int, height_px: int, ground: Colour | Picture) -> None:
        """Start on a plain colour or on another picture."""
        size = (width_px * OVERSAMPLING, height_px * OVERSAMPLING)
        if isinstance(ground, np.ndarray):
            self._image = Image.fromarray(ground).resize(size, Image.Resampling.BICUBIC)
        else:
            self._image = Image.new("RGB", size, ground)
        self._draw = ImageDraw.Draw(self._image)
        self._size = (width_px, height_px)

    def ellipse(self, x: float, y: float, rx: float, ry: float, colour: Colour) -> None:
        """A filled ellipse about (x, y)."""
        self._draw.ellipse(_big((x - rx, y - ry), (x + rx, y + ry)), fill=colour)

    def box(
        self, x0: float, y0: float, x1: float, y1: float, colour: Colour, rounding: float = 0
    ) -> None:
        """A filled rectangle."""
        radius = rounding * OVERSAMPLING
        self._draw.rounded_rectangle(_big((x0, y0), (x1, y1)), radius=radius, fill=colour)

    def polygon(self, points: Sequence[Point], colour: Colour) -> None:
        """A filled polygon."""
        self._draw.polygon(_big(*points), fill=colour)

    def line(self, points: Sequence[Point], colour: Colour, width: float) -> None:
        """A line with round ends."""
        thick = max(1, round(width * OVERSAMPLING))
        self._draw.line(_big(*points), fill=colour, width=thick, joint="curve")
        for x, y in (points[0], points[-1]):
            self.ellipse(x, y, width / 2, width / 2, colour)

    def arc(
        self, x: float, y: float, rx: float, ry: float, degrees: Point, colour: Colour, width: float
    ) -> None:
        """A part of an ellipse's line, clockwise from the first angle to the second."""
        angles = np.deg2rad(np.linspace(*degrees, 24))
        points = [(x + rx * np.cos(a), y + ry * np.sin(a)) for a in angles]
        self.line(points, colour, width)

    def text(self, x: float, y: float, text: str, size: float, colour: Colour) -> None:
        """A line of text, its middle at (x, y)."""
        font = ImageFont.load_default(size * OVERSAMPLING)
        self._draw.text(
            (x * OVERSAMPLING, y * OVERSAMPLING), text, font=font, fill=colour, anchor="mm"
        )

    def picture(self) -> Picture:
        """The drawing."""
        return np.asarray(self._image.resize(self._size, Image.Resampling.BOX)).copy()


def _big(*points: Point) -> list[Point]:
    """Points at the size they are drawn."""
    return [(x * OVERSAMPLING, y * OVERSAMPLING) for x, y in points]


def plain(colour: Colour, size_px: int = 4) -> Picture:
    """One colour."""
    return np.full((size_px, size_px, 3), colour, dtype=np.uint8)


def noise(height_px: int, width_px: int, seed: int, sigma_px: Point) -> Floats:
    """Smooth noise (H, W) of mean 0 and standard deviation 1, without a seam at the edges.

    Args:
        height_px: rows.
        width_px: columns.
        seed: of the random generator.
        sigma_px: how smooth, along x and along y.
    """
    grid = np.random.default_rng(seed).standard_normal((height_px, width_px))
    fy, fx = np.fft.fftfreq(height_px)[:, None], np.fft.rfftfreq(width_px)[None]
    response = np.exp(-2 * np.pi**2 * ((fx * sigma_px[0]) ** 2 + (fy * sigma_px[1]) ** 2))
    smooth = np.fft.irfft2(np.fft.rfft2(grid) * response, s=(height_px, width_px))
    smooth = smooth - smooth.mean()
    return np.asarray(smooth / smooth.std())


def shaded(picture: Picture, factor: Floats) -> Picture:
    """A picture (H, W, 3) made lighter or darker by a factor (H, W)."""
    return np.clip(picture * factor[..., None], 0, 255).astype(np.uint8)


def furry(picture: Picture, seed: int, amount: float = 0.12) -> Picture:
    """A picture as if printed on plush: short hairs that hang down, in tufts."""
    height, width = picture.shape[:2]
    hairs = noise(height, width, seed, (0.5, 1.6))
    tufts = noise(height, width, seed + 1, (3, 4))
    return shaded(picture, 1 + amount * (0.7 * hairs + 0.6 * tufts))


def speckled(picture: Picture, seed: int, amount: float = 0.03) -> Picture:
    """A picture on a slightly uneven ground: foam, clay, paint."""
    height, width = picture.shape[:2]
    return shaded(picture, 1 + amount * noise(height, width, seed, (0.7, 0.7)))


def brushed(
    colour: Colour, width_px: int, height_px: int, seed: int, amount: float = 0.06
) -> Picture:
    """Metal brushed along the picture's rows."""
    ground = np.full((height_px, width_px, 3), colour, dtype=np.uint8)
    return shaded(ground, 1 + amount * noise(height_px, width_px, seed, (12, 0.5)))


def wood(
    light: Colour, dark: Colour, width_px: int, height_px: int, seed: int, n_rings: float = 9
) -> Picture:
    """A board sawn along the trunk: the rings show as long arches along the picture's rows.

    Args:
        light: colour of early wood.
        dark: colour of late wood.
        width_px: along the grain.
        height_px: across the grain.
        seed: of the irregularities.
        n_rings: how many rings, about, cross the board.
    """
    y, x = np.mgrid[:height_px, :width_px] / np.array([height_px, width_px])[:, None, None]
    wave = noise(height_px, width_px, seed, (width_px / 6, height_px / 8))
    depth = np.hypot(0.35 * (x + 0.25), y - 0.58) + 0.012 * wave
    ring = (depth * n_rings * 1.6) % 1.0
    late = np.clip(ring, 0, 1) ** 2 * (1 - np.clip((ring - 0.92) / 0.08, 0, 1))
    fibre = noise(height_px, width_px, seed + 1, (9, 0.5))
    share = (0.85 * late + 0.07 * fibre)[..., None]
    mixed = np.array(light) * (1 - share) + np.array(dark) * share
    picture = np.clip(mixed, 0, 255).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(picture, (3, 3), 0.6), dtype=np.uint8)
