"""Table 2 in full precision, one figure set per row, for CSV and Parquet."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from imodbatch.reporting.comparison import Comparison
from imodbatch.reporting.operating_points import TUNINGS, Table2Column
from imodbatch.reporting.paper import MARK, TABLE_2
from imodbatch.reporting.scores import class_rows
from imodbatch.reporting.table_2 import precision_recall
from imodbatch.tables.schemas import BACKGROUND_CLASS_ID

OURS = "ours"
FIGURES = pa.schema(
    [
        pa.field("source", pa.string(), nullable=False),  # ours, or the paper: other data
        pa.field("run", pa.string()),
        pa.field("grid", pa.string()),  # of the detector, elevations × azimuths
        pa.field("group", pa.string(), nullable=False),
        pa.field("column", pa.string(), nullable=False),
        pa.field("method", pa.string()),
        pa.field("tuning", pa.string()),
        pa.field("class_id", pa.int16()),  # -1 = mean, -2 = background, null = none of ours
        pa.field("class_name", pa.string(), nullable=False),
        pa.field("precision", pa.float64()),  # shares; null = undefined or not given
        pa.field("recall", pa.float64()),
        pa.field("ap_voc07_11pt", pa.float64()),
        pa.field("n_annotations", pa.int64()),
        pa.field("n_kept", pa.int64()),
        pa.field("n_true_positives", pa.int64()),
        pa.field("n_false_positives_any_score", pa.int64()),
    ]
)
THRESHOLDS = pa.schema(
    [
        pa.field("run", pa.string(), nullable=False),
        pa.field("grid", pa.string(), nullable=False),
        pa.field("method", pa.string(), nullable=False),
        pa.field("tuning", pa.string(), nullable=False),
        pa.field("class_id", pa.int16(), nullable=False),
        pa.field("class_name", pa.string(), nullable=False),
        pa.field("sequence_id", pa.string(), nullable=False),
        pa.field("threshold", pa.float64()),  # null = none could be tuned
    ]
)


def figures_table(comparison: Comparison, columns: Sequence[Table2Column]) -> pa.Table:
    """Every figure of ours and of the paper, as `FIGURES`."""
    classes = comparison.any_run.classes
    rows = [
        _figures(comparison, column, tuning, class_id, name)
        for column in columns
        for tuning in TUNINGS
        for class_id, name in class_rows(classes, with_background=True)
    ]
    return pa.Table.from_pylist([*rows, *_paper_rows(classes)], schema=FIGURES)


def thresholds_table(comparison: Comparison, columns: Sequence[Table2Column]) -> pa.Table:
    """The threshold of every class, column, tuning and sequence, as `THRESHOLDS`."""
    rows = [
        {
            **_origin(column),
            "tuning": tuning,
            "class_id": k,
            "class_name": name,
            "sequence_id": sequence_id,
            "threshold": _or_none(point.thresholds[k, s]),
        }
        for column in columns
        for tuning, point in column.points.items()
        for k, name in enumerate(comparison.any_run.classes)
        for s, sequence_id in enumerate(comparison.any_run.sequence_ids)
    ]
    return pa.Table.from_pylist(rows, schema=THRESHOLDS)


def _origin(column: Table2Column) -> dict[str, Any]:
    return {"run": column.run.folder.name, "grid": column.grid, "method": column.method}


def _figures(
    comparison: Comparison, column: Table2Column, tuning: str, class_id: int, name: str
) -> dict[str, Any]:
    point = column.points.get(tuning)
    precision, recall = precision_recall(point, class_id)
    row = {
        **_origin(column),
        **{"source": OURS, "group": column.group, "column": column.name, "tuning": tuning},
        **{"class_id": class_id, "class_name": name},
        **{"precision": _or_none(precision), "recall": _or_none(recall)},
    }
    if class_id != BACKGROUND_CLASS_ID:
        row |= {"ap_voc07_11pt": _or_none(column.ap(class_id))}
    if class_id < 0:
        return row
    return {
        **row,
        "n_annotations": comparison.n_counted(class_id),
        "n_kept": None if point is None else int(point.counts.n_kept[class_id]),
        "n_true_positives": None if point is None else int(point.counts.n_hits[class_id]),
        "n_false_positives_any_score": column.n_false_positives(class_id),
    }


def _paper_rows(classes: Sequence[str]) -> list[dict[str, Any]]:
    ids = {name: class_id for class_id, name in class_rows(classes, with_background=True)}
    return [
        {
            **{"source": MARK, "group": column.group, "column": column.name},
            **{"class_id": ids.get(name), "class_name": name},
            **{"precision": precision / 100, "recall": recall / 100},
            "ap_voc07_11pt": column.ap[name],
        }
        for column in TABLE_2
        for name, (precision, recall) in column.precision_recall.items()
    ]


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
