"""All boxes of a run, to be fused and scored again in memory: what the parts of diagnose share."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.core.diagnosis import Overlaps, overlaps
from imodbatch.core.fusion import Sightings
from imodbatch.core.precision import ap_voc07_11pt
from imodbatch.core.scoring import (
    Candidates,
    ScoredBoxes,
    Truth,
    average_precisions,
    match_all,
    mean_over_classes,
)
from imodbatch.core.trajectory import LOST
from imodbatch.core.voxels import group_labels, voxel_indices
from imodbatch.fusion.evidence import (
    everywhere,
    fuse_methods,
    places_of,
    shaped_scores,
    survival,
    taken,
    voxels_of,
)
from imodbatch.settings.config import Pipeline
from imodbatch.tables.columns import boxes_of, column, image_numbers, stacked, truth_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
METRIC = "ap_voc07_11pt"


@dataclass(frozen=True)
class Meeting:
    """Which boxes have a place and what they share it with.

    Attributes:
        rows: (V,) the boxes, as rows of the detections.
        voxel: (V,) voxel numbers, those of different sequences apart.
        azimuth_bin: (V,).
        elevation_bin: (V,).
    """

    rows: Ints
    voxel: Ints
    azimuth_bin: Ints
    elevation_bin: Ints


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

    @cached_property
    def own_meeting(self) -> Meeting:
        """Where the boxes met in the run itself, as `lift` wrote it."""
        seen = self.observations.take(self.placed)
        return Meeting(
            self.placed,
            self.number_voxels(self.placed, voxels_of(seen)),
            column(seen, "azimuth_bin").astype(np.int64),
            column(seen, "elevation_bin").astype(np.int64),
        )

    @property
    def own_voxels(self) -> Ints:
        """(V,) voxel numbers of the run itself."""
        return self.own_meeting.voxel

    @cached_property
    def voxel_of_box(self) -> Ints:
        """(n,) the same of every box, −1 where it has no place."""
        numbers = np.full(self.detections.num_rows, -1, dtype=np.int64)
        numbers[self.placed] = self.own_voxels
        return numbers

    @cached_property
    def instance(self) -> Ints:
        """(A,) number of the physical object of every annotation, −1 where nobody says."""
        parts = [self.annotations[name] for name in ("sequence_id", "instance_id")]
        names = pc.binary_join_element_wise(*parts, "/").combine_chunks()
        return names.dictionary_encode().indices.fill_null(-1).to_numpy().astype(np.int64)

    @property
    def iou_percent(self) -> int:
        """The first of those asked: from here on a box counts as right."""
        return self.pipeline.matching.iou_percents[0]

    def voxel_numbers(self, voxel_size_m: float) -> Ints:
        """(V,) voxel number of the placed boxes, voxels of different sequences apart."""
        voxels = voxel_indices(places_of(self.observations)[self.placed], voxel_size_m)
        return self.number_voxels(self.placed, voxels)

    def number_voxels(self, rows: Ints, voxels: Ints) -> Ints:
        """Numbers (V,) of the voxels (V, 3) that boxes of any sequences fell in."""
        return group_labels(np.column_stack([self.sequence[rows], voxels]))

    def candidate_scores(self, voxel_numbers: Ints) -> dict[str, Array]:
        """Method → (D,) scores of the candidates when boxes meet in the voxels given."""
        return self.scores_of(replace(self.own_meeting, voxel=voxel_numbers))

    def scores_of(self, meeting: Meeting) -> dict[str, Array]:
        """Method → (D,) scores of the candidates when boxes meet as given."""
        rows = meeting.rows
        sightings = Sightings(
            self.image[rows],
            meeting.voxel,
            meeting.azimuth_bin,
            meeting.elevation_bin,
            self.scores[rows],
        )
        box, class_id = self.survivors
        config = self.pipeline.fuse
        fused = fuse_methods(sightings, config)
        return {
            # rounded as the fused table stores them, so that ties are the same
            name: everywhere(result, rows, self.scores)
            .score[box, class_id]
            .astype(np.float32)
            .astype(np.float64)
            for name, result in taken(fused, sightings, self.survives[rows], config).items()
        }

    def average_precisions(self, scores: Array, iou_percent: int) -> Array:
        """11-point AP per class (K,)."""
        candidates, rule = self.candidates, self.pipeline.matching.rule
        found = match_all(candidates, scores, self.truth, iou_percent / 100, rule)
        sequence = self.sequence[self.survivors[0]]
        boxes = ScoredBoxes.ranked(scores, found.outcome, candidates.class_id, sequence)
        return average_precisions(boxes, self.truth.counted(self.n_classes), ap_voc07_11pt)

    def mean_average_precisions(self, meeting: Meeting) -> dict[str, float | None]:
        """Method → 11-point AP at the first IoU, mean over classes, when boxes meet as given."""
        means = {
            name: mean_over_classes(self.average_precisions(scores, self.iou_percent))
            for name, scores in self.scores_of(meeting).items()
        }
        return {name: value if np.isfinite(value) else None for name, value in means.items()}


def camera_centers(frames: pa.Table, poses: pa.Table) -> Array:
    """Camera centres by image number (F, 3), NaN where lost."""
    centers = np.full((frames.num_rows, 3), np.nan)
    known = poses.filter(pc.not_equal(poses["status"], LOST))
    centers[image_numbers(frames, known)] = stacked(known, "tx_m", "ty_m", "tz_m")
    return centers
