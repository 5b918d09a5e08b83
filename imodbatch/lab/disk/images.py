"""Colour and depth images, each whole or not at all."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from imodbatch.tables.atomic import replacing


def write_image(
    path: Path, pixels: NDArray[Any], kind: Literal["PNG", "JPEG"] = "PNG", **how: Any
) -> None:
    """Write pixels; folders are made.

    Args:
        path: of the file.
        pixels: (H, W, 3) uint8 RGB, or (H, W) uint16.
        kind: of the file.
        **how: it is compressed, in Pillow's words.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        Image.fromarray(pixels).save(file, kind, **how)


def write_depth(path: Path, depth_m: NDArray[np.floating], **how: Any) -> None:
    """Write depth (H, W) as 16-bit millimetres in a PNG; 0 = none."""
    write_image(path, to_millimetres(depth_m.astype(np.float64)), **how)


def to_millimetres(depth_m: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Depth (H, W) in metres as 16-bit millimetres; 0 = none or beyond 65.535 m."""
    millimetres = np.round(np.nan_to_num(depth_m, nan=0.0) * 1000)
    return np.where(millimetres <= 65535, millimetres, 0).astype(np.uint16)
