"""Questions to the metrics and matches of a run, answered by name, null where nothing is known."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.core.matching import OUTCOME_NAMES, Outcome
from imodbatch.core.precision import precision_recall, rank
from imodbatch.core.scoring import ScoredBoxes
from imodbatch.reporting.names import in_order
from imodbatch.tables.columns import codes
from imodbatch.tables.schemas import MEAN_CLASS_ID, SEVERAL_IOUS

USUAL_IOU_PERCENT = 50
TUNED_ON_TEST = "threshold_tuned_on_test"


@dataclass(frozen=True, eq=False)
class MatchColumns:
    """The matches of one method at one IoU, D of them; `sequence` counts in order of names.

    Attributes:
        annotation: (D,) ordinal of the matched annotation, -1 where there is none.
        outcome: (D,) values of `core.matching.Outcome`.
    """

    sequence: NDArray[np.int64]
    frame: NDArray[np.int64]
    detection: NDArray[np.int64]
    class_id: NDArray[np.int64]
    score: NDArray[np.float64]
    outcome: NDArray[np.int64]
    annotation: NDArray[np.int64]

    def take(self, rows: NDArray[Any]) -> "MatchColumns":
        """Some of the rows."""
        return MatchColumns(**{name: column[rows] for name, column in vars(self).items()})

    def scored(self) -> ScoredBoxes:
        """Those that count, best first; equal scores keep their order."""
        return ScoredBoxes.ranked(self.score, self.outcome, self.class_id, self.sequence)


@dataclass(frozen=True, eq=False)
class Curve:
    """Recall and precision of one method and class after each annotation found."""

    recall: NDArray[np.float64]
    precision: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Results:
    """The metrics, matches and annotations of a run.

    Attributes:
        tables: the run's tables by name.
        sequence_ids: every sequence of the run, sorted.
    """

    tables: Mapping[str, pa.Table]
    sequence_ids: tuple[str, ...]

    @cached_property
    def _metrics(self) -> dict[tuple[str, int, int, str], dict[str, Any]]:
        rows = self.tables["metrics"].to_pylist()
        return {(r["method"], r["class_id"], r["iou_percent"], r["metric"]): r for r in rows}

    @cached_property
    def methods(self) -> tuple[str, ...]:
        """Every method that has metrics or matches, in the order of display."""
        found = (pc.unique(self.tables[name]["method"]) for name in ("metrics", "matches"))
        return in_order(m for methods in found for m in methods.to_pylist())

    @cached_property
    def iou_percents(self) -> tuple[int, ...]:
        """The IoU limits in use, the headline's first: 50 if it is one of them."""
        found = {iou for _, _, iou, _ in self._metrics if iou != SEVERAL_IOUS}
        found |= set(pc.unique(self.tables["matches"]["iou_percent"]).to_pylist())
        return tuple(sorted(found, key=lambda p: (p != USUAL_IOU_PERCENT, p))) or (
            USUAL_IOU_PERCENT,
        )

    @property
    def main_iou(self) -> int:
        """The IoU limit of headline, curves and pictures."""
        return self.iou_percents[0]

    def has(self, metric: str, iou_percent: int) -> bool:
        """Whether the metrics table speaks of this metric at all."""
        return any(key[2:] == (iou_percent, metric) for key in self._metrics)

    def value(
        self, method: str, class_id: int, metric: str, iou_percent: int | None = None
    ) -> float | None:
        """A figure of the metrics table; None where it is absent, null or NaN."""
        iou_percent = self.main_iou if iou_percent is None else iou_percent
        row = self._metrics.get((method, class_id, iou_percent, metric))
        value = None if row is None else row["value"]
        return None if value is None or math.isnan(value) else float(value)

    def is_tuned_on_test(self) -> bool | None:
        """Whether thresholds were tuned on the sequences evaluated; None if nobody says."""
        values = [
            row["value"]
            for (_, class_id, _, metric), row in self._metrics.items()
            if metric == TUNED_ON_TEST and class_id == MEAN_CLASS_ID and row["value"] is not None
        ]
        return bool(max(values)) if values else None

    @cached_property
    def annotations(self) -> pa.Table:
        """The annotations that count: those that are neither ignored nor of a crowd."""
        table = self.tables["annotations"]
        return table.filter(pc.invert(pc.or_(table["is_ignored"], table["is_crowd"])))

    def n_annotations(self, class_id: int) -> int:
        """Annotations of a class that count, over all sequences."""
        return int(pc.sum(pc.equal(self.annotations["class_id"], class_id)).as_py() or 0)

    def n_evaluated(self, class_id: int) -> int:
        """Annotations of a class behind its metrics; those of all sequences if there are none."""
        counts = [row["n_annotations"] for key, row in self._metrics.items() if key[1] == class_id]
        return max(counts) if counts else self.n_annotations(class_id)

    def n_false_positives(self, method: str, class_id: int) -> int:
        """False positives of a class at any score: from the metrics, else counted."""
        value = self.value(method, class_id, "n_false_positives")
        if value is not None:
            return round(value)
        table = self.tables["matches"]
        is_one = (
            (pc.field("method") == method)
            & (pc.field("class_id") == class_id)
            & (pc.field("iou_percent") == self.main_iou)
            & (pc.field("outcome") == OUTCOME_NAMES[Outcome.FALSE_POSITIVE])
        )
        return int(table.filter(is_one).num_rows)

    def matches(self, method: str) -> MatchColumns:
        """The matches of a method at the main IoU."""
        chosen = (pc.field("method") == method) & (pc.field("iou_percent") == self.main_iou)
        table = self.tables["matches"].filter(chosen)
        return MatchColumns(
            sequence=codes(table["sequence_id"], self.sequence_ids),
            frame=_integers(table["frame_index"]),
            detection=_integers(table["detection_index"]),
            class_id=_integers(table["class_id"]),
            score=table["score"].to_numpy().astype(np.float64),
            outcome=codes(table["outcome"], OUTCOME_NAMES),
            annotation=_integers(pc.fill_null(table["annotation_index"], -1)),
        )

    def kept(self, method: str) -> MatchColumns:
        """The matches of a method whose score reaches its tuned threshold for the class."""
        matches = self.matches(method)
        limits = np.full(int(matches.class_id.max(initial=-1)) + 1, np.inf)
        for class_id in range(len(limits)):
            threshold = self.value(method, class_id, "threshold")
            limits[class_id] = np.inf if threshold is None else threshold
        return matches.take(matches.score >= limits[matches.class_id])


def curve(matches: MatchColumns, class_id: int, n_annotations: int) -> Curve:
    """The curve of one class: ranked by score, ties by sequence, frame and detection.

    Ignored detections are left out. Only the points where an annotation is found are kept: between
    two of them precision falls and recall stands still.
    """
    counts = (matches.class_id == class_id) & (matches.outcome != Outcome.IGNORED)
    rows = matches.take(counts)
    order = rank(rows.score, rows.sequence, rows.frame, rows.detection)
    is_right = rows.outcome[order] == Outcome.TRUE_POSITIVE
    precision, recall = precision_recall(is_right, n_annotations)
    return Curve(recall[is_right], precision[is_right])


def centers_from_above(poses: pa.Table) -> NDArray[np.float64]:
    """Camera centres (m, 2), NaN where there is no pose."""
    columns = [poses[name].to_numpy().astype(np.float64) for name in ("tx_m", "ty_m")]
    return np.stack(columns, axis=-1)


def _integers(column: pa.ChunkedArray) -> NDArray[np.int64]:
    return np.asarray(column.to_numpy(), dtype=np.int64)
