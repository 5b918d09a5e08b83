"""How AP falls with worse poses: a plot per kind of disturbance, one table, one CSV file."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa
from markupsafe import Markup

from imodbatch.reporting.figures import Panel, PanelLine, panels_svg
from imodbatch.reporting.grids import Cell, Grid, Row, method_columns
from imodbatch.reporting.names import AP_METRICS, in_order, number

KINDS = {
    "jitter": "Jitter: each frame wrong on its own",
    "drift": "Drift: error growing from frame to frame, up to the level in the last one",
}
SHIFT, TURN = "translation_mm", "rotation_mdeg"
PANELS = {
    (SHIFT,): "RMS shift (mm)",
    (TURN,): "RMS turn (°)",
    (SHIFT, TURN): "RMS shift (mm) and turn",
}
"""What is disturbed in a panel of the plot, and the panel's label."""
JitterRow = dict[str, Any]


@dataclass(frozen=True)
class JitterSection:
    """What the page shows: (heading, plot) per kind, and the table of all figures."""

    plots: tuple[tuple[str, Markup], ...]
    grid: Grid


def jitter_section(jitters: pa.Table) -> JitterSection | None:
    """Plots and table; None where no poses were disturbed."""
    rows = sorted(jitters.to_pylist(), key=_place)
    if not rows:
        return None
    plots = tuple(
        (heading, _plot(kind, [row for row in rows if row["kind"] == kind]))
        for kind, heading in KINDS.items()
    )
    return JitterSection(plots, _grid(rows))


def _place(row: JitterRow) -> tuple[int, int, int]:
    """Sorts no disturbance first, then by panel and level."""
    return ((), *PANELS).index(_disturbed(row)), row[SHIFT], row[TURN]


def _disturbed(row: JitterRow) -> tuple[str, ...]:
    """Which of shift and turn are not 0."""
    return tuple(name for name in (SHIFT, TURN) if row[name])


def _plot(kind: str, rows: Sequence[JitterRow]) -> Markup:
    known = [row for row in rows if row["value"] is not None]
    if not known:
        return Markup("<p>No class has annotations: there is no AP to draw.</p>")
    asked = {_disturbed(row) for row in known}
    panels = [
        _panel([row for row in known if _disturbed(row) in ((), names)], names)
        for names in PANELS
        if names in asked
    ]
    metric = rows[0]["metric"]
    return panels_svg(panels, f"mean {AP_METRICS.get(metric, metric)}", f"under {kind} of poses")


def _panel(rows: Sequence[JitterRow], names: tuple[str, ...]) -> Panel:
    lines = []
    for method in in_order(row["method"] for row in rows):
        of_method = [row for row in rows if row["method"] == method]
        lines.append(
            PanelLine(
                method,
                [row[names[0]] for row in of_method],
                [row["value"] for row in of_method],
                [row["spread"] or 0.0 for row in of_method],
            )
        )
    ticks = {
        row[names[0]]: "\n".join(
            _degrees(row[name]) if name == TURN else str(row[name]) for name in names
        )
        for row in rows
    }
    return Panel(PANELS[names], ticks, lines)


def _grid(rows: Sequence[JitterRow]) -> Grid:
    """Kinds and levels down, methods across."""
    methods = in_order(row["method"] for row in rows)
    found = {(row["kind"], row[SHIFT], row[TURN], row["method"]): row for row in rows}
    levels = dict.fromkeys((row["kind"], row[SHIFT], row[TURN]) for row in rows)
    grid_rows = [
        Row(
            _level(*level),
            tuple(Cell(number(found[(*level, method)]["value"])) for method in methods),
        )
        for level in sorted(levels, key=lambda level: [*KINDS].index(level[0]))
    ]
    title = "Mean AP under disturbed poses"
    return Grid("jitters", title, "disturbance", method_columns(methods), tuple(grid_rows))


def _level(kind: str, translation_mm: int, rotation_mdeg: int) -> str:
    parts = [f"{translation_mm} mm"] if translation_mm else []
    parts += [_degrees(rotation_mdeg)] if rotation_mdeg else []
    return f"{kind}, {' and '.join(parts) or 'none'}"


def _degrees(mdeg: int) -> str:
    return f"{mdeg / 1000:g}°"
