"""metrics: from what became of each box, every figure of a run (Konno et al. 2020, Tables 1, 2).

The sequences are pooled: AP per class and mean, precision and recall at the tuned threshold, and
those of the background per pixel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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
    ground = _Ground.of(frames, annotations, detections, classes, config)
    by_key = [(name, "ascending") for name in DETECTIONS.key]
    matches = matches.sort_by([("score", "descending"), *by_key])
    rows: list[dict[str, Any]] = []
    for method in sorted(pc.unique(matches["method"]).to_pylist()):
        of_method = matches.filter(pc.equal(matches["method"], method))
        for iou_percent in matching.iou_percents:
            found = of_method.filter(pc.equal(of_method["iou_percent"], iou_percent))
            figures = _Figures(method, iou_percent, classes)
            _add_average_precisions(figures, ground, found, config)
            _add_operating_points(figures, ground, found, config)
            rows += figures.rows
        if "ap_coco" in config.names:
            first = of_method.filter(pc.equal(of_method["iou_percent"], matching.iou_percents[0]))
            figures = _Figures(method, SEVERAL_IOUS, classes)
            figures.add_classes_and_mean(
                "ap_coco",
                _over_several_ious(ground, first, coco_ap),
                Counts.of(ground.scored(first), ground.n_annotations.sum(axis=1)),
            )
            rows += figures.rows
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
    """What all methods are held against.

    Attributes:
        sequence_ids: S of them.
        n_annotations: (K, S) that count.
        is_tuned_on: (S,) where thresholds are chosen.
        is_tested: (S,) where they are judged.
    """

    frames: pa.Table
    annotations: pa.Table
    detections: pa.Table
    sequence_ids: pa.Array
    n_annotations: Ints
    is_tuned_on: NDArray[np.bool_]
    is_tested: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        frames: pa.Table,
        annotations: pa.Table,
        detections: pa.Table,
        classes: Sequence[str],
        config: MetricsConfig,
    ) -> "_Ground":
        """Count the annotations, and part the sequences."""
        sequence_ids = pc.unique(frames["sequence_id"])
        counted = annotations.filter(pc.invert(annotations["is_ignored"]))
        n_annotations = np.zeros((len(classes), len(sequence_ids)), dtype=np.int64)
        sequence = codes(counted["sequence_id"], sequence_ids)
        np.add.at(n_annotations, (column(counted, "class_id"), sequence), 1)
        is_tuned_on, is_tested = _parts(sequence_ids.to_pylist(), config)
        tables = (frames, annotations, detections)
        return cls(*tables, sequence_ids, n_annotations, is_tuned_on, is_tested)

    def scored(self, matches: pa.Table) -> ScoredBoxes:
        """The boxes of one method at one IoU, best first; those given are in rank order."""
        return ScoredBoxes.ranked(
            column(matches, "score").astype(np.float64),
            codes(matches["outcome"], OUTCOME_NAMES),
            column(matches, "class_id").astype(np.int64),
            codes(matches["sequence_id"], self.sequence_ids),
        )

    def tested(self, table: pa.Table) -> pa.Table:
        """The rows of sequences where thresholds are judged."""
        return table.filter(
            pa.array(self.is_tested[codes(table["sequence_id"], self.sequence_ids)])
        )


def _parts(known: list[str], config: MetricsConfig) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Sequences (S,) to tune thresholds on, and those to judge them on; all for both by default."""
    tuning = set(config.threshold_sequences)
    is_tuned_on = np.isin(known, sorted(tuning)) if tuning else np.ones(len(known), dtype=np.bool_)
    if not tuning:
        return is_tuned_on, is_tuned_on
    if not tuning <= set(known) or is_tuned_on.all():
        raise ConfigError(
            f"metrics.threshold_sequences {sorted(tuning)}: expected some, not all, of the run's "
            f"sequences {sorted(known)}."
        )
    return is_tuned_on, ~is_tuned_on


@dataclass(frozen=True)
class _Figures:
    """Rows of the metrics table for one method and IoU."""

    method: str
    iou_percent: int
    classes: Sequence[str]
    rows: list[dict[str, Any]] = field(default_factory=list)

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
    tuned_on_test = float(ground.is_tested is ground.is_tuned_on)
    figures.add("threshold_tuned_on_test", MEAN_CLASS_ID, tuned_on_test, 0, 0)

    reaches = column(found, "score") >= thresholds[column(found, "class_id")]
    kept_rows = ground.tested(found.filter(pa.array(reaches)))
    frames, true, detections = (
        ground.tested(table) for table in (ground.frames, ground.annotations, ground.detections)
    )
    precision, recall = background_per_pixel(frames, true, detections, kept_rows)
    for metric, value in (("precision", precision), ("recall", recall)):
        figures.add(metric, BACKGROUND_CLASS_ID, value, behind.n_annotations.sum(), kept_rows.num_rows)


def _over_several_ious(ground: _Ground, matches: pa.Table, coco_ap: CocoAp) -> Array:
    """AP@[.5:.95] of each class (K,)."""
    frames, annotations, detections = ground.frames, ground.annotations, ground.detections
    candidates = candidates_of(matches, detections, image_numbers(frames, matches))
    truth = truth_of(annotations, image_numbers(frames, annotations))
    scores = column(matches, "score").astype(np.float64)
    return coco_ap(candidates, scores, truth, len(ground.n_annotations))
