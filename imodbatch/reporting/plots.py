"""From tables to the page's plots: which lines, dots and objects each one shows."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from markupsafe import Markup

from imodbatch.core.trajectory import LOST
from imodbatch.reporting.figures import (
    TopView,
    class_colors,
    precision_recall_svg,
    sweep_svg,
    top_view_svg,
)
from imodbatch.reporting.names import AP_METRICS, OFFLINE, in_order, plural
from imodbatch.reporting.results import Results, centers_from_above, curve
from imodbatch.reporting.run_info import RunInfo
from imodbatch.reporting.scores import HEADLINE

MOST_MAPS = 24


def precision_recall_plots(
    results: Results, classes: Sequence[str]
) -> list[tuple[str, str, Markup]]:
    """(class, remark, SVG) for each class with annotations."""
    shown = [i for i in range(len(classes)) if results.n_annotations(i)]
    matches = {method: results.matches(method) for method in results.methods} if shown else {}
    plots = []
    for class_id in shown:
        n = results.n_annotations(class_id)
        curves = [(method, curve(rows, class_id, n)) for method, rows in matches.items()]
        points = []
        for method in results.methods:
            precision = results.value(method, class_id, "precision")
            recall = results.value(method, class_id, "recall")
            if precision is not None and recall is not None:
                points.append((method, recall, precision))
        svg = precision_recall_svg(classes[class_id], curves, points)
        plots.append((classes[class_id], plural(n, "annotation"), svg))
    return plots


def sweep_plot(sweeps: pa.Table, info: RunInfo) -> Markup | None:
    """The sweep over voxel sizes; None if there is none."""
    rows = [row for row in sweeps.to_pylist() if row["value"] is not None]
    if not rows:
        return None
    names = sorted({row["metric"] for row in rows}, key=lambda name: (name != HEADLINE, name))
    rows = sorted((r for r in rows if r["metric"] == names[0]), key=lambda r: r["voxel_mm"])
    lines = []
    for method in in_order(row["method"] for row in rows):
        of_method = [row for row in rows if row["method"] == method]
        sizes, values = ([row[name] for row in of_method] for name in ("voxel_mm", "value"))
        lines.append((method, sizes, values))
    used_m = info.setting("lift", "voxel_size_m")
    label = f"mean {AP_METRICS.get(names[0], names[0])}"
    return sweep_svg(lines, None if used_m is None else 1000 * float(used_m), label)


def objects_method(objects: pa.Table, frame_method: str) -> str:
    """The method whose objects are shown: `frame_method`, or its sibling that has some."""
    base = frame_method.removesuffix(OFFLINE)
    found = set(pc.unique(objects["method"]).to_pylist())
    choice = [frame_method, base + OFFLINE, base]
    return next((method for method in choice if method in found), frame_method)


def maps(
    results: Results, info: RunInfo, frame_method: str
) -> tuple[list[tuple[str, str, Markup]], list[tuple[str, str]], int]:
    """Top views (sequence, remark, SVG), the classes in them with colours, and how many are left.

    A sequence without objects and poses has nothing to show.
    """
    objects = results.tables["objects"]
    objects = objects.filter(pc.field("method") == objects_method(objects, frame_method))
    all_poses = results.tables["poses"]
    palette = class_colors(len(info.classes))
    views, seen = [], set()
    drawable = _sequences(objects) | _sequences(all_poses.filter(pc.field("status") != LOST))
    for sequence_id in sorted(drawable)[:MOST_MAPS]:
        is_here = pc.field("sequence_id") == sequence_id
        rows = objects.filter(is_here).sort_by("object_index").to_pylist()
        poses = all_poses.filter(is_here).sort_by("frame_index")
        strong = [row["score"] >= _threshold(results, row, frame_method) for row in rows]
        seen |= {row["class_id"] for row, is_one in zip(rows, strong, strict=True) if is_one}
        view = TopView(
            xy=np.array([(row["x_m"], row["y_m"]) for row in rows]).reshape(-1, 2),
            colors=[
                palette[row["class_id"] % len(palette)] if palette else "black" for row in rows
            ],
            is_strong=np.array(strong, dtype=np.bool_),
            yaw_rad=np.array([row["yaw_rad"] for row in rows], dtype=np.float64),
            path=centers_from_above(poses),
        )
        remark = f"{plural(len(rows), 'object')}, {sum(strong)} at or above threshold"
        views.append((sequence_id, remark, top_view_svg(sequence_id, view)))
    legend = [(info.class_name(i), palette[i % len(palette)]) for i in sorted(seen)]
    return views, legend, max(0, len(drawable) - MOST_MAPS)


def _threshold(results: Results, row: dict[str, int], frame_method: str) -> float:
    """Tuned threshold of an object's class; objects see all frames, so the offline one is right."""
    base = frame_method.removesuffix(OFFLINE)
    values = (results.value(m, row["class_id"], "threshold") for m in (base + OFFLINE, base))
    return next((value for value in values if value is not None), -np.inf)


def _sequences(table: pa.Table) -> set[str]:
    return set(pc.unique(table["sequence_id"]).to_pylist())
