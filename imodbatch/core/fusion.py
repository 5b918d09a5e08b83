"""The idea: views of one place must agree on what it is *and* on how it is turned.

Every box that falls in a voxel was seen from some azimuth a (geometry). The detector says, for
each class k, from which azimuth b of the object's own frame it believes to look. If the object is
turned by a pose offset d, then b = a + d for every view. So each view casts its scores as votes
over d; the views' votes are added, and the best d wins (Konno et al. 2020, Eq. 1–2):

    h[k] = max_d  Σ over observed cells (a, e)  P[a, e][k, e, (a + d) mod N]

A cell (a, e) of a voxel is one slot: a camera that stands still fills the same slot again and does
not raise h. `cell_reduce` says how repeated visits combine. Elevation comes from geometry. A cell
never observed adds nothing, so h lies between 0 and the number of observed cells.

The formula printed in the paper shifts the index of the sum on both sides and does not depend on
d; what is meant is the rule above, as in RotationNet by the same author.

Baselines from the same boxes: ``single`` is the marginal over viewpoints; ``naive`` adds it up over
the frames; ``naive_log`` adds up its log-odds, which takes views as independent.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Method = Literal["single", "naive", "naive_log", "imod"]
CellReduce = Literal["mean", "max", "last"]
Mode = Literal["online", "offline"]


@dataclass(frozen=True)
class Sightings:
    """The placed boxes of one sequence, V of them, in any order.

    Attributes:
        frame: (V,) frame number; equal numbers are one moment.
        voxel: (V,) number of the voxel the box fell in.
        azimuth_bin: (V,) geometric azimuth bin a.
        elevation_bin: (V,) geometric elevation bin e.
        view_scores: (V, K, M, N) softmax scores; M = N = 1 for a detector without viewpoints.
    """

    frame: Ints
    voxel: Ints
    azimuth_bin: Ints
    elevation_bin: Ints
    view_scores: NDArray[np.floating]


@dataclass(frozen=True)
class FusedScores:
    """What fusion says of each of V boxes and K classes.

    Attributes:
        score: (V, K).
        pose_bin: (V, K) best pose hypothesis d, −1 where it has no meaning.
        n_cells: (V, K) slots (or frames, for the naive sums) behind the score.
    """

    score: Array
    pose_bin: Ints
    n_cells: Ints


def marginal(view_scores: NDArray[np.floating]) -> Array:
    """Scores per class, summed over viewpoints: (V, K, M, N) → (V, K)."""
    return view_scores.sum(axis=(-2, -1), dtype=np.float64)


def log_odds(probability: Array, floor: float) -> Array:
    """Log-odds of scores, clipped to [floor, 1 − floor]; a score of exactly 0 gives 0.

    A softmax is never exactly 0: such a score means that the detector said nothing of the class,
    which is no evidence against it.
    """
    clipped = np.clip(probability, floor, 1 - floor)
    return np.where(probability == 0, 0.0, np.log(clipped / (1 - clipped)))


def pose_votes(azimuth_scores: Array, azimuth_bins: Ints) -> Array:
    """Re-index each view's scores from the predicted azimuth b to the object pose d (Eq. 1).

    Args:
        azimuth_scores: (V, K, N) scores at the view's own elevation.
        azimuth_bins: (V,) geometric azimuth bin a of each view.

    Returns:
        (V, K, N) with ``votes[v, k, d] == azimuth_scores[v, k, (a_v + d) % N]``.
    """
    n_azimuths = azimuth_scores.shape[-1]
    predicted = (azimuth_bins[:, None] + np.arange(n_azimuths)) % n_azimuths
    return np.take_along_axis(azimuth_scores, predicted[:, None, :], axis=-1)


def fuse(
    sightings: Sightings,
    method: Method,
    mode: Mode,
    cell_reduce: CellReduce = "mean",
    probability_floor: float = 1e-4,
) -> FusedScores:
    """Score every box of a sequence by all that its voxel has seen.

    Args:
        sightings: the placed boxes.
        method: which rule.
        mode: ``online`` uses the frames up to and including a box's own; ``offline`` all frames.
        cell_reduce: how boxes that fill one slot combine (``imod`` only), element by element.
        probability_floor: limit of the log-odds (``naive_log`` only).
    """
    scores = sightings.view_scores
    n_boxes, n_classes = scores.shape[:2]
    class_scores = marginal(scores)
    if method == "single":
        no_pose = np.full(class_scores.shape, -1, dtype=np.int64)
        return FusedScores(class_scores, no_pose, np.ones_like(no_pose))

    order = np.lexsort((np.arange(n_boxes), sightings.frame, sightings.voxel))
    voxel, frame = sightings.voxel[order], sightings.frame[order]
    class_scores = class_scores[order]
    enters = _best_of_each_moment(voxel, frame, class_scores)
    cells = sightings.elevation_bin[order] * (sightings.azimuth_bin.max(initial=0) + 1)
    cells += sightings.azimuth_bin[order]
    has_pose = method == "imod" and scores.shape[-1] > 1

    fused = FusedScores(
        np.empty((n_boxes, n_classes)),
        np.full((n_boxes, n_classes), -1, dtype=np.int64),
        np.empty((n_boxes, n_classes), dtype=np.int64),
    )
    starts = np.flatnonzero(np.r_[True, voxel[1:] != voxel[:-1]][:n_boxes])
    for start, stop in zip(starts, np.r_[starts, n_boxes][1:], strict=True):
        here = slice(start, stop)
        rows = order[here]
        if method == "imod":
            votes = _votes(scores[rows], sightings.azimuth_bin[rows], sightings.elevation_bin[rows])
            totals, counts = _running_cells(votes, enters[here], cells[here], cell_reduce)
        else:
            evidence = class_scores[here]
            if method == "naive_log":
                evidence = log_odds(evidence, probability_floor)
            totals = np.cumsum(np.where(enters[here], evidence, 0.0), axis=0)[:, :, None]
            counts = np.cumsum(enters[here], axis=0)
        known = _last_of_moment(frame[here]) if mode == "online" else np.full(len(rows), -1)
        fused.score[rows] = totals.max(axis=-1)[known]
        fused.n_cells[rows] = counts[known]
        if has_pose:
            fused.pose_bin[rows] = totals.argmax(axis=-1)[known]
    return fused


def _votes(view_scores: NDArray[np.floating], azimuth_bins: Ints, elevation_bins: Ints) -> Array:
    """Votes (V, K, N) of boxes over poses, read at their own elevation; (V, K, 1) without views."""
    if view_scores.shape[-1] == 1 and view_scores.shape[-2] == 1:
        return view_scores[:, :, 0, :].astype(np.float64)
    at_elevation = view_scores[np.arange(len(view_scores)), :, elevation_bins, :]
    return pose_votes(at_elevation.astype(np.float64), azimuth_bins)


def _best_of_each_moment(voxel: Ints, frame: Ints, class_scores: Array) -> Bools:
    """Which boxes enter a slot: per voxel, frame and class the best one, the first when tied.

    Args:
        voxel: (V,) sorted together with `frame`.
        frame: (V,).
        class_scores: (V, K) marginals.

    Returns:
        (V, K), with exactly one True per voxel, frame and class.
    """
    n_boxes = len(voxel)
    if n_boxes == 0:
        return np.zeros(class_scores.shape, dtype=np.bool_)
    is_start = np.r_[True, (voxel[1:] != voxel[:-1]) | (frame[1:] != frame[:-1])]
    starts, moment = np.flatnonzero(is_start), np.cumsum(is_start) - 1
    is_best = class_scores == np.maximum.reduceat(class_scores, starts, axis=0)[moment]
    position = np.arange(n_boxes)[:, None]
    first = np.minimum.reduceat(np.where(is_best, position, n_boxes), starts, axis=0)
    return np.asarray(position == first[moment])


def _last_of_moment(frame: Ints) -> Ints:
    """Position (V,) of the last box of each box's frame; `frame` is sorted."""
    return np.searchsorted(frame, frame, side="right") - 1


