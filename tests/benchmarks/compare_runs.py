"""Whether two run folders hold the same tables: contents only, not provenance or versions.

    python tests/benchmarks/compare_runs.py RUN_DIR RUN_DIR [--tolerance 1e-9]

Prints a line per table that differs, with the columns and the largest difference, and a sum. Exits
with 1 where anything differs. It reads plain Parquet, so that runs of any two versions of the
package can be compared.
"""

import sys
from pathlib import Path

import click
import numpy as np
import pandas as pd
import pyarrow.parquet as pq


def tables_of(run: Path) -> dict[str, pd.DataFrame]:
    """``table/unit`` → rows."""
    return {
        f"{path.parent.name}/{path.stem}": pq.read_table(path, partitioning=None).to_pandas()
        for path in sorted(run.glob("*/[!.]*.parquet"))
    }


def differences(a: pd.DataFrame, b: pd.DataFrame, tolerance: float) -> list[str]:
    """What differs, in words; empty = nothing."""
    if list(a.columns) != list(b.columns):
        return [f"columns {sorted(set(a.columns) ^ set(b.columns))} are in one of them only"]
    if len(a) != len(b):
        return [f"{len(a):,} rows and {len(b):,}"]
    found = []
    for name in a.columns:
        left, right = a[name], b[name]
        if pd.api.types.is_float_dtype(left) and pd.api.types.is_float_dtype(right):
            x, y = left.to_numpy(), right.to_numpy()
            unlike = np.isnan(x) != np.isnan(y)
            gap = np.nanmax(np.abs(x - y), initial=0.0)
            if unlike.any() or gap > tolerance:
                found.append(f"{name} by up to {gap:.3g}, null in one only {unlike.sum()} times")
        else:
            n_unlike = sum(not _same(x, y) for x, y in zip(left, right, strict=True))
            if n_unlike:
                found.append(f"{name} in {n_unlike:,} of {len(a):,} rows")
    return found


def _same(x: object, y: object) -> bool:
    if isinstance(x, np.ndarray) and isinstance(y, np.ndarray):
        return np.array_equal(x, y)
    return bool(x == y) or (pd.isna(x) and pd.isna(y))  # type: ignore[call-overload]


@click.command()
@click.argument("first", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("second", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--tolerance", type=float, default=0.0, show_default=True, help="Of floats.")
def main(first: Path, second: Path, tolerance: float) -> None:
    """Compare the tables of two run folders."""
    a, b = tables_of(first), tables_of(second)
    n_unlike = 0
    for name in sorted(a.keys() | b.keys()):
        if name not in a or name not in b:
            found = [f"only in {first if name in a else second}"]
        else:
            found = differences(a[name], b[name], tolerance)
        n_unlike += bool(found)
        for text in found:
            click.echo(f"{name}: {text}")
    n_all = len(a.keys() | b.keys())
    click.echo(f"{n_all} tables = {n_all - n_unlike} the same + {n_unlike} different")
    sys.exit(bool(n_unlike))


if __name__ == "__main__":
    main()
