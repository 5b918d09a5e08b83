"""score: fused boxes held against the annotations → matches, and from their rows every metric.

`match` works per sequence and writes what became of each box under each method. `summarise` pools
the sequences: AP per class and mean, precision and recall at the tuned threshold, and the
background per pixel (Konno et al. 2020, Tables 1 and 2).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError
from imodbatch.core.matching import OUTCOME_NAMES
from imodbatch.core.precision import ap_area, ap_voc07_11pt
from imodbatch.core.scoring import Candidates, Truth, match_all, mean_over_classes, ranked_hits
from imodbatch.core.tuning import tune_threshold
from imodbatch.scoring.background import background_per_pixel
from imodbatch.settings.config import MatchingConfig, MetricsConfig
from imodbatch.tables.columns import StageResult, boxes_of, column, image_numbers, tally, truth_of
from imodbatch.tables.parquet import empty, from_columns, from_rows
from imodbatch.tables.schemas import (
    BACKGROUND_CLASS_ID,
    FUSED,
    MATCHES,
    MEAN_CLASS_ID,
    METRICS,
    SEVERAL_IOUS,
)

Array = NDArray[np.float64]
CocoAp = Callable[[Candidates, Array, Truth, int], Array]
AP_BY_NAME = {"ap_voc07_11pt": ap_voc07_11pt, "ap_area": ap_area}


def match(
    fused: pa.Table, detections: pa.Table, annotations: pa.Table, config: MatchingConfig
) -> StageResult:
    """Match the boxes of one sequence under every method and IoU."""
    truth = truth_of(annotations, column(annotations, "frame_index"))
    own_index = column(annotations, "annotation_index")
    parts, counts = [], dict.fromkeys(OUTCOME_NAMES, 0)
    for name in pc.unique(fused["method"]).to_pylist():
        rows = fused.filter(pc.equal(fused["method"], name))
        candidates = _candidates(rows, detections)
        scores = column(rows, "score").astype(np.float64)
        for iou_percent in config.iou_percents:
            found = match_all(candidates, scores, truth, iou_percent / 100, config.rule)
            outcome = np.array(OUTCOME_NAMES)[found.outcome]
            hit = found.annotation_index >= 0
            index = np.zeros(len(hit), dtype=np.int64)
            index[hit] = own_index[found.annotation_index[hit]]
            columns: dict[str, Any] = {key: rows[key] for key in FUSED.key}
            columns |= {
                "iou_percent": [iou_percent] * len(hit),
                "score": rows["score"],
                "outcome": outcome.tolist(),
                "annotation_index": pa.array(index, mask=~hit),
                "iou": pa.array(found.iou, mask=np.isnan(found.iou)),
            }
            parts.append(from_columns(MATCHES, columns))
            for outcome_name in OUTCOME_NAMES:
                counts[outcome_name] += int((outcome == outcome_name).sum())
    table = pa.concat_tables(parts) if parts else empty(MATCHES)
    return StageResult({"matches": table}, tally(table.num_rows, "matches", counts))


def _candidates(rows: pa.Table, detections: pa.Table) -> Candidates:
    """Fused rows of one sequence with the boxes of their detections."""
    frame, index = column(rows, "frame_index"), column(rows, "detection_index")
    boxes = boxes_of(detections)
    position = {
        key: i
        for i, key in enumerate(
            zip(
                column(detections, "frame_index").tolist(),
                column(detections, "detection_index").tolist(),
                strict=True,
            )
        )
    }
    at = [position[key] for key in zip(frame.tolist(), index.tolist(), strict=True)]
    return Candidates(
        frame.astype(np.int64), column(rows, "class_id").astype(np.int64), boxes[at].reshape(-1, 4)
    )


@dataclass(frozen=True)
class ClassHits:
    """One class under one method: ranked scores, hits, and annotations that count."""

    scores: Array
    hits: NDArray[np.bool_]
    n_annotations: int


def summarise(
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
    matches = _in_rank_order(matches)
    is_tuning = _tuning_rows(frames, config)
    rows: list[dict[str, Any]] = []
    n_classes = len(classes)
    for method in sorted(pc.unique(matches["method"]).to_pylist()):
        of_method = matches.filter(pc.equal(matches["method"], method))
        for iou_percent in matching.iou_percents:
            found = of_method.filter(pc.equal(of_method["iou_percent"], iou_percent))
            builder = _MetricRows(method, iou_percent, classes)
            everything = _hits(found, annotations, n_classes)
            builder.add_ap(everything, config)
            builder.add_operating_points(found, annotations, frames, detections, is_tuning, config)
            rows += builder.rows
        if "ap_coco" in config.names:
            first = of_method.filter(pc.equal(of_method["iou_percent"], matching.iou_percents[0]))
            rows += _coco_rows(method, first, frames, annotations, detections, classes, coco_ap)
    table = from_rows(METRICS, rows) if rows else empty(METRICS)
    n_counted = annotations.num_rows - (pc.sum(annotations["is_ignored"]).as_py() or 0)
    summary = f"{table.num_rows:,} metrics from {matches.num_rows:,} matches, "
    summary += f"{n_counted:,} annotations that count"
    attributes = {"classes": list(classes), "threshold_step": config.threshold_step}
    return StageResult({"metrics": table}, summary, _no_truth_warning(n_counted), attributes)


def _no_truth_warning(n_counted: int) -> list[str]:
    if n_counted:
        return []
    return ["no annotation counts: there is no AP. Give [annotations] in the manifest."]


def _in_rank_order(matches: pa.Table) -> pa.Table:
    """By score descending; ties by sequence, frame and detection, ascending."""
    keys = [(name, "ascending") for name in ("sequence_id", "frame_index", "detection_index")]
    return matches.sort_by([("score", "descending"), *keys])


def _tuning_rows(frames: pa.Table, config: MetricsConfig) -> set[str] | None:
    """Sequences on which thresholds are tuned; None = on those that are evaluated."""
    if not config.threshold_sequences:
        return None
    known = set(pc.unique(frames["sequence_id"]).to_pylist())
    tuning = set(config.threshold_sequences)
    if not tuning <= known or tuning == known:
        raise ConfigError(
            f"metrics.threshold_sequences {sorted(tuning)}: expected some, not all, of the run's "
            f"sequences {sorted(known)}."
        )
    return tuning


def _in_sequences(table: pa.Table, sequences: set[str] | None, inside: bool) -> pa.Table:
    if sequences is None:
        return table
    chosen = pc.is_in(table["sequence_id"], value_set=pa.array(sorted(sequences), pa.string()))
    return table.filter(chosen if inside else pc.invert(chosen))


def _hits(matches: pa.Table, annotations: pa.Table, n_classes: int) -> list[ClassHits]:
    """Ranked hits per class; `matches` is in rank order."""
    counted = annotations.filter(pc.invert(annotations["is_ignored"]))
    n_annotations = np.bincount(column(counted, "class_id"), minlength=n_classes)
    class_id = column(matches, "class_id")
    scores = column(matches, "score").astype(np.float64)
    codes = np.zeros(matches.num_rows, dtype=np.int8)
    for code, name in enumerate(OUTCOME_NAMES):
        codes[np.asarray(pc.equal(matches["outcome"], name))] = code
    found = []
    for k in range(n_classes):
        ranked, hits = ranked_hits(scores[class_id == k], codes[class_id == k])
        found.append(ClassHits(ranked, hits, int(n_annotations[k])))
    return found


class _MetricRows:
    """Rows of the metrics table for one method and IoU."""

    def __init__(self, method: str, iou_percent: int, classes: Sequence[str]) -> None:
        self.method, self.iou_percent, self.classes = method, iou_percent, classes
        self.rows: list[dict[str, Any]] = []

    def add(
        self, metric: str, class_id: int, value: float | None, n_annotations: int, n_found: int
    ) -> None:
        """One figure; NaN becomes null."""
        known = value is not None and np.isfinite(value)
        self.rows.append(
            {
                "method": self.method,
                "class_id": class_id,
                "iou_percent": self.iou_percent,
                "metric": metric,
                "class_name": class_name(self.classes, class_id),
                "value": float(value) if known else None,  # type: ignore[arg-type]
                "n_annotations": n_annotations,
                "n_detections": n_found,
            }
        )

    def add_per_class(self, metric: str, values: Sequence[float], hits: list[ClassHits]) -> None:
        """A figure per class and its mean over the classes that have it."""
        for k, value in enumerate(values):
            self.add(metric, k, value, hits[k].n_annotations, len(hits[k].hits))
        mean = mean_over_classes(np.array(values, dtype=np.float64))
        totals = sum(h.n_annotations for h in hits), sum(len(h.hits) for h in hits)
        self.add(metric, MEAN_CLASS_ID, mean, *totals)

    def add_ap(self, hits: list[ClassHits], config: MetricsConfig) -> None:
        """AP of each class that has annotations."""
        for metric, average_precision in AP_BY_NAME.items():
            if metric not in config.names:
                continue
            values = [average_precision(h.hits, h.n_annotations) for h in hits]
            self.add_per_class(metric, [np.nan if v is None else v for v in values], hits)
        for k, h in enumerate(hits):
            n_false = float((~h.hits).sum())
            self.add("n_false_positives", k, n_false, h.n_annotations, len(h.hits))

    def add_operating_points(
        self,
        found: pa.Table,
        annotations: pa.Table,
        frames: pa.Table,
        detections: pa.Table,
        tuning: set[str] | None,
        config: MetricsConfig,
    ) -> None:
        """Precision and recall at the threshold of largest F1, and of the background per pixel."""
        n_classes = len(self.classes)
        tuned = _hits(
            _in_sequences(found, tuning, True),
            _in_sequences(annotations, tuning, True),
            n_classes,
        )
        found, annotations, frames, detections = (
            _in_sequences(table, tuning, False)
            for table in (found, annotations, frames, detections)
        )
        tested = _hits(found, annotations, n_classes)
        step = config.threshold_step
        thresholds = [tune_threshold(h.scores, h.hits, h.n_annotations, step) for h in tuned]
        points = [_operating_point(h, t) for h, t in zip(tested, thresholds, strict=True)]
        for i, metric in enumerate(("precision", "recall", "f1")):
            self.add_per_class(metric, [point[i] for point in points], tested)
        for k, threshold in enumerate(thresholds):
            h = tested[k]
            self.add("threshold", k, threshold, h.n_annotations, len(h.hits))
        tuned_on_test = float(tuning is None)
        self.add("threshold_tuned_on_test", MEAN_CLASS_ID, tuned_on_test, 0, 0)
        kept = _above(found, thresholds)
        precision, recall = background_per_pixel(frames, annotations, detections, kept)
        n_counted = sum(h.n_annotations for h in tested)
        for metric, value in (("precision", precision), ("recall", recall)):
            self.add(metric, BACKGROUND_CLASS_ID, value, n_counted, kept.num_rows)


def class_name(classes: Sequence[str], class_id: int) -> str:
    """Name of a class, of the mean or of the background."""
    special = {MEAN_CLASS_ID: "mean", BACKGROUND_CLASS_ID: "background"}
    return special.get(class_id) or classes[class_id]


def _operating_point(hits: ClassHits, threshold: float) -> tuple[float, float, float]:
    """Precision, recall and F1 at a threshold; NaN without annotations or without a threshold."""
    if hits.n_annotations == 0 or np.isnan(threshold):
        return (float("nan"),) * 3
    kept = hits.hits[hits.scores >= threshold]
    precision = float(kept.mean()) if len(kept) else float("nan")
    recall = float(kept.sum() / hits.n_annotations)
    denominator = len(kept) + hits.n_annotations
    return precision, recall, float(2 * kept.sum() / denominator)


def _above(found: pa.Table, thresholds: Sequence[float]) -> pa.Table:
    """Rows whose score reaches their class's threshold."""
    limit = np.array(thresholds)[column(found, "class_id")] if found.num_rows else np.zeros(0)
    return found.filter(pa.array(column(found, "score") >= limit))


def _coco_rows(
    method: str,
    matches: pa.Table,
    frames: pa.Table,
    annotations: pa.Table,
    detections: pa.Table,
    classes: Sequence[str],
    coco_ap: CocoAp,
) -> list[dict[str, Any]]:
    """AP@[.5:.95], by faster-coco-eval."""
    joined = matches.join(
        detections.drop_columns(["view_scores", "class_ids", "background_score"]),
        keys=["sequence_id", "frame_index", "detection_index"],
    )
    joined = _in_rank_order(joined)
    candidates = Candidates(
        image_numbers(frames, joined),
        column(joined, "class_id").astype(np.int64),
        boxes_of(joined),
    )
    truth = truth_of(annotations, image_numbers(frames, annotations))
    scores = column(joined, "score").astype(np.float64)
    values = coco_ap(candidates, scores, truth, len(classes))
    builder = _MetricRows(method, SEVERAL_IOUS, classes)
    builder.add_per_class("ap_coco", list(values), _hits(matches, annotations, len(classes)))
    return builder.rows
