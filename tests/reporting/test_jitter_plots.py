"""Jitter: each line, tick and cell shows the row of the table that it should."""

import csv
import io

import pytest
from hand_tables import table

from imodbatch.reporting import jitters
from imodbatch.reporting.csv_text import csv_of
from imodbatch.reporting.names import DASH


def row(kind, shift_mm, turn_mdeg, value, spread=None, method="imod"):
    return {
        **{"method": method, "kind": kind, "translation_mm": shift_mm, "rotation_mdeg": turn_mdeg},
        **{"metric": "ap_voc07_11pt", "value": value, "spread": spread, "n_repeats": 3},
    }


LEVELS = [  # kind, shift, turn, then value and spread of imod, and of single
    ("jitter", 20, 1500, (0.25, 0.03125), (0.125, 0.5)),
    ("jitter", 20, 0, (0.5, 0.0625), (0.25, 0.5)),
    ("jitter", 0, 0, (0.875, None), (0.375, None)),
    ("jitter", 0, 1500, (0.75, 0.125), (0.3125, 0.5)),
    ("jitter", 10, 0, (0.625, 0.25), (0.34375, 0.5)),
    ("drift", 0, 0, (0.875, None), (0.375, None)),
    ("drift", 0, 500, (None, None), (None, None)),
]
ROWS = [
    row(kind, shift, turn, *figures, method)
    for kind, shift, turn, *both in LEVELS
    for method, figures in zip(("imod", "single"), both, strict=True)
]


@pytest.fixture
def drawn(monkeypatch):
    """The panels of each plot."""
    calls = []
    monkeypatch.setattr(jitters, "panels_svg", lambda *args: calls.append(args) or "svg")
    return calls


def test_panels_of_shifts_turns_and_both(drawn):
    section = jitters.jitter_section(table("jitters", ROWS))
    assert [heading.split(":")[0] for heading, _ in section.plots] == ["Jitter", "Drift"]
    (panels, label, about), _ = drawn
    assert (label, about) == ("mean AP, 11 points (VOC 2007)", "under jitter of poses")
    shift, turn, both = panels
    lines = {line.method: (line.x, line.values, line.spreads) for line in shift.lines}
    assert shift.label == "RMS shift (mm)"
    assert [*lines] == ["single", "imod"]  # in the order of display
    assert lines["imod"] == ([0, 10, 20], [0.875, 0.625, 0.5], [0.0, 0.25, 0.0625])
    assert lines["single"] == ([0, 10, 20], [0.375, 0.34375, 0.25], [0.0, 0.5, 0.5])
    assert shift.ticks == {0: "0", 10: "10", 20: "20"}
    assert turn.label == "RMS turn (°)"
    assert turn.ticks == {0: "0°", 1500: "1.5°"}
    assert turn.lines[-1].x == [0, 1500]
    assert turn.lines[-1].values == [0.875, 0.75]
    assert both.label == "RMS shift (mm) and turn"
    assert both.ticks == {0: "0\n0°", 20: "20\n1.5°"}
    assert both.lines[-1].x == [0, 20]
    assert both.lines[-1].values == [0.875, 0.25]


def test_levels_stand_from_none_to_both(drawn):  # noqa: ARG001
    """Per kind: nothing, shifts, turns, both."""
    grid = jitters.jitter_section(table("jitters", ROWS)).grid
    assert [column.text for column in grid.columns] == ["single view", "imod (Konno 2020)"]
    assert [(r.name, *(cell.text for cell in r.cells)) for r in grid.rows] == [
        ("jitter, none", "0.375", "0.875"),
        ("jitter, 10 mm", "0.344", "0.625"),
        ("jitter, 20 mm", "0.250", "0.500"),
        ("jitter, 1.5°", "0.312", "0.750"),
        ("jitter, 20 mm and 1.5°", "0.125", "0.250"),
        ("drift, none", "0.375", "0.875"),
        ("drift, 0.5°", DASH, DASH),
    ]


def test_the_csv_is_the_table():
    rows = list(csv.DictReader(io.StringIO(csv_of(table("jitters", ROWS)))))
    assert len(rows) == len(ROWS)
    assert rows[0]["rotation_mdeg"] == "1500"
    assert rows[0]["value"] == "0.25"
    assert rows[4]["spread"] == ""


def test_nothing_disturbed_has_no_section():
    assert jitters.jitter_section(table("jitters", [])) is None
