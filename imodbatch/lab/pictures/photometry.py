"""What light and a cheap camera do to a picture: gain, tint, contrast, blur, noise, JPEG."""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
NOISE_SIDE_PX = 1024
NOISE_STEPS = 16
"""Noise is kept in sixteenths."""
LUMA = np.array([0.299, 0.587, 0.114])


def jitter_object(rgba: Pixels, rng: np.random.Generator) -> Pixels:
    """An object as it looks in other light than it was rendered in."""
    gain = np.exp(rng.normal(0, 0.14)) * (1 + rng.normal(0, 0.03, 3))
    gamma = float(np.exp(rng.normal(0, 0.12)))
    steps = np.linspace(0, 1, 256)[:, None] ** gamma * gain * 255
    table = np.empty((1, 256, 4), np.uint8)
    table[0, :, :3] = np.clip(np.rint(steps), 0, 255)
    table[0, :, 3] = np.arange(256)
    return cv2.LUT(rgba, table)


def jitter_image(image: Pixels, rng: np.random.Generator) -> Pixels:
    """A picture (h, w, 3) as another camera would have taken it."""
    result = _recolour(image, rng)
    if rng.random() < 0.35:
        result = cv2.GaussianBlur(result, (0, 0), float(rng.uniform(0.3, 1.1)))
    if rng.random() < 0.8:
        result = _add_noise(result, float(rng.uniform(0.5, 5.5)), rng)
    if rng.random() < 0.7:
        result = _through_jpeg(result, int(rng.integers(45, 96)))
    return result


def _recolour(image: Pixels, rng: np.random.Generator) -> Pixels:
    """Brightness, contrast, saturation and tint in one 3 × 4 matrix."""
    contrast = float(np.exp(rng.normal(0, 0.12)))
    saturation = float(np.exp(rng.normal(0, 0.15)))
    gain = np.exp(rng.normal(-0.03, 0.13)) * (1 + rng.normal(0, 0.03, 3))
    grey = np.broadcast_to(LUMA, (3, 3))
    matrix = gain[:, None] * contrast * (saturation * np.eye(3) + (1 - saturation) * grey)
    offset = gain * (1 - contrast) * np.asarray(cv2.mean(image)[:3])
    return cv2.transform(image, np.column_stack([matrix, offset]))


def _add_noise(image: Pixels, sigma: float, rng: np.random.Generator) -> Pixels:
    h, w = image.shape[:2]
    tile = _noise(max(NOISE_SIDE_PX, h + 64, w + 64))
    y, x = rng.integers(tile.shape[0] - h + 1), rng.integers(tile.shape[1] - w + 1)
    part = tile[y : y + h, x : x + w]
    noise = cv2.addWeighted(part, sigma / NOISE_STEPS, part, 0.0, 0.0)
    return cv2.add(image, noise, dtype=cv2.CV_8U)


@cache
def _noise(side_px: int) -> NDArray[np.int16]:
    """Normal noise (side, side, 3) to take parts of: drawing it anew takes longer than the rest."""
    noise = np.random.default_rng(20201).standard_normal((side_px, side_px, 3), np.float32)
    return np.rint(noise * NOISE_STEPS).astype(np.int16)


def _through_jpeg(image: Pixels, quality: int) -> Pixels:
    """What is left after compression."""
    coded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
