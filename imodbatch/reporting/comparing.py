"""From finished runs to one comparison: Table 1 with intervals and azimuths, or Table 2."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

import pyarrow as pa
import pyarrow.parquet as pq

from imodbatch.core.errors import ConfigError
from imodbatch.reporting.azimuths import azimuth_block, azimuth_csv, azimuth_grid, azimuth_remark
from imodbatch.reporting.comparison import Comparison, compare_runs
from imodbatch.reporting.csv_text import csv_of
from imodbatch.reporting.grids import Grid
from imodbatch.reporting.operating_points import TUNINGS, Background, table_2_columns
from imodbatch.reporting.page import page
from imodbatch.reporting.paper import MARK
from imodbatch.reporting.run_folder import FinishedRun, open_run
from imodbatch.reporting.table_1 import (
    estimates,
    estimates_csv,
    estimates_grid,
    interval_remark,
    table_1,
    table_1_csv,
    table_remark,
)
from imodbatch.reporting.table_2 import beside, paper_table_2, remarks, table_2
from imodbatch.reporting.table_2_files import figures_table, thresholds_table
from imodbatch.scoring.background import background_per_pixel
from imodbatch.tables.atomic import replacing, write_text

TERMINAL_WIDTH = 100
"""Of running text; tables are as wide as they are."""
NO_AZIMUTHS = "No annotation says from which azimuth its object is seen."


@dataclass(frozen=True)
class Block:
    """One table with what is to be said of it and its figures in full precision."""

    grid: Grid
    remark: str
    csv: str


@dataclass(frozen=True)
class Document:
    """A comparison, ready to be shown."""

    heading: str
    blocks: tuple[Block, ...]
    closing: str = ""

    def text(self) -> str:
        """For a terminal."""
        parts = [f"{block.grid.text()}\n{_wrapped(block.remark)}\n" for block in self.blocks]
        return "\n".join([f"{self.heading}\n", *parts, *self._closing()])

    def markdown(self) -> str:
        """The same as Markdown."""
        parts = [f"{block.grid.markdown()}\n{block.remark}\n" for block in self.blocks]
        return "\n".join([f"## {self.heading}\n", *parts, *self._closing()])

    def _closing(self) -> list[str]:
        return [f"{self.closing}\n"] if self.closing else []

    def write(self, folder: Path) -> Path:
        """Write compare.md and a CSV file per table; returns the former."""
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "compare.md", self.markdown())
        for block in self.blocks:
            write_text(folder / f"{block.grid.name}.csv", block.csv)
        return folder / "compare.md"


@dataclass(frozen=True)
class Table2:
    """Table 2, ready to be shown.

    Attributes:
        grids: for a terminal: a table per tuning, and the paper's.
        wide_grids: for a page: a table per tuning with thresholds, the paper's columns beside.
        remarks: what is to be said of them, a paragraph each.
        tables: by file name, in full precision.
    """

    heading: str
    grids: tuple[Grid, ...]
    wide_grids: tuple[Grid, ...]
    remarks: tuple[str, ...]
    tables: dict[str, pa.Table]

    def text(self) -> str:
        """For a terminal."""
        parts = [f"{grid.text()}\n" for grid in self.grids]
        return (
            f"{self.heading}\n\n" + "".join(parts) + "\n".join(map(_wrapped, self.remarks)) + "\n"
        )

    def write(self, folder: Path) -> Path:
        """Write table2.html, and CSV and Parquet files; returns the page."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in self.tables.items():
            write_text(folder / f"{name}.csv", csv_of(table))
            with replacing(folder / f"{name}.parquet") as file:
                pq.write_table(table, file, compression="zstd")
        context = {
            **{"heading": self.heading, "grids": self.wide_grids, "remarks": self.remarks},
            **{"files": list(self.tables), "paper_mark": MARK},
        }
        write_text(folder / "table2.html", page("table2.html.j2", context))
        return folder / "table2.html"


def _wrapped(text: str) -> str:
    return "\n".join(wrap(text, TERMINAL_WIDTH))


def compare_folders(folders: Sequence[Path], n_resamples: int) -> Document:
    """Compare the runs that lie in some folders.

    Args:
        folders: run folders of the same data, in any order.
        n_resamples: of the bootstrap.

    Raises:
        ConfigError: the runs do not go together.
        TableError: a run is missing, unfinished or damaged.
    """
    comparison = compare_runs([open_run(folder) for folder in folders])
    found = estimates(comparison, n_resamples)
    remark = interval_remark(comparison, n_resamples)
    blocks = [
        Block(table_1(comparison), table_remark(comparison), table_1_csv(comparison)),
        Block(estimates_grid(found), remark, estimates_csv(found)),
    ]
    azimuths = azimuth_block(comparison)
    if azimuths is not None:
        blocks.append(
            Block(azimuth_grid(azimuths), azimuth_remark(azimuths), azimuth_csv(azimuths))
        )
    closing = NO_AZIMUTHS if azimuths is None else ""
    return Document(_heading(comparison), tuple(blocks), closing)


def table_2_of_folders(folders: Sequence[Path]) -> Table2:
    """Table 2 of the runs that lie in some folders.

    Args:
        folders: run folders of the same data, in any order, one of them of a detector without
            viewpoints.

    Raises:
        ConfigError: the runs do not go together.
        TableError: a run is missing, unfinished or damaged.
    """
    comparison = compare_runs([open_run(folder) for folder in folders])
    step = _threshold_step(comparison)
    columns = table_2_columns(comparison, step, _background())
    paper = beside(comparison.any_run.classes)
    plain = [table_2(comparison, columns, tuning) for tuning in TUNINGS]
    wide = [table_2(comparison, columns, t, paper, with_thresholds=True) for t in TUNINGS]
    return Table2(
        _heading(comparison),
        (*plain, paper_table_2()),
        tuple(wide) if paper else (*wide, paper_table_2()),
        tuple(remarks(comparison, columns, step)),
        {
            "table2": figures_table(comparison, columns),
            "table2_thresholds": thresholds_table(comparison, columns),
        },
    )


def _threshold_step(comparison: Comparison) -> float:
    """The one that all runs tuned their thresholds with (Konno et al. 2020, Sec. 5.2: 0.01)."""
    first, *others = comparison.runs
    for run in others:
        if run.threshold_step != first.threshold_step:
            raise ConfigError(
                f"{first.folder} and {run.folder} differ in metrics.threshold_step: "
                f"{first.threshold_step:g} and {run.threshold_step:g}. Run both with one."
            )
    return first.threshold_step


def _background() -> Background:
    """Counts the background's pixels; reads the boxes of a run once."""
    tables: dict[Path, tuple[pa.Table, pa.Table]] = {}

    def count(run: FinishedRun, kept: pa.Table) -> tuple[float, float]:
        if run.folder not in tables:
            tables[run.folder] = run.frames(), run.boxes()
        frames, boxes = tables[run.folder]
        return background_per_pixel(frames, run.results.tables["annotations"], boxes, kept)

    return count


def _heading(comparison: Comparison) -> str:
    return "Compared: " + ", ".join(run.folder.name for run in comparison.runs)
