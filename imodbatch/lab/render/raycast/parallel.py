"""Work on pieces of an index side by side; numpy and embree let go of Python's lock meanwhile."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
from numpy.typing import NDArray

CHUNK = 1 << 15
"""Points at once: few enough for the processor's cache, enough to outweigh Python's overhead."""


@cache
def _pool(_process: int) -> ThreadPoolExecutor:
    """One thread per processor that this process may use; a forked child gets its own."""
    return ThreadPoolExecutor(len(os.sched_getaffinity(0)))


def in_chunks(
    work: Callable[[NDArray[np.intp]], None], index: NDArray[np.intp], chunk: int = CHUNK
) -> None:
    """Call `work` on every piece of an index; pieces must not depend on each other."""
    pieces = [index[i : i + chunk] for i in range(0, len(index), chunk)]
    if len(pieces) < 2:
        for piece in pieces:
            work(piece)
        return
    for _ in _pool(os.getpid()).map(work, pieces):
        pass
