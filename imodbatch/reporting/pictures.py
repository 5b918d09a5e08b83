"""A frame with boxes, small enough for a page: drawn with OpenCV, stored as JPEG in a data URI."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Kind = Literal["missed", "ignored", "false_positive", "true_positive"]
Image = NDArray[np.uint8]
Rgb = tuple[int, int, int]

COLORS: dict[Kind, Rgb] = {
    "true_positive": (22, 150, 60),
    "false_positive": (210, 30, 40),
    "ignored": (140, 140, 140),
    "missed": (250, 204, 21),
}
DRAWING_ORDER = tuple(reversed(COLORS))
THICKNESS_PX = 2
DASH_PX = 6
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.4
MARGIN_PX = 2
JPEG_SETTINGS = [
    *(cv2.IMWRITE_JPEG_QUALITY, 85),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
]
"""Colour at full resolution, or thin lines fade."""


@dataclass(frozen=True)
class DrawnBox:
    """A box in continuous pixels of the frame: (x0, y0, x1, y1), its label and what it is."""

    box: tuple[float, float, float, float]
    kind: Kind
    label: str = ""


def draw_boxes(image: Image, boxes: Sequence[DrawnBox], max_width_px: int) -> Image:
    """The image, shrunk to a width, with boxes and labels; the last of equal kind is on top."""
    scale = min(1.0, max_width_px / image.shape[1])
    canvas = _shrunk(image, scale)
    ordered = sorted(boxes, key=lambda box: DRAWING_ORDER.index(box.kind))
    corners = [_corners(box, scale, canvas.shape) for box in ordered]
    for box, (x0, y0, x1, y1) in zip(ordered, corners, strict=True):
        if box.kind in {"missed", "ignored"}:
            _dashed(canvas, (x0, y0, x1, y1), COLORS[box.kind])
        else:
            cv2.rectangle(canvas, (x0, y0), (x1, y1), COLORS[box.kind], THICKNESS_PX)
    for box, (x0, y0, _, _) in zip(ordered, corners, strict=True):
        if box.label:
            _label(canvas, box.label, (x0, y0), COLORS[box.kind])
    return canvas


def jpeg_data_uri(image: Image) -> str:
    """An RGB image as ``data:image/jpeg;base64,…``."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(".jpg", bgr, JPEG_SETTINGS)
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode()


def _shrunk(image: Image, scale: float) -> Image:
    if scale == 1.0:
        return image.copy()
    height, width = (max(1, round(scale * side)) for side in image.shape[:2])
    shrunk: Image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return shrunk


def _corners(box: DrawnBox, scale: float, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    # OpenCV names pixels: a box from edge x0 to edge x1 holds the pixels floor(x0) to ceil(x1) - 1.
    height, width = shape[:2]
    edges = np.multiply(box.box, scale)
    indices = np.concatenate([np.floor(edges[:2]), np.ceil(edges[2:]) - 1])
    x0, y0, x1, y1 = np.clip(indices, 0, [width - 1, height - 1] * 2).astype(int).tolist()
    return x0, y0, x1, y1


def _dashed(canvas: Image, corners: tuple[int, int, int, int], color: Rgb) -> None:
    x0, y0, x1, y1 = corners
    for x in range(x0, x1 + 1, 2 * DASH_PX):
        for y in (y0, y1):
            cv2.line(canvas, (x, y), (min(x + DASH_PX - 1, x1), y), color, 1)
    for y in range(y0, y1 + 1, 2 * DASH_PX):
        for x in (x0, x1):
            cv2.line(canvas, (x, y), (x, min(y + DASH_PX - 1, y1)), color, 1)


def _label(canvas: Any, text: str, corner: tuple[int, int], color: Rgb) -> None:
    """White text on the box's colour, above the box, or inside it at the image's upper edge."""
    (width, height), base = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
    full_width, full_height = width + 2 * MARGIN_PX, height + base + MARGIN_PX
    left = max(0, min(corner[0] - 1, canvas.shape[1] - full_width))
    top = corner[1] - full_height
    if top < 0:
        top = min(corner[1], max(0, canvas.shape[0] - full_height))
    cv2.rectangle(canvas, (left, top), (left + full_width, top + full_height), color, cv2.FILLED)
    origin = (left + MARGIN_PX, top + height + MARGIN_PX // 2)
    cv2.putText(canvas, text, origin, FONT, FONT_SCALE, (255, 255, 255), 1, cv2.LINE_AA)
