"""A table as the page and Markdown show it: text in cells, decided once, drawn twice."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Cell:
    """One entry: its text, a remark under it, and whether it is the best of its row."""

    text: str
    note: str = ""
    is_best: bool = False

    @property
    def markdown(self) -> str:
        """The cell on one line."""
        text = f"**{self.text}**" if self.is_best else self.text
        return f"{text}, {self.note}" if self.note else text


@dataclass(frozen=True)
class Column:
    """A heading; `group` is the heading above it, `color` that of a method."""

    text: str
    group: str = ""
    color: str = ""
    is_dashed: bool = False


@dataclass(frozen=True)
class Row:
    """A row; a summary row (mean, total) is set apart."""

    name: str
    cells: tuple[Cell, ...]
    is_summary: bool = False


@dataclass(frozen=True)
class Grid:
    """A table with one heading column."""

    name: str
    title: str
    corner: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Group headings with the number of columns under each; empty if no column has a group."""
        spans: list[tuple[str, int]] = []
        for column in self.columns:
            if spans and spans[-1][0] == column.group:
                spans[-1] = (column.group, spans[-1][1] + 1)
            else:
                spans.append((column.group, 1))
        return spans if any(name for name, _ in spans) else []

    def markdown(self) -> str:
        """The same as a Markdown table, with its title above."""
        heads = [f"{c.group}: {c.text}" if c.group else c.text for c in self.columns]
        lines = [_line([self.corner, *heads]), _line(["---", *["---:"] * len(heads)])]
        lines += [_line([row.name, *[cell.markdown for cell in row.cells]]) for row in self.rows]
        return f"### {self.title}\n\n" + "\n".join(lines) + "\n"


def marked_best(values: list[float | None], texts: list[str], notes: list[str]) -> list[Cell]:
    """Cells of which the largest is marked; values that look equal are equally good."""
    known = [(value, text) for value, text in zip(values, texts, strict=True) if value is not None]
    best = max(known)[1] if len(known) > 1 else None
    return [
        Cell(text, note, value is not None and text == best)
        for value, text, note in zip(values, texts, notes, strict=True)
    ]


def _line(cells: list[str]) -> str:
    escaped = (cell.replace("|", "\\|").replace("\n", " ") for cell in cells)
    return "| " + " | ".join(escaped) + " |"
