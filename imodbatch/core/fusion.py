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

Of several boxes that one frame puts into one voxel, only the best enters the slot of a class; the
others are mostly loose boxes round the same object. `best_of_moment` says which, so that they need
not inherit the object's score either (`absent_score`).

Baselines from the same boxes: ``single`` is the marginal over viewpoints; ``naive`` adds it up over
the frames; ``naive_log`` adds up its log-odds, which takes views as independent.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.slots import CellReduce, slot_changes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Method = Literal["single", "naive", "naive_log", "imod"]
Mode = Literal["online", "offline"]
MODES: tuple[Mode, ...] = get_args(Mode)
ROWS_AT_ONCE = 8192  # bounds memory: rows × classes × azimuths of float64 at a time


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
    cell_reduce: CellReduce = "mean",
    probability_floor: float = 1e-4,
) -> dict[Mode, FusedScores]:
    """Score every box of a sequence by all that its voxel has seen.

    Args:
        sightings: the placed boxes.
        method: which rule.
        cell_reduce: how boxes that fill one slot combine (``imod`` only), element by element.
        probability_floor: limit of the log-odds (``naive_log`` only).

    Returns:
        ``online`` by the frames up to and including a box's own; ``offline`` by all frames.
    """
    scores = sightings.view_scores
    class_scores = marginal(scores)
    if method == "single":
        single = _blank(class_scores)
        single.n_cells[:] = 1
        return dict.fromkeys(MODES, single)

    order = np.lexsort((np.arange(len(scores)), sightings.frame, sightings.voxel))
    voxel, frame = sightings.voxel[order], sightings.frame[order]
    enters = _best_of_each_moment(voxel, frame, class_scores[order])
    has_pose = method == "imod" and scores.shape[-1] > 1
    fused = {mode: _blank(class_scores) for mode in MODES}
    for here in _whole_voxels(voxel):
        rows = order[here]
        if method == "imod":
            cells = np.stack(
                [voxel[here], sightings.elevation_bin[rows], sightings.azimuth_bin[rows]]
            )
            votes = _votes(scores[rows], sightings.azimuth_bin[rows], sightings.elevation_bin[rows])
            changes, filled = slot_changes(votes, enters[here], cells, cell_reduce)
        else:
            evidence = class_scores[rows]
            if method == "naive_log":
                evidence = log_odds(evidence, probability_floor)
            changes = np.where(enters[here], evidence, 0.0)[:, :, None]
            filled = enters[here].astype(np.int64)
        totals, counts = _sums_by_group(changes, voxel[here]), _sums_by_group(filled, voxel[here])
        for mode, result in fused.items():
            known = _last_known(voxel[here], frame[here], mode)
            result.score[rows] = totals.max(axis=-1)[known]
            result.n_cells[rows] = counts[known]
            if has_pose:
                result.pose_bin[rows] = totals.argmax(axis=-1)[known]
    return fused


def best_of_moment(sightings: Sightings, candidates: Bools) -> Bools:
    """Which box of a frame stands for what its voxel holds, class by class.

    Args:
        sightings: the placed boxes.
        candidates: (V, K) boxes that are in the running for a class.

    Returns:
        (V, K), True for the candidate with the greatest marginal score in its voxel and frame, the
        first when tied; at most one per voxel, frame and class.
    """
    scores = np.where(candidates, marginal(sightings.view_scores), -np.inf)
    order = np.lexsort((np.arange(len(scores)), sightings.frame, sightings.voxel))
    best = np.zeros(candidates.shape, dtype=np.bool_)
    best[order] = _best_of_each_moment(
        sightings.voxel[order], sightings.frame[order], scores[order]
    )
    return best & candidates


def absent_score(method: Method, n_cells: Ints, probability_floor: float) -> Array:
    """What a rule says of a class that no view has seen: no voxel's score is lower.

    Args:
        method: which rule; not ``single``.
        n_cells: (…) views behind the score.
        probability_floor: limit of the log-odds.
    """
    if method == "naive_log":
        return (n_cells + 1) * log_odds(np.array([probability_floor]), probability_floor)
    return np.zeros(n_cells.shape)


def _blank(class_scores: Array) -> FusedScores:
    """Single-view scores, no pose, no cell."""
    no_pose = np.full(class_scores.shape, -1, dtype=np.int64)
    return FusedScores(class_scores.copy(), no_pose, np.zeros_like(no_pose))


def _whole_voxels(voxel: Ints) -> Iterator[slice]:
    """Cut sorted rows into slices of about `ROWS_AT_ONCE` that never part a voxel."""
    starts = np.flatnonzero(np.diff(voxel, prepend=voxel[:1] - 1))
    start = 0
    while start < len(voxel):
        after = np.searchsorted(starts, start + ROWS_AT_ONCE)
        stop = int(starts[after]) if after < len(starts) else len(voxel)
        yield slice(start, stop)
        start = stop


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


def _last_known(voxel: Ints, frame: Ints, mode: Mode) -> Ints:
    """Position (V,) of the last box that each box may know of; rows sorted by voxel and frame."""
    is_last = np.diff(voxel, append=voxel[-1:] + 1) != 0
    if mode == "online":
        is_last |= np.diff(frame, append=frame[-1:] + 1) != 0
    ends = np.flatnonzero(is_last)
    return ends[np.searchsorted(ends, np.arange(len(voxel)))]


def _sums_by_group(values: NDArray[Any], group: Ints) -> NDArray[Any]:
    """Cumulative sums of (V, …) values within runs of equal `group`."""
    sums = values.copy()
    starts = np.flatnonzero(np.diff(group, prepend=group[:1] - 1))
    lengths = np.diff(starts, append=len(group))
    for start, length in zip(starts[lengths > 1], lengths[lengths > 1], strict=True):
        np.cumsum(values[start : start + length], axis=0, out=sums[start : start + length])
    return sums
