"""Precision: metrics by hand, by plain loops and by what must not change them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imodbatch.core import precision as module
from imodbatch.core.matching import Outcome, match_image
from imodbatch.core.precision import (
    ap_area,
    ap_voc07_11pt,
    best_f1,
    precision_recall,
    rank,
    threshold_sweep,
)


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def hits(text):
    """A ranking written as "+-+": right, wrong, right."""
    return frozen([c == "+" for c in text], dtype=bool)


def naive_11pt(is_true_positive, n_annotations):
    """The formula as usually written, with floats."""
    precision, recall = precision_recall(is_true_positive, n_annotations)
    return np.mean([precision[recall >= t].max(initial=0) for t in np.arange(0, 1.1, 0.1)])


def test_rank_is_descending_with_ties_by_the_keys_in_turn_then_position():
    scores = frozen([0.5, 0.9, 0.5, 0.5, 0.5])
    frame, detection = frozen([2, 0, 1, 2, 2], int), frozen([1, 0, 5, 0, 0], int)
    assert rank(scores, frame, detection).tolist() == [1, 2, 3, 4, 0]
    assert rank(scores).tolist() == [1, 0, 2, 3, 4]
    with pytest.raises(ValueError, match="differ in length"):
        rank(scores, frame[:2])


def test_precision_recall_by_hand():
    precision, recall = precision_recall(hits("+-+"), 4)
    np.testing.assert_allclose(precision, [1, 1 / 2, 2 / 3])
    np.testing.assert_allclose(recall, [0.25, 0.25, 0.5])
    precision, recall = precision_recall(hits("--"), 0)
    assert precision.tolist() == [0, 0]
    assert np.isnan(recall).all()


@pytest.mark.parametrize("n_found", range(1, 11))
def test_11pt_is_right_at_whole_tenths_of_recall(n_found):
    ranking = hits("+" * n_found)
    exact = (n_found + 1) / 11
    assert ap_voc07_11pt(ranking, 10) == pytest.approx(exact, abs=1e-15)
    # The usual formula loses a point at exactly these recalls.
    lost = 1 / 11 if n_found in {3, 6, 7} else 0.0
    assert naive_11pt(ranking, 10) == pytest.approx(exact - lost, abs=1e-12)


def test_ap_by_hand():
    # Precision 1, 1/2, 2/3, 1/2, 3/5 at recalls 1/4, 1/4, 2/4, 2/4, 3/4.
    ranking = hits("+-+-+")
    points = [1] * 3 + [2 / 3] * 3 + [3 / 5] * 2 + [0] * 3
    assert ap_voc07_11pt(ranking, 4) == pytest.approx(sum(points) / 11)
    assert ap_area(ranking, 4) == pytest.approx((1 + 2 / 3 + 3 / 5) / 4)
    # The envelope: a low precision is lifted to a better one further down.
    assert ap_area(hits("-++"), 2) == pytest.approx(2 / 3)
    assert ap_voc07_11pt(hits("-++"), 2) == pytest.approx(2 / 3)


@pytest.mark.parametrize("metric", [ap_voc07_11pt, ap_area])
def test_ap_at_the_ends(metric):
    assert metric(hits("++++"), 4) == 1.0
    assert metric(hits(""), 4) == 0.0
    assert metric(hits("---"), 4) == 0.0
    assert metric(hits("---"), 0) is None
    assert metric(hits(""), 0) is None


@pytest.mark.parametrize("metric", [ap_voc07_11pt, ap_area, precision_recall])
def test_wrong_arguments_are_errors(metric):
    with pytest.raises(TypeError, match="expected booleans, found int8"):
        metric(np.array([Outcome.IGNORED, Outcome.TRUE_POSITIVE], dtype=np.int8), 4)
    with pytest.raises(ValueError, match="2 true positives for 1 annotations"):
        metric(hits("++"), 1)


def plain_envelope_area(is_true_positive, n_annotations):
    """VOC devkit's VOCap.m, word for word."""
    precision, recall = precision_recall(is_true_positive, n_annotations)
    mrec, mpre = [0.0, *recall, 1.0], [0.0, *precision, 0.0]
    for i in range(len(mpre) - 2, -1, -1):
        mpre[i] = max(mpre[i], mpre[i + 1])
    return sum((mrec[i] - mrec[i - 1]) * mpre[i] for i in range(1, len(mrec)))


