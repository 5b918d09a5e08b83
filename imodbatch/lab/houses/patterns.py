"""What textures are drawn with: noise that repeats without a seam, and colours of a palette."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Palette = Sequence[tuple[int, int, int]]
SIDE_PX = 512


def noise(rng: np.random.Generator, cells_x: int, cells_y: int) -> Array:
    """Smooth noise (SIDE, SIDE) in about −1..1 that repeats, of so many waves across and down."""
    grid = np.pad(rng.uniform(-1, 1, (cells_y, cells_x)), 2, mode="wrap")
    step_x, step_y = SIDE_PX / cells_x, SIDE_PX / cells_y
    size = (round((cells_x + 4) * step_x), round((cells_y + 4) * step_y))
    wide = cv2.resize(grid, size, interpolation=cv2.INTER_CUBIC)
    x, y = round(2 * step_x), round(2 * step_y)
    return np.asarray(wide[y : y + SIDE_PX, x : x + SIDE_PX], np.float64)


def clouds(rng: np.random.Generator, cells: int = 4, octaves: int = 5) -> Array:
    """Noise at several sizes, each half as strong as the last."""
    layers = [noise(rng, cells << k, cells << k) / 2**k for k in range(octaves)]
    return np.asarray(np.sum(layers, axis=0) / 1.5)


def grain(rng: np.random.Generator, stretch: int = 12) -> Array:
    """Wood fibres along x: long streaks over slow waves."""
    slow = noise(rng, 2, 6)
    rings = np.sin(2 * np.pi * (2 * slow + noise(rng, 3, 3 * stretch) * 0.6))
    return np.asarray(0.5 * rings + 0.5 * noise(rng, 8, 128) + 0.4 * noise(rng, 16, 256))


def tint(rng: np.random.Generator, palette: Palette, spread: float = 6.0) -> Array:
    """One colour of a palette (3,), a little off."""
    return np.asarray(palette[int(rng.integers(len(palette)))] + rng.normal(0, spread, 3))


def shade(colors: Array, pattern: Array, depth: float) -> Array:
    """A colour (3,) or colours (H, W, 3) made lighter and darker by a pattern (H, W)."""
    return np.asarray(colors * (1 + depth * pattern[..., None]))


def picture(values: Array) -> Picture:
    """Values as 8 bits."""
    return np.rint(np.clip(values, 0, 255)).astype(np.uint8)


def pixels() -> tuple[Array, Array]:
    """Where each pixel lies across and down, (SIDE, SIDE) in 0..1."""
    y, x = np.mgrid[:SIDE_PX, :SIDE_PX].astype(np.float64) / SIDE_PX
    return x, y


def per_cell(rng: np.random.Generator, cell: NDArray[np.int64], spread: float) -> Array:
    """A brightness for each numbered cell, (H, W)."""
    values = rng.normal(0, spread, int(cell.max()) + 1)
    return np.asarray(values[cell])
