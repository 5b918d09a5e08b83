"""From finished runs to one comparison: Table 1 with intervals and azimuths, or Table 2."""

from collections.abc import Mapping, Sequence
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
class Document:
    """A comparison, ready to be shown.

    Attributes:
        heading: which runs.
        parts: tables and what is to be said of them, in their order, a paragraph a line.
        files: by name, the page first: text, or a table for Parquet.
        page_grids: the tables of the page, which has room for wider ones than a terminal.
    """

    heading: str
    parts: tuple[Grid | str, ...]
    files: Mapping[str, str | pa.Table]
    page_grids: tuple[Grid, ...]

    def text(self) -> str:
        """For a terminal."""
        parts = (p.text() if isinstance(p, Grid) else _wrapped(p) for p in self.parts)
        return "\n".join([f"{self.heading}\n", *parts])

    def write(self, folder: Path) -> Path:
        """Write the files; returns the page."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self.files.items():
            if isinstance(content, str):
                write_text(folder / name, content)
                continue
            with replacing(folder / name) as file:
                pq.write_table(content, file, compression="zstd")
        return folder / next(iter(self.files))


def _wrapped(paragraphs: str) -> str:
    return "".join(f"{line}\n" for p in paragraphs.splitlines() for line in wrap(p, TERMINAL_WIDTH))


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
    ap, intervals = table_1(comparison), estimates_grid(found)
    csv = {ap.name: table_1_csv(comparison), intervals.name: estimates_csv(found)}
    parts: list[Grid | str] = [ap, table_remark(comparison)]
    parts += [intervals, interval_remark(comparison, n_resamples)]
    if azimuths := azimuth_block(comparison):
        grid = azimuth_grid(azimuths)
        csv[grid.name] = azimuth_csv(azimuths)
        parts += [grid, azimuth_remark(azimuths)]
    else:
        parts.append(NO_AZIMUTHS)
    heading = _heading(comparison)
    shown = (part.markdown() if isinstance(part, Grid) else f"{part}\n" for part in parts)
    files = {"compare.md": "\n".join([f"## {heading}\n", *shown])}
    files |= {f"{name}.csv": text for name, text in csv.items()}
    grids = tuple(part for part in parts if isinstance(part, Grid))
    return Document(heading, tuple(parts), files, grids)


def table_2_of_folders(folders: Sequence[Path]) -> Document:
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
    page_grids = tuple(wide) if paper else (*wide, paper_table_2())
    said = remarks(comparison, columns, step)
    tables = {
        "table2": figures_table(comparison, columns),
        "table2_thresholds": thresholds_table(comparison, columns),
    }
    context = {
        **{"heading": _heading(comparison), "grids": page_grids, "remarks": said},
        **{"files": list(tables), "paper_mark": MARK},
    }
    files: dict[str, str | pa.Table] = {"table2.html": page("table2.html.j2", context)}
    files |= {f"{name}.csv": csv_of(table) for name, table in tables.items()}
    files |= {f"{name}.parquet": table for name, table in tables.items()}
    parts: tuple[Grid | str, ...] = (*plain, paper_table_2(), "\n".join(said))
    return Document(_heading(comparison), parts, files, page_grids)


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