@given(st.lists(st.booleans(), max_size=40), st.integers(1, 20))
def test_ap_agrees_with_plain_loops(flags, n_missed):
    ranking, n_annotations = frozen(flags, dtype=bool), sum(flags) + n_missed
    assert ap_area(ranking, n_annotations) == pytest.approx(
        plain_envelope_area(ranking, n_annotations)
    )
    points = []
    for t in range(11):
        found = np.cumsum(flags, dtype=int)
        precisions = [n / (i + 1) for i, n in enumerate(found) if 10 * int(n) >= t * n_annotations]
        points.append(max(precisions, default=0))
    assert ap_voc07_11pt(ranking, n_annotations) == pytest.approx(sum(points) / 11)


STRICTLY_INCREASING = {
    "affine": lambda s: 3 * s - 7,
    "cube": lambda s: s**3,
    "exp": np.exp,
    "arctan": np.arctan,
}


@given(
    st.lists(st.integers(-500, 500), min_size=1, max_size=30),
    st.sampled_from(sorted(STRICTLY_INCREASING)),
    st.sampled_from(["voc", "coco"]),
    st.integers(0, 1000),
)
def test_ap_does_not_change_under_strictly_increasing_score_maps(hundredths, name, rule, seed):
    rng = np.random.default_rng(seed)
    annotations = frozen([[20 * i, 0, 20 * i + 10, 10] for i in range(4)])
    boxes = annotations[rng.integers(0, 4, len(hundredths))]
    boxes = boxes + rng.integers(-3, 4, boxes.shape)
    no_flags = frozen([False] * 4, dtype=bool)

    def average_precisions(scores):
        outcome = match_image(boxes, scores, annotations, no_flags, no_flags, 0.5, rule).outcome
        ranked = outcome[rank(scores)] == Outcome.TRUE_POSITIVE
        return ap_voc07_11pt(ranked, 4), ap_area(ranked, 4)

    scores = frozen(hundredths) / 100
    mapped = STRICTLY_INCREASING[name](scores)
    assert len(np.unique(mapped)) == len(np.unique(scores))
    assert average_precisions(mapped) == average_precisions(scores)


def plain_sweep(scores, flags, n_annotations, thresholds):
    rows = []
    for threshold in thresholds:
        kept = [flag for score, flag in zip(scores, flags, strict=True) if score >= threshold]
        precision = sum(kept) / len(kept) if kept else np.nan
        recall = sum(kept) / n_annotations
        f1 = 2 * precision * recall / (precision + recall) if sum(kept) else 0.0
        rows.append((precision, recall, f1))
    return np.array(rows).T


@pytest.mark.parametrize(
    ("low", "high", "first", "last"),
    [(0.0, 0.99, 0, 100), (0.2, 7.3, 0, 731), (-2.5, 1.5, -250, 151), (-0.9, -0.1, -90, -9)],
)
def test_sweep_agrees_with_a_plain_loop(low, high, first, last):
    rng = np.random.default_rng(5)
    scores = frozen([low, high, *np.round(rng.uniform(low, high, 58), 2)])
    flags = frozen(rng.random(60) < 0.4, dtype=bool)
    sweep = threshold_sweep(scores, flags, 50, 0.01)
    np.testing.assert_array_equal(sweep.thresholds, np.arange(first, last + 1) * 0.01)
    precision, recall, f1 = plain_sweep(scores, flags, 50, sweep.thresholds)
    np.testing.assert_allclose(sweep.precision, precision)
    np.testing.assert_allclose(sweep.recall, recall)
    np.testing.assert_allclose(sweep.f1, f1)
    # The first threshold keeps all, the last none, the one before it something.
    assert sweep.recall[0] == flags.sum() / 50
    assert np.isnan(sweep.precision[-1])
    assert not np.isnan(sweep.precision[-2])