def _running_cells(
    votes: Array, enters: Bools, cells: Ints, cell_reduce: CellReduce
) -> tuple[Array, Ints]:
    """Sum over the cells of one voxel after each of its boxes.

    Each box changes its own cell's slot only, so the sum after it is the sum of all changes so far.

    Args:
        votes: (V, K, D) in order of time.
        enters: (V, K) whether the box enters its slot for the class.
        cells: (V,) number of each box's cell.
        cell_reduce: as in `fuse`.

    Returns:
        Sums (V, K, D) and numbers of filled cells (V, K).
    """
    changes = np.empty_like(votes)
    newly_filled = np.empty(enters.shape, dtype=np.int64)
    values, cell_of_row, n_visits = np.unique(cells, return_inverse=True, return_counts=True)
    once = n_visits[cell_of_row] == 1
    changes[once] = np.where(enters[once, :, None], votes[once], 0.0)
    newly_filled[once] = enters[once]
    for cell in values[n_visits > 1]:
        rows = np.flatnonzero(cells == cell)
        history = SLOT_HISTORY[cell_reduce](votes[rows], enters[rows])
        changes[rows] = np.diff(history, axis=0, prepend=0.0)
        filled = np.maximum.accumulate(enters[rows], axis=0).astype(np.int64)
        newly_filled[rows] = np.diff(filled, axis=0, prepend=0)
    return np.cumsum(changes, axis=0), np.cumsum(newly_filled, axis=0)


def _mean_history(votes: Array, enters: Bools) -> Array:
    total = np.cumsum(np.where(enters[:, :, None], votes, 0.0), axis=0)
    return total / np.maximum(np.cumsum(enters, axis=0), 1)[:, :, None]


def _max_history(votes: Array, enters: Bools) -> Array:
    return np.maximum.accumulate(np.where(enters[:, :, None], votes, 0.0), axis=0)


def _last_history(votes: Array, enters: Bools) -> Array:
    position = np.where(enters, np.arange(len(votes))[:, None], -1)
    latest = np.maximum.accumulate(position, axis=0)[:, :, None]
    return np.where(latest >= 0, np.take_along_axis(votes, np.maximum(latest, 0), axis=0), 0.0)


SLOT_HISTORY = {"mean": _mean_history, "max": _max_history, "last": _last_history}
