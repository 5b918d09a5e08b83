"""Detections as a table, CSV or Parquet: a row per box.

Columns: frame_index or file_name; sequence_id if the file holds several sequences; x0_px, y0_px,
x1_px, y1_px; then either class_name and score, or a whole score vector in C order of [class,
elevation, azimuth] (a list column view_scores, or columns view_score_0, view_score_1, …), with
background_score if that is not what the vector leaves of 1. Other columns are of no matter.
"""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv, parquet

from imodbatch.core.detections import Detections
from imodbatch.core.errors import ConfigError, DataError, one_line
from imodbatch.datasets.base import Footage
from imodbatch.datasets.detections.found import (
    KEY,
    OTHER_SEQUENCES,
    Entries,
    Found,
    Grid,
    asked_for,
    check_scores,
    of_classes,
    refuse_shared_numbers,
)
from imodbatch.datasets.names import ClassNames, FrameNames, Place, missing_file
from imodbatch.settings.manifest import Manifest
from imodbatch.settings.sections import DetectionsSection
from imodbatch.settings.toml import did_you_mean

BOX_COLUMNS = ("x0_px", "y0_px", "x1_px", "y1_px")
NUMBERED = re.compile(r"view_score_(\d+)")
ROUNDING = 0.01
"""How far beyond 1 a softmax that was stored as float16 may sum."""
BACKWARDS = "Are these x, y, width, height? Give x0_px, y0_px, x1_px, y1_px."


def read_found(footage: Footage, section: DetectionsSection, grid: Grid) -> Found:
    """All rows of the file.

    Args:
        footage: the frames of the sequence's slice.
        section: `[detections]` of the manifest.
        grid: what score vectors have entries for.

    Raises:
        ConfigError: a rename to an unknown class; a grid is declared but the file has no vectors.
        DataError: see `imodbatch.datasets.detections.read_detections`.
    """
    manifest = footage.manifest
    path = manifest.path_in(footage.sequence, section.path)
    table = _Table(path, _read(path, section.format))
    boxes = np.stack([table.floats(name) for name in BOX_COLUMNS], axis=1)
    keys, places = _places(footage, section, table)
    vectors = table.vectors(grid)
    if vectors is None:
        class_ids, scores = _single_scores(manifest, section, table, grid)
        found = of_classes(table.entries, boxes, class_ids, scores, grid.n_classes)
        places = asked_for(places, class_ids)
    else:
        found = Detections(boxes, vectors, _background(table, vectors).astype(np.float32))
    return Found(table.entries, found, places, keys, BACKWARDS)


@dataclass(frozen=True)
class _Table:
    """A table and its file; every access is checked."""

    path: Path
    data: Any

    @property
    def entries(self) -> Entries:
        """The rows, for errors."""
        return Entries(self.path, lambda number: f"row {number} (from 0)")

    def has(self, name: str) -> bool:
        return name in self.data.column_names

    def column(self, name: str, dtype: Any) -> Any:
        """A column in an Arrow type."""
        if not self.has(name):
            hint = did_you_mean(name, self.data.column_names)
            raise DataError(f"{self.path}: has no column {name}.{hint}")
        try:
            return self.data.column(name).cast(dtype)
        except (pa.ArrowException, ValueError) as error:
            raise DataError(
                f"{self.path}: column {name} is not all {dtype} ({one_line(error)}). Correct it."
            ) from None

    def floats(self, name: str) -> NDArray[np.float64]:
        """(n,) numbers, NaN where missing."""
        column: NDArray[np.float64] = self.column(name, pa.float64()).to_numpy()
        return column

    def keys(self, name: str, dtype: Any) -> list[Any]:
        """(n,) numbers or strings, none missing."""
        column = self.column(name, dtype)
        if column.null_count:
            first = column.is_null().to_pylist().index(True)
            raise DataError(f"{self.path}: {self.entries.name(first)} has no {name}. Fill it in.")
        values: list[Any] = column.to_pylist()
        return values

    def vectors(self, grid: Grid) -> NDArray[np.float32] | None:
        """(n, K·M·N) score vectors, None if the table has none."""
        numbered = [name for name in self.data.column_names if NUMBERED.fullmatch(name)]
        if self.has("view_scores"):
            scores = self._list_vectors(grid)
        elif numbered:
            expected = [f"view_score_{i}" for i in range(grid.n_scores)]
            if set(numbered) != set(expected):
                raise DataError(
                    f"{self.path}: has {len(numbered)} columns view_score_…. {_expected(grid)}"
                )
            scores = np.stack([self.floats(name).astype(np.float32) for name in expected], axis=1)
        else:
            return None
        check_scores(self.entries, scores)
        return scores

    def _list_vectors(self, grid: Grid) -> NDArray[np.float32]:
        column = self.data.column("view_scores")
        if not _is_list_of_numbers(column.type):
            raise DataError(
                f"{self.path}: column view_scores holds {column.type}. Expected lists of numbers "
                "(Parquet), or columns view_score_0, view_score_1, … (CSV)."
            )
        lengths = pc.fill_null(pc.list_value_length(column), 0).to_numpy()
        self.entries.refuse(
            lengths != grid.n_scores,
            lambda row: f"view_scores has {lengths[row]} values",
            _expected(grid),
        )
        values = np.asarray(pc.list_flatten(column).to_numpy(), dtype=np.float32)
        return values.reshape(len(lengths), grid.n_scores)


