"""Tables of a run as its folder holds them, and which stage to run where one is missing."""

from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa

from imodbatch.core.errors import TableError
from imodbatch.run.plan import Plan
from imodbatch.run.step import Step, Tables
from imodbatch.run.steps import STEPS
from imodbatch.tables.parquet import (
    PER_RUN,
    Stored,
    TableInfo,
    read_info,
    read_stored,
    table_path,
)
from imodbatch.tables.schemas import TABLES

Identities = dict[str, dict[str, str]]
"""Of tables, by name and then by sequence or `PER_RUN`."""


def load(plan: Plan, table: str, columns: list[str] | None = None) -> pa.Table:
    """A table of all chosen sequences, or of the run.

    Raises:
        TableError: it is not there, or damaged.
    """
    return _joined(_open(plan, table).values(), columns)


def read_inputs(part: Plan, step: Step) -> tuple[Tables, Identities]:
    """The tables that a step reads, and the identities of the files that they are from."""
    tables, identities = {}, {}
    for name in step.reads:
        stored = _open(part, name)
        tables[name] = _joined(stored.values())
        identities[name] = {unit: one.info.digest for unit, one in stored.items()}
    return tables, identities


def input_identities(part: Plan, step: Step) -> Identities:
    """The same identities, without reading a row."""
    return {
        name: {unit: _info(path, name).digest for unit, path in _paths(part, name).items()}
        for name in step.reads
    }


def output_paths(part: Plan, step: Step) -> list[Path]:
    """Where the tables lie that a step writes."""
    unit = PER_RUN if step.per_run else part.sequence.id
    return [table_path(part.run_dir, name, unit) for name in step.writes]


def _paths(part: Plan, table: str) -> dict[str, Path]:
    """The files of a table by sequence, or the run's."""
    units = [PER_RUN] if TABLES[table].per_run else [s.id for s in part.sequences]
    return {unit: table_path(part.run_dir, table, unit) for unit in units}


def _open(part: Plan, table: str) -> dict[str, Stored]:
    """The parts of a table by unit, each read once."""
    paths = _paths(part, table)
    for path in paths.values():
        _info(path, table)
    return {unit: read_stored(path, TABLES[table]) for unit, path in paths.items()}


def _joined(parts: Iterable[Stored], columns: list[str] | None = None) -> pa.Table:
    rows = [part.rows.select(columns or part.rows.column_names) for part in parts]
    return pa.concat_tables(rows).combine_chunks()


def _info(path: Path, table: str) -> TableInfo:
    """A table's metadata; where there is none, the error says which stage writes it."""
    info = read_info(path)
    if info is None:
        stage = next(step.stage for step in STEPS if table in step.writes)
        fault = "damaged" if path.exists() else "no such table"
        raise TableError(f"{path}: {fault}. Run `imodbatch {stage}` or `imodbatch run` first.")
    return info
