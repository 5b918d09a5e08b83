"""Targets and losses of the training: closed forms, and that ignored boxes take no part."""

import math

import numpy as np
import pytest
import torch

from imodbatch.core.symmetry import Symmetry
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.detection.heads import FactorisedHead, FlatHead
from imodbatch.lab.learning.samples import Sample
from imodbatch.lab.learning.targets import (
    BACKGROUND,
    OBJECT,
    TAKES_NO_PART,
    ImageTargets,
    ViewTargets,
    covered_share,
    draw_rois,
    image_targets,
    label_candidates,
    without_ignored,
)
from imodbatch.lab.learning.terms import box_loss, score_losses

GRID = ViewGrid(8, (math.radians(10), math.radians(50)))
STEP = math.pi / 4


def seen_from(azimuth: float, elevation_deg: float = 12.0, class_id: int = 0) -> Sample:
    return Sample(
        image=np.zeros((4, 4, 3), dtype=np.uint8),
        boxes=np.array([[0, 0, 2, 2]], dtype=np.float32),
        class_ids=np.array([class_id]),
        azimuth_rad=np.array([azimuth], dtype=np.float32),
        elevation_rad=np.array([math.radians(elevation_deg)], dtype=np.float32),
        is_ignored=np.array([False]),
    )


def views(targets: ViewTargets, sample: Sample) -> np.ndarray:
    return targets(sample)[0].reshape(GRID.n_elevations, GRID.n_azimuths).numpy()


@pytest.mark.parametrize(("azimuth", "bin_"), [(0.0, 0), (3.4 * STEP, 3), (7.6 * STEP, 0)])
def test_unsmoothed_targets_are_one_cell(azimuth: float, bin_: int) -> None:
    found = views(ViewTargets(GRID), seen_from(azimuth, 45.0))
    expected = np.zeros((2, 8))
    expected[1, bin_] = 1
    np.testing.assert_array_equal(found, expected)


def test_smoothed_targets_are_von_mises() -> None:
    sigma = 0.5
    found = views(ViewTargets(GRID, sigma), seen_from(2.5 * STEP))[0]
    expected = np.exp(np.cos(2.5 * STEP - np.arange(8) * STEP) / sigma**2)
    np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-5)
    assert found[2] == pytest.approx(found[3])  # halfway between the two


def test_tiny_sigma_is_the_nearest_cell_without_overflow() -> None:
    found = views(ViewTargets(GRID, 1e-3, 1e-3), seen_from(2.4 * STEP, 45.0))
    assert found[1, 2] == pytest.approx(1)


def test_elevation_is_smoothed_as_a_gaussian() -> None:
    sigma = math.radians(20)
    found = views(ViewTargets(GRID, 0.0, sigma), seen_from(0.0, 20.0))[:, 0]
    expected = np.exp([-((10 / 20) ** 2) / 2, -((30 / 20) ** 2) / 2])
    np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-5)


@pytest.mark.parametrize(
    ("symmetry", "expected"),
    [
        ("none", [0, 1, 0, 0, 0, 0, 0, 0]),
        (2, [0, 0.5, 0, 0, 0, 0.5, 0, 0]),
        (4, [0, 0.25] * 4),
        ("full", [0.125] * 8),
    ],
)
def test_symmetric_classes_share_the_weight(symmetry: Symmetry, expected: list[float]) -> None:
    targets = ViewTargets(GRID, symmetries=("none", symmetry))
    np.testing.assert_allclose(views(targets, seen_from(STEP, class_id=1))[0], expected, atol=1e-6)


def test_unknown_viewpoint_has_no_target_unless_symmetry_makes_it_irrelevant() -> None:
    targets = ViewTargets(GRID, 0.3, 0.3, symmetries=("none", "full"))
    assert views(targets, seen_from(math.nan)).sum() == 0
    assert views(targets, seen_from(math.nan, class_id=1)).sum() == pytest.approx(1)
    assert views(targets, seen_from(0.0, math.nan, class_id=1)).sum() == 0


