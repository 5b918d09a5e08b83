"""The fused AP if one cause of loss were gone: ablate_fusion.py RUN_DIR PIPELINE.

Fuses a finished run's boxes again, each time with one thing replaced by the truth or by a choice.
Needs annotations with instance ids and azimuths, as simulated houses have them.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.fusion import MODES, Mode, fuse
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.fusion.evidence import sightings_of
from imodbatch.reporting.run_folder import open_run
from imodbatch.scoring.losses import best_boxes, oracle_voxels
from imodbatch.scoring.rescoring import Evidence
from imodbatch.settings.config import Pipeline, load_pipeline
from imodbatch.tables.parquet import read_table, table_path
from imodbatch.tables.schemas import TABLES

Array = NDArray[np.float64]
METHODS = ("single", "naive", "imod", "imod_offline")


def main(folder: Path, pipeline: Pipeline) -> None:
    run = open_run(folder)
    tables = {
        name: pa.concat_tables(
            read_table(table_path(folder, name, sequence_id), TABLES[name])
            for sequence_id in run.sequence_ids
        )
        for name in ("frames", "annotations", "detections", "observations")
    }
    evidence = Evidence(**tables, n_classes=len(run.classes), pipeline=pipeline)
    everyone = replace(evidence, pipeline=with_takers(pipeline, "all"))
    own = evidence.own_voxels
    oracle = oracle_voxels(evidence)
    rows = {
        "as it is": aps(evidence, evidence.candidate_scores(own)),
        "every box takes its voxel's score": aps(evidence, everyone.candidate_scores(own)),
        "true viewpoints": aps(evidence, with_true_views(evidence).candidate_scores(own)),
        "no viewpoints": aps(evidence, without_views(evidence).candidate_scores(own)),
        "true places: a voxel per instance": aps(evidence, evidence.candidate_scores(oracle)),
        "true places and viewpoints": aps(
            evidence, with_true_views(evidence).candidate_scores(oracle)
        ),
        "score per cell filled": aps(evidence, per_cell(evidence)),
        "own score × score per cell": aps(evidence, blended(evidence)),
    }
    iou = evidence.pipeline.matching.iou_percents[0]
    perfect = best_boxes(evidence.overlaps, iou / 100).astype(np.float64)
    ceiling = evidence.average_precisions(perfect, iou)
    symmetric = symmetric_classes(tables["annotations"], len(run.classes))
    groups = {"symmetric classes": symmetric, "other classes": ~symmetric}
    print(f"{'mean ap_voc07_11pt':36}" + "".join(f"{m:>14}" for m in METHODS))
    for title, found in rows.items():
        print(line(title, [np.nanmean(found[m]) for m in METHODS]))
        if title == "as it is":
            for group, members in groups.items():
                print(line(f"  {group}", [np.nanmean(found[m][members]) for m in METHODS]))
    print(line("perfect ranking of the same boxes", [np.nanmean(ceiling)]))


def line(title: str, values: list[float]) -> str:
    return f"{title:36}" + "".join(f"{value:14.3f}" for value in values)


def with_takers(pipeline: Pipeline, takers: str) -> Pipeline:
    return pipeline.model_copy(update={"fuse": pipeline.fuse.model_copy(update={"takers": takers})})


def aps(evidence: Evidence, scores: dict[str, Array]) -> dict[str, Array]:
    iou = evidence.pipeline.matching.iou_percents[0]
    return {name: evidence.average_precisions(scores[name], iou) for name in METHODS}


class _Changed(Evidence):
    """Evidence with other score vectors."""

    changed: NDArray[np.float32]

    @property
    def scores(self) -> NDArray[np.float32]:  # type: ignore[override]
        return self.changed


def changed(evidence: Evidence, scores: NDArray[np.float32]) -> Evidence:
    new = _Changed(
        evidence.frames, evidence.annotations, evidence.detections, evidence.observations,
        evidence.n_classes, evidence.pipeline,
    )  # fmt: skip
    object.__setattr__(new, "changed", scores)
    return new


def with_true_views(evidence: Evidence) -> Evidence:
    """Boxes that found an object name its true azimuth, and the elevation they are seen from."""
    scores = evidence.scores.copy()
    grid = ViewGrid(scores.shape[3], tuple(0.1 * e for e in range(scores.shape[2])))
    seen_from = evidence.observations["elevation_bin"].fill_null(0).to_numpy()
    azimuth = evidence.annotations["own_azimuth_rad"].to_numpy(zero_copy_only=False)
    box, class_id = evidence.survivors
    hit = evidence.overlaps.candidate_iou >= 0.5
    for row in np.flatnonzero(hit):
        true = azimuth[evidence.overlaps.candidate_annotation[row]]
        if np.isfinite(true):
            cells = scores[box[row], class_id[row]]
            total = cells.sum()
            cells[:] = 0
            cells[seen_from[box[row]], int(grid.azimuth_bins(true))] = total
    return changed(evidence, scores)


def without_views(evidence: Evidence) -> Evidence:
    """All viewpoints equally likely: what is left is a sum over the cells."""
    scores = evidence.scores
    total = scores.sum(axis=(2, 3), keepdims=True)
    return changed(evidence, np.broadcast_to(total, scores.shape).astype(np.float32))


def fused_and_cells(evidence: Evidence, mode: Mode) -> tuple[Array, Array]:
    seen = evidence.observations.take(evidence.placed)
    sightings = sightings_of(
        seen,
        evidence.scores[evidence.placed],
        evidence.own_voxels[:, None],
        evidence.image[evidence.placed],
    )
    config = evidence.pipeline.fuse
    fused = fuse(sightings, "imod", config.cell_reduce)[mode]
    box, class_id = evidence.survivors
    n_cells = np.ones(evidence.scores.shape[:2])
    n_cells[evidence.placed] = np.maximum(fused.n_cells, 1)
    single = evidence.scores.sum(axis=(2, 3), dtype=np.float64)
    return n_cells[box, class_id], single[box, class_id]


def per_cell(evidence: Evidence) -> dict[str, Array]:
    """The mean over the filled cells in place of the sum: late frames do not outrank early ones."""
    scores = evidence.candidate_scores(evidence.own_voxels)
    for name, mode in zip(("imod", "imod_offline"), MODES, strict=True):
        scores[name] = scores[name] / fused_and_cells(evidence, mode)[0]
    return scores


def blended(evidence: Evidence) -> dict[str, Array]:
    """A box's own score times the fused one per cell: both the place and the box must convince."""
    scores = per_cell(evidence)
    own = fused_and_cells(evidence, "online")[1]
    return scores | {name: own * scores[name] for name in ("imod", "imod_offline")}


def symmetric_classes(annotations: pa.Table, n_classes: int) -> NDArray[np.bool_]:
    found = np.zeros(n_classes, dtype=np.bool_)
    table = annotations.select(["class_id", "symmetry"]).to_pylist()
    for row in table:
        found[row["class_id"]] |= row["symmetry"] not in (None, "none", "1", 1)
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), load_pipeline(Path(sys.argv[2])))
