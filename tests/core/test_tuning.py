"""Thresholds by hand, and what a held-out sequence may not know."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imodbatch.core.tuning import (
    ScoredBoxes,
    counts_at,
    leave_one_out,
    reaches,
    tune_threshold,
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
    return tune_threshold(np.array(scores), np.array(is_hit, dtype=np.bool_), n_annotations, STEP)


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
    assert (counts.precision, counts.recall) == ([2 / 3], [1.0])


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
