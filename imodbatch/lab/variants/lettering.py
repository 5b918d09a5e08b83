"""Words as packaging shows them: bold, outlined, shaded, slanted, bent and turned."""

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from imodbatch.lab.objects.paint import Colour
from imodbatch.lab.objects.part import Picture
from imodbatch.lab.variants.palettes import Rng

Mask = NDArray[np.uint8]

_STROKE_FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX, cv2.FONT_HERSHEY_SCRIPT_COMPLEX, cv2.FONT_HERSHEY_SCRIPT_SIMPLEX,
)  # fmt: skip
_HEIGHT_PX = 72


def word_mask(rng: Rng, text: str, width_px: float, height_px: float) -> Mask:
    """Coverage (h, w) of a word in a random style, at most as large as given.

    Args:
        rng: decides the style.
        text: the word.
        width_px: greatest width.
        height_px: greatest height.
    """
    mask = _letters(rng, text)
    if rng.random() < 0.35:
        mask = _slanted(mask, rng.uniform(0.1, 0.35))
    if rng.random() < 0.4:
        mask = _bent(mask, rng.uniform(-0.35, 0.35), rng.uniform(-0.3, 0.4))
    mask = _cropped(mask)
    factor = min(width_px / mask.shape[1], height_px / mask.shape[0])
    stretch = rng.uniform(0.85, 1.25)
    size = (
        max(2, min(int(width_px), round(mask.shape[1] * factor))),
        max(2, min(int(height_px), round(mask.shape[0] * factor * stretch))),
    )
    return np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_AREA), np.uint8)


def _letters(rng: Rng, text: str) -> Mask:
    """A word at a fixed height, with room round it."""
    if rng.random() < 0.55:
        font = ImageFont.load_default(_HEIGHT_PX)
        left, top, right, bottom = font.getbbox(text)
        image = Image.new("L", (int(right - left) + 60, int(bottom - top) + 60))
        weight = int(rng.choice([0, 2, 4, 6]))
        ImageDraw.Draw(image).text(
            (30 - left, 30 - top), text, font=font, fill=255, stroke_width=weight
        )
        return np.asarray(image)
    face = int(rng.choice(_STROKE_FONTS))
    weight = int(rng.integers(3, 13))
    (width, height), below = cv2.getTextSize(text, face, 2.6, weight)
    mask = np.zeros((height + below + 60, width + 60), np.uint8)
    cv2.putText(mask, text, (30, height + 30), face, 2.6, 255, weight, cv2.LINE_AA)
    return mask


def _slanted(mask: Mask, slope: float) -> Mask:
    """Leaning to the right."""
    height, width = mask.shape
    matrix = np.array([[1, -slope, slope * height], [0, 1, 0]], np.float64)
    return np.asarray(cv2.warpAffine(mask, matrix, (width + int(slope * height), height)), np.uint8)


def _bent(mask: Mask, arch: float, bulge: float) -> Mask:
    """The word along an arch, its middle taller or smaller than its ends."""
    height, width = mask.shape
    room = int(height * (abs(arch) + 0.5))
    y, x = np.mgrid[: height + 2 * room, :width].astype(np.float32)
    across = (2 * x / width - 1) ** 2
    scale = 1 + bulge * (0.5 - across)
    source_y = (y - room - height / 2 - arch * height * (across - 0.5)) / scale + height / 2
    return np.asarray(cv2.remap(mask, x, source_y.astype(np.float32), cv2.INTER_LINEAR), np.uint8)


def _cropped(mask: Mask) -> Mask:
    """Without empty borders."""
    rows, columns = np.flatnonzero(mask.max(axis=1)), np.flatnonzero(mask.max(axis=0))
    if not len(rows):
        return np.full((4, 4), 255, np.uint8)
    return mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def stamp(
    picture: Picture, mask: Mask, centre: tuple[float, float], colour: Colour | Picture
) -> None:
    """Put a colour, or a picture of the mask's size, where the mask covers; cut at the borders.

    Args:
        picture: changed in place.
        mask: (h, w) coverage.
        centre: (x, y) of the mask's middle on the picture.
        colour: what is put there.
    """
    height, width = mask.shape
    x0, y0 = round(centre[0] - width / 2), round(centre[1] - height / 2)
    x1, y1 = min(x0 + width, picture.shape[1]), min(y0 + height, picture.shape[0])
    left, top = max(x0, 0), max(y0, 0)
    if left >= x1 or top >= y1:
        return
    cut = (slice(top - y0, y1 - y0), slice(left - x0, x1 - x0))
    share = mask[cut][..., None] / 255.0
    ink = colour[cut] if isinstance(colour, np.ndarray) else np.array(colour)
    there = picture[top:y1, left:x1]
    picture[top:y1, left:x1] = np.round(there * (1 - share) + ink * share).astype(np.uint8)


def word(
    picture: Picture,
    rng: Rng,
    text: str,
    centre: tuple[float, float],
    size: tuple[float, float],
    colour: Colour,
    edge: Colour | None = None,
    turn_deg: float = 0.0,
) -> None:
    """A word in a random style, with an outline and a shadow if an edge colour is given.

    Args:
        picture: changed in place.
        rng: decides the style.
        text: the word.
        centre: (x, y) of its middle.
        size: greatest (width, height) before it is turned.
        colour: of the letters.
        edge: of the outline.
        turn_deg: counter-clockwise.
    """
    mask = word_mask(rng, text, *size)
    margin = 4 + mask.shape[0] // 6
    mask = np.pad(mask, margin)
    if turn_deg:
        mask = turned(mask, turn_deg)
    if edge is not None:
        around = max(1, round(mask.shape[0] * rng.uniform(0.02, 0.07)))
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * around + 1,) * 2)
        outline = np.asarray(cv2.dilate(mask, kernel), np.uint8)
        drop = rng.integers(0, around + 2)
        stamp(picture, outline, (centre[0] + drop, centre[1] + drop), edge)
        stamp(picture, outline, centre, edge)
    stamp(picture, mask, centre, colour)


def turned(mask: Mask, degrees: float) -> Mask:
    """A mask turned counter-clockwise, on a larger ground."""
    height, width = mask.shape
    cos, sin = abs(np.cos(np.deg2rad(degrees))), abs(np.sin(np.deg2rad(degrees)))
    new = (int(width * cos + height * sin) + 2, int(height * cos + width * sin) + 2)
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1.0)
    matrix[:, 2] += [(new[0] - width) / 2, (new[1] - height) / 2]
    return np.asarray(cv2.warpAffine(mask, matrix, new), np.uint8)
