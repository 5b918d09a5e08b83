"""Figures as inline SVG: figure objects only, no pyplot state, equal bytes for equal input."""

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imodbatch.reporting.names import method_style
from imodbatch.reporting.results import Curve

Array = NDArray[np.float64]
STYLE = {
    "svg.fonttype": "none",  # text stays text: small, sharp, in the reader's own font
    "font.family": "sans-serif",
    "font.size": 8.0,
    "axes.edgecolor": "#9ca3af",
    "axes.labelcolor": "#374151",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.6,
    "xtick.color": "#6b7280",
    "ytick.color": "#6b7280",
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
}
CURVE_POINTS = 150
PATH_POINTS = 1500
YAW_MARK_M = 0.12
PATH_COLOR, REFERENCE_COLOR = "#0369a1", "#111827"


@dataclass(frozen=True)
class TopView:
    """Objects and camera of one sequence from above, in metres.

    Attributes:
        xy: (n, 2) places of objects.
        colors: of each object.
        is_strong: (n,) whether the score reaches the class's threshold.
        yaw_rad: (n,) NaN where unknown.
        path: (m, 2) camera centres in order of frames, NaN where the pose is lost.
    """

    xy: Array
    colors: Sequence[str]
    is_strong: NDArray[np.bool_]
    yaw_rad: Array
    path: Array


@dataclass(frozen=True)
class PanelLine:
    """A method's values over a quantity, with half the length of their error bars."""

    method: str
    x: Sequence[float]
    values: Sequence[float]
    spreads: Sequence[float]


@dataclass(frozen=True)
class Panel:
    """One of several plots side by side: label and ticks of its horizontal axis, and its lines."""

    label: str
    ticks: Mapping[float, str]
    lines: Sequence[PanelLine]


@dataclass(frozen=True)
class PathView:
    """A camera's path from above, in metres.

    Attributes:
        path: (m, 2) camera centres in order of frames, NaN where the pose is lost.
        reference: (m, 2) true ones; empty = unknown.
        marks: places (k, 2) to be marked, each group with its colour.
    """

    path: Array
    reference: Array
    marks: Sequence[tuple[Array, str]]


def precision_recall_svg(
    class_name: str,
    curves: Sequence[tuple[str, Curve]],
    points: Sequence[tuple[str, float, float]],
) -> Markup:
    """Curves of one class; a dot where each method's tuned threshold lies.

    Args:
        class_name: for the description.
        curves: (method, curve).
        points: (method, recall, precision).
    """
    with mpl.rc_context(_style(f"pr {class_name}")):
        figure, axes = _new((3.4, 2.7))
        for method, curve in curves:
            style = method_style(method)
            chosen = _spread(len(curve.recall), CURVE_POINTS)
            recall = np.append(curve.recall[chosen][:1] * 0, curve.recall[chosen])
            precision = np.append(curve.precision[chosen][:1], curve.precision[chosen])
            line = "--" if style.is_dashed else "-"
            axes.plot(recall, precision, color=style.color, linestyle=line, linewidth=1.4)
        for method, at_recall, at_precision in points:
            style = method_style(method)
            face = "white" if style.is_dashed else style.color
            axes.plot(at_recall, at_precision, "o", color=style.color, mfc=face, markersize=4.5)
        axes.set(xlim=(0, 1.02), ylim=(0, 1.04), xlabel="recall", ylabel="precision")
        return _svg(figure, f"Precision over recall, {class_name}")


def sweep_svg(
    lines: Sequence[tuple[str, Sequence[float], Sequence[float]]],
    used_mm: float | None,
    label: str,
) -> Markup:
    """A metric over the voxel's size; a grey line marks the size used.

    Args:
        lines: (method, voxel sizes in millimetres, values).
        used_mm: the run's own voxel size.
        label: name of the metric.
    """
    with mpl.rc_context(_style("sweep")):
        figure, axes = _new((6.4, 3.0))
        if used_mm is not None:
            axes.axvline(used_mm, color="#9ca3af", linewidth=1.0, linestyle=":")
            axes.annotate(
                "used here",
                (used_mm, 0.0),
                xycoords=("data", "axes fraction"),
                xytext=(3, 3),
                textcoords="offset points",
                color="#6b7280",
            )
        for method, sizes, values in lines:
            axes.plot(sizes, values, **_marked_line(method))
        axes.set(xlabel="voxel edge (mm)", ylabel=label)
        axes.set_xticks(sorted({size for _, sizes, _ in lines for size in sizes}))
        return _svg(figure, "Mean AP over the voxel's size")


