"""Matching: which detections of one class in one image find an annotation.

Detections are taken by descending score and each claims an annotation that it overlaps enough. Two
rules are in use, and they differ. VOC lets a detection look only at the annotation it overlaps
most: if that one is taken, the detection is a duplicate, even if it overlaps another one enough.
COCO lets it take the best annotation that is still free. Under both, a detection that lands on an
ignored annotation counts neither as right nor as wrong.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from imodbatch.core.boxes import coverage_matrix, iou_matrix

Rule = Literal["voc", "coco"]
AnyArray = npt.NDArray[Any]


class Outcome(IntEnum):
    """What became of a detection; the values index `OUTCOME_NAMES`."""

    FALSE_POSITIVE = 0
    TRUE_POSITIVE = 1
    IGNORED = 2


OUTCOME_NAMES = tuple(outcome.name.lower() for outcome in Outcome)
"""Names for tables: ``np.array(OUTCOME_NAMES)[matches.outcome]``."""

NO_ANNOTATION = -1

# Reading an enum's member costs as much as a whole step of the loops below.
_FALSE_POSITIVE, _TRUE_POSITIVE, _IGNORED = (int(outcome) for outcome in Outcome)


@dataclass(frozen=True, eq=False)
class Matches:
    """What became of each of D detections, in the order in which they were given.

    Attributes:
        outcome: (D,) int8 values of `Outcome`.
        annotation_index: (D,) int64 index of the annotation that was found or that absorbed the
            detection; `NO_ANNOTATION` (-1) for false positives.
        iou: (D,) overlap with that annotation (with a crowd under "coco": the share of the
            detection inside it). For a false positive under "voc": its largest IoU with any
            annotation, which tells a duplicate or a loose box from a stray one. NaN if none.
    """

    outcome: npt.NDArray[np.int8]
    annotation_index: npt.NDArray[np.int64]
    iou: npt.NDArray[np.float64]


def match_image(
    boxes: AnyArray,
    scores: AnyArray,
    annotation_boxes: AnyArray,
    is_ignored: AnyArray,
    is_crowd: AnyArray,
    iou_threshold: float,
    rule: Rule = "voc",
) -> Matches:
    """Match the detections of one class in one image to the annotations of that class there.

    Detections are taken by descending score, equal scores by ascending position.

    "voc" (Everingham et al. 2010, Sec. 4.2, and the VOC devkit's ``VOCevaldet.m``): a detection
    looks at the annotation of largest IoU, ignored ones included, the first among equals. Below the
    threshold it is a false positive. Otherwise an ignored ("difficult") annotation absorbs it, and
    any number of others; a free one makes it a true positive; a taken one a false positive. VOC
    knows no crowds: here a crowd is an ignored annotation like any other.

    "coco" (COCO API, ``cocoeval.py: evaluateImg``): a detection takes the annotation of largest
    overlap among those still free, the last among equals; ignored ones are looked at only if no
    ordinary one fits. An ignored annotation absorbs one detection, a crowd any number; overlap with
    a crowd is the share of the detection inside it.

    Args:
        boxes: (D, 4) x0 y0 x1 y1 in pixels.
        scores: (D,) any real values; only their order matters.
        annotation_boxes: (A, 4) likewise.
        is_ignored: (A,) bool, annotations that count neither way.
        is_crowd: (A,) bool, annotations of a region of many objects; always ignored too.
        iou_threshold: Least overlap that makes a match (>=).
        rule: "voc" or "coco".

    Returns:
        One entry per detection, in the order given.

    Raises:
        ValueError: If the rule is unknown or lengths do not agree.
    """
    if rule not in ("voc", "coco"):
        raise ValueError(f'rule: expected "voc" or "coco", found {rule!r}')
    n_detections, n_annotations = len(boxes), len(annotation_boxes)
    if len(scores) != n_detections:
        raise ValueError(f"expected one score per box, found {len(scores)} for {n_detections}")
    if not len(is_ignored) == len(is_crowd) == n_annotations:
        raise ValueError(
            f"expected {n_annotations} flags, one per annotation, found {len(is_ignored)} "
            f"is_ignored and {len(is_crowd)} is_crowd"
        )
    matches = Matches(
        outcome=np.full(n_detections, _FALSE_POSITIVE, dtype=np.int8),
        annotation_index=np.full(n_detections, NO_ANNOTATION, dtype=np.int64),
        iou=np.full(n_detections, np.nan),
    )
    if n_detections == 0 or n_annotations == 0:
        return matches
    crowd = np.asarray(is_crowd, dtype=np.bool_)
    ignored = np.asarray(is_ignored, dtype=np.bool_) | crowd
    ranking = np.argsort(-np.asarray(scores, dtype=np.float64), kind="stable")
    overlaps = iou_matrix(boxes, annotation_boxes)
    if rule == "voc":
        _fill_voc(matches, ranking, overlaps, ignored, iou_threshold)
    else:
        if crowd.any():
            overlaps = np.where(crowd, coverage_matrix(boxes, annotation_boxes), overlaps)
        _fill_coco(matches, ranking, overlaps, ignored, crowd, iou_threshold=iou_threshold)
    return matches


def _fill_voc(
    matches: Matches,
    ranking: npt.NDArray[np.int64],
    overlaps: npt.NDArray[np.float64],
    ignored: npt.NDArray[np.bool_],
    iou_threshold: float,
) -> None:
    """Write the outcomes under VOC's rule into the new, empty `matches`."""
    best_annotations = overlaps.argmax(axis=1)
    best_ious = overlaps.max(axis=1)
    np.copyto(matches.iou, best_ious, where=best_ious > 0.0)
    taken = set()
    for detection in ranking[best_ious[ranking] >= iou_threshold].tolist():
        annotation = int(best_annotations[detection])
        if ignored[annotation]:
            matches.outcome[detection] = _IGNORED
        elif annotation not in taken:
            matches.outcome[detection] = _TRUE_POSITIVE
            taken.add(annotation)
        else:
            continue
        matches.annotation_index[detection] = annotation


def _fill_coco(
    matches: Matches,
    ranking: npt.NDArray[np.int64],
    overlaps: npt.NDArray[np.float64],
    ignored: npt.NDArray[np.bool_],
    crowd: npt.NDArray[np.bool_],
    *,
    iou_threshold: float,
) -> None:
    """Write the outcomes under COCO's rule into the new, empty `matches`."""
    least_overlap = min(iou_threshold, 1.0 - 1e-10)  # as COCO: 1.0 still finds equal boxes
    free_ordinary = np.flatnonzero(~ignored).tolist()
    free_ignored = np.flatnonzero(ignored).tolist()
    for detection in ranking[(overlaps[ranking] >= least_overlap).any(axis=1)].tolist():
        row = overlaps[detection].tolist()
        free, outcome = free_ordinary, _TRUE_POSITIVE
        annotation = _last_best(row, free, least_overlap)
        if annotation == NO_ANNOTATION:
            free, outcome = free_ignored, _IGNORED
            annotation = _last_best(row, free, least_overlap)
        if annotation == NO_ANNOTATION:
            continue
        if not crowd[annotation]:
            free.remove(annotation)
        matches.outcome[detection] = outcome
        matches.annotation_index[detection] = annotation
        matches.iou[detection] = row[annotation]


def _last_best(row: list[float], candidates: list[int], least_overlap: float) -> int:
    """The candidate of largest overlap, the last among equals; `NO_ANNOTATION` if none fits."""
    best_overlap, best = least_overlap, NO_ANNOTATION
    for annotation in candidates:
        if row[annotation] >= best_overlap:
            best_overlap, best = row[annotation], annotation
    return best
