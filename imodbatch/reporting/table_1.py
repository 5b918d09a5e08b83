"""The paper's Table 1 with our figures, and how far its means and differences can be trusted."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.resampling import Interval, draw_sequences, mean_aps, percentile_interval
from imodbatch.reporting.comparison import (
    DIFFERENCES,
    WITH_VIEW,
    WITHOUT_VIEW,
    Comparison,
    MethodColumn,
)
from imodbatch.reporting.csv_text import to_csv
from imodbatch.reporting.grids import Cell, Column, Grid, Row, marked_best
from imodbatch.reporting.names import number, plural
from imodbatch.reporting.paper import MARK, TABLE_1, PaperColumn
from imodbatch.reporting.scores import class_rows
from imodbatch.tables.schemas import MEAN_CLASS_ID

PAPER_ELEVATIONS = 3
PAPER_GROUP = "simulation"
FEW_SEQUENCES = 10
"""Below so many, an interval is called rough."""


@dataclass(frozen=True)
class Estimate:
    """A mean AP, or the difference of two, with the interval of its resampled values."""

    group: str
    name: str
    value: float
    interval: Interval | None
    is_difference: bool


def table_1(comparison: Comparison) -> Grid:
    """AP per class, grid and method, the best of each grid marked, the paper's columns beside."""
    rows = []
    for class_id, name in class_rows(comparison.any_run.classes):
        n_annotations = comparison.n_counted(class_id)
        cells = [Cell(f"{n_annotations:,}")]
        for group in comparison.groups:
            ours = _of_group(comparison, group)
            notes = ["" if n_annotations else _false_positives(c, class_id) for c in ours]
            cells += marked_best([c.ap(class_id) for c in ours], notes)
            cells += [Cell(number(c.ap.get(name))) for c in _paper(comparison, group)]
        rows.append(Row(name, tuple(cells), class_id == MEAN_CLASS_ID))
    columns = [Column("boxes", "true")]
    for group in comparison.groups:
        columns += [Column(c.name, group) for c in _of_group(comparison, group)]
        columns += [
            Column(c.name, f"{group}, {MARK}, {c.group}") for c in _paper(comparison, group)
        ]
    iou = comparison.any_run.results.main_iou / 100
    title = f"AP, 11 points (VOC 2007), IoU ≥ {iou:.2f}, in the layout of the paper's Table 1"
    return Grid("ap", title, "class", tuple(columns), tuple(rows))


def table_1_csv(comparison: Comparison) -> str:
    """The same in full precision; empty = no AP. False positives stand for every class."""
    ours = comparison.columns
    paper = [(group, c) for group in comparison.groups for c in _paper(comparison, group)]
    head = ["class_id", "class_name", "n_annotations"]
    head += [f"{c.group} {c.name}" for c in ours]
    head += [f"{c.group} {c.name}, false positives" for c in ours]
    head += [f"{group} {c.name} ({MARK}, {c.group})" for group, c in paper]
    rows = [
        [
            *(class_id, name, comparison.n_counted(class_id)),
            *(c.ap(class_id) for c in ours),
            *(c.n_false_positives(class_id) for c in ours),
            *(c.ap.get(name) for _, c in paper),
        ]
        for class_id, name in class_rows(comparison.any_run.classes)
    ]
    return to_csv(head, rows)


def estimates(comparison: Comparison, n_resamples: int, seed: int = 0) -> list[Estimate]:
    """Mean AP of every column and the differences within each grid, with 95 % intervals.

    All of them share the same draws of sequences. One sequence alone gives no interval.
    """
    columns = comparison.columns
    n_sequences = len(comparison.any_run.sequence_ids)
    draws = draw_sequences(n_sequences, n_resamples if n_sequences > 1 else 0, seed)
    values = mean_aps([c.boxes for c in columns], comparison.n_annotations, draws)
    found = [
        Estimate(c.group, c.name, c.mean, percentile_interval(values[:, i]), False)
        for i, c in enumerate(columns)
    ]
    for group in comparison.groups:
        found += _differences(group, columns, values)
    return found


