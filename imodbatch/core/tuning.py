"""Score thresholds per class: tuned where they are used, or on the other sequences.

A threshold chosen on the very boxes it is judged by flatters every method, the more so the fewer
boxes there are. Leaving one sequence out shows by how much: the threshold for a sequence is chosen
on all the others, and what it keeps there is counted. The counts of all sequences are then added,
so precision and recall are of the same boxes and annotations as before.

A class that shows in one sequence alone cannot be tuned on the others: it has no threshold there
(NaN), and neither its boxes nor its annotations there are counted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.scoring import ScoredBoxes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_THRESHOLDS = 1_000_000
_LARGEST_EXACT_STEP = 2.0**52


@dataclass(frozen=True, eq=False)
class Counts:
    """What thresholds keep, per class.

    Attributes:
        n_kept: (K,) boxes.
        n_hits: (K,) those of them that found an annotation.
        n_annotations: (K,) that count and stand in sequences where the class has a threshold.
    """

    n_kept: Ints
    n_hits: Ints
    n_annotations: Ints

    @classmethod
    def of(cls, kept: ScoredBoxes, n_annotations: Ints) -> "Counts":
        """Count the boxes kept, beside the annotations (K,) that they were to find."""
        n_kept, n_hits = (
            np.bincount(class_id, minlength=len(n_annotations))
            for class_id in (kept.class_id, kept.class_id[kept.is_hit])
        )
        return cls(n_kept, n_hits, n_annotations)

    @property
    def precision(self) -> Array:
        """(K,) hits per box kept; NaN where none is kept or nothing was to be found."""
        return np.where(self.n_annotations > 0, _quotient(self.n_hits, self.n_kept), np.nan)

    @property
    def recall(self) -> Array:
        """(K,) hits per annotation; NaN where nothing was to be found."""
        return _quotient(self.n_hits, self.n_annotations)

    @property
    def f1(self) -> Array:
        """(K,) harmonic mean of both, 0 without a hit; NaN where nothing was to be found."""
        f1 = _quotient(2 * self.n_hits, self.n_kept + self.n_annotations)
        return np.where(self.n_annotations > 0, f1, np.nan)


def tune(boxes: ScoredBoxes, n_annotations: Ints, step: float) -> Array:
    """The threshold of each class: the multiple of `step` with the largest F1.

    Among equals the lowest, which keeps the most (Konno et al. 2020, Sec. 5).

    Args:
        boxes: of all sequences that are tuned on.
        n_annotations: (K,) that count there.
        step: between thresholds; see `kept_at_steps` for where they begin and end.

    Returns:
        (K,). A box is kept if its score reaches it. NaN where nothing is to be found: no threshold
        is better than another.
    """
    found = np.full(len(n_annotations), np.nan)
    for k in np.flatnonzero(n_annotations).tolist():
        own = boxes.of_class(k)
        thresholds, n_kept, n_hits = kept_at_steps(own.score, own.is_hit, step)
        # From counts, so that equal quotients are equal numbers and ties for the best are real ones
        found[k] = thresholds[np.argmax(2 * n_hits / (n_kept + n_annotations[k]))]
    return found


def tune_thresholds(boxes: ScoredBoxes, n_annotations: Ints, step: float) -> Array:
    """One threshold per class, tuned on all sequences.

    Args:
        boxes: of all sequences.
        n_annotations: (K, S) annotations that count.
        step: between thresholds.

    Returns:
        (K, S), the same in every sequence; NaN as in `tune`.
    """
    per_class = tune(boxes, n_annotations.sum(axis=1), step)
    return np.repeat(per_class[:, None], n_annotations.shape[1], axis=1)


def leave_one_out(boxes: ScoredBoxes, n_annotations: Ints, step: float) -> Array:
    """One threshold per class and sequence, tuned on all the other sequences.

    Arguments are those of `tune_thresholds`.

    Returns:
        (K, S); column s knows nothing of sequence s. NaN where the other sequences hold no
        annotation of the class, and so everywhere if there is one sequence only.
    """
    found = np.empty(n_annotations.shape)
    for s in range(n_annotations.shape[1]):
        others = np.delete(n_annotations, s, axis=1).sum(axis=1)
        found[:, s] = tune(boxes.take(boxes.sequence != s), others, step)
    return found


def reaches(score: Array, class_id: Ints, sequence: Ints, thresholds: Array) -> Bools:
    """(D,) whether boxes reach the threshold (K, S) of their class and sequence; NaN keeps none."""
    return np.asarray(score >= thresholds[class_id, sequence], dtype=np.bool_)


def counts_at(boxes: ScoredBoxes, n_annotations: Ints, thresholds: Array) -> Counts:
    """What thresholds (K, S) keep of the boxes, added over the sequences."""
    kept = boxes.take(reaches(boxes.score, boxes.class_id, boxes.sequence, thresholds))
    return Counts.of(kept, np.where(np.isnan(thresholds), 0, n_annotations).sum(axis=1))


def kept_at_steps(scores: Array, is_hit: Bools, step: float) -> tuple[Array, Ints, Ints]:
    """How many boxes and hits each of T thresholds keeps.

    Thresholds are ``k * step`` for integers k (no sum accumulates), from 0, or from just below the
    least score if that is negative, to just beyond the largest: fused scores exceed 1, log-odds go
    below 0. Where that would make more than `MAX_THRESHOLDS`, only those are evaluated at which the
    set of kept boxes has changed since the threshold before; each stands for itself and all that
    follow until the next, so `tune` finds the same one.

    Args:
        scores: (D,) of one class, in any order.
        is_hit: (D,) in the same order.
        step: between thresholds.

    Returns:
        (T,) thresholds, ascending, boxes with ``score >= threshold``, and hits among them. Without
        boxes: the threshold 0 alone.

    Raises:
        ValueError: the step is not positive or too small beside the scores for float64, or scores
            are not finite.
    """
    order = np.argsort(scores)
    thresholds = _thresholds(scores, step)
    n_below = np.searchsorted(scores[order], thresholds, side="left")
    n_hits_below = np.concatenate([[0], np.cumsum(is_hit[order])])
    return thresholds, len(scores) - n_below, n_hits_below[-1] - n_hits_below[n_below]


def _thresholds(scores: Array, step: float) -> Array:
    """Ascending multiples of `step` at which scores are to be cut (see `kept_at_steps`)."""
    if not (np.isfinite(step) and step > 0.0):
        raise ValueError(f"step: expected a positive number, found {step}")
    if len(scores) == 0:
        return np.zeros(1)
    if not np.abs(scores).max() < _LARGEST_EXACT_STEP * step:  # written so that NaN fails it
        raise ValueError(f"scores: expected finite values within 2**52 steps of {step}")
    losing = _first_step_beyond(scores, step)
    first, last = min(0, int(losing.min()) - 1), int(losing.max())
    if last - first < MAX_THRESHOLDS:
        steps = np.arange(first, last + 1)
    else:
        steps = np.unique(np.append(losing, first))
    return np.multiply(steps, step, dtype=np.float64)


def _first_step_beyond(scores: Array, step: float) -> Ints:
    """For each score the least integer k with ``k * step > score``, exact in float arithmetic."""
    k = np.floor(scores / step).astype(np.int64) + 1
    # The quotient may round across an integer: 0.29 / 0.01 is 28.999999999999996.
    k += k * step <= scores
    k -= (k - 1) * step > scores
    return k


def _quotient(numerators: Ints, denominators: Ints) -> Array:
    """Quotients, NaN where the denominator is 0."""
    quotients = np.full(len(numerators), np.nan)
    np.divide(numerators, denominators, out=quotients, where=denominators > 0)
    return quotients
