"""A finished run, read from its folder alone: its tables say what they were made with."""

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from imodbatch.core.errors import TableError
from imodbatch.reporting.results import Results
from imodbatch.tables.parquet import (
    Stored,
    TableInfo,
    read_info,
    read_stored,
    read_table,
    table_path,
)
from imodbatch.tables.schemas import TABLES

CURE = "Bring it up to date with `imodbatch run`."


@dataclass(frozen=True)
class DetectorGrid:
    """M elevations × N azimuths that a detector tells apart; 1 × 1 = it knows no viewpoints."""

    n_elevations: int
    n_azimuths: int

    @property
    def has_viewpoints(self) -> bool:
        """Whether there is more than one."""
        return self.n_elevations * self.n_azimuths > 1

    def __str__(self) -> str:
        return f"{self.n_elevations}×{self.n_azimuths}"


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """A run whose boxes were matched.

    Attributes:
        folder: where its tables lie.
        classes: names by class id.
        grid: of the detector, not of the geometry.
        threshold_step: between the scores among which a threshold is sought.
        results: its annotations, matches and metrics, with the sequences they hold.
    """

    folder: Path
    classes: tuple[str, ...]
    grid: DetectorGrid
    threshold_step: float
    results: Results

    @property
    def sequence_ids(self) -> tuple[str, ...]:
        """Sorted."""
        return self.results.sequence_ids

    def detections(self, sequence_id: str) -> pa.Table:
        """The detections of a sequence, with their whole score vectors."""
        return _read(self.folder, "detections", sequence_id)

    def boxes(self) -> pa.Table:
        """The detections of all sequences without their score vectors."""
        heavy = ["view_scores", "class_ids"]
        return pa.concat_tables(self.detections(s).drop_columns(heavy) for s in self.sequence_ids)

    def frames(self) -> pa.Table:
        """The frames of all sequences."""
        return pa.concat_tables(_read(self.folder, "frames", s) for s in self.sequence_ids)


def open_run(folder: Path) -> FinishedRun:
    """Read a run folder.

    Raises:
        TableError: there is none, a table is missing or damaged, or the metrics are not of the
            matches that lie there.
    """
    if not folder.is_dir():
        raise TableError(f"{folder}: no such run folder. Make it with `imodbatch run`.")
    metrics = _stored(folder, "metrics")
    matched = metrics.info.inputs["matches"]
    matches = {sequence_id: _stored(folder, "matches", sequence_id) for sequence_id in matched}
    for sequence_id, identity in matched.items():
        if matches[sequence_id].info.digest != identity:
            raise TableError(
                f"{folder}: its metrics are of other matches than those of {sequence_id}. {CURE}"
            )
    sequence_ids = tuple(sorted(matched))
    tables = {
        "annotations": pa.concat_tables(_read(folder, "annotations", s) for s in sequence_ids),
        "matches": pa.concat_tables(matches[s].rows for s in sequence_ids),
        "metrics": metrics.rows,
    }
    if not tables["matches"].num_rows:
        raise TableError(
            f"{folder}: there are no detections to compare. Lower detect.score_threshold."
        )
    said = metrics.info.attributes
    try:
        return FinishedRun(
            folder,
            tuple(said["classes"]),
            _grid(folder, sequence_ids),
            said["threshold_step"],
            Results(tables, sequence_ids),
        )
    except KeyError as error:
        raise TableError(
            f"{folder}: its tables do not say {error}: an older version made them. {CURE}"
        ) from None


def _grid(folder: Path, sequence_ids: tuple[str, ...]) -> DetectorGrid:
    """The largest of the sequences': one without any frame looked at says 1 × 1."""
    said = [_info(folder, "detections", sequence_id).attributes for sequence_id in sequence_ids]
    grids = [DetectorGrid(a["n_elevations"], a["n_azimuths"]) for a in said]
    return max(grids, key=lambda grid: grid.n_elevations * grid.n_azimuths)


def _info(folder: Path, table: str, *sequence_id: str) -> TableInfo:
    path = table_path(folder, table, *sequence_id)
    info = read_info(path)
    if info is None:
        raise TableError(f"{path}: no such table, or a damaged one. {CURE}")
    return info


def _stored(folder: Path, table: str, *sequence_id: str) -> Stored:
    _info(folder, table, *sequence_id)  # says how to come by a table that is not there
    return read_stored(table_path(folder, table, *sequence_id), TABLES[table])


def _read(folder: Path, table: str, *sequence_id: str) -> pa.Table:
    return read_table(table_path(folder, table, *sequence_id), TABLES[table])