def estimates_grid(found: Sequence[Estimate]) -> Grid:
    """A row per mean and per difference."""
    rows = []
    for estimate in found:
        interval = estimate.interval
        limits = [None, None] if interval is None else [interval.low, interval.high]
        show = _signed if estimate.is_difference else number
        cells = [Cell(show(value)) for value in (estimate.value, *limits)]
        rows.append(Row(f"{estimate.group} {estimate.name}", tuple(cells)))
    columns = (Column("mean AP"), Column("from", "95 %"), Column("to", "95 %"))
    title = "Mean AP and differences, with paired bootstrap intervals over sequences"
    return Grid("intervals", title, "", columns, tuple(rows))


def estimates_csv(found: Sequence[Estimate]) -> str:
    """The same in full precision; empty = no interval."""
    rows = [
        [
            *(e.group, e.name, e.value),
            *((e.interval.low, e.interval.high) if e.interval else (None, None)),
        ]
        for e in found
    ]
    return to_csv(["grid", "column", "mean_ap", "low", "high"], rows)


def interval_remark(comparison: Comparison, n_resamples: int) -> str:
    """How the intervals came about, and how little they may mean."""
    n = len(comparison.any_run.sequence_ids)
    if n == 1:
        return "There is one sequence only, so there is nothing to resample: no interval."
    text = (
        f"{n_resamples:,} resamples of {plural(n, 'sequence')}, the same for every column; on each "
        "the boxes are pooled and ranked anew. A resample holds fewer different sequences than the "
        "data, which suits sums, whose size differs between sequences: a value may lie at the end "
        "of its interval."
    )
    if n < FEW_SEQUENCES:
        text += (
            f" With {n} sequences an interval is rough: there are only {comb(2 * n - 1, n):,} "
            "different resamples, and none holds a sequence unlike these."
        )
    return text


def table_remark(comparison: Comparison) -> str:
    """What the columns are."""
    text = (
        "w/o view: single frames of the detector without viewpoint classes. w/ view: single frames "
        "of the detector with them. Naive: sum of its scores in a voxel. Ours: Eq. 1–2."
    )
    if comparison.without_view is None:
        text += " No run of a detector without viewpoints was named: w/o view is left out."
    if not comparison.n_annotations.sum(axis=1).all():
        text += (
            " A class without annotations has no AP and is left out of the mean; its false "
            "positives, at any score, are counted."
        )
    return text + " The paper's columns were measured on other data: they are no target."


def _differences(
    group: str, columns: Sequence[MethodColumn], resampled: NDArray[np.float64]
) -> list[Estimate]:
    place = {column.name: i for i, column in enumerate(columns) if column.group == group}
    return [
        Estimate(
            group,
            f"{better} − {worse}",
            columns[place[better]].mean - columns[place[worse]].mean,
            percentile_interval(resampled[:, place[better]] - resampled[:, place[worse]]),
            is_difference=True,
        )
        for better, worse in DIFFERENCES
        if better in place and worse in place
    ]


def _of_group(comparison: Comparison, group: str) -> list[MethodColumn]:
    return [column for column in comparison.columns if column.group == group]


def _paper(comparison: Comparison, group: str) -> list[PaperColumn]:
    """The paper's columns of that grid on its simulated data, if it has them."""
    grid = comparison.groups[group].grid
    if grid.n_elevations != PAPER_ELEVATIONS:
        return []
    return [c for c in TABLE_1.get(grid.n_azimuths, ()) if c.group == PAPER_GROUP]


def _false_positives(column: MethodColumn, class_id: int) -> str:
    """Said once per detector: without annotations every box is one, however it is scored."""
    if column.name not in (WITHOUT_VIEW, WITH_VIEW):
        return ""
    return plural(column.n_false_positives(class_id), "false positive")


def _signed(value: float | None) -> str:
    return number(value) if value is None or np.isnan(value) else f"{value:+.3f}"
