"""How large an object is and where it goes, so that no two boxes overlap too much.

The scale of an object is its longer side (of the tight box) as a share of the image's shorter side:
a height would make a flat spoon wider than the image. Scales are spread evenly over their
logarithm, since an object's size in an image goes with one over its distance.
"""

import numpy as np

from imodbatch.core.boxes import FloatArray as Boxes
from imodbatch.core.boxes import area, clip, coverage_matrix, iou_matrix

N_TRIES = 30
LARGEST_COVER = 0.85
"""Share of another object's box that a new one may lie over: a hidden one teaches nothing."""
INSIDE_SHARE = 0.75
"""Share of objects that lie wholly within the image, if they fit."""


def random_scale(scale_range: tuple[float, float], rng: np.random.Generator) -> float:
    """A scale, log-uniform."""
    low, high = np.log(scale_range)
    return float(np.exp(rng.uniform(low, high)))


def random_corner(
    width_px: int,
    height_px: int,
    image_width_px: int,
    image_height_px: int,
    taken: Boxes,
    max_iou: float,
    min_inside: float,
    rng: np.random.Generator,
) -> tuple[int, int] | None:
    """Left and top of an object, which may be outside; None if no place was found.

    Args:
        width_px: of the object.
        height_px: of the object.
        image_width_px: of the image.
        image_height_px: of the image.
        taken: (n, 4) boxes of the objects that are there, clipped to the image.
        max_iou: with any of them, of boxes clipped to the image.
        min_inside: share of the object's box that lies within the image.
        rng: source of chance.
    """
    for _ in range(N_TRIES):
        x, y = (
            _start(side, room, rng)
            for side, room in ((width_px, image_width_px), (height_px, image_height_px))
        )
        whole = np.array([[x, y, x + width_px, y + height_px]], np.float64)
        clipped = clip(whole, image_width_px, image_height_px)
        if area(clipped)[0] < min_inside * area(whole)[0]:
            continue
        if not len(taken):
            return x, y
        covered = coverage_matrix(taken, clipped).max()
        if iou_matrix(clipped, taken).max() <= max_iou and covered <= LARGEST_COVER:
            return x, y
    return None


def _start(side: int, room: int, rng: np.random.Generator) -> int:
    """Where the object begins along one axis."""
    if side <= room and rng.random() < INSIDE_SHARE**0.5:
        return int(rng.integers(room - side + 1))
    return int(rng.integers(room + 1)) - side // 2
