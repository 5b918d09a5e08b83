"""Where parts of one grey image lie in another: corners and their tracks, in continuous pixels."""

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.poses.rgbd.gray import HALF_PX, Gray

Array = NDArray[np.float64]
MOST_CORNERS, CORNER_QUALITY = 300, 0.01


def corners(gray: Gray, apart_px: float) -> Array:
    """At most 300 clear corners (n, 2), so far apart at least (Shi & Tomasi 1994)."""
    found = cv2.goodFeaturesToTrack(gray, MOST_CORNERS, CORNER_QUALITY, apart_px)
    if found is None:
        return np.zeros((0, 2))
    return found.reshape(-1, 2).astype(np.float64) + HALF_PX


def track(
    gray_from: Gray, gray_to: Gray, pixels: Array, expected: Array, window_px: int, n_levels: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Look for patches of one image in another (pyramidal Lucas–Kanade, Bouguet 2001).

    Args:
        gray_from: (H, W).
        gray_to: (H, W).
        pixels: (n, 2) middles of the patches.
        expected: (n, 2) where to begin to look.
        window_px: width and height of a patch.
        n_levels: of the image pyramid, besides the image itself.

    Returns:
        (n, 2) pixels in the second image, and (n,) which of them were found.
    """
    if len(pixels) == 0:
        return pixels, np.zeros(0, dtype=np.bool_)
    start, guess = ((x - HALF_PX).astype(np.float32).reshape(-1, 1, 2) for x in (pixels, expected))
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        *(gray_from, gray_to, start, guess),
        winSize=(window_px, window_px),
        maxLevel=n_levels,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return end[:, 0].astype(np.float64) + HALF_PX, found.ravel() > 0
