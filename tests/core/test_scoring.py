"""Scoring of many images: the same as image by image, and the classes that have no value."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imodbatch.core.matching import Outcome, match_image
from imodbatch.core.precision import ap_area
from imodbatch.core.scoring import (
    Candidates,
    ScoredBoxes,
    Truth,
    average_precisions,
    match_all,
    mean_over_classes,
)

FP, TP, IGNORED = (int(o) for o in Outcome)


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def random_boxes(rng, n):
    corners = rng.integers(0, 12, (n, 2))
    sizes = rng.integers(4, 12, (n, 2))
    return frozen(np.concatenate([corners, corners + sizes], axis=1))


def random_case(rng, n_candidates=60, n_annotations=30, n_images=5, n_classes=3):
    crowd = rng.random(n_annotations) < 0.1
    truth = Truth(
        frozen(rng.integers(0, n_images, n_annotations), np.int64),
        frozen(rng.integers(0, n_classes, n_annotations), np.int64),
        random_boxes(rng, n_annotations),
        frozen(crowd | (rng.random(n_annotations) < 0.2), bool),
        frozen(crowd, bool),
    )
    candidates = Candidates(
        frozen(rng.integers(0, n_images + 1, n_candidates), np.int64),
        frozen(rng.integers(0, n_classes + 1, n_candidates), np.int64),
        random_boxes(rng, n_candidates),
    )
    return candidates, frozen(rng.integers(0, 8, n_candidates) / 8), truth


@given(st.integers(0, 2**32 - 1), st.sampled_from(["voc", "coco"]), st.sampled_from([0.3, 0.5]))
@settings(max_examples=40)
def test_match_all_is_match_image_on_each_image_and_class(seed, rule, iou_threshold):
    candidates, scores, truth = random_case(np.random.default_rng(seed))
    found = match_all(candidates, scores, truth, iou_threshold, rule)
    n_seen = 0
    for image in range(6):
        for class_id in range(4):
            rows = np.flatnonzero((candidates.image == image) & (candidates.class_id == class_id))
            true_rows = np.flatnonzero((truth.image == image) & (truth.class_id == class_id))
            expected = match_image(
                candidates.boxes[rows],
                scores[rows],
                truth.boxes[true_rows],
                truth.is_ignored[true_rows],
                truth.is_crowd[true_rows],
                iou_threshold,
                rule,
            )
            np.testing.assert_array_equal(found.outcome[rows], expected.outcome)
            np.testing.assert_array_equal(found.iou[rows], expected.iou)
            index = [true_rows[i] if i >= 0 else -1 for i in expected.annotation_index]
            np.testing.assert_array_equal(found.annotation_index[rows], index)
            n_seen += len(rows)
    assert n_seen == len(scores)


def small_case():
    """Two images, two classes; the first image's boxes all lie on the same spot."""
    box, other = [0, 0, 10, 10], [20, 20, 30, 30]
    truth = Truth(
        frozen([0, 0, 1, 1], np.int64),
        frozen([0, 1, 0, 0], np.int64),
        frozen([box, box, box, other]),
        frozen([0, 0, 0, 1], bool),
        frozen([0, 0, 0, 0], bool),
    )
    candidates = Candidates(
        frozen([1, 0, 0, 0, 1, 2], np.int64),
        frozen([0, 0, 0, 1, 0, 0], np.int64),
        frozen([box, box, box, box, other, box]),
    )
    return candidates, frozen([0.5, 0.6, 0.9, 0.1, 0.8, 0.7]), truth


def test_match_all_by_hand():
    candidates, scores, truth = small_case()
    found = match_all(candidates, scores, truth, 0.5, "voc")
    assert found.outcome.tolist() == [TP, FP, TP, TP, IGNORED, FP]
    assert found.annotation_index.tolist() == [2, -1, 0, 1, 3, -1]
    np.testing.assert_array_equal(found.iou, [1, 1, 1, 1, 1, np.nan])


def test_match_all_of_nothing():
    candidates, scores, truth = small_case()
    none = Candidates(frozen([], np.int64), frozen([], np.int64), frozen(np.zeros((0, 4))))
    assert match_all(none, frozen([]), truth, 0.5, "voc").outcome.shape == (0,)
    empty = Truth(none.image, none.class_id, none.boxes, frozen([], bool), frozen([], bool))
    found = match_all(candidates, scores, empty, 0.5, "coco")
    assert (found.outcome == FP).all()
    assert (found.annotation_index == -1).all()
    assert np.isnan(found.iou).all()
    np.testing.assert_array_equal(empty.counted(3), [0, 0, 0])


def test_counted_leaves_out_what_is_ignored():
    truth = Truth(
        frozen([0] * 6, np.int64),
        frozen([0, 0, 2, 2, 2, 0], np.int64),
        frozen(np.tile([0, 0, 1, 1], (6, 1))),
        frozen([0, 1, 0, 0, 0, 0], bool),
        frozen([0, 0, 0, 0, 1, 0], bool),  # a crowd is ignored, whether it says so or not
    )
    np.testing.assert_array_equal(truth.counted(4), [2, 0, 2, 0])


def ranked(scores, outcome, class_id):
    return ScoredBoxes.ranked(scores, outcome, class_id, frozen(np.zeros(len(scores)), np.int64))


def test_boxes_are_ranked_without_those_ignored():
    scores = frozen([0.2, 0.9, 0.5, 0.9, 0.5])
    outcome = frozen([TP, FP, IGNORED, TP, TP], np.int8)
    boxes = ScoredBoxes.ranked(scores, outcome, frozen([5, 6, 7, 8, 9], int), frozen(range(5), int))
    np.testing.assert_array_equal(boxes.score, [0.9, 0.9, 0.5, 0.2])
    np.testing.assert_array_equal(boxes.is_hit, [False, True, True, True])
    np.testing.assert_array_equal(boxes.class_id, [6, 8, 9, 5])
    np.testing.assert_array_equal(boxes.sequence, [1, 3, 4, 0])
    assert boxes.of_class(8).sequence.tolist() == [3]


def test_average_precisions_by_hand():
    candidates, scores, truth = small_case()
    outcome = match_all(candidates, scores, truth, 0.5, "voc").outcome
    # class 0, best first: TP .9, (ignored .8), FP .7, FP .6, TP .5 of 2; class 1: TP of 1
    boxes = ranked(scores, outcome, candidates.class_id)
    found = average_precisions(boxes, truth.counted(3), ap_area)
    np.testing.assert_allclose(found, [0.5 * 1 + 0.5 * 2 / 4, 1.0, np.nan])
    assert mean_over_classes(found) == pytest.approx((0.75 + 1) / 2)


def test_a_class_without_annotations_has_no_value_though_it_has_boxes():
    boxes = ranked(frozen([0.9, 0.8]), frozen([FP, FP], np.int8), frozen([1, 1], np.int64))
    found = average_precisions(boxes, frozen([3, 0], np.int64), ap_area)
    np.testing.assert_array_equal(found, [0.0, np.nan])  # none found; none to be found
    assert mean_over_classes(found) == 0.0


def test_mean_over_classes():
    assert mean_over_classes(frozen([0.2, np.nan, 0.6])) == pytest.approx(0.4)
    assert np.isnan(mean_over_classes(frozen([np.nan, np.nan])))
    assert np.isnan(mean_over_classes(frozen([])))