def test_detector_without_viewpoints_has_one_cell_even_if_unknown() -> None:
    targets = ViewTargets(ViewGrid(1, (0.0,)))
    np.testing.assert_array_equal(targets(seen_from(math.nan)), [[1.0]])


# Losses


@pytest.mark.parametrize("head_type", ["flat", "factorised"])
def test_parts_add_up_to_the_cross_entropy_over_all_cells(head_type: str) -> None:
    torch.manual_seed(2)
    n_classes, cells, n = 3, 8, 20
    head = (
        FlatHead(5, n_classes * cells)
        if head_type == "flat"
        else FactorisedHead(5, n_classes, cells)
    )
    for parameter in head.parameters():
        torch.nn.init.normal_(parameter)
    logits = head(torch.randn(n, 5))
    flat = torch.randint(0, n_classes * cells + 1, (n,))
    flat[:3] = n_classes * cells  # background
    class_ids = torch.div(flat, cells, rounding_mode="floor")
    one_hot = torch.nn.functional.one_hot(flat % cells, cells).float()
    one_hot[class_ids == n_classes] = 0
    parts = score_losses(logits, class_ids, one_hot)
    wanted = torch.nn.functional.cross_entropy(logits, flat)
    assert parts.view_loss > 0.1
    assert parts.class_loss > 0.1
    torch.testing.assert_close(parts.class_loss + parts.view_loss, wanted)


def test_uniform_scores_have_known_losses() -> None:
    class_ids, seen = torch.tensor([0, 2]), torch.tensor([[0.25] * 4, [0.0] * 4])
    parts = score_losses(torch.zeros(2, 2 * 4 + 1), class_ids, seen)
    assert parts.view_loss.item() == pytest.approx(math.log(4) / 2)
    assert parts.class_loss.item() == pytest.approx((math.log(9 / 4) + math.log(9)) / 2)


def test_unknown_view_trains_the_class_only() -> None:
    logits = torch.zeros(1, 9, requires_grad=True)
    parts = score_losses(logits, torch.tensor([1]), torch.zeros(1, 4))
    assert parts.view_loss == 0
    (gradient,) = torch.autograd.grad(parts.class_loss, logits)
    assert gradient[0, 4:8].std() == pytest.approx(0, abs=1e-7)  # no cell of the class preferred
    assert gradient[0, 4] < 0 < gradient[0, 0]


def test_box_loss_counts_objects_only() -> None:
    deltas, wanted = torch.tensor([[1.0, 0, 0, 0], [9.0, 9, 9, 9]]), torch.zeros(2, 4)
    found = box_loss(deltas, wanted, torch.tensor([True, False]))
    assert found.item() == pytest.approx((1 - 1 / 18) / 2)


def test_losses_without_rois_are_zero() -> None:
    parts = score_losses(torch.zeros(0, 9), torch.zeros(0, dtype=torch.int64), torch.zeros(0, 4))
    assert parts.class_loss == parts.view_loss == 0


# RoIs


def truth(ignored: list[list[float]] | None = None) -> ImageTargets:
    return ImageTargets(
        boxes=torch.tensor([[0.0, 0, 40, 40], [100, 0, 140, 40]]),
        class_ids=torch.tensor([2, 1]),
        views=torch.eye(4)[[3, 1]],
        ignored_boxes=torch.tensor(ignored or []).reshape(-1, 4),
    )


def test_candidates_are_labelled_by_overlap() -> None:
    candidates = torch.tensor(
        [[0.0, 0, 40, 38], [101, 0, 140, 40], [0, 0, 40, 15], [60, 60, 90, 90]]
    )
    labels, matched = label_candidates(candidates, truth())
    assert labels.tolist() == [OBJECT, OBJECT, BACKGROUND, BACKGROUND]
    assert matched[:2].tolist() == [0, 1]


