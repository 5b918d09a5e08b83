"""Colour images of a sequence as the grey ones that features and tracking work on."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.engines.rgbd import RgbdFrames
from imodbatch.errors import DataError

Gray = NDArray[np.uint8]
HALF_PX = 0.5  # opencv counts pixels from the centre of the first one, we from its corner


def read_gray(frames: RgbdFrames, position: int) -> Gray | None:
    """Grey image (H, W) of a frame; None = missing or damaged.

    Raises:
        DataError: its size is not the camera's.
    """
    color = frames.read_color(position)
    if color is None:
        return None
    height, width = color.shape[:2]
    camera = frames.camera
    if (width, height) != (camera.width_px, camera.height_px):
        raise DataError(
            f"{frames.sequence_id}: colour image of frame {frames.frame_index[position]} is "
            f"{width} × {height}, expected {camera.width_px} × {camera.height_px}. Correct "
            "camera.color in the manifest, or leave the frame out."
        )
    gray: Any = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    return gray  # type: ignore[no-any-return]
