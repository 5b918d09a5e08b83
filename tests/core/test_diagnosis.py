"""Diagnosis: small cases worked out by hand."""

import math
from itertools import combinations

import numpy as np
import pytest

from imodbatch.core.diagnosis import overlaps, spread
from imodbatch.core.scoring import Candidates, Truth


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def truth_of(image, class_id, boxes):
    flags = frozen([0] * len(image), bool)
    return Truth(
        frozen(image, np.int64),
        frozen(class_id, np.int64),
        frozen(boxes).reshape(-1, 4),
        flags,
        flags,
    )


def candidates_of(image, class_id, boxes):
    return Candidates(
        frozen(image, np.int64), frozen(class_id, np.int64), frozen(boxes).reshape(-1, 4)
    )


def test_overlaps_within_image_and_class():
    truth = truth_of(
        [0, 0, 1, 2],
        [0, 0, 0, 1],
        [[0, 0, 10, 10], [5, 0, 15, 10], [0, 0, 10, 10], [0, 0, 10, 10]],
    )
    candidates = candidates_of(
        [0, 0, 0, 2, 3],
        [0, 0, 1, 1, 0],
        [
            [0, 0, 10, 8],  # 0.8 of annotation 0; 40 / 140 of annotation 1
            [10, 0, 20, 10],  # 1/3 of annotation 1
            [0, 0, 10, 10],  # another class: nothing
            [0, 0, 5, 10],  # half of annotation 3
            [0, 0, 10, 10],  # an image without annotations
        ],
    )
    found = overlaps(candidates, truth)
    np.testing.assert_allclose(found.annotation_iou, [0.8, 1 / 3, 0, 0.5])
    np.testing.assert_allclose(found.candidate_iou, [0.8, 1 / 3, 0, 0.5, 0])
    assert found.candidate_annotation.tolist() == [0, 1, -1, 3, -1]


def test_several_candidates_may_share_an_annotation():
    truth = truth_of([4], [2], [[0, 0, 10, 10]])
    candidates = candidates_of([4, 4], [2, 2], [[0, 0, 10, 5], [0, 0, 10, 7]])
    found = overlaps(candidates, truth)
    np.testing.assert_allclose(found.annotation_iou, [0.7])
    np.testing.assert_allclose(found.candidate_iou, [0.5, 0.7])
    assert found.candidate_annotation.tolist() == [0, 0]


def test_overlaps_of_nothing():
    truth = truth_of([0], [0], [[0, 0, 1, 1]])
    none = overlaps(candidates_of([], [], []), truth)
    np.testing.assert_array_equal(none.annotation_iou, [0])
    assert none.candidate_iou.shape == none.candidate_annotation.shape == (0,)
    alone = overlaps(candidates_of([0], [0], [[0, 0, 1, 1]]), truth_of([], [], []))
    np.testing.assert_array_equal(alone.candidate_iou, [0])
    assert alone.candidate_annotation.tolist() == [-1]
    assert alone.annotation_iou.shape == (0,)


def far_camera(n):
    """Cameras 10 m away in +x: a place with smaller x lies further behind."""
    return frozen(np.tile([10.0, 0, 0], (n, 1)))


def test_split_pairs_by_hand():
    # instance 7: voxels a a a b → 6 pairs, 3 split; instance 3: voxels c d → 1 pair, split;
    # instance 5: one sighting, no pair
    instance = frozen([7, 3, 7, 7, 5, 7, 3], np.int64)
    voxel = frozen([0, 4, 0, 1, 0, 0, 9], np.int64)
    found = spread(instance, voxel, frozen(np.zeros((7, 3))), far_camera(7))
    assert found.n_pairs == 7
    assert found.split_pairs == pytest.approx(4 / 7)
    assert found.n_instances == 3
    assert found.voxels_per_instance == pytest.approx((2 + 2 + 1) / 3)
    assert found.n_sightings == 7
    assert found.place_spread_m == 0
    assert found.behind_share == 0


def test_split_pairs_against_a_plain_loop():
    rng = np.random.default_rng(0)
    instance, voxel = frozen(rng.integers(0, 4, 30), np.int64), frozen(rng.integers(0, 3, 30))
    found = spread(instance, voxel.astype(np.int64), frozen(rng.random((30, 3))), far_camera(30))
    pairs = [(i, j) for i, j in combinations(range(30), 2) if instance[i] == instance[j]]
    assert found.n_pairs == len(pairs)
    n_split = sum(voxel[i] != voxel[j] for i, j in pairs)
    assert found.split_pairs == pytest.approx(n_split / len(pairs))


def test_behind_share_is_seen_from_the_camera():
    # the median place is the origin; behind by more than 3 cm: the sightings at −0.04 and −0.5
    x = [0.0, 0.0, 0.0, 0.02, 0.3, -0.02, -0.04, -0.5, 0.5]
    xyz = frozen([[v, 0, 0] for v in x])
    same = frozen([1] * 9, np.int64)
    found = spread(same, same, xyz, far_camera(9))
    assert found.behind_share == pytest.approx(2 / 9)
    assert found.place_spread_m == pytest.approx(0.02)  # 0 0 0 .02 .02 .04 .3 .5 .5
    # from the other side, before and behind change places: 0.3 and 0.5
    assert spread(same, same, xyz, -far_camera(9)).behind_share == pytest.approx(2 / 9)
    mirrored = frozen(np.delete(xyz, 8, axis=0))  # without 0.5: the median stays, one is behind
    eight = frozen([1] * 8, np.int64)
    assert spread(eight, eight, mirrored, -far_camera(8)).behind_share == pytest.approx(1 / 8)
    assert spread(eight, eight, mirrored, far_camera(8)).behind_share == pytest.approx(2 / 8)


def test_sideways_is_not_behind():
    xyz = frozen([[0, 0, 0], [0, 0.2, 0], [0, -0.2, 0], [0, 0, 0.2], [0, 0, -0.2]])
    same = frozen([1] * 5, np.int64)
    found = spread(same, same, xyz, far_camera(5))
    assert found.behind_share == 0
    assert found.place_spread_m == pytest.approx(0.2)


def test_each_instance_has_its_own_middle():
    xyz = frozen([[0, 0, 0], [0, 0, 0.1], [5, 0, 0], [5, 0, 0.3]])
    found = spread(frozen([0, 0, 1, 1], np.int64), frozen([0, 0, 1, 1]), xyz, far_camera(4) * 2)
    assert found.place_spread_m == pytest.approx(np.median([0.05, 0.05, 0.15, 0.15]))
    assert found.split_pairs == 0


def test_spread_of_nothing_is_unknown():
    none = frozen([], np.int64)
    found = spread(none, none, frozen(np.zeros((0, 3))), frozen(np.zeros((0, 3))))
    assert (found.n_pairs, found.n_instances, found.n_sightings) == (0, 0, 0)
    shares = (found.split_pairs, found.voxels_per_instance, found.place_spread_m)
    assert all(math.isnan(v) for v in (*shares, found.behind_share))
    alone = frozen([3], np.int64)
    single = spread(alone, alone, frozen(np.zeros((1, 3))), far_camera(1))
    assert math.isnan(single.split_pairs)
    assert single.voxels_per_instance == 1
