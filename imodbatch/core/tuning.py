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

from imodbatch.core.precision import best_f1, threshold_sweep

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ScoredBoxes:
    """D boxes of one method, each for one class; ignored ones are left out.

    Attributes:
        score: (D,) what a threshold is held against.
        is_hit: (D,) whether the box found an annotation.
        class_id: (D,) below K.
        sequence: (D,) ordinal of its sequence, below S.
    """

    score: Array
    is_hit: Bools
    class_id: Ints
    sequence: Ints

    def take(self, rows: Bools) -> "ScoredBoxes":
        """Those boxes that a (D,) mask marks."""
        return ScoredBoxes(**{name: column[rows] for name, column in vars(self).items()})


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

    @property
    def precision(self) -> Array:
        """(K,) hits per box kept; NaN where none is kept or nothing was to be found."""
        return np.where(self.n_annotations > 0, _quotient(self.n_hits, self.n_kept), np.nan)

    @property
    def recall(self) -> Array:
        """(K,) hits per annotation; NaN where nothing was to be found."""
        return _quotient(self.n_hits, self.n_annotations)


def tune_threshold(scores: Array, is_hit: Bools, n_annotations: int, step: float) -> float:
    """The multiple of `step` with the largest F1; among equals the lowest, which keeps the most.

    Args:
        scores: (D,) of one class, in any order, without ignored boxes.
        is_hit: (D,) in the same order.
        n_annotations: of the class that count.
        step: between thresholds; see `threshold_sweep` for where they begin and end.

    Returns:
        A box is kept if its score reaches it. NaN where nothing is to be found: no threshold is
        better than another.
    """
    if n_annotations == 0:
        return float("nan")
    sweep = threshold_sweep(scores, is_hit, n_annotations, step)
    return float(sweep.thresholds[best_f1(sweep)])


def tune_thresholds(boxes: ScoredBoxes, n_annotations: Ints, step: float) -> Array:
    """One threshold per class, tuned on all sequences.

    Args:
        boxes: of all sequences.
        n_annotations: (K, S) annotations that count.
        step: between thresholds.

    Returns:
        (K, S), the same in every sequence; NaN as in `tune_threshold`.
    """
    per_class = _per_class(boxes, n_annotations.sum(axis=1), step)
    return np.repeat(per_class[:, None], n_annotations.shape[1], axis=1)


def leave_one_out(boxes: ScoredBoxes, n_annotations: Ints, step: float) -> Array:
    """One threshold per class and sequence, tuned on all the other sequences.

    Args:
        boxes: of all sequences.
        n_annotations: (K, S) annotations that count.
        step: between thresholds.

    Returns:
        (K, S); column s knows nothing of sequence s. NaN where the other sequences hold no
        annotation of the class, and so everywhere if there is one sequence only.
    """
    found = np.empty(n_annotations.shape)
    for s in range(n_annotations.shape[1]):
        others = np.delete(n_annotations, s, axis=1).sum(axis=1)
        found[:, s] = _per_class(boxes.take(boxes.sequence != s), others, step)
    return found


def reaches(score: Array, class_id: Ints, sequence: Ints, thresholds: Array) -> Bools:
    """(D,) whether boxes reach the threshold (K, S) of their class and sequence; NaN keeps none."""
    return np.asarray(score >= thresholds[class_id, sequence], dtype=np.bool_)


def counts_at(boxes: ScoredBoxes, n_annotations: Ints, thresholds: Array) -> Counts:
    """What thresholds (K, S) keep of the boxes, added over the sequences."""
    n_classes = len(thresholds)
    kept = boxes.take(reaches(boxes.score, boxes.class_id, boxes.sequence, thresholds))
    return Counts(
        n_kept=np.bincount(kept.class_id, minlength=n_classes),
        n_hits=np.bincount(kept.class_id[kept.is_hit], minlength=n_classes),
        n_annotations=np.where(np.isnan(thresholds), 0, n_annotations).sum(axis=1),
    )


def _per_class(boxes: ScoredBoxes, n_annotations: Ints, step: float) -> Array:
    """The threshold of each class (K,) for boxes and annotations (K,) that are tuned on at once."""
    found = np.empty(len(n_annotations))
    for k, n in enumerate(n_annotations):
        rows = boxes.class_id == k
        found[k] = tune_threshold(boxes.score[rows], boxes.is_hit[rows], int(n), step)
    return found


def _quotient(numerators: Ints, denominators: Ints) -> Array:
    """Quotients, NaN where the denominator is 0."""
    quotients = np.full(len(numerators), np.nan)
    np.divide(numerators, denominators, out=quotients, where=denominators > 0)
    return quotients
