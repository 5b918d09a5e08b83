"""How much of a figure is chance: the bootstrap over sequences.

Frames of one sequence show the same objects and fail together, so sequences are what is drawn, with
replacement, as many as there are. Every method is scored on the same draws: what a draw does to all
of them alike cancels in their differences (the paired bootstrap).
An AP is not a mean over sequences: on each draw the boxes are pooled and ranked anew, a sequence
drawn twice counting twice.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.precision import ap_voc07_11pt
from imodbatch.core.scoring import AveragePrecision, ScoredBoxes, mean_over_classes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Interval:
    """Where the middle part of the resampled values lies."""

    low: float
    high: float


def draw_sequences(n_sequences: int, n_resamples: int, seed: int = 0) -> Ints:
    """How often each sequence is drawn: (n_resamples, n_sequences), each row adding up to it."""
    drawn = np.random.default_rng(seed).integers(n_sequences, size=(n_resamples, n_sequences))
    one_hot = drawn[..., None] == np.arange(n_sequences)
    return one_hot.sum(axis=1, dtype=np.int64)


def pooled_ap(
    boxes: ScoredBoxes,
    n_annotations: Ints,
    times: Ints,
    average_precision: AveragePrecision = ap_voc07_11pt,
) -> float:
    """AP of one class over the sequences drawn.

    Args:
        boxes: of the class, ranked over all sequences; the copies of a box stand one after another.
        n_annotations: (S,) annotations of the class that count, per sequence.
        times: (S,) how often each sequence is drawn.
        average_precision: ranked hits and annotations → AP.

    Returns:
        The AP; NaN where the sequences drawn hold no annotation of the class.
    """
    is_hit = np.repeat(boxes.is_hit, times[boxes.sequence])
    value = average_precision(is_hit, int(n_annotations @ times))
    return float("nan") if value is None else value


def mean_aps(
    methods: Sequence[Sequence[ScoredBoxes]],
    n_annotations: Ints,
    draws: Ints,
    average_precision: AveragePrecision = ap_voc07_11pt,
) -> Array:
    """Mean AP over classes of every method on every draw.

    The order in which sequences were drawn is of no account, so each combination is computed once:
    four sequences have no more than 35 of them.

    Args:
        methods: C methods, each with its K classes.
        n_annotations: (K, S) annotations that count, per class and sequence.
        draws: (B, S) how often each sequence is drawn, as `draw_sequences` gives them.
        average_precision: ranked hits and annotations → AP.

    Returns:
        (B, C); NaN where a draw holds no annotation at all.
    """
    combinations, place = np.unique(draws, axis=0, return_inverse=True)
    values = [
        [
            mean_over_classes(
                np.array(
                    [
                        pooled_ap(boxes, n_annotations[k], times, average_precision)
                        for k, boxes in enumerate(classes)
                    ]
                )
            )
            for classes in methods
        ]
        for times in combinations
    ]
    by_combination = np.array(values, dtype=np.float64).reshape(len(combinations), len(methods))
    return by_combination[place.reshape(-1)]


def percentile_interval(values: Array, coverage: float = 0.95) -> Interval | None:
    """The interval that leaves out equally many resampled values at either end.

    Efron and Tibshirani 1993, Ch. 13.

    Args:
        values: (B,) one figure on every draw; NaN = the draw does not have it.
        coverage: share of the values inside.

    Returns:
        The interval; None where no draw has the figure.
    """
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return None
    low, high = np.quantile(known, [(1 - coverage) / 2, (1 + coverage) / 2])
    return Interval(float(low), float(high))
