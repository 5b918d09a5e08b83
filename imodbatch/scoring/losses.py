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
    iou = evidence.overlaps.annotation_iou[(truth.class_id == k) & ~truth.is_ignored]
    return {
        "no_box": _share(iou < LOOSE_IOU),
        "loose_box": _share((iou >= LOOSE_IOU) & (iou < evidence.iou_percent / 100)),
    }


def _place_losses(evidence: Evidence, poses: pa.Table, k: int) -> dict[str, tuple[float, int]]:
    """How the sightings of each instance of a class scatter; needs instance ids and places."""
    boxes, instance = _sightings(evidence, k)
    has_place = evidence.voxel_of_box[boxes] >= 0
    boxes, instance = boxes[has_place], instance[has_place]
    voxel = evidence.voxel_of_box[boxes]
    cameras = camera_centers(evidence.frames, poses)[evidence.image[boxes]]
    found = spread(instance, voxel, places_of(evidence.observations)[boxes], cameras)
    box, class_id = evidence.survivors
    stray = box[(class_id == k) & (evidence.overlaps.candidate_iou < LOOSE_IOU)]
    stray_voxel = evidence.voxel_of_box[stray]
    return {
        "unplaced": _share(~has_place),
        "split_pairs": (found.split_pairs, found.n_pairs),
        "voxels_per_instance": (found.voxels_per_instance, found.n_instances),
        "place_spread_m": (found.place_spread_m, found.n_sightings),
        "behind_share": (found.behind_share, found.n_sightings),
        "false_in_true_voxel": _share(np.isin(stray_voxel[stray_voxel >= 0], voxel)),
    }


def _sightings(evidence: Evidence, k: int) -> tuple[Ints, Ints]:
    """Boxes of class k that overlap an instance enough, and the number of the instance."""
    found = evidence.overlaps
    box, class_id = evidence.survivors
    rows = np.flatnonzero((class_id == k) & (found.candidate_iou >= evidence.iou_percent / 100))
    instance = evidence.instance[found.candidate_annotation[rows]]
    return box[rows][instance >= 0], instance[instance >= 0]


def _ceilings(evidence: Evidence) -> list[dict[str, Any]]:
    """AP of imod with looser boxes, one voxel per instance, a perfect ranking."""
    if not len(evidence.truth.image):
        return []
    iou_percent = evidence.iou_percent
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
    voxel = evidence.voxel_of_box.copy()
    first_new = voxel.max(initial=-1) + 1
    for k in range(evidence.n_classes):
        boxes, instance = _sightings(evidence, k)
        voxel[boxes] = first_new + instance
    return voxel[evidence.placed]
