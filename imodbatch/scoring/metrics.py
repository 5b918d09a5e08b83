"""metrics: from what became of each box, every figure of a run (Konno et al. 2020, Tables 1, 2).

The sequences are pooled: AP per class and mean, precision and recall at the tuned threshold, and
those of the background per pixel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError
from imodbatch.core.matching import OUTCOME_NAMES
from imodbatch.core.precision import ap_area, ap_voc07_11pt
from imodbatch.core.scoring import (
    Candidates,
    ScoredBoxes,
    Truth,
    average_precisions,
    mean_over_classes,
)
from imodbatch.core.tuning import Counts, tune
from imodbatch.scoring.background import background_per_pixel
from imodbatch.settings.config import MatchingConfig, MetricsConfig
from imodbatch.tables.columns import (
    StageResult,
    candidates_of,
    codes,
    column,
    image_numbers,
    truth_of,
)
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import (
    BACKGROUND_CLASS_ID,
    DETECTIONS,
    MEAN_CLASS_ID,
    METRICS,
    SEVERAL_IOUS,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
CocoAp = Callable[[Candidates, Array, Truth, int], Array]
AP_BY_NAME = {"ap_voc07_11pt": ap_voc07_11pt, "ap_area": ap_area}


def run(
    frames: pa.Table,
    annotations: pa.Table,
    detections: pa.Table,
    matches: pa.Table,
    classes: Sequence[str],
    coco_ap: CocoAp,
    matching: MatchingConfig,
    config: MetricsConfig,
) -> StageResult:
    """Every metric of a run, from the rows of `matches`.

    Args:
        frames: all frames of the run; likewise the other tables.
        annotations: what is true.
        detections: the boxes behind `matches`.
        matches: the outcome of each box, class, method and IoU.
        classes: names by class id.
        coco_ap: AP@[.5:.95] per class from candidates, scores and truth.
        matching: how `matches` came about; its first IoU is the one of AP over several.
        config: metrics, and how thresholds are tuned.

    Raises:
        ConfigError: `threshold_sequences` names a sequence that the run does not have, or all.
    """
    tuning = config.threshold_sequences
    ground = _Ground(frames, annotations, detections, len(classes), tuning)
    _check_tuning(tuning, ground.sequence_ids.to_pylist())
    by_key = [(name, "ascending") for name in DETECTIONS.key]
    matches = matches.sort_by([("score", "descending"), *by_key])
    rows: list[dict[str, Any]] = []
    for method in sorted(pc.unique(matches["method"]).to_pylist()):
        of_method = matches.filter(pc.equal(matches["method"], method))
        for iou_percent in matching.iou_percents:
            found = of_method.filter(pc.equal(of_method["iou_percent"], iou_percent))
            figures = _Figures(rows, method, iou_percent, classes)
            _add_average_precisions(figures, ground, found, config)
            _add_operating_points(figures, ground, found, config)
        if "ap_coco" in config.names:
            first = of_method.filter(pc.equal(of_method["iou_percent"], matching.iou_percents[0]))
            figures = _Figures(rows, method, SEVERAL_IOUS, classes)
            behind = Counts.of(ground.scored(first), ground.n_annotations.sum(axis=1))
            values = _over_several_ious(ground, first, coco_ap)
            figures.add_classes_and_mean("ap_coco", values, behind)
    n_counted = int(ground.n_annotations.sum())
    summary = f"{len(rows):,} metrics from {matches.num_rows:,} matches, "
    summary += f"{n_counted:,} annotations that count"
    no_truth = "no annotation counts: there is no AP. Give [annotations] in the manifest."
    return StageResult(
        {"metrics": from_rows(METRICS, rows)},
        summary,
        [] if n_counted else [no_truth],
        {"classes": list(classes), "threshold_step": config.threshold_step},
    )


@dataclass(frozen=True)
class _Ground:
    """What all methods are held against: the tables of a run, K classes in S sequences."""

    frames: pa.Table
    annotations: pa.Table
    detections: pa.Table
    n_classes: int
    threshold_sequences: tuple[str, ...]

    @cached_property
    def sequence_ids(self) -> pa.Array:
        """(S,)."""
        return pc.unique(self.frames["sequence_id"])

    @cached_property
    def n_annotations(self) -> Ints:
        """(K, S) that count."""
        counted = self.annotations.filter(pc.invert(self.annotations["is_ignored"]))
        found = np.zeros((self.n_classes, len(self.sequence_ids)), dtype=np.int64)
        np.add.at(found, (column(counted, "class_id"), self.sequence_of(counted)), 1)
        return found

    @cached_property
    def is_tuned_on(self) -> NDArray[np.bool_]:
        """(S,) where thresholds are chosen: in the sequences named for it, else in all."""
        names = self.threshold_sequences or self.sequence_ids.to_pylist()
        return np.isin(self.sequence_ids.to_pylist(), names)

    @property
    def is_tested(self) -> NDArray[np.bool_]:
        """(S,) where they are judged: in the others, else in all."""
        return ~self.is_tuned_on if self.threshold_sequences else self.is_tuned_on

    def sequence_of(self, table: pa.Table) -> Ints:
        """(n,) ordinal of each row's sequence."""
        return codes(table["sequence_id"], self.sequence_ids)

    def tested(self, table: pa.Table) -> pa.Table:
        """The rows of sequences where thresholds are judged."""
        return table.filter(pa.array(self.is_tested[self.sequence_of(table)]))

    def scored(self, matches: pa.Table) -> ScoredBoxes:
        """The boxes of one method at one IoU, best first; those given are in rank order."""
        return ScoredBoxes.ranked(
            column(matches, "score").astype(np.float64),
            codes(matches["outcome"], OUTCOME_NAMES),
            column(matches, "class_id").astype(np.int64),
            self.sequence_of(matches),
        )


