"""Figures as comma-separated text in full precision; what is unknown is an empty field."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import pyarrow as pa


def to_csv(
    head: Sequence[str], rows: Sequence[Sequence[object]] | Sequence[Mapping[str, Any]]
) -> str:
    """Rows under their headings; None and NaN are empty fields."""
    text: str = pd.DataFrame(list(rows), columns=list(head), dtype=object).to_csv(index=False)
    return text


def csv_of(table: pa.Table) -> str:
    """A table as it is; null is an empty field."""
    return to_csv(table.column_names, table.to_pylist())
