"""Parquet tables on disk: checked against their schema, written whole or not at all, with a past.

The file's metadata holds the table's name, schema version and key, the provenance (all that the
content depends on) and the stage's summary. Equal provenance means: up to date.
"""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from imodbatch.core.errors import TableError
from imodbatch.tables.atomic import replacing
from imodbatch.tables.schemas import TableSpec

ARROW_ERRORS = (
    pa.ArrowInvalid,
    pa.ArrowTypeError,
    pa.ArrowNotImplementedError,
    OverflowError,
    ValueError,
)
UNREADABLE = (pa.ArrowInvalid, KeyError, TypeError, ValueError)
METADATA_KEY = b"imodbatch"
PER_RUN = "run"


@dataclass(frozen=True)
class TableInfo:
    """What a table's metadata says.

    Attributes:
        provenance: everything the content depends on.
        summary: one line that adds up.
        attributes: figures of the stage worth keeping that are not rows.
    """

    table: str
    version: int
    key: tuple[str, ...]
    provenance: dict[str, Any] = field(default_factory=dict)
    summary: str = ""
    attributes: dict[str, Any] = field(default_factory=dict)

    @property
    def inputs(self) -> dict[str, dict[str, str]]:
        """Table → sequence → identity of the tables that it was made from."""
        return dict(self.provenance.get("inputs", {}))

    @property
    def digest(self) -> str:
        """Digest of table name, version and provenance: the table's identity."""
        return digest([self.table, self.version, self.provenance])


@dataclass(frozen=True)
class Stored:
    """What one file held: `info` is of these `rows` and no others."""

    info: TableInfo
    rows: pa.Table


def digest(value: object) -> str:
    """SHA-256 of a JSON-like value."""
    text = json.dumps(value, sort_keys=True, ensure_ascii=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def table_path(run_dir: Path, table: str, sequence_id: str = PER_RUN) -> Path:
    """Where a table of a run lies."""
    return run_dir / table / f"{sequence_id}.parquet"


def conform(table: pa.Table, spec: TableSpec) -> pa.Table:
    """The table in its schema's columns and types.

    Raises:
        TableError: a column is missing or foreign, has nulls it may not have, or a key repeats.
    """
    missing = [name for name in spec.schema.names if name not in table.column_names]
    foreign = [name for name in table.column_names if name not in spec.schema.names]
    if missing or foreign:
        raise TableError(f"table {spec.name}: columns missing {missing}, foreign {foreign}.")
    with _naming(spec):
        table = table.select(spec.schema.names).cast(spec.schema)
    for column in spec.schema:
        if not column.nullable and table[column.name].null_count:
            raise TableError(f"table {spec.name}: {column.name} may not be null.")
    key = table.select(list(spec.key))
    if key.num_rows and key.group_by(list(spec.key)).aggregate([]).num_rows < key.num_rows:
        counts = key.group_by(list(spec.key)).aggregate([([], "count_all")])
        double = counts.filter(pc.greater(counts["count_all"], 1)).drop_columns("count_all")
        double = double.slice(0, 1).to_pylist()[0]
        raise TableError(f"table {spec.name}: the key {double} stands more than once.")
    return table


def empty(spec: TableSpec) -> pa.Table:
    """A table without rows."""
    return spec.schema.empty_table()


def from_columns(spec: TableSpec, columns: dict[str, Any]) -> pa.Table:
    """A table from arrays or lists, cast to its schema."""
    with _naming(spec):
        arrays = {f.name: _array(columns[f.name], f.type) for f in spec.schema if f.name in columns}
        return conform(pa.table(arrays), spec)


@contextmanager
def _naming(spec: TableSpec) -> Iterator[None]:
    """Arrow's errors as one line that names the table."""
    try:
        yield
    except ARROW_ERRORS as error:
        raise TableError(f"table {spec.name}: {str(error).splitlines()[0]}.") from None


def _array(values: Any, dtype: pa.DataType) -> pa.Array:
    if isinstance(values, (pa.Array, pa.ChunkedArray)):
        return values.cast(dtype)
    return pa.array(values, type=dtype)


def from_rows(spec: TableSpec, rows: list[dict[str, Any]]) -> pa.Table:
    """A table from dictionaries, one per row; absent keys are null."""
    with _naming(spec):
        return conform(pa.Table.from_pylist(rows, schema=spec.schema), spec)


def write_table(path: Path, table: pa.Table, info: TableInfo) -> None:
    """Write a table so that a reader finds the old file or the new one, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = {"key": list(info.key), "digest": info.digest, **asdict(info)}
    metadata = {METADATA_KEY: json.dumps(stored, ensure_ascii=False, default=str).encode()}
    with replacing(path) as file:
        pq.write_table(
            table.replace_schema_metadata({**(table.schema.metadata or {}), **metadata}),
            file,
            compression="zstd",
            write_page_checksum=True,
        )


def read_info(path: Path) -> TableInfo | None:
    """A table's metadata, or None when there is no such table or it cannot be read."""
    try:
        return _info(pq.read_schema(path))
    except (OSError, *UNREADABLE):
        return None


def _info(schema: pa.Schema) -> TableInfo:
    """What a file's schema says; one of `UNREADABLE` where it is no table of ours."""
    stored = json.loads((schema.metadata or {})[METADATA_KEY])
    names = ("table", "version", "key", "provenance", "summary", "attributes")
    values = {name: stored[name] for name in names}
    return TableInfo(**{**values, "key": tuple(values["key"])})


def attributes_of(table: pa.Table) -> dict[str, Any]:
    """The stage's figures that came with a table as it was read; of several, those of the first."""
    stored = (table.schema.metadata or {}).get(METADATA_KEY, b"{}")
    return dict(json.loads(stored).get("attributes", {}))


def read_table(path: Path, spec: TableSpec) -> pa.Table:
    """Read and check a table's rows; see `read_stored`."""
    return read_stored(path, spec).rows


def read_stored(path: Path, spec: TableSpec) -> Stored:
    """Read and check a table; metadata and rows are of one file, even if it is replaced meanwhile.

    Raises:
        TableError: it is missing, damaged, or of another schema version.
    """
    try:
        file = path.open("rb")
    except FileNotFoundError:
        raise TableError(
            f"{path}: no such table. Run the stage before this one first, or `imodbatch run`."
        ) from None
    with file:
        return _read_open(path, file, spec)


def _read_open(path: Path, file: BinaryIO, spec: TableSpec) -> Stored:
    try:
        parquet = pq.ParquetFile(file, page_checksum_verification=True)
        info = _info(parquet.schema_arrow)
    except (OSError, *UNREADABLE):
        raise TableError(
            f"{path}: not a readable imodbatch table. Delete it and run again."
        ) from None
    if (info.table, info.version) != (spec.name, spec.version):
        raise TableError(
            f"{path}: holds {info.table} version {info.version}, expected {spec.name} version "
            f"{spec.version}. Delete the run folder and run again."
        )
    try:
        rows = conform(parquet.read(), spec)
        return Stored(info, rows.replace_schema_metadata(parquet.schema_arrow.metadata))
    except (OSError, pa.ArrowInvalid) as error:
        message = str(error).splitlines()[0]
        raise TableError(f"{path}: damaged ({message}). Delete it and run again.") from None
