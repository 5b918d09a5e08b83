"""limits: how much the voxel size matters, and what holds fusion back; the second half of score.

Both fuse again in memory, from the places that `lift` found, and write what they see. Nothing here
feeds back into a result.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.config import Pipeline
from imodbatch.core.diagnosis import LOOSE_IOU, Overlaps, overlaps, spread
from imodbatch.core.precision import ap_voc07_11pt
from imodbatch.core.scoring import (
    Candidates,
    Truth,
    average_precisions,
    match_all,
    mean_over_classes,
)
from imodbatch.core.voxels import group_labels, voxel_indices
from imodbatch.schemas import LOSSES, SWEEPS
from imodbatch.stages.base import (
    Progress,
    StageResult,
    boxes_of,
    column,
    image_numbers,
    truth_of,
    world_from_cam_of,
)
from imodbatch.stages.evidence import (
    everywhere,
    fuse_variants,
    places_of,
    shaped_scores,
    sightings_of,
    stand_aside,
    survival,
    voxels_of,
)
from imodbatch.tables import empty, from_rows

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SWEEP_METRIC = "ap_voc07_11pt"
CEILING_METHODS = ("imod", "imod_offline")


@dataclass(frozen=True)
class Evidence:
    """All boxes of a run as arrays, to be fused again and again."""

    frames: pa.Table
    annotations: pa.Table
    detections: pa.Table
    observations: pa.Table
    n_classes: int
    pipeline: Pipeline

    @cached_property
    def scores(self) -> NDArray[np.float32]:
        """(n, K, M, N)."""
        return shaped_scores(self.detections, self.n_classes, self.pipeline.viewpoint)

    @cached_property
    def placed(self) -> Ints:
        """Rows of the boxes that have a place."""
        return np.flatnonzero(column(self.observations, "status") == "placed")

    @cached_property
    def image(self) -> Ints:
        """(n,) image number of every box; it rises with sequence and frame."""
        return image_numbers(self.frames, self.detections)

    @cached_property
    def sequence(self) -> Ints:
        """(n,) number of the sequence of every box."""
        names = column(self.detections, "sequence_id").astype(str)
        return np.unique(names, return_inverse=True)[1]

    @cached_property
    def truth(self) -> Truth:
        """The annotations."""
        return truth_of(self.annotations, image_numbers(self.frames, self.annotations))

    @cached_property
    def survives(self) -> NDArray[np.bool_]:
        """(n, K) for which classes each box is a candidate."""
        return survival(self.detections, self.n_classes)

    @cached_property
    def survivors(self) -> tuple[Ints, Ints]:
        """Box (D,) and class (D,) of every candidate."""
        box, class_id = np.nonzero(self.survives)
        return box, class_id

    @cached_property
    def candidates(self) -> Candidates:
        """A candidate per box and class for which it survived."""
        box, class_id = self.survivors
        return Candidates(self.image[box], class_id, boxes_of(self.detections)[box])

    @cached_property
    def overlaps(self) -> Overlaps:
        """Best overlaps of annotations and candidates."""
        return overlaps(self.candidates, self.truth)

    def voxel_numbers(self, voxel_size_m: float) -> Ints:
        """(V,) voxel number of the placed boxes, voxels of different sequences apart."""
        voxels = voxel_indices(places_of(self.observations)[self.placed], voxel_size_m)
        return self._number(voxels)

    @cached_property
    def own_voxels(self) -> Ints:
        """(V,) voxel numbers as `lift` wrote them."""
        return self._number(voxels_of(self.observations.take(self.placed)))

    def _number(self, voxels: Ints) -> Ints:
        return group_labels(np.column_stack([self.sequence[self.placed], voxels]))

    def candidate_scores(self, voxel_numbers: Ints) -> dict[str, Array]:
        """Method → (D,) scores of the candidates when boxes meet in the voxels given."""
        seen = self.observations.take(self.placed)
        sightings = sightings_of(
            seen, self.scores[self.placed], voxel_numbers[:, None], self.image[self.placed]
        )
        box, class_id = self.survivors
        config = self.pipeline.fuse
        fused = fuse_variants(sightings, config)
        standing = stand_aside(fused, sightings, self.survives[self.placed], config)
        return {
            # rounded as the fused table stores them, so that ties are the same
            name: everywhere(result, self.placed, self.scores)
            .score[box, class_id]
            .astype(np.float32)
            .astype(np.float64)
            for name, result in standing.items()
        }

    def average_precisions(self, scores: Array, iou_percent: int) -> Array:
        """11-point AP per class (K,)."""
        rule = self.pipeline.score.matching
        found = match_all(self.candidates, scores, self.truth, iou_percent / 100, rule)
        counted = self.truth.counted(self.n_classes)
        return average_precisions(self.candidates, scores, found.outcome, counted, ap_voc07_11pt)


def sweep(evidence: Evidence, progress: Progress[float] = iter) -> StageResult:
    """Mean AP of every method at every voxel size asked."""
    rows: list[dict[str, Any]] = []
    iou_percent = evidence.pipeline.score.iou_percents[0]
    for size_m in progress(evidence.pipeline.score.voxel_sweep_m):
        numbers = evidence.voxel_numbers(size_m)
        for name, scores in evidence.candidate_scores(numbers).items():
            value = mean_over_classes(evidence.average_precisions(scores, iou_percent))
            rows.append(
                {
                    "method": name,
                    "voxel_mm": round(1000 * size_m),
                    "metric": SWEEP_METRIC,
                    "value": value if np.isfinite(value) else None,
                }
            )
    table = from_rows(SWEEPS, rows) if rows else empty(SWEEPS)
    sizes = len(evidence.pipeline.score.voxel_sweep_m)
    return StageResult({"sweeps": table}, f"{table.num_rows} APs at {sizes} voxel sizes")


def losses(evidence: Evidence, poses: pa.Table, classes: Sequence[str]) -> StageResult:
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
    table = from_rows(LOSSES, rows) if rows else empty(LOSSES)
    return StageResult({"losses": table}, f"{table.num_rows} figures on what holds fusion back")


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _share(flags: NDArray[np.bool_]) -> tuple[float, int]:
    return (float(flags.mean()) if len(flags) else float("nan")), len(flags)


def _box_losses(evidence: Evidence, k: int) -> dict[str, tuple[float, int]]:
    truth = evidence.truth
    counted = (truth.class_id == k) & ~truth.is_ignored
    iou = evidence.overlaps.annotation_iou[counted]
    right = evidence.pipeline.score.iou_percents[0] / 100
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
    cameras = _camera_centers(evidence, poses)[evidence.image[boxes]]
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
    right = evidence.pipeline.score.iou_percents[0] / 100
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


def _camera_centers(evidence: Evidence, poses: pa.Table) -> Array:
    """Camera centres by image number (F, 3), NaN where lost."""
    centers = np.full((evidence.frames.num_rows, 3), np.nan)
    for sequence_id in set(poses["sequence_id"].to_pylist()):
        of_sequence = poses.filter(pc.equal(poses["sequence_id"], sequence_id))
        known = world_from_cam_of(of_sequence)
        keys = pa.table(
            {"sequence_id": [sequence_id] * len(known), "frame_index": list(known)},
        )
        numbers = image_numbers(evidence.frames, keys)
        if known:
            centers[numbers] = np.stack([transform[:3, 3] for transform in known.values()])
    return centers


def _ceilings(evidence: Evidence) -> list[dict[str, Any]]:
    """AP of imod with looser boxes, one voxel per instance, a perfect ranking."""
    if not len(evidence.truth.image):
        return []
    iou_percent = evidence.pipeline.score.iou_percents[0]
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