@given(st.integers(-300, 3000), st.sampled_from([0.01, 0.05, 0.1, 0.3]))
def test_a_score_on_a_threshold_is_kept_and_the_next_threshold_ends_the_sweep(k, step):
    score = k * step  # the quotient by the step often falls short of k
    sweep = threshold_sweep(frozen([score]), hits("+"), 1, step)
    assert sweep.thresholds[-2:].tolist() == [k * step, (k + 1) * step]
    assert sweep.recall[-2:].tolist() == [1.0, 0.0]


@given(st.integers(-300, 3000), st.sampled_from([0.01, 0.05, 0.1, 0.3]))
def test_a_score_just_below_a_threshold_is_lost_there_and_the_sweep_ends(k, step):
    score = np.nextafter(k * step, -np.inf)  # the quotient by the step often rounds up to k
    sweep = threshold_sweep(frozen([score]), hits("+"), 1, step)
    assert sweep.thresholds[-1] == k * step
    assert sweep.recall[-2:].tolist() == [1.0, 0.0]


def test_sweep_takes_few_thresholds_where_steps_would_be_too_many(monkeypatch):
    rng = np.random.default_rng(6)
    scores, flags = frozen(rng.uniform(-3, 9, 40)), frozen(rng.random(40) < 0.5, dtype=bool)
    dense = threshold_sweep(scores, flags, 30, 0.01)
    monkeypatch.setattr(module, "MAX_THRESHOLDS", 100)
    sparse = threshold_sweep(scores, flags, 30, 0.01)
    assert len(sparse.thresholds) <= 41
    assert len(dense.thresholds) > 1000
    # Each dense threshold has the quality of the sparse one at or before it.
    at_or_before = np.searchsorted(sparse.thresholds, dense.thresholds, side="right") - 1
    for name in ("precision", "recall", "f1"):
        np.testing.assert_array_equal(
            getattr(sparse, name)[at_or_before], getattr(dense, name), err_msg=name
        )
    assert sparse.thresholds[best_f1(sparse)] == dense.thresholds[best_f1(dense)]


def test_sweep_of_huge_scores_is_small():
    sweep = threshold_sweep(frozen([1e9, 0.5]), hits("+-"), 1, 0.01)
    assert len(sweep.thresholds) == 3
    assert sweep.recall.tolist() == [1, 1, 0]
    np.testing.assert_allclose(sweep.thresholds, [0, 0.51, 1e9 + 0.01], rtol=1e-15)


def test_sweep_without_detections_or_annotations():
    nothing = threshold_sweep(frozen([]), hits(""), 3, 0.01)
    assert nothing.thresholds.tolist() == [0.0]
    assert np.isnan(nothing.precision).all()
    assert nothing.recall.tolist() == nothing.f1.tolist() == [0.0]
    needless = threshold_sweep(frozen([0.5]), hits("-"), 0, 0.5)
    np.testing.assert_array_equal(needless.precision, [0, 0, np.nan])
    assert np.isnan(needless.recall).all()
    assert needless.f1.tolist() == [0, 0, 0]


def test_best_f1_takes_the_lowest_threshold_among_equals():
    # F1 is 2/3 for thresholds up to 0.2 (one of two right, one annotation), 1 from 0.3 to 0.8.
    sweep = threshold_sweep(frozen([0.8, 0.25]), hits("+-"), 1, 0.1)
    best = best_f1(sweep)
    assert sweep.f1[best] == 1.0
    assert sweep.thresholds[best] == pytest.approx(0.3)
    assert (sweep.f1 == 1.0).sum() == 6


def test_wrong_sweeps_are_errors():
    for step in (0.0, -0.1, np.nan):
        with pytest.raises(ValueError, match="step: expected a positive number"):
            threshold_sweep(frozen([0.5]), hits("+"), 1, step)
    for score in (np.nan, np.inf, 1e300):
        with pytest.raises(ValueError, match="expected finite values"):
            threshold_sweep(frozen([0.5, score]), hits("+-"), 1, 0.01)
    with pytest.raises(ValueError, match="one flag per score, found 1 for 2"):
        threshold_sweep(frozen([0.5, 0.6]), hits("+"), 1, 0.01)
