"""What was lost where: rows per stage, sequence and status, and what holds fusion back."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pyarrow as pa

from imodbatch.reporting.grids import Cell, Column, Grid, Row
from imodbatch.reporting.names import DASH, number
from imodbatch.reporting.run_info import RunInfo
from imodbatch.tables.schemas import MEAN_CLASS_ID

STAGE_OF_TABLE = {
    "frames": "index",
    "annotations": "index",
    "poses": "poses",
    "detections": "detect",
    "observations": "lift",
}
WITH_STATUS = ("poses", "observations")
USUAL_STATUSES = ("frames", "annotations", "tracked", "dense", "interpolated", "lost", "placed")
TOTAL = "all sequences"
CAUSES = {
    "no_box": "no box near the annotation (share)",
    "loose_box": "only a loose box (share)",
    "unplaced": "right boxes without a place (share)",
    "split_pairs": "pairs of sightings in different voxels (share)",
    "voxels_per_instance": "voxels per object (mean)",
    "place_spread_m": "scatter of places (m, median)",
    "behind_share": "sightings behind the object (share)",
    "false_in_true_voxel": "false boxes in an object's voxel (share)",
    "ap_as_is": "AP as it is",
    "ap_iou_30": "AP if loose boxes counted",
    "ap_oracle_voxels": "AP with one voxel per object",
    "ap_perfect_ranking": "AP if right boxes came first",
}
"""Headings of the causes in `core.diagnosis`; others keep their own name."""


class StatusCount(NamedTuple):
    """How many rows of a stage's table have a status, in one sequence."""

    stage: str
    sequence_id: str
    status: str
    n: int


def status_counts(tables: Mapping[str, pa.Table]) -> list[StatusCount]:
    """Counts in order of stages, sequences and statuses; tables without status count their rows."""
    counts = []
    for name, stage in STAGE_OF_TABLE.items():
        keys = ["sequence_id", "status"] if name in WITH_STATUS else ["sequence_id"]
        groups = tables[name].group_by(keys).aggregate([([], "count_all")]).to_pylist()
        found = (
            StatusCount(stage, g["sequence_id"], g.get("status", name), g["count_all"])
            for g in groups
        )
        counts += sorted(found, key=lambda c: (c.sequence_id, _place(c.status)))
    return counts


def status_grid(counts: Sequence[StatusCount], sequence_ids: Sequence[str]) -> Grid:
    """Sequences down, statuses across, with a total."""
    kinds = list(dict.fromkeys((c.stage, c.status) for c in counts))
    stages = list(dict.fromkeys(STAGE_OF_TABLE.values()))
    kinds.sort(key=lambda kind: (stages.index(kind[0]), _place(kind[1])))
    found = {(c.sequence_id, c.stage, c.status): c.n for c in counts}
    rows = [
        Row(name, tuple(Cell(f"{found.get((name, *kind), 0):,}") for kind in kinds))
        for name in sequence_ids
    ]
    totals = [sum(c.n for c in counts if (c.stage, c.status) == kind) for kind in kinds]
    rows.append(Row(TOTAL, tuple(Cell(f"{total:,}") for total in totals), is_summary=True))
    columns = tuple(Column(status.replace("_", " "), stage) for stage, status in kinds)
    return Grid("status", "Rows by stage and status", "sequence", columns, tuple(rows))


def losses_grid(losses: pa.Table, info: RunInfo) -> Grid | None:
    """Classes down, causes across; None if nothing was diagnosed."""
    rows = losses.to_pylist()
    if not rows:
        return None
    found = {(row["class_id"], row["cause"]): row for row in rows}
    told = dict.fromkeys(row["cause"] for row in rows)
    causes = [c for c in CAUSES if c in told] + [c for c in told if c not in CAUSES]
    class_ids = sorted({row["class_id"] for row in rows}, key=lambda i: (i < 0, i))
    grid_rows = []
    for class_id in class_ids:
        name = "all classes" if class_id == MEAN_CLASS_ID else info.class_name(class_id)
        cells = (_loss(found.get((class_id, cause))) for cause in causes)
        grid_rows.append(Row(name, tuple(cells), class_id == MEAN_CLASS_ID))
    columns = tuple(Column(CAUSES.get(cause, cause.replace("_", " "))) for cause in causes)
    return Grid("losses", "What holds fusion back", "class", columns, tuple(grid_rows))


def _loss(row: dict[str, float] | None) -> Cell:
    if row is None:
        return Cell(DASH)
    return Cell(number(row["value"]), f"n = {row['n']:,}")


def _place(status: str) -> tuple[int, str]:
    known = status in USUAL_STATUSES
    return (USUAL_STATUSES.index(status) if known else len(USUAL_STATUSES)), status
