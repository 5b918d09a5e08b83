"""Precision, recall and the average precision that is read off them.

The detections of one class in all images are ranked by score. Walking down the ranking, recall is
the share of annotations found so far and precision the share of detections so far that were right.
Ignored detections are taken out before: they count neither way.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
AnyArray = npt.NDArray[Any]


def rank(scores: AnyArray, *tie_breakers: AnyArray) -> IntArray:
    """The fixed order in which detections are counted.

    By descending score; equal scores by the tie breakers, ascending, the first one given being the
    most significant; then by position. NaN scores come last.

    Args:
        scores: (D,) any real values.
        *tie_breakers: (D,) integer keys each, e.g. image index, detection index.

    Returns:
        (D,) positions, best first.

    Raises:
        ValueError: If lengths differ.
    """
    descending = -np.asarray(scores, dtype=np.float64)
    if any(len(key) != len(descending) for key in tie_breakers):
        raise ValueError("rank: scores and tie breakers differ in length")
    return np.lexsort((*reversed(tie_breakers), descending))  # lexsort's last key is its first


def precision_recall(
    is_true_positive: AnyArray, n_annotations: int
) -> tuple[FloatArray, FloatArray]:
    """Precision and recall after each detection of a ranking.

    Args:
        is_true_positive: (D,) bool, ranked, without ignored detections.
        n_annotations: Annotations to be found, without ignored ones.

    Returns:
        Precision (D,) and recall (D,); recall is NaN if there is nothing to be found.

    Raises:
        TypeError: If `is_true_positive` is not boolean.
        ValueError: If more annotations are found than there are.
    """
    n_found = _found_so_far(is_true_positive, n_annotations)
    return _precision(n_found), n_found / (n_annotations or np.nan)


def ap_voc07_11pt(is_true_positive: AnyArray, n_annotations: int) -> float | None:
    """11-point average precision (Everingham et al. 2010, Sec. 4.2; VOC 2007).

    For t = 0..10 the best precision at recall >= t / 10, averaged. The comparison is one of
    integers, ``10 * found >= t * annotations``: the usual ``recall >= np.arange(0, 1.1, 0.1)`` sets
    3/10 against 0.30000000000000004 and so loses a point at recalls 3/10, 6/10 and 7/10.

    Arguments and errors are those of `precision_recall`.

    Returns:
        Average precision in [0, 1]; None (there is no such thing) without annotations.
    """
    n_found = _found_so_far(is_true_positive, n_annotations)
    if n_annotations == 0:
        return None
    first_reaching = np.searchsorted(10 * n_found, np.arange(11) * n_annotations, side="left")
    best_from_here = np.append(_envelope(n_found), 0.0)  # 0 where the recall is never reached
    return float(best_from_here[first_reaching].mean())


def ap_area(is_true_positive: AnyArray, n_annotations: int) -> float | None:
    """Average precision over all points: the area under the monotone envelope (VOC 2010 and later).

    Each annotation found adds 1 / annotations of recall, at the best precision from there on.
    Arguments, result and errors are those of `ap_voc07_11pt`.
    """
    n_found = _found_so_far(is_true_positive, n_annotations)
    if n_annotations == 0:
        return None
    finds_one = np.diff(n_found, prepend=0) > 0
    return float(_envelope(n_found)[finds_one].sum() / n_annotations)


def _found_so_far(is_true_positive: AnyArray, n_annotations: int) -> IntArray:
    """(D,) annotations found down to each rank, with the checks that all metrics share."""
    flags = np.asarray(is_true_positive)
    if flags.dtype != np.bool_ and flags.size:
        raise TypeError(
            f"is_true_positive: expected booleans, found {flags.dtype}; outcome codes would count "
            "ignored detections as right"
        )
    n_found = np.cumsum(flags, dtype=np.int64)
    if n_annotations < 0 or (len(n_found) and n_found[-1] > n_annotations):
        raise ValueError(
            f"{n_found[-1] if len(n_found) else 0} true positives for {n_annotations} annotations"
        )
    return n_found


def _precision(n_found: IntArray) -> FloatArray:
    """(D,) precision at each rank."""
    return np.divide(n_found, np.arange(1, len(n_found) + 1), dtype=np.float64)


def _envelope(n_found: IntArray) -> FloatArray:
    """(D,) best precision at each rank or further down."""
    return np.maximum.accumulate(_precision(n_found)[::-1])[::-1]
