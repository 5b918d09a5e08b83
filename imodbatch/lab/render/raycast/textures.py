"""All textures of a scene in one array of texels, at every power-of-two size.

A pixel that covers many texels takes them from the level where it covers about one, so print far
away turns grey and does not flicker. Between the charts of a scanned texture lies black that no
face uses: levels are averaged over used texels only, and the gaps are then filled from the
coarser levels, so that no black creeps over the seams.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.render.raycast.interface import Floats
from imodbatch.lab.render.raycast.tone import linear_of_srgb

LANE_BITS = 21
UNIT = (1 << 13) - 1
"""White. Thirteen bits of colour and eight of weight fill a lane; three lanes fill 63 bits."""
STEPS = 16
"""Places between two texels that are told apart, each way."""


@dataclass(frozen=True, eq=False)
class Pyramid:
    """One texture's levels, finest first, each (h, w) uint64: linear RGB in three lanes."""

    levels: tuple[NDArray[np.uint64], ...]

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the finest level."""
        height, width = self.levels[0].shape
        return width, height


def make_pyramid(texture: NDArray[np.uint8], corner_uvs: Floats) -> Pyramid:
    """Levels of a texture (H, W, 3) of which the faces (F, 3, 2) use a part."""
    colors = [linear_of_srgb()[texture]]
    weights = [_used(texture.shape[:2], corner_uvs)]
    while max(colors[-1].shape[:2]) > 1:
        color, weight = colors[-1], weights[-1]
        size = (max(color.shape[1] // 2, 1), max(color.shape[0] // 2, 1))
        premultiplied = cv2.resize(color * weight[..., None], size, interpolation=cv2.INTER_AREA)
        smaller = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
        premultiplied = premultiplied.reshape(size[1], size[0], 3)
        colors.append(premultiplied / np.maximum(smaller, 1e-6)[..., None])
        weights.append(smaller)
    for fine in range(len(colors) - 2, -1, -1):
        height, width = weights[fine].shape
        coarse = cv2.resize(colors[fine + 1], (width, height), interpolation=cv2.INTER_LINEAR)
        gap = weights[fine] <= 0
        colors[fine] = np.where(gap[..., None], coarse.reshape(height, width, 3), colors[fine])
    return Pyramid(tuple(_pack(color) for color in colors))


def _used(shape: tuple[int, int], corner_uvs: Floats) -> Floats:
    """1 where a face uses the texel, 0 elsewhere; (H, W). Repeated textures are used wholly."""
    height, width = shape
    if not len(corner_uvs) or corner_uvs.min() < -1e-3 or corner_uvs.max() > 1 + 1e-3:
        return np.ones(shape, dtype=np.float32)
    used = np.zeros(shape, dtype=np.uint8)
    corners = np.floor(corner_uvs * np.array([width, height])).astype(np.int32)
    corners = np.clip(corners, 0, [width - 1, height - 1])
    cv2.polylines(used, list(corners), True, 1)
    for corner in corners[np.abs(_cross(corners)) > 2]:
        cv2.fillConvexPoly(used, corner, 1)
    return used.astype(np.float32)


def _cross(corners: NDArray[np.int32]) -> NDArray[np.int64]:
    """Twice the signed area (F,) of triangles (F, 3, 2)."""
    u, v = np.moveaxis(corners[:, 1:].astype(np.int64) - corners[:, :1], 1, 0)
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _pack(color: Floats) -> NDArray[np.uint64]:
    """Linear RGB (h, w, 3) as one number per texel: one look-up and one sum for all channels."""
    lanes = np.rint(np.clip(color, 0, 1) * UNIT).astype(np.uint64)
    packed = lanes[..., 0] | (lanes[..., 1] << LANE_BITS) | (lanes[..., 2] << 2 * LANE_BITS)
    return packed.astype(np.uint64)


class TexelStore:
    """Many pyramids in one array, looked up by (texture, level)."""

    def __init__(self, pyramids: list[Pyramid]) -> None:
        n_levels = max((len(p.levels) for p in pyramids), default=1)
        self.n_levels = np.array([len(p.levels) for p in pyramids], dtype=np.int32)
        shape = (len(pyramids), n_levels)
        self._start = np.zeros(shape, dtype=np.int32)
        self._width = np.ones(shape, dtype=np.int32)
        self._height = np.ones(shape, dtype=np.int32)
        start, parts = 0, []
        for i, pyramid in enumerate(pyramids):
            for j in range(n_levels):
                level = pyramid.levels[min(j, len(pyramid.levels) - 1)]
                if j < len(pyramid.levels):
                    parts.append(level.ravel())
                    self._start[i, j] = start
                    start += level.size
                else:
                    self._start[i, j] = self._start[i, j - 1]
                self._height[i, j], self._width[i, j] = level.shape
        self._texels = np.concatenate(parts) if parts else np.zeros(1, dtype=np.uint64)

    def sample(self, texture: NDArray[np.int32], uv: Floats, level: Floats) -> Floats:
        """Linear RGB (3, N).

        Args:
            texture: (N,) which texture.
            uv: (2, N) texture coordinates.
            level: (N,) the logarithm to base 2 of the texels that a pixel covers each way.
        """
        level = np.clip(level, 0, self.n_levels[texture] - 1)
        lower = level.astype(np.int32)
        color = self._bilinear(texture, uv, lower)
        between = np.flatnonzero(level > lower)
        if between.size:
            upper = self._bilinear(texture[between], uv[:, between], lower[between] + 1)
            share = level[between] - lower[between]
            color[:, between] += share * (upper - color[:, between])
        return color

    def _bilinear(self, texture: NDArray[np.int32], uv: Floats, level: NDArray[np.int32]) -> Floats:
        """Weighted mean of four texels (3, N)."""
        cell = texture * self._start.shape[1] + level
        width, height = self._width.ravel().take(cell), self._height.ravel().take(cell)
        start = self._start.ravel().take(cell)
        x0, x1, right = _neighbours(uv[0], width)
        y0, y1, lower = _neighbours(uv[1], height)
        left, upper = STEPS - right, STEPS - lower
        y0 = start + y0 * width
        y1 = start + y1 * width
        total = self._texels.take(y0 + x0) * (left * upper)
        total += self._texels.take(y0 + x1) * (right * upper)
        total += self._texels.take(y1 + x0) * (left * lower)
        total += self._texels.take(y1 + x1) * (right * lower)
        color = np.empty((3, len(total)), np.float32)
        mask = np.uint64((1 << LANE_BITS) - 1)
        for channel in range(3):
            color[channel] = (total >> np.uint64(channel * LANE_BITS)) & mask
        color *= np.float32(1 / (UNIT * STEPS * STEPS))
        return color


def _neighbours(
    coordinate: Floats, size: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.uint64]]:
    """The two texels (N,) about a texture coordinate (N,), and the second one's share in steps.

    A texture that repeats goes on at its other side; one that does not stops at its border.
    """
    inside = (coordinate >= 0) & (coordinate <= 1)
    steps = np.floor((coordinate * size - np.float32(0.5)) * STEPS + np.float32(0.5)).astype(
        np.int32
    )
    first = steps >> 4
    share = (steps & (STEPS - 1)).astype(np.uint64)
    second = np.minimum(first + 1, size - 1)
    if inside.all():
        return np.maximum(first, 0), second, share
    return (
        np.where(inside, np.maximum(first, 0), first % size),
        np.where(inside, second, (first + 1) % size),
        share,
    )
