"""How well a detector names the azimuth from which it sees an object, in single frames."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.core.matching import OUTCOME_NAMES, Outcome
from imodbatch.core.symmetry import Symmetry, n_fold, parse_symmetry
from imodbatch.core.viewpoint import azimuth_bins_apart
from imodbatch.reporting.comparison import METHODS, WITH_VIEW, Comparison
from imodbatch.reporting.grids import Cell, Column, Grid, Row
from imodbatch.reporting.names import percent
from imodbatch.reporting.run_folder import FinishedRun
from imodbatch.reporting.scores import to_csv


@dataclass(frozen=True)
class AzimuthAccuracy:
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
    def exact(self) -> float | None:
        """Share of `n`; None without any."""
        return self.n_exact / self.n if self.n else None

    @property
    def near(self) -> float | None:
        """Share of `n`; None without any."""
        return self.n_near / self.n if self.n else None


@dataclass(frozen=True)
class AzimuthBlock:
    """Accuracy per class and detector grid.

    Attributes:
        classes: names by class id.
        symmetries: of each class; None = unknown.
        by_group: detector grid → a figure per class; None where azimuth means nothing.
    """

    classes: tuple[str, ...]
    symmetries: tuple[Symmetry | None, ...]
    by_group: dict[str, tuple[AzimuthAccuracy | None, ...]]


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
    rows: list[list[object]] = []
    for k, (name, symmetry) in enumerate(zip(block.classes, block.symmetries, strict=True)):
        row: list[object] = [k, name, symmetry]
        for figures in block.by_group.values():
            found = figures[k]
            row += [None] * 3 if found is None else [found.n, found.n_exact, found.n_near]
        rows.append(row)
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


def _accuracies(
    run: FinishedRun, symmetries: Sequence[Symmetry | None]
) -> tuple[AzimuthAccuracy | None, ...]:
    apart: list[list[int]] = [[] for _ in symmetries]
    for class_id, predicted_bin, azimuth_rad in _true_positives(run):
        turns = n_fold(symmetries[class_id])
        if turns is not None:
            bins = azimuth_bins_apart(predicted_bin, azimuth_rad, run.grid.n_azimuths, turns)
            apart[class_id].append(int(bins))
    return tuple(
        None if n_fold(symmetry) is None else _accuracy(np.array(bins, dtype=np.int64))
        for symmetry, bins in zip(symmetries, apart, strict=True)
    )


def _accuracy(bins_apart: NDArray[np.int64]) -> AzimuthAccuracy:
    return AzimuthAccuracy(
        len(bins_apart), int((bins_apart == 0).sum()), int((bins_apart <= 1).sum())
    )


def _true_positives(run: FinishedRun) -> Iterator[tuple[int, int, float]]:
    """Class, predicted azimuth bin and true azimuth of each right box whose truth is known."""
    is_right = (
        (pc.field("method") == METHODS[WITH_VIEW])
        & (pc.field("iou_percent") == run.results.main_iou)
        & (pc.field("outcome") == OUTCOME_NAMES[Outcome.TRUE_POSITIVE])
    )
    keys = ["sequence_id", "frame_index", "annotation_index"]
    annotations = run.results.tables["annotations"].select([*keys, "own_azimuth_rad"])
    right = run.results.tables["matches"].filter(is_right).drop_columns(["iou", "score"])
    right = right.join(annotations, keys=keys).filter(pc.field("own_azimuth_rad").is_valid())
    shape = (len(run.classes), run.grid.n_elevations, run.grid.n_azimuths)
    for sequence_id in run.sequence_ids:
        detections = run.detections(sequence_id)
        numbers = zip(
            detections["frame_index"].to_pylist(),
            detections["detection_index"].to_pylist(),
            strict=True,
        )
        place = {key: i for i, key in enumerate(numbers)}
        vectors = detections["view_scores"].combine_chunks()
        for row in right.filter(pc.field("sequence_id") == sequence_id).to_pylist():
            vector = vectors[place[row["frame_index"], row["detection_index"]]].values.to_numpy()
            scores = vector.reshape(shape)[row["class_id"]].sum(axis=0)
            yield row["class_id"], int(scores.argmax()), row["own_azimuth_rad"]


def _mark(symmetry: Symmetry | None) -> str:
    turns = n_fold(symmetry)
    return " ◯" if turns is None else f" ×{turns}" if turns > 1 else ""


def _cells(figure: AzimuthAccuracy | None) -> list[Cell]:
    if figure is None:
        return [Cell(percent(None))] * 3
    return [Cell(f"{figure.n:,}"), Cell(percent(figure.exact)), Cell(percent(figure.near))]


def _mean_cells(block: AzimuthBlock, figures: Sequence[AzimuthAccuracy | None]) -> list[Cell]:
    """Boxes in all, and the mean share over the classes without symmetry that have boxes."""
    plain = [
        figure
        for figure, symmetry in zip(figures, block.symmetries, strict=True)
        if figure is not None and figure.n and n_fold(symmetry) == 1
    ]
    exact = float(np.mean([f.n_exact / f.n for f in plain])) if plain else None
    near = float(np.mean([f.n_near / f.n for f in plain])) if plain else None
    return [Cell(f"{sum(f.n for f in plain):,}"), Cell(percent(exact)), Cell(percent(near))]
