"""The slots of a voxel: what a view adds where a view from the same side has been before.

A cell (azimuth, elevation) of a voxel is one slot; its first view fills it. A later one changes
what it holds: to the mean of its views, to their greatest, or to the latest.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
CellReduce = Literal["mean", "max", "last"]


def slot_changes(
    votes: Array, enters: Bools, cells: Ints, cell_reduce: CellReduce
) -> tuple[Array, Ints]:
    """What each box changes in its own slot: their sum so far is the sum over the slots.

    All slots are filled at once, visit by visit: first every slot's first box, then every slot's
    second one, and so on.

    Args:
        votes: (V, K, D), each voxel's boxes in order of time.
        enters: (V, K) whether the box enters its slot for the class.
        cells: (3, V) voxel, elevation and azimuth, which name the slot.
        cell_reduce: how the boxes of one slot combine, element by element.

    Returns:
        Changes (V, K, D) of the slot's content, and (V, K) 1 where the box is the slot's first.
    """
    slot = np.unique(cells, axis=1, return_inverse=True)[1].reshape(-1)
    by_slot = np.argsort(slot, kind="stable")
    first = np.searchsorted(slot[by_slot], slot)
    visit = np.empty_like(slot)
    visit[by_slot] = np.arange(len(slot)) - first[by_slot]
    by_visit = np.argsort(visit, kind="stable")
    n_slots = int(slot.max(initial=-1)) + 1
    content = np.zeros((n_slots, *votes.shape[1:]))
    n_entered = np.zeros((n_slots, votes.shape[1]), dtype=np.int64)
    changes, is_first = np.empty_like(votes), np.empty(enters.shape, dtype=np.int64)
    for rows in np.split(by_visit, np.cumsum(np.bincount(visit))[:-1]):
        at = slot[rows]
        is_first[rows] = enters[rows] & (n_entered[at] == 0)
        n_entered[at] += enters[rows]
        updated = UPDATE_SLOT[cell_reduce](content[at], votes[rows], n_entered[at][:, :, None])
        updated = np.where(enters[rows][:, :, None], updated, content[at])
        changes[rows] = updated - content[at]
        content[at] = updated
    return changes, is_first


def _running_mean(content: Array, votes: Array, n_entered: Ints) -> Array:
    return content + (votes - content) / np.maximum(n_entered, 1)


def _running_max(content: Array, votes: Array, n_entered: Ints) -> Array:  # noqa: ARG001
    return np.maximum(content, votes)


def _latest(content: Array, votes: Array, n_entered: Ints) -> Array:  # noqa: ARG001
    return votes


UPDATE_SLOT = {"mean": _running_mean, "max": _running_max, "last": _latest}
