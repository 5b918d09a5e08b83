"""Fusion against plain loops written straight over the formula, and the properties it promises."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imodbatch.core import fusion
from imodbatch.core.fusion import (
    Sightings,
    absent_score,
    best_of_moment,
    log_odds,
    marginal,
    pose_votes,
)
from imodbatch.core.viewpoint import yaw_from_pose_bin

REDUCES = ("mean", "max", "last")
MODES = ("online", "offline")
METHODS = ("single", "naive", "naive_log", "imod")
# name: (M, N) of the detector's scores, (M, N) of the geometry
GRIDS = {
    "3x16": ((3, 16), (3, 16)),
    "3x8": ((3, 8), (3, 8)),
    "1x5": ((1, 5), (1, 5)),
    "3x1": ((3, 1), (3, 1)),
    "no viewpoints, 3x16 cells": ((1, 1), (3, 16)),
}
SEEDS = st.integers(0, 2**32 - 1)


def frozen(values, dtype=None):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def fuse(sightings, method, mode, *settings, **named):
    """Scores in one mode."""
    return fusion.fuse(sightings, method, *settings, **named)[mode]


def sightings_of(frame, voxel, azimuth_bin, elevation_bin, view_scores):
    integers = (frame, voxel, azimuth_bin, elevation_bin)
    return Sightings(*(frozen(values, np.int64) for values in integers), frozen(view_scores))


def random_sightings(
    rng, grid="3x8", *, n_boxes=40, n_classes=3, n_frames=9, n_voxels=3, ties=False
):
    """Boxes in few frames, voxels and cells, so that slots are shared and visited again.

    With `ties` the scores are multiples of 1/8: sums are exact and equal ones frequent.
    """
    (m, n), (cells_m, cells_n) = GRIDS[grid]
    if ties:
        scores = rng.integers(0, 3, (n_boxes, n_classes, m, n)) / 8
    else:
        logits = np.exp(3 * rng.standard_normal((n_boxes, n_classes * m * n + 1)))
        scores = (logits / logits.sum(axis=1, keepdims=True))[:, 1:]
        scores = scores.reshape(n_boxes, n_classes, m, n)
    return sightings_of(
        5 * rng.integers(-1, n_frames, n_boxes),
        rng.integers(0, n_voxels, n_boxes),
        rng.choice(rng.integers(0, cells_n, 4), n_boxes),
        rng.integers(0, cells_m, n_boxes),
        scores.astype(np.float32),
    )


def rows_of(sightings, rows):
    return Sightings(*(frozen(getattr(sightings, f.name)[rows]) for f in fields(Sightings)))


def joined(*parts):
    return Sightings(
        *(frozen(np.concatenate([getattr(p, f.name) for p in parts])) for f in fields(Sightings))
    )


def entering(sightings, i, k, mode):
    """Boxes that count for class k of box i: the best of each moment in its voxel, in time."""
    scores = sightings.view_scores.astype(np.float64)
    moments = {}
    for j in range(len(scores)):
        if sightings.voxel[j] != sightings.voxel[i]:
            continue
        if mode == "online" and sightings.frame[j] > sightings.frame[i]:
            continue
        moments.setdefault(int(sightings.frame[j]), []).append(j)
    return [max(moments[f], key=lambda j: scores[j, k].sum()) for f in sorted(moments)]


def plain_totals(sightings, i, k, mode, cell_reduce):
    """Σ over cells of P[a, e][k, e, (a + d) % N], for each d; and the number of cells."""
    scores = sightings.view_scores.astype(np.float64)
    n = scores.shape[3]
    slots = {}
    for j in entering(sightings, i, k, mode):
        a, e = int(sightings.azimuth_bin[j]), int(sightings.elevation_bin[j])
        if scores.shape[2:] == (1, 1):
            votes = [scores[j, k, 0, 0]]
        else:
            votes = [scores[j, k, e, (a + d) % n] for d in range(n)]
        slots.setdefault((a, e), []).append(votes)
    totals = [0.0] * n
    for visits in slots.values():
        for d in range(n):
            values = [votes[d] for votes in visits]
            totals[d] += {
                "mean": sum(values) / len(values),
                "max": max(values),
                "last": values[-1],
            }[cell_reduce]
    return totals, len(slots)


def plain_sum(sightings, i, k, mode, evidence):
    boxes = entering(sightings, i, k, mode)
    scores = sightings.view_scores.astype(np.float64)
    return sum(evidence(float(scores[j, k].sum())) for j in boxes), len(boxes)


def assert_same(a, b, tolerance=1e-12):
    np.testing.assert_allclose(a.score, b.score, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(a.pose_bin, b.pose_bin)
    np.testing.assert_array_equal(a.n_cells, b.n_cells)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("cell_reduce", REDUCES)
@pytest.mark.parametrize("grid", GRIDS)
def test_imod_is_the_formula(grid, cell_reduce, mode):
    for seed in range(2):
        sightings = random_sightings(np.random.default_rng(seed), grid)
        fused = fuse(sightings, "imod", mode, cell_reduce)
        has_pose = GRIDS[grid][0][1] > 1
        for i, k in np.ndindex(fused.score.shape):
            totals, n_cells = plain_totals(sightings, i, k, mode, cell_reduce)
            assert fused.score[i, k] == pytest.approx(max(totals), rel=0, abs=1e-6)
            assert fused.n_cells[i, k] == n_cells
            assert fused.pose_bin[i, k] == (int(np.argmax(totals)) if has_pose else -1)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("cell_reduce", ["max", "last"])
def test_ties_go_to_the_first_box_and_the_first_pose(cell_reduce, mode):
    n_tied_boxes = n_tied_poses = 0
    for seed in range(3):
        sightings = random_sightings(
            np.random.default_rng(seed), "1x5", n_boxes=30, n_frames=4, n_classes=2, ties=True
        )
        fused = fuse(sightings, "imod", mode, cell_reduce)
        for i, k in np.ndindex(fused.score.shape):
            totals, _ = plain_totals(sightings, i, k, mode, cell_reduce)
            assert fused.score[i, k] == max(totals)
            assert fused.pose_bin[i, k] == totals.index(max(totals))
            n_tied_poses += totals.count(max(totals)) > 1
        moments = zip(
            sightings.frame, sightings.voxel, marginal(sightings.view_scores), strict=True
        )
        keys = [(f, v, s[0]) for f, v, s in moments]
        n_tied_boxes += len(keys) - len(set(keys))
    assert n_tied_boxes > 5
    assert n_tied_poses > 5


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("grid", ["3x8", "no viewpoints, 3x16 cells"])
@pytest.mark.parametrize("ties", [False, True])
def test_naive_sums_are_the_formula(grid, mode, ties):
    floor = 0.02

    def odds(p):
        clipped = min(max(p, floor), 1 - floor)
        return 0.0 if p == 0 else math.log(clipped / (1 - clipped))

    sightings = random_sightings(np.random.default_rng(3), grid, ties=ties)
    for method, evidence in (("naive", lambda p: p), ("naive_log", odds)):
        fused = fuse(sightings, method, mode, probability_floor=floor)
        for i, k in np.ndindex(fused.score.shape):
            total, n_frames = plain_sum(sightings, i, k, mode, evidence)
            assert fused.score[i, k] == pytest.approx(total, rel=0, abs=1e-6)
            assert fused.n_cells[i, k] == n_frames
        assert (fused.pose_bin == -1).all()


def test_the_cells_of_a_detector_without_viewpoints_still_count():
    """Standing still and walking round give other scores, though the detector says the same."""
    scores = np.full((4, 1, 1, 1), 0.5)
    still = sightings_of(range(4), [0] * 4, [3] * 4, [1] * 4, scores)
    round_ = sightings_of(range(4), [0] * 4, [0, 4, 8, 12], [1] * 4, scores)
    risen = sightings_of(range(4), [0] * 4, [3] * 4, [0, 1, 2, 0], scores)
    np.testing.assert_allclose(fuse(still, "imod", "online").score[:, 0], [0.5] * 4)
    np.testing.assert_allclose(fuse(round_, "imod", "online").score[:, 0], [0.5, 1, 1.5, 2])
    np.testing.assert_allclose(fuse(risen, "imod", "online").score[:, 0], [0.5, 1, 1.5, 1.5])
    assert fuse(risen, "imod", "online").pose_bin.tolist() == [[-1]] * 4


def test_the_paper_s_equation_as_printed_does_not_depend_on_the_pose():
    """Σ over (a, e) of p[f(a, d), e] only reorders a sum; the votes of the views do not."""
    n, m = 8, 3
    rng = np.random.default_rng(0)
    p = rng.random((n, m))  # p[a − 1, e]: the likelihood at the observed bins, a from 1 to N

    def f(a, d):
        return a + d if a + d <= n else a + d - n

    literal = [sum(p[f(a, d) - 1, e] for a in range(1, n + 1) for e in range(m)) for d in range(n)]
    np.testing.assert_allclose(literal, p.sum(), rtol=1e-12)

    # an object turned by −3 bins, seen from four sides by a detector that is sure of each
    azimuths = frozen([0, 2, 4, 6])
    scores = np.zeros((4, 1, 1, n))
    scores[np.arange(4), 0, 0, (azimuths + 3) % n] = 0.9
    votes = pose_votes(scores[:, :, 0], azimuths).sum(axis=0)[0]
    np.testing.assert_allclose(votes, [0, 0, 0, 3.6, 0, 0, 0, 0])
    fused = fuse(sightings_of([0, 1, 2, 3], [0] * 4, azimuths, [0] * 4, scores), "imod", "offline")
    assert fused.pose_bin.tolist() == [[3]] * 4
    np.testing.assert_allclose(fused.score, 3.6)


def test_views_that_disagree_on_the_pose_do_not_add_up():
    scores = np.zeros((2, 1, 1, 8))
    scores[0, 0, 0, 1], scores[1, 0, 0, 5] = 0.9, 0.8  # d = 1 from azimuth 0, d = 3 from azimuth 2
    fused = fuse(sightings_of([0, 1], [0, 0], [0, 2], [0, 0], scores), "imod", "offline")
    np.testing.assert_allclose(fused.score, 0.9)
    assert fused.pose_bin.tolist() == [[1], [1]]
    assert fused.n_cells.tolist() == [[2], [2]]


def test_elevation_comes_from_geometry():
    scores = np.zeros((1, 1, 3, 4))
    scores[0, 0, 2, 1], scores[0, 0, 1, 3] = 0.9, 0.3
    seen = sightings_of([0], [0], [0], [1], scores)
    fused = fuse(seen, "imod", "online")
    np.testing.assert_allclose(fused.score, 0.3)
    assert fused.pose_bin.tolist() == [[3]]


def test_pose_votes():
    rng = np.random.default_rng(5)
    scores, azimuths = frozen(rng.random((6, 2, 8))), frozen(rng.integers(0, 8, 6))
    votes = pose_votes(scores, azimuths)
    assert votes.shape == (6, 2, 8)
    for v, k, d in np.ndindex(votes.shape):
        assert votes[v, k, d] == scores[v, k, (azimuths[v] + d) % 8]


@given(SEEDS, st.sampled_from(["3x16", "3x8", "1x5"]), st.integers(-20, 20))
@settings(max_examples=40)
def test_turning_the_scene_keeps_scores_and_turns_the_yaw(seed, grid, turn):
    n = GRIDS[grid][0][1]
    still = random_sightings(np.random.default_rng(seed), grid, n_boxes=20)
    turned = replace(still, azimuth_bin=frozen((still.azimuth_bin + turn) % n))
    for mode in MODES:
        before, after = fuse(still, "imod", mode), fuse(turned, "imod", mode)
        np.testing.assert_allclose(after.score, before.score, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(after.n_cells, before.n_cells)
        yaw_before = yaw_from_pose_bin(before.pose_bin, n)
        yaw_after = yaw_from_pose_bin(after.pose_bin, n)
        rest = (yaw_after - yaw_before - turn * 2 * np.pi / n) / (2 * np.pi)
        np.testing.assert_allclose(rest, np.round(rest), atol=1e-9)


@given(SEEDS, st.sampled_from(METHODS), st.sampled_from(MODES), st.sampled_from(REDUCES))
@settings(max_examples=60)
def test_the_order_of_the_input_is_irrelevant(seed, method, mode, cell_reduce):
    rng = np.random.default_rng(seed)
    sightings = random_sightings(rng, "3x8", n_boxes=25, n_frames=4)
    shuffle = rng.permutation(25)
    direct = fuse(sightings, method, mode, cell_reduce)
    shuffled = fuse(rows_of(sightings, shuffle), method, mode, cell_reduce)
    np.testing.assert_array_equal(shuffled.score, direct.score[shuffle])
    np.testing.assert_array_equal(shuffled.pose_bin, direct.pose_bin[shuffle])
    np.testing.assert_array_equal(shuffled.n_cells, direct.n_cells[shuffle])


@given(SEEDS, st.sampled_from(["mean", "max"]))
@settings(max_examples=30)
def test_offline_the_order_of_frames_is_irrelevant(seed, cell_reduce):
    rng = np.random.default_rng(seed)
    sightings = random_sightings(rng, "3x8", n_boxes=25)
    reordered = replace(sightings, frame=frozen(-sightings.frame))
    assert_same(
        fuse(reordered, "imod", "offline", cell_reduce),
        fuse(sightings, "imod", "offline", cell_reduce),
    )


def test_last_keeps_the_latest_visit():
    scores = np.zeros((2, 1, 1, 4))
    scores[:, 0, 0, 0] = 0.9, 0.2
    seen = sightings_of([0, 1], [0, 0], [0, 0], [0, 0], scores)
    np.testing.assert_allclose(fuse(seen, "imod", "online", "last").score[:, 0], [0.9, 0.2])
    np.testing.assert_allclose(fuse(seen, "imod", "online", "max").score[:, 0], [0.9, 0.9])
    np.testing.assert_allclose(fuse(seen, "imod", "online", "mean").score[:, 0], [0.9, 0.55])
    # element by element: the two visits may be best at different poses
    scores[1, 0, 0] = [0.2, 0.7, 0, 0]
    seen = sightings_of([0, 1], [0, 0], [0, 0], [0, 0], scores)
    np.testing.assert_allclose(fuse(seen, "imod", "online", "mean").score[:, 0], [0.9, 0.55])
    np.testing.assert_allclose(fuse(seen, "imod", "online", "last").score[:, 0], [0.9, 0.7])


@given(SEEDS, st.sampled_from(tuple(GRIDS)), st.sampled_from(REDUCES), st.integers(2, 5))
@settings(max_examples=60)
def test_standing_still_does_not_raise_the_score(seed, grid, cell_reduce, n_repeats):
    rng = np.random.default_rng(seed)
    once = random_sightings(rng, grid, n_boxes=12, n_frames=4)
    # every frame shown again and again, all its boxes in the same cells
    again = joined(*(replace(once, frame=frozen(10 * once.frame + r)) for r in range(n_repeats)))
    fused = fuse(again, "imod", "offline", cell_reduce)
    expected = fuse(once, "imod", "offline", cell_reduce)
    np.testing.assert_allclose(
        fused.score, np.tile(expected.score, (n_repeats, 1)), rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(fused.n_cells, np.tile(expected.n_cells, (n_repeats, 1)))

    # one box in one cell, as the frames come in: the score stays where it was; naive grows
    alone = rows_of(once, [0])
    stays = joined(*(replace(alone, frame=frozen([r])) for r in range(n_repeats)))
    first = fuse(alone, "imod", "online", cell_reduce).score
    online = fuse(stays, "imod", "online", cell_reduce).score
    np.testing.assert_allclose(online, np.tile(first, (n_repeats, 1)), rtol=0, atol=1e-12)
    grown = fuse(stays, "naive", "online").score
    np.testing.assert_allclose(
        grown, marginal(alone.view_scores) * np.arange(1, n_repeats + 1)[:, None]
    )


@given(SEEDS, st.sampled_from(tuple(GRIDS)), st.sampled_from(MODES), st.sampled_from(REDUCES))
@settings(max_examples=60)
def test_scores_lie_between_zero_and_the_number_of_cells(seed, grid, mode, cell_reduce):
    sightings = random_sightings(np.random.default_rng(seed), grid, n_boxes=30)
    fused = fuse(sightings, "imod", mode, cell_reduce)
    assert (fused.score >= -1e-12).all()
    assert (fused.score <= fused.n_cells + 1e-12).all()
    assert (fused.n_cells >= 1).all()
    places = np.stack([sightings.voxel, sightings.azimuth_bin, sightings.elevation_bin], axis=1)
    cells = np.unique(places, axis=0)
    for v in np.unique(sightings.voxel):
        assert fused.n_cells[sightings.voxel == v].max() <= (cells[:, 0] == v).sum()


def test_a_detector_that_is_always_right_reaches_the_number_of_cells():
    scores = np.zeros((12, 1, 3, 4))
    azimuth, elevation = np.tile(np.arange(4), 3), np.repeat(np.arange(3), 4)
    scores[np.arange(12), 0, elevation, (azimuth + 1) % 4] = 1.0
    seen = sightings_of(range(12), [0] * 12, azimuth, elevation, scores)
    fused = fuse(seen, "imod", "online")
    np.testing.assert_allclose(fused.score[:, 0], np.arange(1, 13))
    np.testing.assert_array_equal(fused.n_cells[:, 0], np.arange(1, 13))
    assert (fused.pose_bin == 1).all()


@given(SEEDS, st.sampled_from(METHODS), st.sampled_from(tuple(GRIDS)), st.sampled_from(REDUCES))
@settings(max_examples=60)
def test_online_at_the_last_frame_of_a_voxel_is_offline(seed, method, grid, cell_reduce):
    sightings = random_sightings(np.random.default_rng(seed), grid, n_boxes=25)
    online = fuse(sightings, method, "online", cell_reduce)
    offline = fuse(sightings, method, "offline", cell_reduce)
    for v in np.unique(sightings.voxel):
        rows = np.flatnonzero(sightings.voxel == v)
        last = rows[sightings.frame[rows] == sightings.frame[rows].max()]
        np.testing.assert_array_equal(online.score[last], offline.score[last])
        np.testing.assert_array_equal(online.pose_bin[last], offline.pose_bin[last])
        np.testing.assert_array_equal(online.n_cells[last], offline.n_cells[last])
        if method != "single":
            assert (offline.score[rows] == offline.score[rows[0]]).all()


@given(SEEDS, st.sampled_from(METHODS), st.sampled_from(tuple(GRIDS)), st.sampled_from(REDUCES))
@settings(max_examples=60)
def test_online_never_looks_ahead(seed, method, grid, cell_reduce):
    sightings = random_sightings(np.random.default_rng(seed), grid, n_boxes=25)
    past = np.flatnonzero(sightings.frame <= 15)
    whole = fuse(sightings, method, "online", cell_reduce)
    cut = fuse(rows_of(sightings, past), method, "online", cell_reduce)
    np.testing.assert_array_equal(cut.score, whole.score[past])
    np.testing.assert_array_equal(cut.n_cells, whole.n_cells[past])


@given(SEEDS, st.sampled_from(METHODS), st.sampled_from(MODES), st.sampled_from(REDUCES))
@settings(max_examples=60)
def test_voxels_do_not_influence_each_other(seed, method, mode, cell_reduce):
    sightings = random_sightings(np.random.default_rng(seed), "3x8", n_boxes=25)
    both = fuse(sightings, method, mode, cell_reduce)
    for v in np.unique(sightings.voxel):
        rows = np.flatnonzero(sightings.voxel == v)
        alone = fuse(rows_of(sightings, rows), method, mode, cell_reduce)
        np.testing.assert_array_equal(alone.score, both.score[rows])
        np.testing.assert_array_equal(alone.pose_bin, both.pose_bin[rows])
        np.testing.assert_array_equal(alone.n_cells, both.n_cells[rows])


def test_of_two_boxes_of_one_frame_the_better_enters_per_class():
    scores = np.zeros((2, 2, 1, 2))
    scores[0, :, 0, 0] = 0.6, 0.1
    scores[1, :, 0, 0] = 0.2, 0.5
    seen = sightings_of([0, 0], [0, 0], [0, 0], [0, 0], scores)
    for method in ("imod", "naive"):
        np.testing.assert_allclose(fuse(seen, method, "online").score, [[0.6, 0.5]] * 2)
    # in other cells too: a moment gives one box, and its cell alone is filled
    apart = replace(seen, azimuth_bin=frozen([0, 1]))
    fused = fuse(apart, "imod", "online")
    np.testing.assert_allclose(fused.score, [[0.6, 0.5]] * 2)
    assert fused.pose_bin.tolist() == [[0, 1]] * 2
    assert fused.n_cells.tolist() == [[1, 1]] * 2


@pytest.mark.parametrize("mode", MODES)
def test_single_is_the_marginal(mode):
    sightings = random_sightings(np.random.default_rng(8), "3x16")
    fused = fuse(sightings, "single", mode)
    plain = [[float(np.sum(p, dtype=np.float64)) for p in box] for box in sightings.view_scores]
    np.testing.assert_allclose(fused.score, plain, rtol=1e-12)
    assert (fused.pose_bin == -1).all()
    assert (fused.n_cells == 1).all()


def test_a_score_of_exactly_zero_is_no_evidence():
    np.testing.assert_array_equal(log_odds(frozen([0.0, 0.5]), 1e-3), [0.0, 0.0])
    np.testing.assert_allclose(
        log_odds(frozen([1e-9, 1e-3, 0.2, 1.0]), 1e-3),
        [-math.log(999), -math.log(999), -math.log(4), math.log(999)],
    )
    scores = np.array([0.8, 0.0, 0.7, 1e-9]).reshape(4, 1, 1, 1)
    seen = sightings_of(range(4), [0] * 4, [0] * 4, [0] * 4, scores)
    fused = fuse(seen, "naive_log", "online", probability_floor=1e-3).score[:, 0]
    expected = np.cumsum([math.log(4), 0.0, math.log(7 / 3), -math.log(999)])
    np.testing.assert_allclose(fused, expected)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("mode", MODES)
def test_no_boxes(method, mode):
    for grid in ((3, 8), (1, 1)):
        nothing = sightings_of([], [], [], [], np.zeros((0, 4, *grid), dtype=np.float32))
        fused = fuse(nothing, method, mode)
        assert fused.score.shape == fused.pose_bin.shape == fused.n_cells.shape == (0, 4)


def test_one_box_per_voxel_frame_and_class_stands_for_the_place():
    scores = np.zeros((6, 2, 1, 1))
    scores[:, 0, 0, 0] = [0.5, 0.9, 0.9, 0.4, 0.8, 0.3]
    scores[:, 1, 0, 0] = [0.5, 0.1, 0.1, 0.6, 0.2, 0.3]
    sightings = Sightings(
        frame=np.array([0, 0, 0, 0, 1, 1]),
        voxel=np.array([7, 7, 7, 3, 7, 7]),
        azimuth_bin=np.zeros(6, dtype=int),
        elevation_bin=np.zeros(6, dtype=int),
        view_scores=scores,
    )
    candidates = np.ones((6, 2), dtype=bool)
    candidates[4, 0] = candidates[5, 1] = candidates[3, 1] = False
    stands = best_of_moment(sightings, candidates)
    # Class 0: 1 ties with 2 and comes first; 3 is alone in its voxel; 4 is no candidate, so 5 is.
    assert stands[:, 0].tolist() == [False, True, False, True, False, True]
    assert stands[:, 1].tolist() == [True, False, False, False, True, False]


@pytest.mark.parametrize("method", ["naive", "naive_log", "imod"])
def test_nothing_scores_lower_than_what_was_never_seen(method):
    rng = np.random.default_rng(3)
    sightings = Sightings(
        frame=np.arange(40),
        voxel=np.zeros(40, dtype=int),
        azimuth_bin=np.arange(40) % 4,
        elevation_bin=np.zeros(40, dtype=int),
        view_scores=rng.random((40, 2, 1, 4)) * 1e-6,  # as sure as can be that nothing is there
    )
    fused = fuse(sightings, method, "online")
    assert (absent_score(method, fused.n_cells, 1e-4) <= fused.score).all()
