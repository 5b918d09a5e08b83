"""COCO's average precision, computed by faster-coco-eval from boxes held in memory.

The library is a C++ port of the COCO API and gives its numbers, including the 101 recall points
that it compares as floats. Three of its habits are bridged here. It overwrites an annotation's
``ignore`` with ``iscrowd``, so an annotation that is ignored without being a crowd is given an area
outside the evaluated range, which has the effect meant. It takes an annotation or detection number
0 for "unmatched", so numbers start at 1. It counts at most 100 detections per image unless told.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from imodbatch.core.scoring import Candidates, Truth

AnyArray = npt.NDArray[Any]

_COUNTED_AREA, _IGNORED_AREA = 1.0, -1.0
_AREA_RANGE = [0.0, float("inf")]


def coco_ap(
    candidates: Candidates, scores: AnyArray, truth: Truth, n_classes: int
) -> npt.NDArray[np.float64]:
    """AP@[.5:.95] of each class (COCO API, ``cocoeval.py``), all areas, no limit on detections.

    ``maxDets`` is set to the largest number of detections that an image has of the class: COCO's
    limit of 100 per image and class would silently drop the rest. Where no image has more than 100,
    the numbers are COCO's own. Equal scores are ordered by image id, then by position.

    Args:
        candidates: D detections; their boxes are in continuous pixels.
        scores: (D,) any real values; only their order matters.
        truth: A annotations; an ignored one absorbs one detection, a crowd any number.
        n_classes: Number K of classes.

    Returns:
        (K,) average precision in [0, 1]; 0 for a class with annotations and no detections, NaN for
        a class without annotations that count.

    Raises:
        ValueError: If parallel arrays differ in length or a class id is not in 0..K-1.
    """
    _check("detections", candidates.class_id, {**vars(candidates), "scores": scores}, n_classes)
    _check("annotations", truth.class_id, vars(truth), n_classes)
    values = np.full(n_classes, np.nan)
    for class_id in np.flatnonzero(truth.counted(n_classes)).tolist():
        values[class_id] = _class_ap(*_records(candidates, scores, truth, class_id))
    return values


def _class_ap(
    detection_records: list[dict[str, Any]], annotation_records: list[dict[str, Any]]
) -> float:
    """AP@[.5:.95] of one class that has annotations."""
    from faster_coco_eval import COCOeval_faster

    evaluator = COCOeval_faster(
        _dataset(annotation_records, detection_records),
        _dataset(detection_records, annotation_records),
        iouType="bbox",
        print_function=_silent,
    )
    n_detections_per_image = np.unique(
        [record["image_id"] for record in detection_records], return_counts=True
    )[1]
    evaluator.params.maxDets = [int(n_detections_per_image.max(initial=1))]
    evaluator.params.areaRng = [_AREA_RANGE]
    evaluator.params.areaRngLbl = ["all"]
    evaluator.evaluate()
    evaluator.accumulate()
    return float(evaluator.eval["precision"].mean())  # (IoU, recall, class, area, maxDets)


def _dataset(records: list[dict[str, Any]], others: list[dict[str, Any]]) -> Any:
    """The library's data set of `records`, over the images of both lists."""
    from faster_coco_eval import COCO

    image_ids = sorted({record["image_id"] for record in records + others})
    content = {
        "images": [{"id": image_id} for image_id in image_ids],
        "annotations": records,
        "categories": [{"id": 1, "name": "object"}],
    }
    return COCO(content, print_function=_silent)


def _records(
    candidates: Candidates, scores: AnyArray, truth: Truth, class_id: int
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The detections and annotations of one class as the library wants them."""
    found, wanted = (np.flatnonzero(rows.class_id == class_id) for rows in (candidates, truth))
    area = np.where(truth.is_ignored[wanted], _IGNORED_AREA, _COUNTED_AREA)
    is_crowd = truth.is_crowd[wanted].astype(np.int64)
    all_count = np.full(len(found), _COUNTED_AREA)
    return (
        _rows_as_records(candidates, found, score=scores[found], area=all_count),
        _rows_as_records(truth, wanted, iscrowd=is_crowd, area=area),
    )


def _rows_as_records(
    of: Candidates | Truth, rows: AnyArray, **columns: AnyArray
) -> list[dict[str, Any]]:
    """Boxes as x y width height, with further columns."""
    corners = np.asarray(of.boxes, dtype=np.float64).reshape(-1, 4)[rows]
    extents = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    columns |= {"image_id": of.image[rows], "bbox": extents}
    values = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [
        {"id": number, "category_id": 1, **dict(zip(columns, row, strict=True))}
        for number, row in enumerate(values, start=1)
    ]


def _check(name: str, class_id: AnyArray, arrays: dict[str, AnyArray], n_classes: int) -> None:
    """Raise a ValueError unless the arrays are parallel and the class ids known."""
    lengths = {field: len(values) for field, values in arrays.items()}
    if len(set(lengths.values())) != 1:
        raise ValueError(f"{name}: expected arrays of one length, found {lengths}")
    if np.any((class_id < 0) | (class_id >= n_classes)):
        raise ValueError(
            f"{name}: expected class ids in 0..{n_classes - 1}, "
            f"found {class_id.min()}..{class_id.max()}"
        )


def _silent(*_: object) -> None:
    """Take the place of the library's printing."""
