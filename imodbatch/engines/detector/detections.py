"""What a detector says about one image, before any threshold or suppression over categories."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class RawDetections:
    """The RoIs of one image: one box and one whole softmax each.

    Attributes:
        boxes: (R, 4) float32, x0 y0 x1 y1 in continuous pixels of the image as it was given, the
            top-left corner of the image at (0, 0); inside the image and of positive area.
        scores: (R, K·M·N) float32 probabilities, C order of [class, elevation, azimuth].
        background: (R,) float32 probability of being no object; with `scores` a row sums to 1.
    """

    boxes: NDArray[np.float32]
    scores: NDArray[np.float32]
    background: NDArray[np.float32]

    def __len__(self) -> int:
        """Count the RoIs."""
        return len(self.boxes)
