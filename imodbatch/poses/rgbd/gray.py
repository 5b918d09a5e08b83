"""Colour images of a sequence as the grey ones that features and tracking work on."""

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.poses.rgbd.frames import ColorImage, RgbdFrames

Gray = NDArray[np.uint8]
HALF_PX = 0.5
"""OpenCV and open3d count pixels from the middle of the first one, we from the image's corner."""


def to_gray(color: ColorImage) -> Gray:
    """Grey (H, W) of RGB (H, W, 3)."""
    return np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY))


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
    return to_gray(color)