def test_ignored_boxes_are_neither_object_nor_background() -> None:
    region = [50.0, 50, 100, 100]
    candidates = torch.tensor(
        [
            [50.0, 50, 100, 100],  # the region itself
            [60, 60, 70, 70],  # inside it
            [60, 60, 70, 130],  # by more than half inside
            [60, 90, 70, 200],  # mostly outside
            [0, 0, 40, 40],  # an object elsewhere
        ]
    )
    labels, _ = label_candidates(candidates, truth([region]))
    none = TAKES_NO_PART
    assert labels.tolist() == [none, none, none, BACKGROUND, OBJECT]
    assert label_candidates(candidates, truth())[0].tolist() == [0, 0, 0, 0, 1]


def test_object_stays_object_on_an_ignored_box() -> None:
    labels = torch.tensor([1.0, 0.0, -1.0])
    boxes = torch.tensor([[0.0, 0, 10, 10]] * 3)
    assert without_ignored(labels, boxes, boxes[:1]).tolist() == [1, -1, -1]


def test_covered_share() -> None:
    boxes, regions = (
        torch.tensor([[0.0, 0, 10, 10]]),
        torch.tensor([[5.0, 5, 99, 99], [20, 0, 30, 9]]),
    )
    torch.testing.assert_close(covered_share(boxes, regions), torch.tensor([[0.25, 0.0]]))


def test_drawn_rois_carry_their_object_and_skip_ignored_regions() -> None:
    torch.manual_seed(0)
    corners = torch.rand(400, 2) * 300
    proposals = torch.cat([corners, corners + 30], dim=1)
    region = [150.0, 150, 250, 250]
    targets = truth([region])
    drawn = draw_rois(proposals, targets, n_classes=5, n_rois=64, object_fraction=0.5)
    assert len(drawn.rois) == 64
    is_object = drawn.class_ids < 5
    assert set(drawn.class_ids[is_object].tolist()) == {1, 2}  # the true boxes are candidates too
    for roi, class_id, view, box in zip(
        *(part[is_object] for part in (drawn.rois, drawn.class_ids, drawn.views, drawn.boxes)),
        strict=True,
    ):
        row = targets.class_ids.tolist().index(int(class_id))
        torch.testing.assert_close(view, targets.views[row])
        torch.testing.assert_close(box, targets.boxes[row])
        assert roi[0] < box[2]
    assert drawn.views[~is_object].sum() == 0
    shares = covered_share(drawn.rois[~is_object], targets.ignored_boxes)
    assert shares.max() < 0.5
    assert covered_share(proposals, targets.ignored_boxes).max() > 0.9  # there was what to skip


def test_images_without_objects_give_background_only() -> None:
    empty = ImageTargets(
        torch.zeros(0, 4), torch.zeros(0, dtype=torch.int64), torch.zeros(0, 4), torch.zeros(0, 4)
    )
    drawn = draw_rois(torch.tensor([[0.0, 0, 9, 9]]), empty, 5, 8, 0.5)
    assert drawn.class_ids.tolist() == [5]


def test_ignored_boxes_are_parted_from_those_that_count() -> None:
    sample = Sample(
        image=np.zeros((4, 4, 3), dtype=np.uint8),
        boxes=np.array([[0, 0, 2, 2], [1, 1, 3, 3]], dtype=np.float32),
        class_ids=np.array([0, 1]),
        azimuth_rad=np.zeros(2, dtype=np.float32),
        elevation_rad=np.zeros(2, dtype=np.float32),
        is_ignored=np.array([True, False]),
    )
    targets = image_targets(sample, ViewTargets(GRID))
    assert targets.class_ids.tolist() == [1]
    assert targets.boxes.tolist() == [[1, 1, 3, 3]]
    assert targets.ignored_boxes.tolist() == [[0, 0, 2, 2]]
    assert targets.views.shape == (1, 16)
