"""Where a curve that is known at even steps has its top."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def peak(x: Array, y: Array) -> float:
    """Abscissa of the top of a parabola through the highest value (of even steps) and its two."""
    i = int(np.clip(y.argmax(), 1, len(y) - 2))
    bend = y[i - 1] - 2 * y[i] + y[i + 1]
    offset = 0.5 * (y[i - 1] - y[i + 1]) / bend if bend < 0 else 0.0
    return float(x[i] + np.clip(offset, -1, 1) * (x[1] - x[0]))
