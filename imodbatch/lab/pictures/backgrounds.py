"""Pictures without target objects, such as frames of a robot in its surroundings → random crops."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.datasets.images import is_listed

SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".webp"}
SMALLEST_CROP = 0.45
"""Share of the largest crop's side."""


def list_backgrounds(folder: Path) -> list[Path]:
    """All pictures in a folder and below it, sorted.

    Raises:
        DataError: there is no such folder or no picture in it.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder of backgrounds. Correct the path.")
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
    if not paths:
        raise DataError(f"{folder}: no pictures ({', '.join(sorted(SUFFIXES))}). Put some there.")
    return paths


def random_background(
    paths: Sequence[Path], width_px: int, height_px: int, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """A random part of a random picture, mirrored half of the time, (height, width, 3) RGB.

    Raises:
        DataError: the picture cannot be read.
    """
    path = paths[int(rng.integers(len(paths)))]
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR) if is_listed(path) else None
    if picture is None:
        raise DataError(f"{path}: not a readable picture. Remove it from the backgrounds.")
    h, w = picture.shape[:2]
    # The largest crop of the wanted shape, then a part of it.
    fit = min(w / width_px, h / height_px) * rng.uniform(SMALLEST_CROP, 1.0)
    crop_w, crop_h = (max(1, int(fit * side)) for side in (width_px, height_px))
    x, y = int(rng.integers(w - crop_w + 1)), int(rng.integers(h - crop_h + 1))
    crop = picture[y : y + crop_h, x : x + crop_w]
    if rng.random() < 0.5:
        crop = crop[:, ::-1]
    how = cv2.INTER_AREA if fit > 1 else cv2.INTER_LINEAR
    resized = cv2.resize(np.ascontiguousarray(crop), (width_px, height_px), interpolation=how)
    return cv2.cvtColor(resized, cv2.COLOR_BGR2RGB)
