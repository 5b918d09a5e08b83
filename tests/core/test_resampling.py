"""The bootstrap over sequences, against values by hand and against plain repetition."""

from itertools import product

import numpy as np
import pytest

from imodbatch.core.precision import ap_area, ap_voc07_11pt
from imodbatch.core.resampling import (
    Interval,
    draw_sequences,
    mean_aps,
    percentile_interval,
    pooled_ap,
)
from imodbatch.core.scoring import ScoredBoxes


def ranked(hits, sequence):
    n = len(hits)
    columns = {
        "score": np.linspace(1, 0, n),
        "is_hit": np.array(hits, dtype=bool),
        "class_id": np.zeros(n, dtype=np.int64),
        "sequence": np.array(sequence, dtype=np.int64),
    }
    for column in columns.values():
        column.setflags(write=False)
    return ScoredBoxes(**columns)


def test_each_draw_takes_as_many_sequences_as_there_are():
    draws = draw_sequences(4, 500)
    assert draws.shape == (500, 4)
    assert (draws.sum(axis=1) == 4).all()
    assert draws.min() == 0
    assert draws.max() == 4
    assert draws.mean(axis=0) == pytest.approx(np.ones(4), abs=0.15)


def test_a_seed_fixes_the_draws():
    assert np.array_equal(draw_sequences(5, 20, seed=3), draw_sequences(5, 20, seed=3))
    assert not np.array_equal(draw_sequences(5, 20, seed=3), draw_sequences(5, 20, seed=4))


def test_pooled_ap_by_hand():
    """Ranking: hit of sequence 0, miss of 1, hit of 1; each sequence holds one annotation."""
    boxes, n_annotations = ranked([1, 0, 1], [0, 1, 1]), np.array([1, 1])
    # recall 1/2 at precision 1, recall 1 at precision 2/3
    assert pooled_ap(boxes, n_annotations, np.array([1, 1])) == pytest.approx((6 + 5 * 2 / 3) / 11)
    assert pooled_ap(boxes, n_annotations, np.array([2, 0])) == 1.0
    # sequence 1 alone, twice: miss miss hit hit
    assert pooled_ap(boxes, n_annotations, np.array([0, 2])) == pytest.approx(0.5)


def test_pooled_ap_without_annotations_is_unknown():
    boxes = ranked([1, 0], [0, 1])
    assert np.isnan(pooled_ap(boxes, np.array([1, 0]), np.array([0, 2])))
    assert pooled_ap(ranked([], []), np.array([1, 0]), np.array([1, 1])) == 0.0


@pytest.mark.parametrize("metric", [ap_voc07_11pt, ap_area])
def test_a_sequence_drawn_twice_is_a_sequence_that_stands_there_twice(metric):
    """Against pooling real copies, each with its own sequence number."""
    rng = np.random.default_rng(0)
    is_hit, sequence, n_annotations = rng.random(60) < 0.5, rng.integers(3, size=60), [25, 30, 20]
    boxes = ranked(is_hit, sequence)
    for times in product(range(3), repeat=3):
        if sum(times) == 0:
            continue
        rows = [i for i in range(60) for _ in range(times[sequence[i]])]
        n = sum(n * t for n, t in zip(n_annotations, times, strict=True))
        expected = metric(np.array(is_hit)[rows], n)
        assert pooled_ap(boxes, np.array(n_annotations), np.array(times), metric) == expected


def test_the_mean_leaves_out_a_class_that_the_draw_does_not_hold():
    """Class 0 (AP 1) is only in sequence 0, class 1 (AP 0) only in sequence 1."""
    methods = [[ranked([1], [0]), ranked([0], [1])]]
    n_annotations = np.array([[1, 0], [0, 1]])
    draws = np.array([[1, 1], [2, 0], [0, 2], [1, 1]])
    assert mean_aps(methods, n_annotations, draws).tolist() == [[0.5], [1.0], [0.0], [0.5]]


def test_a_draw_without_any_annotation_has_no_mean():
    found = mean_aps([[ranked([1], [0])]], np.array([[1, 0]]), np.array([[0, 2]]))
    assert np.isnan(found).all()


def test_equal_methods_never_differ():
    rng = np.random.default_rng(1)
    classes = [ranked(rng.random(40) < 0.6, rng.integers(4, size=40)) for _ in range(3)]
    n_annotations = np.full((3, 4), 20)
    found = mean_aps([classes, classes], n_annotations, draw_sequences(4, 200))
    assert found.shape == (200, 2)
    assert len(np.unique(found[:, 0])) > 10
    assert percentile_interval(found[:, 1] - found[:, 0]) == Interval(0.0, 0.0)


def test_methods_share_their_draws():
    """A method that is better by the same amount everywhere has a difference without spread."""
    good = [ranked([1, 1], [0, 1])]
    bad = [ranked([0, 0], [0, 1])]
    found = mean_aps([bad, good], np.array([[1, 1]]), draw_sequences(2, 50))
    assert percentile_interval(found[:, 1] - found[:, 0]) == Interval(1.0, 1.0)


def test_the_interval_cuts_equal_shares_off_both_ends():
    values = np.append(np.arange(101.0), np.nan)
    found = percentile_interval(values, 0.9)
    assert (found.low, found.high) == pytest.approx((5.0, 95.0))
    assert percentile_interval(values).low == pytest.approx(2.5)
    assert percentile_interval(np.array([np.nan])) is None


def test_no_draws_give_no_values():
    assert mean_aps([[ranked([1], [0])]] * 3, np.array([[1]]), draw_sequences(1, 0)).shape == (0, 3)
