"""Many small pictures on one texture, in shelves, each with a margin of its own edge.

The margin keeps a neighbour's colour out when a texture is read between pixels.
"""

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.objects.part import Array, Picture

WIDTH_PX = 512
MAX_HEIGHT_PX = 512
MARGIN_PX = 3


def pack(pictures: list[Picture]) -> tuple[NDArray[np.uint8], list[Array]]:
    """Lay pictures on a texture.

    Args:
        pictures: (h, w, 3) each.

    Returns:
        The texture (H, W, 3), and for each picture (u, v, width, height) as fractions of it.

    Raises:
        ValueError: they don't fit.
    """
    texture = np.zeros((MAX_HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)
    corner = np.zeros((len(pictures), 2), dtype=np.int64)
    x = y = shelf = 0
    for index in sorted(range(len(pictures)), key=lambda i: -pictures[i].shape[0]):
        padded = np.pad(pictures[index], ((MARGIN_PX,) * 2, (MARGIN_PX,) * 2, (0, 0)), "edge")
        height, width = padded.shape[:2]
        if x + width > WIDTH_PX:
            x, y, shelf = 0, y + shelf, 0
        if width > WIDTH_PX or y + height > MAX_HEIGHT_PX:
            raise ValueError(f"{len(pictures)} pictures don't fit on {WIDTH_PX} px squared.")
        texture[y : y + height, x : x + width] = padded
        corner[index] = x + MARGIN_PX, y + MARGIN_PX
        x, shelf = x + width, max(shelf, height)
    texture = texture[: y + shelf]
    size = np.array([WIDTH_PX, len(texture)])
    rectangles = [
        np.concatenate([corner[i] / size, np.array(picture.shape[1::-1]) / size])
        for i, picture in enumerate(pictures)
    ]
    return texture, rectangles
