"""losses: what holds fusion back; a part of diagnose, which feeds back into no result."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.diagnosis import LOOSE_IOU, Overlaps, spread
from imodbatch.fusion.evidence import places_of
from imodbatch.scoring.rescoring import Evidence, camera_centers
from imodbatch.tables.columns import StageResult
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import LOSSES

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
CEILING_METHODS = ("imod", "imod_offline")


def run(evidence: Evidence, poses: pa.Table, classes: Sequence[str]) -> StageResult:
    """A figure for each cause of `core.diagnosis`, per class."""
    rows: list[dict[str, Any]] = []
    for k in range(len(classes)):
        rows += [
            {"class_id": k, "cause": cause, "value": _known(value), "n": n}
            for cause, (value, n) in {
                **_box_losses(evidence, k),
                **_place_losses(evidence, poses, k),
            }.items()
        ]
    rows += _ceilings(evidence)
    summary = f"{len(rows)} figures on what holds fusion back"
    return StageResult({"losses": from_rows(LOSSES, rows)}, summary)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _share(flags: NDArray[np.bool_]) -> tuple[float, int]:
    return (float(flags.mean()) if len(flags) else float("nan")), len(flags)


def _box_losses(evidence: Evidence, k: int) -> dict[str, tuple[float, int]]:
    truth = evidence.truth
    counted = (truth.class_id == k) & ~truth.is_ignored
    iou = evidence.overlaps.annotation_iou[counted]
    right = evidence.pipeline.matching.iou_percents[0] / 100
    return {
        "no_box": _share(iou < LOOSE_IOU),
        "loose_box": _share((iou >= LOOSE_IOU) & (iou < right)),
    }


def _place_losses(evidence: Evidence, poses: pa.Table, k: int) -> dict[str, tuple[float, int]]:
    """How the sightings of each instance of a class scatter; needs instance ids and places."""
    sighted = _sightings_of_instances(evidence, k)
    row_of_box = np.full(evidence.detections.num_rows, -1)
    row_of_box[evidence.placed] = np.arange(len(evidence.placed))
    boxes = np.array(sorted(sighted), dtype=np.int64)
    has_place = row_of_box[boxes] >= 0
    boxes = boxes[has_place]
    names = [sighted[int(box)] for box in boxes]
    instance = np.unique(names, return_inverse=True)[1] if names else np.zeros(0, dtype=np.int64)
    voxel = evidence.own_voxels[row_of_box[boxes]]
    cameras = camera_centers(evidence.frames, poses)[evidence.image[boxes]]
    found = spread(instance, voxel, places_of(evidence.observations)[boxes], cameras)
    return {
        "unplaced": _share(~has_place),
        "split_pairs": (found.split_pairs, found.n_pairs),
        "voxels_per_instance": (found.voxels_per_instance, found.n_instances),
        "place_spread_m": (found.place_spread_m, found.n_sightings),
        "behind_share": (found.behind_share, found.n_sightings),
        "false_in_true_voxel": _false_in_true_voxel(evidence, k, set(voxel.tolist()), row_of_box),
    }


def _sightings_of_instances(evidence: Evidence, k: int) -> dict[int, str]:
    """Box → instance, for the boxes of class k that overlap an annotation enough."""
    right = evidence.pipeline.matching.iou_percents[0] / 100
    found = evidence.overlaps
    box, class_id = evidence.survivors
    rows = np.flatnonzero((class_id == k) & (found.candidate_iou >= right))
    sequences = evidence.annotations["sequence_id"].to_pylist()
    instances = evidence.annotations["instance_id"].to_pylist()
    sighted = {}
    for row in rows:
        annotation = int(found.candidate_annotation[row])
        if instances[annotation] is not None:
            sighted[int(box[row])] = f"{sequences[annotation]}/{instances[annotation]}"
    return sighted


def _false_in_true_voxel(
    evidence: Evidence, k: int, true_voxels: set[int], row_of_box: Ints
) -> tuple[float, int]:
    found = evidence.overlaps
    box, class_id = evidence.survivors
    stray = box[(class_id == k) & (found.candidate_iou < LOOSE_IOU)]
    stray = stray[row_of_box[stray] >= 0]
    voxels = evidence.own_voxels[row_of_box[stray]]
    return _share(np.isin(voxels, sorted(true_voxels)))


def _ceilings(evidence: Evidence) -> list[dict[str, Any]]:
    """AP of imod with looser boxes, one voxel per instance, a perfect ranking."""
    if not len(evidence.truth.image):
        return []
    iou_percent = evidence.pipeline.matching.iou_percents[0]
    by_method = evidence.candidate_scores(evidence.own_voxels)
    chosen = next((name for name in CEILING_METHODS if name in by_method), None)
    if chosen is None:
        return []
    usual, oracle = by_method[chosen], evidence.candidate_scores(oracle_voxels(evidence))[chosen]
    perfect = best_boxes(evidence.overlaps, iou_percent / 100).astype(np.float64)
    counted = evidence.truth.counted(evidence.n_classes)
    rows = []
    for cause, values in (
        ("ap_as_is", evidence.average_precisions(usual, iou_percent)),
        ("ap_iou_30", evidence.average_precisions(usual, round(100 * LOOSE_IOU))),
        ("ap_oracle_voxels", evidence.average_precisions(oracle, iou_percent)),
        ("ap_perfect_ranking", evidence.average_precisions(perfect, iou_percent)),
    ):
        rows += [
            {"class_id": k, "cause": cause, "value": _known(value), "n": int(counted[k])}
            for k, value in enumerate(values)
        ]
    return rows


def best_boxes(found: Overlaps, iou: float) -> NDArray[np.bool_]:
    """(D,) the candidate that fits each annotation best, if well enough."""
    is_best = np.zeros(len(found.candidate_iou), dtype=np.bool_)
    order = np.argsort(-found.candidate_iou, kind="stable")
    order = order[found.candidate_iou[order] >= iou]
    is_best[order[np.unique(found.candidate_annotation[order], return_index=True)[1]]] = True
    return is_best


def oracle_voxels(evidence: Evidence) -> Ints:
    """(V,) voxel numbers in which every sighting of an instance shares one voxel, alone."""
    numbers = evidence.own_voxels.copy()
    row_of_box = {int(box): row for row, box in enumerate(evidence.placed)}
    first = int(numbers.max(initial=-1)) + 1
    number_of: dict[str, int] = {}
    for k in range(evidence.n_classes):
        for box, name in _sightings_of_instances(evidence, k).items():
            if box in row_of_box:
                number = number_of.setdefault(name, first + len(number_of))
                numbers[row_of_box[box]] = number
    return numbers
