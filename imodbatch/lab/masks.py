"""Where in a picture the pixels of a mask lie."""

import numpy as np
from numpy.typing import NDArray


def bounds_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int] | None:
    """Left, top, right and bottom (exclusive) of the pixels (H, W) that are set; None = none is."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
