"""Boxes: area, overlap, clipping and non-maximum suppression.

A box is x0 y0 x1 y1 in continuous pixels: the top-left corner of the image is (0, 0), so an area is
``(x1 - x0) * (y1 - y0)`` with no "+ 1" anywhere. A box with x1 <= x0 or y1 <= y0 is degenerate: it
has no area and overlaps nothing.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
AnyArray = npt.NDArray[Any]


def area(boxes: AnyArray) -> FloatArray:
    """Area of each box, 0 for a degenerate one.

    Args:
        boxes: (n, 4) x0 y0 x1 y1 in pixels.

    Returns:
        (n,) areas in square pixels.
    """
    checked = _as_boxes(boxes)
    sizes = np.maximum(checked[:, 2:] - checked[:, :2], 0.0)
    return sizes[:, 0] * sizes[:, 1]


def iou_matrix(a: AnyArray, b: AnyArray) -> FloatArray:
    """Intersection over union of every box of `a` with every box of `b`.

    Args:
        a: (A, 4) x0 y0 x1 y1 in pixels.
        b: (B, 4) likewise.

    Returns:
        (A, B) in [0, 1]; a degenerate box gives 0, never NaN.
    """
    intersections = _intersections(a, b)
    unions = area(a)[:, None] + area(b)[None, :] - intersections
    return _ratio(intersections, unions)


def coverage_matrix(a: AnyArray, b: AnyArray) -> FloatArray:
    """Share of every box of `a` that lies inside every box of `b`.

    It takes the place of IoU where `b` marks a crowd, a region that holds many objects: a detection
    of one of them fills little of the region (COCO API, ``maskApi.c: bbIou`` with ``iscrowd``).

    Args:
        a: (A, 4) x0 y0 x1 y1 in pixels.
        b: (B, 4) likewise.

    Returns:
        (A, B) intersection over the area of `a`, in [0, 1]; 0 where `a` is degenerate.
    """
    return _ratio(_intersections(a, b), area(a)[:, None])


def clip(boxes: AnyArray, width_px: float, height_px: float) -> FloatArray:
    """Cut boxes at the image's border; one that lies wholly outside becomes degenerate.

    Args:
        boxes: (n, 4) x0 y0 x1 y1 in pixels.
        width_px: Width of the image.
        height_px: Height of the image.

    Returns:
        (n, 4) new array with x in [0, width_px] and y in [0, height_px].
    """
    upper = np.array([width_px, height_px, width_px, height_px], dtype=np.float64)
    return np.minimum(np.maximum(_as_boxes(boxes), 0.0), upper)


def nms_per_category(
    boxes: AnyArray, category_scores: AnyArray, score_threshold: float, iou_threshold: float
) -> BoolArray:
    """Greedy non-maximum suppression in each category by itself, of boxes that all share.

    Boxes are visited by descending score, equal scores by ascending index. A box is kept unless its
    IoU with a box kept before it is greater than the threshold (strictly, as in torchvision).

    One RoI has one box and a score per category (class-agnostic box regression), so the overlaps
    are computed once. A RoI lives on if it survives in any category; pass marginal scores, summed
    over the viewpoints: suppression per viewpoint class would leave one box per viewpoint.

    Args:
        boxes: (R, 4) x0 y0 x1 y1 in pixels.
        category_scores: (R, K) marginal score of each RoI for each category.
        score_threshold: A RoI takes part in a category if its score there is at least this.
        iou_threshold: Largest IoU that two boxes kept for the same category may have.

    Returns:
        (R, K) True where the RoI survives for that category.

    Raises:
        ValueError: If `category_scores` is not (R, K).
    """
    scores = np.asarray(category_scores)
    if scores.ndim != 2 or len(scores) != len(boxes):
        raise ValueError(f"scores: expected ({len(boxes)}, K), found shape {scores.shape}")
    overlaps = iou_matrix(boxes, boxes) > iou_threshold
    rankings = np.argsort(-scores, axis=0, kind="stable")
    # Compared in the scores' own type: as float64 a float32 score of 0.01 falls below 0.01.
    takes_part = scores >= scores.dtype.type(score_threshold)
    survives = np.zeros(scores.shape, dtype=np.bool_)
    for category in np.flatnonzero(takes_part.any(axis=0)):
        ranking = rankings[:, category]
        ranking = ranking[takes_part[ranking, category]]
        survives[_survivors(ranking, overlaps), category] = True
    return survives


def _survivors(ranking: IndexArray, overlaps: BoolArray) -> IndexArray:
    """Indices in `ranking` that no survivor before them overlaps."""
    suppressed = np.zeros(len(overlaps), dtype=np.bool_)
    kept = []
    for index in ranking.tolist():
        if not suppressed[index]:
            kept.append(index)
            suppressed |= overlaps[index]
    return np.array(kept, dtype=np.int64)


def _intersections(a: AnyArray, b: AnyArray) -> FloatArray:
    """(A, B) areas that the boxes of `a` and `b` share."""
    first, second = _as_boxes(a)[:, None, :], _as_boxes(b)[None, :, :]
    starts = np.maximum(first[..., :2], second[..., :2])
    ends = np.minimum(first[..., 2:], second[..., 2:])
    sizes = np.maximum(ends - starts, 0.0)
    shared: FloatArray = sizes[..., 0] * sizes[..., 1]
    return shared


def _ratio(numerators: FloatArray, denominators: FloatArray) -> FloatArray:
    """Quotients, 0 where the denominator is not positive."""
    quotients = np.zeros(numerators.shape)
    np.divide(numerators, denominators, out=quotients, where=denominators > 0.0)
    return quotients


def _as_boxes(boxes: AnyArray) -> FloatArray:
    """Boxes as float64, checked to be (n, 4)."""
    checked = np.asarray(boxes, dtype=np.float64)
    if checked.ndim != 2 or checked.shape[1] != 4:
        raise ValueError(f"boxes: expected shape (n, 4), found {checked.shape}")
    return checked
