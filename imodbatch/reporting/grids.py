"""A table as the page and Markdown show it: text in cells, decided once, drawn twice."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from textwrap import wrap

from imodbatch.reporting.names import DASH, method_style, number

GAP, BAR = "  ", " | "
"""Between the columns of a terminal's table: within a group, and before one."""


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

    def text(self) -> str:
        """The same for a terminal: aligned, titles wrapped, remarks of cells below."""
        heads = [column.text.split() or [""] for column in self.columns]
        texts = [[row.cells[i].text for row in self.rows] for i in range(len(heads))]
        widths = [max(map(len, head + cells)) for head, cells in zip(heads, texts, strict=True)]
        margin = max(len(name) for name in (self.corner, *(row.name for row in self.rows)))
        lines = [self.title, ""]
        if self.groups:
            lines += _group_lines(self.groups, widths, margin)
        depth = max(len(head) for head in heads)
        for level in range(depth):
            words = [([""] * (depth - len(head)) + head)[level] for head in heads]
            lines.append(self._text_line(self.corner if level == depth - 1 else "", words, widths))
        rule = "-" * len(lines[-1])
        for row in self.rows:
            lines += [rule] if row is self.rows[0] or row.is_summary else []
            lines.append(self._text_line(row.name, [cell.text for cell in row.cells], widths))
        return "\n".join([*(line.rstrip() for line in lines), *self._remarks()]) + "\n"

    def _text_line(self, name: str, texts: list[str], widths: list[int]) -> str:
        margin = max(len(name) for name in (self.corner, *(row.name for row in self.rows)))
        line, before = name.ljust(margin), None
        for column, text, width in zip(self.columns, texts, widths, strict=True):
            line += (GAP if column.group == before else BAR) + text.rjust(width)
            before = column.group
        return line

    def _remarks(self) -> list[str]:
        """A line per row whose cells have remarks."""
        lines = []
        for row in self.rows:
            noted = [
                f"{column.group} {column.text}: {cell.note}".strip()
                for column, cell in zip(self.columns, row.cells, strict=True)
                if cell.note
            ]
            lines += [f"{row.name}: {'; '.join(noted)}."] if noted else []
        return lines

    def markdown(self) -> str:
        """The same as a Markdown table, with its title above."""
        heads = [f"{c.group}: {c.text}" if c.group else c.text for c in self.columns]
        lines = [_line([self.corner, *heads]), _line(["---", *["---:"] * len(heads)])]
        lines += [_line([row.name, *[cell.markdown for cell in row.cells]]) for row in self.rows]
        return f"### {self.title}\n\n" + "\n".join(lines) + "\n"


def method_columns(methods: Iterable[str]) -> tuple[Column, ...]:
    """A heading per method, in its looks."""
    styles = map(method_style, methods)
    return tuple(Column(s.name, "", s.color, s.is_dashed) for s in styles)


def marked_best(values: Sequence[float | None], notes: Sequence[str]) -> list[Cell]:
    """Figures of which the largest is marked; values that look equal are equally good."""
    texts = [number(value) for value in values]
    known = [float(text) for text in texts if text != DASH]
    best = number(max(known)) if len(known) > 1 else None
    return [Cell(text, note, text == best) for text, note in zip(texts, notes, strict=True)]


def _group_lines(groups: list[tuple[str, int]], widths: list[int], margin: int) -> list[str]:
    """Group headings over their columns, each wrapped to the width it has."""
    blocks, start = [], 0
    for name, n_columns in groups:
        width = sum(widths[start : start + n_columns]) + len(GAP) * (n_columns - 1)
        blocks.append((wrap(name, width) or [""], width))
        start += n_columns
    depth = max(len(lines) for lines, _ in blocks)
    return [
        " " * margin
        + "".join(
            BAR + (lines[level] if level < len(lines) else "").ljust(width)
            for lines, width in blocks
        )
        for level in range(depth)
    ]


def _line(cells: list[str]) -> str:
    escaped = (cell.replace("|", "\\|").replace("\n", " ") for cell in cells)
    return "| " + " | ".join(escaped) + " |"
