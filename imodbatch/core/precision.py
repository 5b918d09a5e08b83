"""Precision, recall and what is read off them: average precision and the best threshold.

The detections of one class in all images are ranked by score. Walking down the ranking, recall is
the share of annotations found so far and precision the share of detections so far that were right.
Ignored detections are taken out before: they count neither way.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
AnyArray = npt.NDArray[Any]

MAX_THRESHOLDS = 1_000_000
_LARGEST_EXACT_STEP = 2.0**52


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
    recall = _quotient(n_found, np.full_like(n_found, n_annotations), np.nan)
    return _precision(n_found), recall


def ap_voc07_11pt(is_true_positive: AnyArray, n_annotations: int) -> float | None:
    """11-point average precision (Everingham et al. 2010, Sec. 4.2; VOC 2007).

    For t = 0..10 the best precision at recall >= t / 10, averaged. The comparison is one of
    integers, ``10 * found >= t * annotations``: the usual ``recall >= np.arange(0, 1.1, 0.1)`` sets
    3/10 against 0.30000000000000004 and so loses a point at recalls 3/10, 6/10 and 7/10.

    Args:
        is_true_positive: (D,) bool, ranked, without ignored detections.
        n_annotations: Annotations to be found, without ignored ones.

    Returns:
        Average precision in [0, 1]; None (there is no such thing) without annotations.

    Raises:
        TypeError: If `is_true_positive` is not boolean.
        ValueError: If more annotations are found than there are.
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

    Args:
        is_true_positive: (D,) bool, ranked, without ignored detections.
        n_annotations: Annotations to be found, without ignored ones.

    Returns:
        Average precision in [0, 1]; None (there is no such thing) without annotations.

    Raises:
        TypeError: If `is_true_positive` is not boolean.
        ValueError: If more annotations are found than there are.
    """
    n_found = _found_so_far(is_true_positive, n_annotations)
    if n_annotations == 0:
        return None
    finds_one = np.diff(n_found, prepend=0) > 0
    return float(_envelope(n_found)[finds_one].sum() / n_annotations)


@dataclass(frozen=True, eq=False)
class Sweep:
    """Quality at each of T thresholds; a detection is kept if score >= threshold.

    Attributes:
        thresholds: (T,) ascending, multiples of the step; the last one keeps nothing.
        precision: (T,) NaN where nothing is kept.
        recall: (T,) NaN if there is nothing to be found.
        f1: (T,) harmonic mean of both, 0 where it is undefined.
    """

    thresholds: FloatArray
    precision: FloatArray
    recall: FloatArray
    f1: FloatArray


def threshold_sweep(
    scores: AnyArray, is_true_positive: AnyArray, n_annotations: int, step: float
) -> Sweep:
    """Precision, recall and F1 for thresholds in steps (Konno et al. 2020, Sec. 5).

    Thresholds are ``k * step`` for integers k (no sum accumulates), from 0, or from just below the
    least score if that is negative, to just beyond the largest: fused scores exceed 1, log-odds go
    below 0. Where that would make more than `MAX_THRESHOLDS`, only those are evaluated at which the
    set of kept detections has changed since the threshold before; each stands for itself and all
    that follow until the next, so `best_f1` finds the same one.

    Args:
        scores: (D,) in any order, without ignored detections; compared as float64.
        is_true_positive: (D,) bool, in the same order.
        n_annotations: Annotations to be found, without ignored ones.
        step: Distance between thresholds.

    Returns:
        One entry per threshold. Without detections: the threshold 0 alone.

    Raises:
        TypeError: If `is_true_positive` is not boolean.
        ValueError: If the step is not positive or too small beside the scores for float64, scores
            are not finite, lengths differ or more annotations are found than there are.
    """
    values = np.asarray(scores, dtype=np.float64)
    if len(values) != len(is_true_positive):
        raise ValueError(
            f"expected one flag per score, found {len(is_true_positive)} for {len(values)}"
        )
    ranking = rank(values)
    n_found = _found_so_far(np.asarray(is_true_positive)[ranking], n_annotations)
    thresholds = _thresholds(values, step)
    n_kept = len(values) - np.searchsorted(values[ranking[::-1]], thresholds, side="left")
    n_right = np.concatenate(([0], n_found))[n_kept]
    # From counts, so that equal quotients are equal numbers and ties for the best are real ones.
    return Sweep(
        thresholds=thresholds,
        precision=_quotient(n_right, n_kept, np.nan),
        recall=_quotient(n_right, np.full_like(n_kept, n_annotations), np.nan),
        f1=_quotient(2 * n_right, n_kept + n_annotations, 0.0),
    )


def best_f1(sweep: Sweep) -> int:
    """Index of the largest F1; among equals the lowest threshold, which keeps the most."""
    return int(np.argmax(sweep.f1))


def _thresholds(scores: FloatArray, step: float) -> FloatArray:
    """Ascending multiples of `step` at which scores are to be cut (see `threshold_sweep`)."""
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


def _first_step_beyond(scores: FloatArray, step: float) -> IntArray:
    """For each score the least integer k with ``k * step > score``, exact in float arithmetic."""
    k = np.floor(scores / step).astype(np.int64) + 1
    # The quotient may round across an integer: 0.29 / 0.01 is 28.999999999999996.
    k += k * step <= scores
    k -= (k - 1) * step > scores
    return k


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


def _quotient(numerators: IntArray, denominators: IntArray, undefined: float) -> FloatArray:
    """Quotients, `undefined` where the denominator is 0."""
    quotients = np.full(len(numerators), undefined)
    np.divide(numerators, denominators, out=quotients, where=denominators > 0)
    return quotients