def _check_tuning(threshold_sequences: tuple[str, ...], known: list[str]) -> None:
    tuning = set(threshold_sequences)
    if tuning and not tuning < set(known):
        raise ConfigError(
            f"metrics.threshold_sequences {sorted(tuning)}: expected some, not all, of the run's "
            f"sequences {sorted(known)}."
        )


@dataclass(frozen=True)
class _Figures:
    """Adds to the rows of the metrics table those of one method and IoU."""

    rows: list[dict[str, Any]]
    method: str
    iou_percent: int
    classes: Sequence[str]

    def add(self, metric: str, class_id: int, value: float, n_true: int, n_found: int) -> None:
        """One figure; NaN becomes null."""
        self.rows.append(
            {
                "method": self.method,
                "class_id": class_id,
                "iou_percent": self.iou_percent,
                "metric": metric,
                "class_name": class_name(self.classes, class_id),
                "value": float(value) if np.isfinite(value) else None,
                "n_annotations": int(n_true),
                "n_detections": int(n_found),
            }
        )

    def add_classes(self, metric: str, values: Array, behind: Counts) -> None:
        """A figure per class (K,), beside the annotations and boxes behind it."""
        for k, value in enumerate(values):
            self.add(metric, k, value, behind.n_annotations[k], behind.n_kept[k])

    def add_classes_and_mean(self, metric: str, values: Array, behind: Counts) -> None:
        """The same, and the mean over the classes that have the figure."""
        self.add_classes(metric, values, behind)
        totals = behind.n_annotations.sum(), behind.n_kept.sum()
        self.add(metric, MEAN_CLASS_ID, mean_over_classes(values), *totals)


def class_name(classes: Sequence[str], class_id: int) -> str:
    """Name of a class, of the mean or of the background."""
    special = {MEAN_CLASS_ID: "mean", BACKGROUND_CLASS_ID: "background"}
    return special.get(class_id) or classes[class_id]


def _add_average_precisions(
    figures: _Figures, ground: _Ground, found: pa.Table, config: MetricsConfig
) -> None:
    """AP of each class that has annotations, over all sequences."""
    boxes = ground.scored(found)
    behind = Counts.of(boxes, ground.n_annotations.sum(axis=1))
    for metric, average_precision in AP_BY_NAME.items():
        if metric in config.names:
            values = average_precisions(boxes, behind.n_annotations, average_precision)
            figures.add_classes_and_mean(metric, values, behind)
    n_false = (behind.n_kept - behind.n_hits).astype(np.float64)
    figures.add_classes("n_false_positives", n_false, behind)


def _add_operating_points(
    figures: _Figures, ground: _Ground, found: pa.Table, config: MetricsConfig
) -> None:
    """Precision and recall at the threshold of largest F1, and of the background per pixel."""
    boxes, annotations = ground.scored(found), ground.n_annotations
    thresholds = tune(
        boxes.take(ground.is_tuned_on[boxes.sequence]),
        annotations[:, ground.is_tuned_on].sum(axis=1),
        config.threshold_step,
    )
    tested = boxes.take(ground.is_tested[boxes.sequence])
    behind = Counts.of(tested, annotations[:, ground.is_tested].sum(axis=1))
    kept = tested.take(tested.score >= thresholds[tested.class_id])
    # a class that is not tuned has no figures, as in `counts_at`
    point = Counts.of(kept, np.where(np.isnan(thresholds), 0, behind.n_annotations))
    figures.add_classes_and_mean("precision", point.precision, behind)
    figures.add_classes_and_mean("recall", point.recall, behind)
    figures.add_classes_and_mean("f1", point.f1, behind)
    figures.add_classes("threshold", thresholds, behind)
    tuned_on_test = float(not ground.threshold_sequences)
    figures.add("threshold_tuned_on_test", MEAN_CLASS_ID, tuned_on_test, 0, 0)

    reaches = column(found, "score") >= thresholds[column(found, "class_id")]
    kept_rows = ground.tested(found.filter(pa.array(reaches)))
    frames, true, detections = (
        ground.tested(table) for table in (ground.frames, ground.annotations, ground.detections)
    )
    precision, recall = background_per_pixel(frames, true, detections, kept_rows)
    for metric, value in (("precision", precision), ("recall", recall)):
        figures.add(
            metric, BACKGROUND_CLASS_ID, value, behind.n_annotations.sum(), kept_rows.num_rows
        )


def _over_several_ious(ground: _Ground, matches: pa.Table, coco_ap: CocoAp) -> Array:
    """AP@[.5:.95] of each class (K,)."""
    frames, annotations, detections = ground.frames, ground.annotations, ground.detections
    candidates = candidates_of(matches, detections, image_numbers(frames, matches))
    truth = truth_of(annotations, image_numbers(frames, annotations))
    scores = column(matches, "score").astype(np.float64)
    return coco_ap(candidates, scores, truth, ground.n_classes)
