"""Index → one object filling a small picture: cheap material to pretrain a view head on.

The crop is cut as a detector would cut it: the box is a little off, and background shows around.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imodbatch.training.backgrounds import random_background
from imodbatch.training.blending import BLENDINGS, Patch
from imodbatch.training.composition import Composer, resize_cutout
from imodbatch.training.photometry import jitter_image, jitter_object


class ObjectCrop(NamedTuple):
    """A small picture of one object.

    Attributes:
        image: (size, size, 3) uint8 RGB.
        class_id: number of its class.
        azimuth_rad: in [0, 2π).
        elevation_rad: above the object's horizon.
    """

    image: NDArray[np.uint8]
    class_id: int
    azimuth_rad: float
    elevation_rad: float


class ObjectCrops:
    """Crops by index, of the objects and backgrounds of a composer."""

    def __init__(
        self,
        composer: Composer,
        size_px: int = 64,
        fill: tuple[float, float] = (0.7, 1.05),
        shift: float = 0.08,
    ) -> None:
        """Keep what crops are made of.

        Args:
            composer: its objects, backgrounds and seed.
            size_px: side of a crop.
            fill: the object's longer side over the crop's.
            shift: of the object's middle, as a share of the crop's side.
        """
        self.composer, self.size_px, self.fill, self.shift = composer, size_px, fill, shift

    def __call__(self, index: int) -> ObjectCrop:
        """Crop number `index`."""
        composer, size = self.composer, self.size_px
        rng = np.random.default_rng([composer.seed, index, 1])
        class_id, cutouts, view = composer.random_cutout(rng)
        longer = max(2.0, float(rng.uniform(*self.fill)) * size)
        rgba = resize_cutout(cutouts.rgba(view), longer)
        image = random_background(composer.backgrounds, size, size, rng)
        offsets = rng.uniform(-self.shift, self.shift, 2) * size
        y0, x0 = (
            round(0.5 * (size - side) + offset)
            for side, offset in zip(rgba.shape[:2], offsets.tolist(), strict=True)
        )
        names = composer.settings.blendings
        if composer.settings.photometric:
            rgba = jitter_object(rgba, rng)
        BLENDINGS[names[int(rng.integers(len(names)))]](image, Patch(rgba, x0, y0), rng)
        if composer.settings.photometric:
            image = jitter_image(image, rng)
        angles = cutouts.azimuth_rad[view], cutouts.elevation_rad[view]
        return ObjectCrop(image, class_id, float(angles[0]), float(angles[1]))
