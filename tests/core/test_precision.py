"""Precision: metrics by hand, by plain loops and by what must not change them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imodbatch.core.matching import Outcome, match_image
from imodbatch.core.precision import ap_area, ap_voc07_11pt, precision_recall, rank


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
