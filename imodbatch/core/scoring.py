"""Boxes of many images held against the truth, class by class."""

from collections.abc import Callable, Iterator
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


@dataclass(frozen=True, eq=False)
class ScoredBoxes:
    """D boxes of one method, each for one class and held against the truth, none of them ignored.

    Attributes:
        score: (D,) what ranks them.
        is_hit: (D,) whether the box found an annotation.
        class_id: (D,) below K.
        sequence: (D,) ordinal of its sequence, below S.
    """

    score: Array
    is_hit: Bools
    class_id: Ints
    sequence: Ints

    @classmethod
    def ranked(
        cls, score: Array, outcome: NDArray[np.integer], class_id: Ints, sequence: Ints
    ) -> "ScoredBoxes":
        """The boxes that count, best first; equal scores keep their order.

        Args:
            score: (D,) and so the others.
            outcome: values of `Outcome`.
            class_id: below K.
            sequence: ordinals.
        """
        order = rank(score)
        order = order[outcome[order] != Outcome.IGNORED]
        is_hit = outcome[order] == Outcome.TRUE_POSITIVE
        return cls(score[order], is_hit, class_id[order], sequence[order])

    def take(self, rows: Bools | Ints) -> "ScoredBoxes":
        """Some of the boxes."""
        return ScoredBoxes(**{name: column[rows] for name, column in vars(self).items()})

    def of_class(self, class_id: int) -> "ScoredBoxes":
        """Those of one class."""
        return self.take(self.class_id == class_id)


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
    for rows, true_rows in alike(candidates, truth):
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


def average_precisions(
    boxes: ScoredBoxes, n_annotations: Ints, average_precision: AveragePrecision
) -> Array:
    """AP per class (K,), NaN for a class without annotations.

    Args:
        boxes: best first.
        n_annotations: (K,) that count.
        average_precision: ranked hits and annotations → AP.
    """
    found = (
        average_precision(boxes.of_class(k).is_hit, int(n)) for k, n in enumerate(n_annotations)
    )
    return np.array([np.nan if value is None else value for value in found], dtype=np.float64)


def mean_over_classes(values: Array) -> float:
    """Mean over the classes that have a value; NaN when none has."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def alike(candidates: Candidates, truth: Truth) -> Iterator[tuple[Ints, Ints]]:
    """Rows of candidates and rows of annotations that share image and class, where both are."""
    annotations_of = _groups(truth.image, truth.class_id)
    for group, rows in _groups(candidates.image, candidates.class_id).items():
        if group in annotations_of:
            yield rows, annotations_of[group]


def _groups(image: Ints, class_id: Ints) -> dict[tuple[int, int], Ints]:
    """Rows of each image and class, in their order."""
    if len(image) == 0:
        return {}
    order = np.lexsort((class_id, image))
    change = (np.diff(image[order]) != 0) | (np.diff(class_id[order]) != 0)
    groups = np.split(order, np.flatnonzero(change) + 1)
    return {(int(image[rows[0]]), int(class_id[rows[0]])): rows for rows in groups}
