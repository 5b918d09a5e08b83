"""What a detector says: boxes with a score for every class seen from every viewpoint."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Detections:
    """R boxes as parallel arrays.

    Attributes:
        boxes: (R, 4) x0 y0 x1 y1 in continuous pixels, the image's top-left corner at (0, 0).
        scores: (R, K·M·N) float32 in C order of [class, elevation, azimuth].
        background: (R,) float32 score of being no object.
    """

    boxes: NDArray[np.floating]
    scores: NDArray[np.float32]
    background: NDArray[np.float32]

    def __len__(self) -> int:
        """Count the boxes."""
        return len(self.boxes)

    def take(self, rows: NDArray[np.intp]) -> "Detections":
        """Some of the boxes, by their positions."""
        return Detections(self.boxes[rows], self.scores[rows], self.background[rows])


def one_hot(
    class_ids: NDArray[np.int64], scores: NDArray[np.float64], n_classes: int
) -> NDArray[np.float32]:
    """Scores (n, K) of a detector that names one class per box: an exact 0 for all others.

    Args:
        class_ids: (n,) ordinals, -1 = none of the K.
        scores: (n,) of these classes.
        n_classes: K.
    """
    found = np.zeros((len(class_ids), n_classes), dtype=np.float32)
    rows = np.flatnonzero(class_ids >= 0)
    found[rows, class_ids[rows]] = scores[rows]
    return found
