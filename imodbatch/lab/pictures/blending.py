"""Ways to paste an object so that its edge does not give it away; each picture uses one.

After Dwibedi et al. 2017, "Cut, Paste and Learn". All work in place on a part of the picture.

- ``gaussian``: the edge of the alpha mask is blurred.
- ``poisson``: the object's gradients on the background's colours. The object is put on a plain
  patch of the background's mean colour first, and that patch is cloned: so the background's
  large-scale light falls on the object, while a red brick stays red and a green one green.
- ``motion``: object and mask are smeared along a short line, as by a moving camera.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
SILHOUETTE = 128
"""Alpha from which on a pixel belongs to the object."""
CLONE_SIDE_PX = 64
"""Poisson's equation is solved at this size: what it adds to the object is smooth."""
RIM_PX = 4


@dataclass(frozen=True, eq=False)
class Patch:
    """An object at its size and place in a picture.

    Attributes:
        rgba: (h, w, 4) uint8.
        x0: column of its left edge, may be negative.
        y0: row of its top edge, may be negative.
    """

    rgba: Pixels
    x0: int
    y0: int

    def padded(self, margin_px: int) -> "Patch":
        """The same with a transparent margin."""
        m = margin_px
        rgba = cv2.copyMakeBorder(self.rgba, m, m, m, m, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0))
        return Patch(rgba, self.x0 - m, self.y0 - m)

    def window(self, image: Pixels) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Rows and columns of the image that it covers, and the same of the patch."""
        # A patch wholly outside has an empty window, on either side of the border.
        sides = zip((self.y0, self.x0), self.rgba.shape[:2], image.shape[:2], strict=True)
        rows, columns = (
            (slice(min(max(start, 0), room), min(max(start + side, 0), room)), start)
            for start, side, room in sides
        )
        own = tuple(slice(s.start - start, s.stop - start) for s, start in (rows, columns))
        return (rows[0], columns[0]), (own[0], own[1])


def gaussian(image: Pixels, patch: Patch, rng: np.random.Generator) -> None:
    """Paste with a blurred edge."""
    sigma = float(rng.uniform(0.4, 0.4 + min(1.6, 0.015 * max(patch.rgba.shape[:2]))))
    wide = patch.padded(RIM_PX)
    premultiplied = _premultiplied(wide.rgba)
    alpha = np.ascontiguousarray(premultiplied[..., 3])
    soft = cv2.GaussianBlur(alpha, (0, 0), sigma)
    # Colours beyond the old edge come from the blurred object, so that no dark rim appears.
    halo = cv2.GaussianBlur(premultiplied, (0, 0), sigma)
    spread = halo[..., :3] / np.maximum(halo[..., 3:], 1e-3)
    own = np.where(alpha[..., None] > 0.99, wide.rgba[..., :3], spread)
    _composite(image, wide, own * soft[..., None], soft)


def motion(image: Pixels, patch: Patch, rng: np.random.Generator) -> None:
    """Paste an object smeared along a line through the middle of each pixel."""
    longest = max(patch.rgba.shape[:2])
    length = float(rng.uniform(2.0, 2.0 + min(9.0, 0.06 * longest)))
    kernel = line_kernel(length, float(rng.uniform(0, np.pi)))
    wide = patch.padded(kernel.shape[0] // 2 + 1)
    smeared = cv2.filter2D(_premultiplied(wide.rgba), -1, kernel)
    _composite(image, wide, smeared[..., :3], smeared[..., 3])


def poisson(image: Pixels, patch: Patch, rng: np.random.Generator) -> None:
    """Paste so that gradients, not colours, are the object's (Pérez et al. 2003)."""
    # Wide enough that the rim is background alone when all is shrunk to the clone's size.
    rim_px = RIM_PX + math.ceil(2 * max(patch.rgba.shape[:2]) / CLONE_SIDE_PX)
    wide = patch.padded(rim_px + 2)
    (rows, columns), own = wide.window(image)
    target = image[rows, columns]
    if not target.size:
        return
    alpha = wide.rgba[own][..., 3]
    reach = cv2.dilate(alpha, np.ones((2 * rim_px + 1, 2 * rim_px + 1), np.uint8))
    rim = (reach > 0) & (alpha == 0)
    if not rim.any():
        gaussian(image, patch, rng)
        return
    plain = np.broadcast_to(target[rim].mean(axis=0), target.shape)
    weight = alpha[..., None] / np.float32(255)
    source: NDArray[np.floating[Any]] = wide.rgba[own][..., :3] * weight + plain * (1 - weight)
    strength = float(rng.uniform(0.5, 1.0))
    lent = _membrane(source, target, reach) * np.float32(strength)
    cloned = np.clip(source + lent, 0, 255)
    # Of the plain patch only a thin edge is shown: more of it would be a halo.
    soft = cv2.GaussianBlur(cv2.dilate(alpha, np.ones((3, 3), np.uint8)), (0, 0), 0.8)
    cover = np.maximum(soft[..., None] / np.float32(255), weight)
    image[rows, columns] = np.rint(target + (cloned - target) * cover).astype(np.uint8)


