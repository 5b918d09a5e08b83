"""Many textures into one atlas, and colours of vertices into a texture."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Uvs = NDArray[np.float32]
MAX_SIDE_PX = 1024
GUTTER_PX = 2
"""Repeated border around each texture, so that neighbours do not bleed in."""
MAX_REPEATS = 8
MAX_CELL_PX = 6
SHRINK = 0.85


@dataclass(frozen=True, eq=False)
class Atlas:
    """One texture (H, W, 3) and, per texture put in, where its uv (0, 0) and (1, 1) went."""

    texture: Image
    places: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]

    def move(self, number: int, uvs: Uvs) -> Uvs:
        """Texture coordinates (..., 2) of a texture as coordinates of the atlas."""
        origin, size = self.places[number]
        return (origin + uvs * size).astype(np.float32)


def make_atlas(images: list[Image], max_side_px: int = MAX_SIDE_PX) -> Atlas:
    """Pack textures side by side; all are shrunk alike until they fit."""
    if len(images) == 1:
        scale = min(1.0, max_side_px / max(images[0].shape[:2]))
        return Atlas(_scaled(images[0], scale), ((np.zeros(2), np.ones(2)),))
    scale = 1.0
    while True:
        scaled = [_scaled(image, scale) for image in images]
        corners, width, height = _shelves([image.shape[:2] for image in scaled], max_side_px)
        if width <= max_side_px and height <= max_side_px:
            break
        scale *= SHRINK
    texture = np.zeros((height, width, 3), np.uint8)
    places, whole = [], np.array([width, height])
    for image, (x, y) in zip(scaled, corners, strict=True):
        h, w = image.shape[:2]
        rim = np.pad(image, ((GUTTER_PX, GUTTER_PX), (GUTTER_PX, GUTTER_PX), (0, 0)), mode="edge")
        texture[y : y + h + 2 * GUTTER_PX, x : x + w + 2 * GUTTER_PX] = rim
        corner = np.array([x + GUTTER_PX, y + GUTTER_PX])
        places.append((corner / whole, np.array([w, h]) / whole))
    return Atlas(texture, tuple(places))


def unrepeat(image: Image, uvs: Uvs) -> tuple[Image, Uvs]:
    """A texture that repeats, written out as often as its faces (F, 3, 2) need it."""
    # The small step keeps a corner on the border, give or take rounding, in its own copy.
    uvs = uvs - np.floor(uvs.min(axis=1, keepdims=True) + 1e-4)
    repeats = np.ceil(uvs.max(axis=(0, 1), initial=1.0) - 1e-4).astype(int)
    repeats = np.clip(repeats, 1, MAX_REPEATS)
    if (repeats > 1).any():
        image = np.tile(image, (repeats[1], repeats[0], 1))
        uvs = uvs / repeats
    return image, np.clip(uvs, 0, 1).astype(np.float32)


def texture_of_corner_colors(colors: Image) -> tuple[Image, Uvs]:
    """A texture in which each face has a cell that blends its corners' colours.

    Args:
        colors: (F, 3, 3) sRGB of the faces' corners.

    Returns:
        The texture and the corners' coordinates (F, 3, 2).
    """
    n_across = int(np.ceil(np.sqrt(max(len(colors), 1))))
    cell = int(np.clip(MAX_SIDE_PX // n_across, 1, MAX_CELL_PX))
    if (colors == colors[:, :1]).all():
        cell = 1
    step = np.arange(cell) / max(cell - 1, 1)
    b, c = np.meshgrid(step, step)
    corners = colors.astype(np.float64)[:, None, None]
    blend = corners[..., 0, :] * (1 - b - c)[..., None]
    blend = blend + corners[..., 1, :] * b[..., None] + corners[..., 2, :] * c[..., None]
    if cell == 1:
        blend = corners.mean(axis=-2)
    cells = np.zeros((n_across * n_across, cell, cell, 3), np.uint8)
    cells[: len(colors)] = np.rint(np.clip(blend, 0, 255))
    cells[len(colors) :] = cells[:1]
    texture = cells.reshape(n_across, n_across, cell, cell, 3).transpose(0, 2, 1, 3, 4)
    side = n_across * cell
    index = np.arange(len(colors))
    corner = np.stack([index % n_across, index // n_across], axis=1) * cell + 0.5
    away = (cell - 1) * np.array([[0, 0], [1, 0], [0, 1]])
    uvs = (corner[:, None] + away) / side
    return texture.reshape(side, side, 3), uvs.astype(np.float32)


def _shelves(
    sizes: list[tuple[int, int]], max_side_px: int
) -> tuple[list[tuple[int, int]], int, int]:
    """Top-left corners of (height, width) rectangles set in rows, and width and height in all."""
    padded = [(h + 2 * GUTTER_PX, w + 2 * GUTTER_PX) for h, w in sizes]
    area = sum(h * w for h, w in padded)
    limit = min(max_side_px, max(int(1.1 * np.sqrt(area)), *(w for _, w in padded)))
    corners = [(0, 0)] * len(sizes)
    x = y = shelf = width = 0
    for number in sorted(range(len(sizes)), key=lambda i: -padded[i][0]):
        h, w = padded[number]
        if x and x + w > limit:
            x, y, shelf = 0, y + shelf, 0
        corners[number] = (x, y)
        x, shelf = x + w, max(shelf, h)
        width = max(width, x)
    return corners, width, y + shelf


def _scaled(image: Image, scale: float) -> Image:
    """A texture (h, w, 3) made smaller."""
    if scale >= 1:
        return image
    size = (max(int(image.shape[1] * scale), 1), max(int(image.shape[0] * scale), 1))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
