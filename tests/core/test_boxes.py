"""Boxes: overlaps worked out by hand, suppression against a plain loop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imodbatch.core.boxes import area, clip, coverage_matrix, iou_matrix, nms_per_category


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def random_boxes(rng, n):
    corners = rng.integers(0, 30, (n, 2))
    return frozen(np.concatenate([corners, corners + rng.integers(1, 20, (n, 2))], axis=1))


def plain_iou(a, b):
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    shared = width * height
    return shared / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - shared)


def nms(boxes, scores, iou_threshold):
    """Positions that survive in a single category, ascending."""
    survives = nms_per_category(boxes, scores[:, None], -np.inf, iou_threshold)
    return np.flatnonzero(survives[:, 0])


def plain_nms(boxes, scores, iou_threshold):
    kept = []
    for i in sorted(range(len(boxes)), key=lambda i: (-scores[i], i)):
        if all(plain_iou(boxes[i], boxes[j]) <= iou_threshold for j in kept):
            kept.append(i)
    return kept


def test_area_is_continuous_and_zero_for_degenerate_boxes():
    boxes = frozen([[0, 0, 2, 3], [1.5, 0, 2, 1], [1, 1, 1, 5], [5, 5, 2, 2]])
    np.testing.assert_array_equal(area(boxes), [6.0, 0.5, 0.0, 0.0])


def test_iou_and_coverage_by_hand():
    a = frozen([[0, 0, 10, 10], [0, 0, 4, 5]])
    b = frozen([[0, 0, 10, 10], [5, 0, 15, 10], [10, 0, 20, 10]])
    np.testing.assert_allclose(iou_matrix(a, b), [[1, 1 / 3, 0], [0.2, 0, 0]])
    np.testing.assert_allclose(coverage_matrix(a, b), [[1, 0.5, 0], [1, 0, 0]])


def test_degenerate_boxes_overlap_nothing():
    degenerate = frozen([[3, 3, 3, 3], [8, 8, 2, 2], [2, 4, 6, 4]])
    both = np.concatenate([degenerate, [[0, 0, 10, 10]]])
    for matrix in (iou_matrix(both, both), coverage_matrix(both, both)):
        expected = np.zeros((4, 4))
        expected[3, 3] = 1.0
        np.testing.assert_array_equal(matrix, expected)


def test_iou_agrees_with_a_plain_loop():
    rng = np.random.default_rng(1)
    a, b = random_boxes(rng, 40), random_boxes(rng, 30)
    expected = [[plain_iou(p, q) for q in b] for p in a]
    np.testing.assert_allclose(iou_matrix(a, b), expected, rtol=1e-15)
    assert np.count_nonzero(expected) > 100


def test_no_boxes_keep_their_shapes():
    none, one = frozen(np.zeros((0, 4))), frozen([[0, 0, 1, 1]])
    assert area(none).shape == (0,)
    assert iou_matrix(none, one).shape == (0, 1)
    assert coverage_matrix(one, none).shape == (1, 0)
    assert clip(none, 5, 5).shape == (0, 4)
    assert nms_per_category(none, frozen(np.zeros((0, 3))), 0.1, 0.5).shape == (0, 3)


def test_clip_returns_a_new_array():
    boxes = frozen([[-5, 2, 700, 490], [650, 10, 660, 20]])
    np.testing.assert_array_equal(clip(boxes, 640, 480), [[0, 2, 640, 480], [640, 10, 640, 20]])
    inside = frozen([[1, 1, 2, 2]])
    assert not np.shares_memory(clip(inside, 640, 480), inside)


@pytest.mark.parametrize("iou_threshold", [0.0, 0.3, 0.5, 1.0])
def test_nms_agrees_with_a_plain_loop(iou_threshold):
    rng = np.random.default_rng(2)
    for _ in range(30):
        boxes = random_boxes(rng, 25)
        scores = frozen(rng.integers(0, 8, 25) / 8)  # ties
        kept = nms(boxes, scores, iou_threshold)
        assert kept.tolist() == sorted(plain_nms(boxes.tolist(), scores.tolist(), iou_threshold))


def test_nms_suppresses_above_the_threshold_only():
    boxes = frozen([[0, 0, 10, 10], [0, 0, 10, 5]])  # IoU exactly 1/2
    scores = frozen([0.9, 0.8])
    assert nms(boxes, scores, 0.5).tolist() == [0, 1]
    assert nms(boxes, scores, np.nextafter(0.5, 0)).tolist() == [0]


def test_nms_chain_keeps_what_only_a_suppressed_box_overlaps():
    boxes = frozen([[0, 0, 10, 10], [4, 0, 14, 10], [8, 0, 18, 10]])
    assert nms(boxes, frozen([0.9, 0.8, 0.7]), 0.4).tolist() == [0, 2]


def test_nms_breaks_ties_by_lower_index():
    boxes = frozen([[0, 0, 10, 10]] * 3)
    assert nms(boxes, frozen([0.5, 0.7, 0.7]), 0.5).tolist() == [1]


@given(st.permutations(range(20)), st.integers(0, 1000))
def test_nms_does_not_depend_on_the_order_of_distinct_scores(permutation, seed):
    rng = np.random.default_rng(seed)
    boxes, scores = random_boxes(rng, 20), frozen(rng.permutation(20))
    kept_of_permuted = nms(boxes[permutation], scores[permutation], 0.4)
    kept = np.sort(np.array(permutation)[kept_of_permuted])
    np.testing.assert_array_equal(kept, nms(boxes, scores, 0.4))


def test_nms_per_category_is_nms_of_each_category():
    rng = np.random.default_rng(3)
    boxes = random_boxes(rng, 60)
    scores = frozen(rng.random((60, 5)))
    survives = nms_per_category(boxes, scores, 0.3, 0.5)
    n_by_score = n_by_overlap = 0
    for category in range(5):
        candidates = np.flatnonzero(scores[:, category] >= 0.3)
        kept = candidates[nms(boxes[candidates], scores[candidates, category], 0.5)]
        np.testing.assert_array_equal(np.flatnonzero(survives[:, category]), np.sort(kept))
        n_by_score += 60 - len(candidates)
        n_by_overlap += len(candidates) - len(kept)
    assert n_by_score > 10
    assert n_by_overlap > 10


def test_nms_per_category_counts_a_score_at_the_threshold():
    boxes = frozen([[0, 0, 1, 1], [5, 5, 6, 6]])
    scores = frozen([[0.01], [0.0099]], dtype=np.float32)  # float32(0.01) < 0.01
    for threshold in (0.01, np.float64(0.01)):
        survives = nms_per_category(boxes, scores, threshold, 0.5)
        np.testing.assert_array_equal(survives, [[True], [False]])


def test_wrong_shapes_are_errors():
    with pytest.raises(ValueError, match=r"expected shape \(n, 4\), found \(4,\)"):
        area(np.zeros(4))
    for shape in ((2,), (3, 1)):
        with pytest.raises(ValueError, match=r"expected \(2, K\)"):
            nms_per_category(np.zeros((2, 4)), np.zeros(shape), 0.1, 0.5)
