"""Thresholds by hand, and what a held-out sequence may not know."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imodbatch.core import tuning
from imodbatch.core.scoring import ScoredBoxes
from imodbatch.core.tuning import (
    counts_at,
    kept_at_steps,
    leave_one_out,
    reaches,
    tune,
    tune_thresholds,
)

STEP = 0.01


def boxes(*rows: tuple[float, bool, int, int]) -> ScoredBoxes:
    """Boxes from rows of score, hit, class, sequence; read-only, so that no function writes."""
    score, is_hit, class_id, sequence = zip(*rows, strict=True) if rows else ((),) * 4
    columns = {
        "score": np.array(score, dtype=np.float64),
        "is_hit": np.array(is_hit, dtype=np.bool_),
        "class_id": np.array(class_id, dtype=np.int64),
        "sequence": np.array(sequence, dtype=np.int64),
    }
    for column in columns.values():
        column.setflags(write=False)
    return ScoredBoxes(**columns)


def threshold(scores: list[float], is_hit: list[bool], n_annotations: int) -> float:
    rows = [(score, hit, 0, 0) for score, hit in zip(scores, is_hit, strict=True)]
    return float(tune(boxes(*rows), np.array([n_annotations]), STEP)[0])


def frozen(values: object, dtype: type = np.float64) -> np.ndarray:
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


# One threshold


def test_f1_by_hand() -> None:
    """F1 of keeping 1, 2, 3, 4 boxes: 2/4, 2/5, 4/6, 4/7; three are kept from 0.41 on."""
    assert threshold([2.5, 1.75, 0.9, 0.4], [True, False, True, False], 3) == pytest.approx(0.41)


def test_scores_beyond_1_are_cut_as_well() -> None:
    """Fused scores are sums: the best cut lies between 1.75 and 2.5."""
    assert threshold([2.5, 1.75], [True, False], 1) == pytest.approx(1.76)


def test_among_equal_f1_the_lowest_threshold_wins() -> None:
    """Keeping one box and keeping all four have the same F1, 2/3."""
    assert threshold([0.9, 0.7, 0.6, 0.5], [True, False, False, True], 2) == 0.0


def test_equal_scores_are_kept_or_left_together() -> None:
    """Keeping only the hit of the pair would be best, and is not to be had."""
    assert threshold([0.5, 0.5, 0.2, 0.1], [True, False, False, False], 1) == pytest.approx(0.21)


def test_log_odds_are_cut_below_zero() -> None:
    assert threshold([-0.5, -2.0], [True, False], 1) == pytest.approx(-1.99)


def test_nothing_to_be_found_has_no_threshold_but_nothing_found_has() -> None:
    assert np.isnan(threshold([0.9], [False], 0))
    assert threshold([], [], 3) == 0.0
    assert threshold([0.9], [False], 3) == 0.0  # no F1 is better than 0


# Where boxes are cut


@pytest.mark.parametrize(
    ("low", "high", "first", "last"),
    [(0.0, 0.99, 0, 100), (0.2, 7.3, 0, 731), (-2.5, 1.5, -250, 151), (-0.9, -0.1, -90, -9)],
)
def test_steps_agree_with_a_plain_loop(low: float, high: float, first: int, last: int) -> None:
    rng = np.random.default_rng(5)
    scores = frozen([low, high, *np.round(rng.uniform(low, high, 58), 2)])
    is_hit = frozen(rng.random(60) < 0.4, bool)
    thresholds, n_kept, n_hits = kept_at_steps(scores, is_hit, STEP)
    np.testing.assert_array_equal(thresholds, np.arange(first, last + 1) * STEP)
    assert n_kept.tolist() == [int((scores >= t).sum()) for t in thresholds]
    assert n_hits.tolist() == [int((scores[is_hit] >= t).sum()) for t in thresholds]
    # the first threshold keeps all, the last none, the one before it something
    assert (n_kept[0], n_kept[-1]) == (60, 0)
    assert n_kept[-2] > 0


@given(st.integers(-300, 3000), st.sampled_from([0.01, 0.05, 0.1, 0.3]))
def test_a_score_on_a_step_is_kept_there_and_the_next_one_is_the_last(k: int, step: float) -> None:
    score = k * step  # the quotient by the step often falls short of k
    thresholds, n_kept, _ = kept_at_steps(frozen([score]), frozen([True], bool), step)
    assert thresholds[-2:].tolist() == [k * step, (k + 1) * step]
    assert n_kept[-2:].tolist() == [1, 0]


@given(st.integers(-300, 3000), st.sampled_from([0.01, 0.05, 0.1, 0.3]))
def test_a_score_just_below_a_step_is_lost_there_and_it_is_the_last(k: int, step: float) -> None:
    score = np.nextafter(k * step, -np.inf)  # the quotient by the step often rounds up to k
    thresholds, n_kept, _ = kept_at_steps(frozen([score]), frozen([True], bool), step)
    assert thresholds[-1] == k * step
    assert n_kept[-2:].tolist() == [1, 0]


def test_few_thresholds_are_taken_where_steps_would_be_too_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(6)
    scores, is_hit = frozen(rng.uniform(-3, 9, 40)), frozen(rng.random(40) < 0.5, bool)
    dense = kept_at_steps(scores, is_hit, STEP)
    best = threshold(scores.tolist(), is_hit.tolist(), 30)
    monkeypatch.setattr(tuning, "MAX_THRESHOLDS", 100)
    sparse = kept_at_steps(scores, is_hit, STEP)
    assert len(sparse[0]) <= 41
    assert len(dense[0]) > 1000
    # each dense threshold keeps what the sparse one at or before it keeps
    at_or_before = np.searchsorted(sparse[0], dense[0], side="right") - 1
    for few, many in zip(sparse[1:], dense[1:], strict=True):
        np.testing.assert_array_equal(few[at_or_before], many)
    assert threshold(scores.tolist(), is_hit.tolist(), 30) == best


def test_huge_scores_have_few_thresholds() -> None:
    thresholds, n_kept, n_hits = kept_at_steps(
        frozen([1e9, 0.5]), frozen([True, False], bool), STEP
    )
    np.testing.assert_allclose(thresholds, [0, 0.51, 1e9 + 0.01], rtol=1e-15)
    assert (n_kept.tolist(), n_hits.tolist()) == ([2, 1, 0], [1, 1, 0])


def test_without_boxes_there_is_the_threshold_0_alone() -> None:
    found = kept_at_steps(frozen([]), frozen([], bool), STEP)
    assert [column.tolist() for column in found] == [[0.0], [0], [0]]


def test_wrong_steps_and_scores_are_errors() -> None:
    for step in (0.0, -0.1, np.nan):
        with pytest.raises(ValueError, match="step: expected a positive number"):
            kept_at_steps(frozen([0.5]), frozen([True], bool), step)
    for score in (np.nan, np.inf, 1e300):
        with pytest.raises(ValueError, match="expected finite values"):
            kept_at_steps(frozen([0.5, score]), frozen([True, False], bool), STEP)


# Test set or held out


CONTRAST = boxes((0.9, True, 0, 0), (0.6, False, 0, 0), (0.5, True, 0, 1), (0.2, False, 0, 1))
"""Each sequence has a hit above a miss; the threshold that suits one does not suit the other."""
ONE_EACH = np.array([[1, 1]])


def test_tuned_on_the_test_set_by_hand() -> None:
    """F1 of keeping 1, 2, 3, 4: 2/3, 2/4, 4/5, 4/6."""
    thresholds = tune_thresholds(CONTRAST, ONE_EACH, STEP)
    assert thresholds == pytest.approx(np.array([[0.21, 0.21]]))
    counts = counts_at(CONTRAST, ONE_EACH, thresholds)
    assert (counts.n_kept, counts.n_hits, counts.n_annotations) == ([3], [2], [2])
    assert (counts.precision, counts.recall, counts.f1) == ([2 / 3], [1.0], [4 / 5])


def test_held_out_by_hand() -> None:
    """Each is cut where the other would be: both boxes of the first stay, none of the second."""
    thresholds = leave_one_out(CONTRAST, ONE_EACH, STEP)
    assert thresholds == pytest.approx(np.array([[0.21, 0.61]]))
    counts = counts_at(CONTRAST, ONE_EACH, thresholds)
    assert (counts.n_kept, counts.n_hits, counts.n_annotations) == ([2], [1], [2])
    assert (counts.precision, counts.recall) == ([0.5], [0.5])


def test_a_class_of_one_sequence_is_not_counted_there() -> None:
    """Class 1 stands in sequence 0 alone; in sequence 1 its threshold is known, for nothing."""
    rows = boxes((0.9, True, 1, 0), (0.95, False, 1, 1))
    annotations = np.array([[0, 0], [3, 0]])
    thresholds = leave_one_out(rows, annotations, STEP)
    assert np.isnan(thresholds).tolist() == [[True, True], [True, False]]
    counts = counts_at(rows, annotations, thresholds)
    assert (counts.n_kept.tolist(), counts.n_annotations.tolist()) == ([0, 1], [0, 0])
    assert np.isnan(counts.precision).all()
    assert np.isnan(counts.recall).all()
    assert np.isnan(counts.f1).all()


def test_annotations_without_a_threshold_are_left_out_and_the_others_stay() -> None:
    counts = counts_at(
        boxes((0.9, True, 0, 0), (0.8, True, 0, 1)),
        np.array([[4, 5]]),
        np.array([[np.nan, 0.5]]),
    )
    assert (counts.n_kept, counts.n_hits, counts.n_annotations) == ([1], [1], [5])


def test_one_sequence_cannot_be_held_out() -> None:
    assert np.isnan(leave_one_out(boxes((0.9, True, 0, 0)), np.array([[1]]), STEP)).all()


def test_what_is_not_kept_has_a_recall_but_no_precision() -> None:
    counts = counts_at(boxes((0.3, True, 0, 0)), np.array([[1]]), np.array([[0.5]]))
    assert np.isnan(counts.precision).all()
    assert counts.recall == [0.0]


def test_a_score_at_its_threshold_is_kept_and_none_without() -> None:
    kept = reaches(
        np.array([0.5, 0.49, 9.0]),
        np.array([0, 0, 0]),
        np.array([0, 0, 1]),
        np.array([[0.5, np.nan]]),
    )
    assert kept.tolist() == [True, False, False]


N_CLASSES, N_SEQUENCES = 2, 3
ROWS = st.lists(
    st.tuples(
        st.floats(-1.0, 3.0, width=32),
        st.booleans(),
        st.integers(0, N_CLASSES - 1),
        st.integers(0, N_SEQUENCES - 1),
    ),
    max_size=30,
)


def enough_annotations(rows: ScoredBoxes, spare: int) -> np.ndarray:
    """As many annotations per class and sequence as hits, and some that nothing found."""
    counts = np.full((N_CLASSES, N_SEQUENCES), spare)
    np.add.at(counts, (rows.class_id[rows.is_hit], rows.sequence[rows.is_hit]), 1)
    return counts


@given(ROWS, ROWS, st.integers(0, N_SEQUENCES - 1), st.integers(0, 2))
def test_a_threshold_knows_nothing_of_its_own_sequence(
    first: list[tuple[float, bool, int, int]],
    second: list[tuple[float, bool, int, int]],
    held_out: int,
    spare: int,
) -> None:
    """Whatever else stands in the held-out sequence, its thresholds are the same."""
    others = [row for row in first if row[3] != held_out]
    own = [row for row in second if row[3] == held_out]
    before, after = boxes(*first), boxes(*others, *own)
    found = [
        leave_one_out(rows, enough_annotations(rows, spare), STEP)[:, held_out]
        for rows in (before, after)
    ]
    np.testing.assert_array_equal(*found)


@given(ROWS, st.integers(0, 2))
def test_the_test_set_gives_the_best_f1_of_any_one_threshold(
    rows: list[tuple[float, bool, int, int]], spare: int
) -> None:
    """By brute force: tuned where it is judged, a class reaches the best F1 there is."""
    found = boxes(*rows)
    annotations = enough_annotations(found, spare)
    counts = counts_at(found, annotations, tune_thresholds(found, annotations, STEP))
    for k in range(N_CLASSES):
        n = int(annotations[k].sum())
        if n == 0:
            continue
        mine = found.take(found.class_id == k)
        cuts = [(mine.score >= step * STEP) for step in range(-101, 302)]
        best = max(2 * int(mine.is_hit[cut].sum()) / (int(cut.sum()) + n) for cut in cuts)
        assert 2 * counts.n_hits[k] / (counts.n_kept[k] + n) == pytest.approx(best)
