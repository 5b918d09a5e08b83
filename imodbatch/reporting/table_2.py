"""The paper's Table 2 with our figures: precision/recall at tuned thresholds, and AP."""

from collections.abc import Sequence

import numpy as np

from imodbatch.reporting.comparison import Comparison
from imodbatch.reporting.grids import Cell, Column, Grid, Row
from imodbatch.reporting.names import DASH, number, plural
from imodbatch.reporting.operating_points import (
    HELD_OUT,
    NAMES,
    ON_TEST,
    SINGLE,
    OperatingPoint,
    Table2Column,
)
from imodbatch.reporting.paper import TABLE_2, PaperColumn
from imodbatch.reporting.scores import class_rows, paper_cell, paper_grid, paper_head, triple
from imodbatch.tables.schemas import BACKGROUND_CLASS_ID, MEAN_CLASS_ID

GRID_NAMES = {ON_TEST: "tuned-on-test", HELD_OUT: "held-out"}
HOW_TUNED = {
    ON_TEST: "the threshold is chosen on the very sequences it is judged on, as the paper seems to "
    "have done, which flatters every method",
    HELD_OUT: "the threshold for a sequence is chosen on all the other sequences, and what it "
    "keeps there is counted; the counts of all sequences are added",
}


def table_2(
    comparison: Comparison,
    columns: Sequence[Table2Column],
    tuning: str,
    paper: Sequence[PaperColumn] = (),
    with_thresholds: bool = False,
) -> Grid:
    """Precision/recall (AP) per class, of the background and in the mean, the best AP marked.

    Args:
        comparison: what is compared.
        columns: its figures.
        tuning: how thresholds were chosen, one of `operating_points.TUNINGS`.
        paper: columns to stand beside ours.
        with_thresholds: whether cells also say from which score on boxes are kept.
    """
    rows = []
    for class_id, name in class_rows(comparison.any_run.classes, with_background=True):
        aps = [_ap(column, class_id) for column in columns]
        best = max((number(ap) for ap in aps if not np.isnan(ap)), default="")
        cells = [Cell(_n_boxes(comparison, class_id))]
        for column, ap in zip(columns, aps, strict=True):
            point = column.points.get(tuning)
            text = triple(*precision_recall(point, class_id), ap)
            note = _note(comparison, column, point, class_id, with_thresholds)
            cells.append(Cell(text, note, number(ap) == best))
        cells += [paper_cell(column, name) for column in paper]
        rows.append(Row(name, tuple(cells), class_id == MEAN_CLASS_ID))
    n_grids = len(comparison.groups)
    heads = [Column("boxes", "true")]
    heads += [Column(c.name, c.group if n_grids == 1 else f"{c.grid}, {c.group}") for c in columns]
    heads += map(paper_head, paper)
    iou = comparison.any_run.results.main_iou / 100
    title = f"Precision/recall in percent (AP), IoU ≥ {iou:.2f}: {tuning}"
    return Grid(GRID_NAMES[tuning], title, "class", tuple(heads), tuple(rows))


def paper_table_2() -> Grid:
    """The paper's Table 2 as printed, with its own classes."""
    title = "The paper's Table 2 as printed, on other data: precision/recall in percent (AP)"
    return paper_grid("paper", title, TABLE_2[0].precision_recall, TABLE_2)


def beside(classes: Sequence[str]) -> tuple[PaperColumn, ...]:
    """The paper's columns if it has one of the classes."""
    return TABLE_2 if set(classes) & set(TABLE_2[0].ap) else ()


def precision_recall(point: OperatingPoint | None, class_id: int) -> tuple[float, float]:
    """Of a class, the background or the mean; NaN where there is none."""
    if point is None:
        return float("nan"), float("nan")
    if class_id == BACKGROUND_CLASS_ID:
        return point.background
    if class_id == MEAN_CLASS_ID:
        return point.mean
    return float(point.counts.precision[class_id]), float(point.counts.recall[class_id])