BLENDINGS: dict[str, Callable[[Pixels, Patch, np.random.Generator], None]] = {
    "gaussian": gaussian,
    "poisson": poisson,
    "motion": motion,
}


def contact_shadow(
    image: Pixels, patch: Patch, elevation_rad: float, rng: np.random.Generator
) -> None:
    """Darken the ground where the object stands: a soft ellipse about its footprint."""
    h, w = patch.rgba.shape[:2]
    half_w = 0.5 * w * float(rng.uniform(0.95, 1.25))
    half_h = max(1.5, min(half_w, 0.5 * h) * float(np.sin(max(elevation_rad, 0.1))))
    sigma = max(1.0, 0.25 * half_h)
    margin = int(half_w - 0.5 * w + 3 * sigma + 0.2 * w) + 2
    canvas = np.zeros((int(2 * half_h + 6 * sigma) + 4, w + 2 * margin), np.float32)
    middle = (margin + 0.5 * w + float(rng.uniform(-0.12, 0.12)) * w, 0.5 * canvas.shape[0])
    cv2.ellipse(canvas, (middle, (2 * half_w, 2 * half_h), 0.0), 1.0, -1)
    dark = cv2.GaussianBlur(canvas, (0, 0), sigma) * np.float32(rng.uniform(0.25, 0.65))
    top = round(patch.y0 + h - half_h - middle[1])
    shade = Patch(np.dstack([canvas] * 4).astype(np.uint8), patch.x0 - margin, top)
    (rows, columns), own = shade.window(image)
    image[rows, columns] = np.rint(image[rows, columns] * (1 - dark[own][..., None]))


def line_kernel(length_px: float, angle_rad: float) -> NDArray[np.float32]:
    """Weights (k, k) of a motion blur, k odd, symmetric about the middle, sum 1."""
    half = int(np.ceil(0.5 * length_px))
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    steps = np.linspace(-0.5, 0.5, 8 * half + 1) * length_px
    x, y = half + steps * np.cos(angle_rad), half + steps * np.sin(angle_rad)
    np.add.at(kernel, (np.rint(y).astype(int), np.rint(x).astype(int)), 1.0)
    kernel += kernel[::-1, ::-1]
    return kernel / kernel.sum()


def _membrane(
    source: NDArray[np.floating[Any]], target: Pixels, reach: Pixels
) -> NDArray[np.float32]:
    """What cloning adds to the source: the difference at the rim, spread smoothly inwards."""
    h, w = target.shape[:2]
    shrink = min(1.0, CLONE_SIDE_PX / max(h, w))
    small = (max(3, round(shrink * w)), max(3, round(shrink * h)))
    before, behind = (
        cv2.resize(picture, small, interpolation=cv2.INTER_AREA)
        for picture in (np.rint(source).astype(np.uint8), target)
    )
    mask = cv2.resize(reach, small, interpolation=cv2.INTER_AREA)
    # A frame of two pixels: cloning ignores what lies on the border, and a cut object touches it.
    before, behind = (
        cv2.copyMakeBorder(picture, 2, 2, 2, 2, cv2.BORDER_REPLICATE)
        for picture in (before, behind)
    )
    mask = cv2.copyMakeBorder(mask, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=0)
    mask = np.where(mask > 0, 255, 0).astype(np.uint8)
    x, y, mask_w, mask_h = cv2.boundingRect(mask)
    middle = (x + mask_w // 2, y + mask_h // 2)
    cloned = cv2.seamlessClone(before, behind, mask, middle, cv2.NORMAL_CLONE)
    added = (cloned.astype(np.float32) - before)[2:-2, 2:-2]
    # Whole numbers of 0 to 255 went in: what is left of their steps is smoothed away.
    smooth = cv2.GaussianBlur(added, (0, 0), 1.5)
    return cv2.resize(smooth, (w, h), interpolation=cv2.INTER_LINEAR)


def _premultiplied(rgba: Pixels) -> NDArray[np.float32]:
    """Colours times alpha (0 to 255) and alpha (0 to 1), (h, w, 4)."""
    result = rgba.astype(np.float32)
    result[..., 3] *= np.float32(1 / 255)
    result[..., :3] *= result[..., 3:]
    return result


def _composite(
    image: Pixels, patch: Patch, premultiplied: NDArray[np.float32], alpha: NDArray[np.float32]
) -> None:
    (rows, columns), own = patch.window(image)
    behind = image[rows, columns] * (1 - alpha[own][..., None])
    image[rows, columns] = np.rint(np.clip(premultiplied[own] + behind, 0, 255))