def panels_svg(panels: Sequence[Panel], label: str, about: str) -> Markup:
    """A metric over several quantities, side by side on one vertical scale.

    Args:
        panels: one plot each.
        label: name of the metric.
        about: what the panels share, for the description.
    """
    with mpl.rc_context(_style(f"panels {about}")):
        figure = Figure(figsize=(6.4, 2.7), layout="constrained")
        figure.patch.set_alpha(0.0)
        row = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for axes, panel in zip(row, panels, strict=True):
            for line in panel.lines:
                looks = {**_marked_line(line.method), "elinewidth": 0.7}
                axes.errorbar(line.x, line.values, yerr=line.spreads, **looks)
            axes.set_xticks(list(panel.ticks), list(panel.ticks.values()))
            axes.set(xlabel=panel.label)
        row[0].set(ylabel=label)
        return _svg(figure, f"{label} {about}")


def _marked_line(method: str) -> dict[str, Any]:
    """A line with dots in the looks of a method."""
    style = method_style(method)
    return {
        "color": style.color,
        "linestyle": "--" if style.is_dashed else "-",
        "linewidth": 1.4,
        "marker": "o",
        "mfc": "white" if style.is_dashed else style.color,
        "markersize": 4,
    }


def top_view_svg(title: str, view: TopView) -> Markup:
    """Objects of one sequence from above, with the path of the camera."""
    with mpl.rc_context(_style(f"map {title}")):
        figure, axes = _new_map()
        path = view.path[_spread(len(view.path), PATH_POINTS)]
        axes.plot(path[:, 0], path[:, 1], color="#9ca3af", linewidth=1.0, zorder=1)
        _mark_start(axes, path, color="#6b7280", zorder=2)
        weak = ~view.is_strong
        axes.scatter(
            view.xy[weak, 0], view.xy[weak, 1], s=6, color="#d1d5db", zorder=2, linewidths=0
        )
        for row in np.flatnonzero(view.is_strong).tolist():
            (x, y), yaw_rad, color = view.xy[row], view.yaw_rad[row], view.colors[row]
            if np.isfinite(yaw_rad):
                along, across = YAW_MARK_M * np.cos(yaw_rad), YAW_MARK_M * np.sin(yaw_rad)
                axes.plot([x, x + along], [y, y + across], color=color, linewidth=1.2)
            axes.plot(x, y, "o", color=color, markersize=6, mec="white", mew=0.6)
        return _svg(figure, f"Objects and camera path from above, {title}")


def path_svg(title: str, view: PathView) -> Markup:
    """The path of a camera from above, the true one dashed beside it."""
    with mpl.rc_context(_style(f"path {title}")):
        figure, axes = _new_map()
        for line, color, dashes in (
            (view.path, PATH_COLOR, "-"),
            (view.reference, REFERENCE_COLOR, "--"),
        ):
            x, y = line[_spread(len(line), PATH_POINTS)].T
            axes.plot(x, y, color=color, linestyle=dashes, linewidth=1.1)
        for places, color in view.marks:
            some = places[_spread(len(places), PATH_POINTS)]
            axes.scatter(some[:, 0], some[:, 1], s=9, color=color, zorder=3, linewidths=0)
        _mark_start(axes, view.path, color=PATH_COLOR, zorder=4)
        return _svg(figure, f"Camera path from above, {title}")


def class_colors(n_classes: int) -> list[str]:
    """One colour per class id."""
    palette = mpl.colormaps["tab20"].resampled(20)
    order = [*range(0, 20, 2), *range(1, 20, 2)]
    return [str(mpl.colors.to_hex(palette(order[i % 20]))) for i in range(n_classes)]


def _style(salt: str) -> Any:
    return {**STYLE, "svg.hashsalt": salt}


def _new(size_in: tuple[float, float]) -> tuple[Figure, Axes]:
    figure = Figure(figsize=size_in, layout="constrained")
    figure.patch.set_alpha(0.0)
    return figure, figure.add_subplot()


def _new_map() -> tuple[Figure, Axes]:
    figure, axes = _new((4.2, 3.8))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    return figure, axes


def _mark_start(axes: Axes, path: Array, color: str, zorder: int) -> None:
    """A ring where a path (m, 2) has its first pose."""
    seen = path[~np.isnan(path).any(axis=1)]
    if len(seen):
        axes.plot(*seen[0], marker="o", mfc="white", color=color, markersize=6, zorder=zorder)


def _spread(n: int, n_most: int) -> NDArray[np.int64]:
    """At most `n_most` positions spread evenly over n, both ends included."""
    if n <= n_most:
        return np.arange(n)
    return np.unique(np.linspace(0, n - 1, n_most).round().astype(np.int64))


def _svg(figure: Figure, description: str) -> Markup:
    """The figure's <svg> element, without prolog and metadata, as wide as its place allows."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", text)  # names of groups repeat between figures
    label = Markup('<svg role="img" aria-label="{}"').format(description)
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    return Markup(text.replace("<svg", label, 1))