def remarks(comparison: Comparison, columns: Sequence[Table2Column], step: float) -> list[str]:
    """What the figures are, and what is to be known about these."""
    tunings = " ".join(f"{name.capitalize()}: {how}." for name, how in HOW_TUNED.items())
    found = [
        "w/o viewpoint: single frames of the detector without viewpoint classes. w/ viewpoint: "
        "single frames of the detector with them. Naive: sum of its scores in a voxel. SLAM-aware "
        "rule: the same sum over log-odds. Ours: Eq. 1–2. All frames: the same with every frame of "
        "the sequence seen, not only those up to the box's own.",
        f"Thresholds, per class and column: the largest F1 (the paper does not say what was "
        f"maximised), in steps of {step:g} from 0, or from below the least score, to beyond the "
        f"largest; among equals the lowest. {tunings} AP needs no "
        "threshold and is the same under both.",
        "Background is counted in pixels: all outside the kept boxes. The means of precision and "
        f"recall are over the classes and the background, as the paper's; that of AP is over "
        f"{_n_annotated(comparison)} classes with annotations.",
    ]
    if len(comparison.any_run.sequence_ids) == 1:
        found.append(
            f"{HELD_OUT.capitalize()}: there is one sequence only, so there is no other to choose "
            f"a threshold on: {DASH}."
        )
    if _n_annotated(comparison) < len(comparison.any_run.classes):
        found.append(
            "A class without annotations has no figures and is left out of the means; its false "
            "positives, at any score, are counted."
        )
    if any(_n_untuned(comparison, column).any() for column in columns):
        found.append(
            "Where the other sequences hold no annotation of a class, there is no threshold: "
            "neither its boxes nor its annotations there are counted, and none of its boxes hides "
            "background. A class of one sequence only has no held-out figures."
        )
    if any(_lacks_precision(column) for column in columns):
        found.append(
            "Where no box of a class is kept, it has no precision and is left out of that mean."
        )
    for grid, run in comparison.groups.items():
        absent = [name for method, name in NAMES.items() if method not in run.results.methods]
        if absent:
            found.append(f"Not among the methods of the run of {grid}: {', '.join(absent)}.")
    found.append(
        "The paper's columns were measured on other data: they are no target. Those of [26] and "
        "[29] count points, the others boxes, and the background pixels."
    )
    return found


def _ap(column: Table2Column, class_id: int) -> float:
    return float("nan") if class_id == BACKGROUND_CLASS_ID else column.ap(class_id)


def _n_boxes(comparison: Comparison, class_id: int) -> str:
    return "" if class_id == BACKGROUND_CLASS_ID else f"{comparison.n_counted(class_id):,}"


def _note(
    comparison: Comparison,
    column: Table2Column,
    point: OperatingPoint | None,
    class_id: int,
    with_thresholds: bool,
) -> str:
    """Thresholds, and what is missing; the latter once per detector, whose boxes are the same."""
    if class_id < 0:
        return ""
    parts = []
    if point is not None and with_thresholds:
        parts.append(_limits(point, class_id))
    if column.group == SINGLE:
        if not comparison.n_counted(class_id):
            parts.append(plural(column.n_false_positives(class_id), "false positive"))
        elif point is not None:
            n = int(point.n_untuned(comparison.n_annotations)[class_id])
            parts.append(f"{plural(n, 'true box')} left out: no threshold" if n else "")
    return ", ".join(part for part in parts if part)


def _limits(point: OperatingPoint, class_id: int) -> str:
    known = point.thresholds[class_id][np.isfinite(point.thresholds[class_id])]
    if len(known) == 0:
        return ""
    low, high = number(known.min(), 2), number(known.max(), 2)
    return f"≥ {low}" if low == high else f"≥ {low} to {high}"


def _n_annotated(comparison: Comparison) -> int:
    return int((comparison.n_annotations.sum(axis=1) > 0).sum())


def _n_untuned(comparison: Comparison, column: Table2Column) -> np.ndarray:
    points = column.points.values()
    return np.array([point.n_untuned(comparison.n_annotations).sum() for point in points])


def _lacks_precision(column: Table2Column) -> bool:
    """Whether a class has a recall but no precision."""
    counts = [point.counts for point in column.points.values()]
    return any((np.isnan(c.precision) & ~np.isnan(c.recall)).any() for c in counts)
