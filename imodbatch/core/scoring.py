"""Boxes of many images held against the truth, class by class."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.matching import Matches, Outcome, match_image
from imodbatch.core.precision import rank

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
AveragePrecision = Callable[[Bools, int], float | None]


@dataclass(frozen=True)
class Truth:
    """A annotations: image number (A,), class (A,), boxes (A, 4), and which do not count."""

    image: Ints
    class_id: Ints
    boxes: Array
    is_ignored: Bools
    is_crowd: Bools

    def counted(self, n_classes: int) -> Ints:
        """Annotations per class (K,) that count; a crowd never does."""
        counts = ~(self.is_ignored | self.is_crowd)
        return np.bincount(self.class_id[counts], minlength=n_classes)


@dataclass(frozen=True)
class Candidates:
    """D boxes, each for one class, in the order that breaks ties: image (D,), class, boxes."""

    image: Ints
    class_id: Ints
    boxes: Array


def match_all(
    candidates: Candidates, scores: Array, truth: Truth, iou_threshold: float, rule: str
) -> Matches:
    """Match every image and class on its own.

    Args:
        candidates: the boxes.
        scores: (D,) what ranks them.
        truth: the annotations.
        iou_threshold: as a fraction.
        rule: ``voc`` or ``coco``, see `match_image`.

    Returns:
        One entry per candidate; `annotation_index` points into `truth`, −1 = none.
    """
    outcome = np.full(len(scores), Outcome.FALSE_POSITIVE, dtype=np.int8)
    annotation_index = np.full(len(scores), -1, dtype=np.int64)
    iou = np.full(len(scores), np.nan)
    annotations_of = _groups(truth.image, truth.class_id)
    for group, rows in _groups(candidates.image, candidates.class_id).items():
        if group not in annotations_of:
            continue
        true_rows = annotations_of[group]
        matches = match_image(
            candidates.boxes[rows],
            scores[rows],
            truth.boxes[true_rows],
            truth.is_ignored[true_rows],
            truth.is_crowd[true_rows],
            iou_threshold,
            rule,  # type: ignore[arg-type]
        )
        outcome[rows], iou[rows] = matches.outcome, matches.iou
        hit = matches.annotation_index >= 0
        annotation_index[rows[hit]] = true_rows[matches.annotation_index[hit]]
    return Matches(outcome, annotation_index, iou)


def ranked_hits(scores: Array, outcome: NDArray[np.int8]) -> tuple[Array, Bools]:
    """Scores and hits of the candidates that count, best first; equal scores keep their order."""
    order = rank(scores)
    order = order[outcome[order] != Outcome.IGNORED]
    return scores[order], outcome[order] == Outcome.TRUE_POSITIVE


def average_precisions(
    candidates: Candidates,
    scores: Array,
    outcome: NDArray[np.int8],
    n_annotations: Ints,
    average_precision: AveragePrecision,
) -> Array:
    """AP per class (K,), NaN for a class without annotations."""
    result = np.full(len(n_annotations), np.nan)
    for k, n in enumerate(n_annotations):
        rows = candidates.class_id == k
        value = average_precision(ranked_hits(scores[rows], outcome[rows])[1], int(n))
        result[k] = np.nan if value is None else value
    return result


def mean_over_classes(values: Array) -> float:
    """Mean over the classes that have a value; NaN when none has."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _groups(image: Ints, class_id: Ints) -> dict[tuple[int, int], Ints]:
    """Rows of each image and class, in their order."""
    if len(image) == 0:
        return {}
    order = np.lexsort((class_id, image))
    change = (np.diff(image[order]) != 0) | (np.diff(class_id[order]) != 0)
    groups = np.split(order, np.flatnonzero(change) + 1)
    return {(int(image[rows[0]]), int(class_id[rows[0]])): rows for rows in groups}