def _is_list_of_numbers(dtype: Any) -> bool:
    kinds = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    if not any(is_kind(dtype) for is_kind in kinds):
        return False
    return bool(pa.types.is_floating(dtype.value_type) or pa.types.is_integer(dtype.value_type))


def _expected(grid: Grid) -> str:
    return (
        f"Expected {grid.n_scores} = {grid.n_classes} classes x {grid.n_elevations} elevations x "
        f"{grid.n_azimuths} azimuths; check classes, and n_azimuths and elevations_deg of "
        "[detections]."
    )


def _read(path: Path, form: str) -> Any:
    """The file as an Arrow table without repeated columns."""
    try:
        if form == "csv":
            # Without given types "01" would be read as the number 1.
            texts = {name: pa.string() for name in ("sequence_id", "file_name", "class_name")}
            table = csv.read_csv(path, convert_options=csv.ConvertOptions(column_types=texts))
        else:
            # Not `read_table`: it takes folders named a=b for columns.
            with parquet.ParquetFile(path) as file:
                table = file.read()
    except FileNotFoundError:
        raise missing_file(path, KEY) from None
    except (pa.ArrowException, OSError) as error:
        raise DataError(
            f"{path}: cannot be read as {form} ({one_line(error)}). Check detections.format."
        ) from None
    name, count = Counter(table.column_names).most_common(1)[0] if table.column_names else ("", 1)
    if count > 1:
        raise DataError(f"{path}: {count} columns are called {name}. Rename or drop one.")
    return table


def _places(
    footage: Footage, section: DetectionsSection, table: _Table
) -> tuple[list[Any], list[Place]]:
    """(n,) what each row says of its image, and where that belongs."""
    has_sequences = table.has("sequence_id")
    names = FrameNames(footage, KEY, section.path, is_shared=not has_sequences)
    is_ours = [True] * table.data.num_rows
    if has_sequences:
        is_ours = [name == footage.sequence.id for name in table.keys("sequence_id", pa.string())]
    if table.has("frame_index"):
        if not has_sequences:
            refuse_shared_numbers(footage, section.path, "Add a column sequence_id")
        keys = table.keys("frame_index", pa.int64())
        known = {key: names.place_of_number(key) for key in set(keys)}
    elif table.has("file_name"):
        keys = table.keys("file_name", pa.string())
        ours = {key for key, is_one in zip(keys, is_ours, strict=True) if is_one}
        known = {key: names.place_of_name(key, str(table.path)) for key in sorted(ours)}
    else:
        raise DataError(
            f"{table.path}: has neither a column frame_index nor file_name."
            f"{did_you_mean('frame_index', table.data.column_names)}"
        )
    other = Place(None, OTHER_SEQUENCES)
    return keys, [
        known[key] if is_one else other for key, is_one in zip(keys, is_ours, strict=True)
    ]


def _single_scores(
    manifest: Manifest, section: DetectionsSection, table: _Table, grid: Grid
) -> tuple[list[int | None], NDArray[np.float64]]:
    """Class ordinals, None = one that the manifest does not ask for, and their scores."""
    if not (table.has("class_name") and table.has("score")):
        raise DataError(
            f"{table.path}: has no scores. Expected a list column view_scores, or columns "
            "view_score_0, view_score_1, …, or class_name and score."
        )
    if grid.n_scores != grid.n_classes:
        raise ConfigError(
            f"manifest {manifest.name}: [detections] declares {grid.n_elevations} x "
            f"{grid.n_azimuths} viewpoints, but {table.path} has only class_name and score. Take "
            "n_azimuths and elevations_deg out, or give view_scores."
        )
    classes = ClassNames(manifest, section.rename, "detections.rename")
    names = table.keys("class_name", pa.string())
    return [classes.find(name) for name in names], table.floats("score")


def _background(table: _Table, view_scores: NDArray[np.float32]) -> NDArray[np.float64]:
    """(n,) background scores, as given or what the vectors leave of 1."""
    if table.has("background_score"):
        background = table.floats("background_score")
        check_scores(table.entries, background)
        return background
    sums = view_scores.sum(axis=1, dtype=np.float64)
    table.entries.refuse(
        sums > 1 + ROUNDING,
        lambda row: f"the view scores sum to {sums[row]:.3g}",
        "Give a softmax over classes and viewpoints, or a column background_score.",
    )
    rest: NDArray[np.float64] = np.maximum(1.0 - sums, 0.0)
    return rest
