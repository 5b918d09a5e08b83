"""What is drawn lies where the numbers say: x along x, y along y, in the looks of its method."""

import math

import numpy as np
import pytest

from imodbatch.reporting import figures
from imodbatch.reporting.figures import Panel, PanelLine, PathView, TopView
from imodbatch.reporting.results import Curve

NAN = float("nan")


@pytest.fixture(autouse=True)
def _figures_as_they_are(monkeypatch):
    """Figures come as matplotlib's own, not as text."""
    monkeypatch.setattr(figures, "_svg", lambda figure, description: (figure, description))


def lines_of(axes):
    """(x, y) of every line."""
    return [tuple(np.asarray(v).tolist() for v in line.get_data()) for line in axes.lines]


def scattered(axes):
    return [np.asarray(c.get_offsets()).tolist() for c in axes.collections]


def test_a_curve_goes_from_recall_0_and_its_dot_lies_on_the_same_axes():
    curve = Curve(np.array([0.25, 0.5]), np.array([1.0, 0.75]))
    figure, about = figures.precision_recall_svg(
        "cup", [("single", curve), ("imod_offline", curve)], [("single", 0.5, 0.75)]
    )
    (axes,) = figure.axes
    single, offline, dot = lines_of(axes)
    assert single == offline == ([0.0, 0.25, 0.5], [1.0, 1.0, 0.75])
    assert dot == ([0.5], [0.75])
    assert [line.get_linestyle() for line in axes.lines[:2]] == ["-", "--"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("recall", "precision")
    assert about == "Precision over recall, cup"


def test_the_sweep_marks_the_size_used():
    figure, _ = figures.sweep_svg([("imod", [100, 400], [0.25, 0.5])], 200, "AP")
    (axes,) = figure.axes
    used, line = lines_of(axes)
    assert used[0] == [200, 200]
    assert line == ([100, 400], [0.25, 0.5])
    assert axes.get_xticks().tolist() == [100, 400]
    assert axes.get_ylabel() == "AP"


def test_panels_stand_side_by_side_with_error_bars():
    panels = [
        Panel(
            "shift", {0: "none", 20: "20"}, [PanelLine("imod", [0, 20], [0.875, 0.5], [0, 0.25])]
        ),
        Panel("turn", {0: "none"}, [PanelLine("imod", [0], [0.875], [0])]),
    ]
    figure, about = figures.panels_svg(panels, "AP", "under jitter")
    first, second = figure.axes
    assert lines_of(first)[0] == ([0, 20], [0.875, 0.5])
    (bars,) = first.collections
    assert [s.tolist() for s in bars.get_segments()] == [
        [[0, 0.875], [0, 0.875]],
        [[20, 0.25], [20, 0.75]],
    ]
    assert [label.get_text() for label in first.get_xticklabels()] == ["none", "20"]
    assert [axes.get_xlabel() for axes in (first, second)] == ["shift", "turn"]
    assert about == "AP under jitter"


def test_objects_from_above_with_a_stroke_along_their_own_x_axis():
    """Yaw 30°: 12 cm long, cos 30° to the right and sin 30° up. The weak object has neither."""
    view = TopView(
        np.array([[1.0, 2.0], [3.0, -1.0], [5.0, 6.0]]),
        ["red", "green", "blue"],
        np.array([True, False, True]),
        np.array([math.radians(30), 0.0, NAN]),
        np.array([[NAN, NAN], [0.5, 0.25], [1.5, 0.75]]),
    )
    figure, _ = figures.top_view_svg("s", view)
    (axes,) = figure.axes
    path, start, stroke, first, third = lines_of(axes)
    assert (path[0][1:], path[1][1:]) == ([0.5, 1.5], [0.25, 0.75])
    assert start == ([0.5], [0.25])  # the first frame that has a pose
    assert stroke[0] == pytest.approx([1.0, 1.0 + 0.12 * math.sqrt(3) / 2])
    assert stroke[1] == pytest.approx([2.0, 2.0 + 0.12 / 2])
    assert (first, third) == (([1.0], [2.0]), ([5.0], [6.0]))
    assert [line.get_color() for line in axes.lines[2:]] == ["red", "red", "blue"]
    assert scattered(axes) == [[[3.0, -1.0]]]


def test_a_path_beside_the_true_one():
    view = PathView(
        np.array([[0.5, 0.25], [1.5, 0.75]]),
        np.array([[0.5, 0.5], [1.5, 1.0]]),
        [(np.array([[1.5, 0.75]]), "orange")],
    )
    figure, _ = figures.path_svg("s", view)
    (axes,) = figure.axes
    path, true, start = lines_of(axes)
    assert path == ([0.5, 1.5], [0.25, 0.75])
    assert true == ([0.5, 1.5], [0.5, 1.0])
    assert start == ([0.5], [0.25])
    assert [line.get_linestyle() for line in axes.lines[:2]] == ["-", "--"]
    assert scattered(axes) == [[[1.5, 0.75]]]
