"""From finished runs to one comparison: Table 1, its intervals, and how well azimuths are named."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

from imodbatch.reporting.azimuths import azimuth_block, azimuth_csv, azimuth_grid, azimuth_remark
from imodbatch.reporting.comparison import Comparison, compare_runs
from imodbatch.reporting.files import write_whole
from imodbatch.reporting.grids import Grid
from imodbatch.reporting.run_folder import open_run
from imodbatch.reporting.table_1 import (
    estimates,
    estimates_csv,
    estimates_grid,
    interval_remark,
    table_1,
    table_1_csv,
    table_remark,
)

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

    def write(self, folder: Path) -> None:
        """Write compare.md and a CSV file per table."""
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / "compare.md", self.markdown())
        for block in self.blocks:
            write_whole(folder / f"{block.grid.name}.csv", block.csv)


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


def _heading(comparison: Comparison) -> str:
    runs = [*comparison.groups.values()]
    if comparison.without_view is not None:
        runs.insert(0, comparison.without_view)
    return "Compared: " + ", ".join(run.folder.name for run in runs)
