"""How well a detector names the azimuth from which it sees an object, in single frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from imodbatch.core.matching import OUTCOME_NAMES, Outcome
from imodbatch.core.symmetry import Symmetry, n_fold, parse_symmetry
from imodbatch.core.viewpoint import azimuth_bins_apart
from imodbatch.reporting.comparison import METHODS, WITH_VIEW, Comparison
from imodbatch.reporting.csv_text import to_csv
from imodbatch.reporting.grids import Cell, Column, Grid, Row
from imodbatch.reporting.names import percent
from imodbatch.reporting.run_folder import FinishedRun

NO_SHARES = (float("nan"), float("nan"))
NOTHING = (None, None, None)
Figures = tuple["AzimuthAccuracy | None", ...]
"""Of each class; None where azimuth means nothing."""


class AzimuthAccuracy(NamedTuple):
    """The azimuths of one class's true-positive boxes under one detector.

    Attributes:
        n: boxes whose true azimuth is known.
        n_exact: those whose azimuth bin is the true one.
        n_near: those whose bin is the true one or beside it.
    """

    n: int
    n_exact: int
    n_near: int

    @property
    def shares(self) -> tuple[float, float]:
        """The exact and the near ones of `n`; NaN without any."""
        return (self.n_exact / self.n, self.n_near / self.n) if self.n else NO_SHARES


@dataclass(frozen=True)
class AzimuthBlock:
    """Accuracy per class and detector grid.

    Attributes:
        classes: names by class id.
        symmetries: of each class; None = unknown.
        by_group: detector grid → a figure per class.
    """

    classes: tuple[str, ...]
    symmetries: tuple[Symmetry | None, ...]
    by_group: dict[str, Figures]


def azimuth_block(comparison: Comparison) -> AzimuthBlock | None:
    """Read the accuracies off the runs; None where no annotation knows its azimuth."""
    annotations = comparison.any_run.results.tables["annotations"]
    if annotations["own_azimuth_rad"].null_count == annotations.num_rows:
        return None
    classes = comparison.any_run.classes
    symmetries = _symmetries(annotations, len(classes))
    by_group = {group: _accuracies(run, symmetries) for group, run in comparison.groups.items()}
    return AzimuthBlock(classes, symmetries, by_group)


def azimuth_grid(block: AzimuthBlock) -> Grid:
    """Percentages per class, symmetric ones marked, and the mean over the others."""
    rows = [
        Row(
            f"{name}{_mark(symmetry)}",
            tuple(
                cell for figures in block.by_group.values() for cell in _cells(figures[class_id])
            ),
        )
        for class_id, (name, symmetry) in enumerate(
            zip(block.classes, block.symmetries, strict=True)
        )
    ]
    means = [cell for figures in block.by_group.values() for cell in _mean_cells(block, figures)]
    rows.append(Row("mean without symmetric", tuple(means), is_summary=True))
    columns = tuple(
        Column(text, group) for group in block.by_group for text in ("boxes", "exact", "±1 bin")
    )
    title = "Azimuth of single frames, percent of the true-positive boxes"
    return Grid("azimuth", title, "class", columns, tuple(rows))


def azimuth_csv(block: AzimuthBlock) -> str:
    """The counts behind it; empty = azimuth means nothing."""
    head = ["class_id", "class_name", "symmetry"]
    head += [f"{group} {name}" for group in block.by_group for name in ("n", "n_exact", "n_near")]
    rows = [
        [k, *named, *chain(*(figures[k] or NOTHING for figures in block.by_group.values()))]
        for k, named in enumerate(zip(block.classes, block.symmetries, strict=True))
    ]
    return to_csv(head, rows)


def azimuth_remark(block: AzimuthBlock) -> str:
    """What is counted."""
    text = (
        "The bin of the largest score over azimuths, summed over elevations, of boxes that are "
        "right at any score (w/ view), against the annotation's azimuth."
    )
    folds = {n_fold(symmetry) for symmetry in block.symmetries}
    if None in folds:
        text += " ◯: looks the same from all sides, so its azimuth means nothing."
    if folds - {None, 1}:
        text += " ×n: looks the same n times in a turn; the nearest of its equal views counts."
    if None in block.symmetries:
        text += " Symmetry is not known of classes without annotations or where they do not say it."
    return text


def _symmetries(annotations: pa.Table, n_classes: int) -> tuple[Symmetry | None, ...]:
    known = annotations.filter(pc.field("symmetry").is_valid())
    pairs = known.group_by(["class_id", "symmetry"]).aggregate([]).to_pylist()
    found = {row["class_id"]: parse_symmetry(row["symmetry"]) for row in pairs}
    return tuple(found.get(class_id) for class_id in range(n_classes))


def _accuracies(run: FinishedRun, symmetries: Sequence[Symmetry | None]) -> Figures:
    right = _true_positives(run)
    found: list[AzimuthAccuracy | None] = []
    for class_id, symmetry in enumerate(symmetries):
        turns = n_fold(symmetry)
        if turns is None:
            found.append(None)
            continue
        own = right[right.class_id == class_id]
        apart = azimuth_bins_apart(own.bin, own.own_azimuth_rad, run.grid.n_azimuths, turns)
        found.append(AzimuthAccuracy(len(own), int((apart == 0).sum()), int((apart <= 1).sum())))
    return tuple(found)


def _true_positives(run: FinishedRun) -> pd.DataFrame:
    """The right boxes whose true azimuth is known, with the `bin` that the detector names."""
    is_right = (
        (pc.field("method") == METHODS[WITH_VIEW])
        & (pc.field("iou_percent") == run.results.main_iou)
        & (pc.field("outcome") == OUTCOME_NAMES[Outcome.TRUE_POSITIVE])
    )
    keys = ["sequence_id", "frame_index", "annotation_index"]
    annotations = run.results.tables["annotations"].select([*keys, "own_azimuth_rad"])
    right = run.results.tables["matches"].filter(is_right).join(annotations, keys=keys)
    right = right.filter(pc.field("own_azimuth_rad").is_valid()).to_pandas()
    shape = (-1, len(run.classes), run.grid.n_elevations, run.grid.n_azimuths)
    found = []
    for sequence_id, rows in right.groupby("sequence_id"):
        detections = run.detections(str(sequence_id))
        vectors = detections["view_scores"].combine_chunks().flatten().to_numpy().reshape(shape)
        boxes = detections.select(["frame_index", "detection_index"]).to_pandas()
        own = rows.merge(boxes.assign(row=range(len(boxes))))
        scores = vectors[own.row, own.class_id].sum(axis=1)
        found.append(own.assign(bin=scores.argmax(axis=1)))
    return pd.concat(found) if found else right.assign(bin=0)


def _mark(symmetry: Symmetry | None) -> str:
    turns = n_fold(symmetry)
    return " ◯" if turns is None else f" ×{turns}" if turns > 1 else ""


def _cells(figure: AzimuthAccuracy | None) -> list[Cell]:
    if figure is None:
        return [Cell(percent(None))] * 3
    return [Cell(f"{figure.n:,}"), *(Cell(percent(share)) for share in figure.shares)]


def _mean_cells(block: AzimuthBlock, figures: Figures) -> list[Cell]:
    """Boxes in all, and the mean share over the classes without symmetry that have boxes."""
    plain = [
        figure
        for figure, symmetry in zip(figures, block.symmetries, strict=True)
        if figure is not None and figure.n and n_fold(symmetry) == 1
    ]
    means = np.mean([figure.shares for figure in plain], axis=0) if plain else NO_SHARES
    return [Cell(f"{sum(f.n for f in plain):,}"), *(Cell(percent(float(m))) for m in means)]
