"""report: all tables of a run → one HTML page that stands alone, with its tables as Markdown, CSV.

The page is read from top to bottom: what this is, how good each method is, where it goes wrong,
what was lost on the way, and how to get at every number again. It computes no score: its figures
are those of the metrics table.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from imodbatch.reporting.camera_poses import pose_section
from imodbatch.reporting.csv_text import csv_of, to_csv
from imodbatch.reporting.gallery import ReadColor, gallery
from imodbatch.reporting.grids import Grid
from imodbatch.reporting.jitters import jitter_section
from imodbatch.reporting.losses import StatusCount, losses_grid, status_counts, status_grid
from imodbatch.reporting.names import OFFLINE, in_order, method_style, number, plural
from imodbatch.reporting.page import page
from imodbatch.reporting.paper import MARK, PaperColumn, columns
from imodbatch.reporting.pictures import COLORS
from imodbatch.reporting.plots import maps, precision_recall_plots, sweep_plot
from imodbatch.reporting.results import Results
from imodbatch.reporting.run_info import RunInfo
from imodbatch.reporting.scores import (
    HEADLINE,
    ap_csv,
    ap_grid,
    ap_metrics,
    paper_precision_recall_grid,
    precision_recall_csv,
    precision_recall_grid,
)
from imodbatch.settings.config import ReportConfig
from imodbatch.tables.atomic import write_text
from imodbatch.tables.schemas import MEAN_CLASS_ID, TABLES

__all__ = ["RunInfo", "run"]

PAGE = "report.html"


def run(
    run_info: RunInfo,
    tables: Mapping[str, pa.Table],
    read_color: ReadColor,
    config: ReportConfig,
    out_dir: Path,
) -> Path:
    """Write the report of a run and return the page's path.

    Args:
        run_info: what stands in no table.
        tables: every table of the run by name, sequences joined; those that are absent count as
            empty. `detections.view_scores` is not needed.
        read_color: the frames table's `color_path` → (H, W, 3) uint8 RGB. Where it raises
            `DataError`, the picture is left out and the page says why.
        config: what is shown.
        out_dir: where page, Markdown and CSV go.
    """
    complete = {name: tables.get(name, spec.schema.empty_table()) for name, spec in TABLES.items()}
    results = Results(complete, _sequence_ids(complete))
    paper = columns(config.paper, int(run_info.setting("viewpoint", "n_azimuths") or 16))
    counts = status_counts(complete)
    aps = [
        ap_grid(results, run_info.classes, metric, iou, paper)
        for metric, iou in ap_metrics(results)
    ]
    at_threshold = [precision_recall_grid(results, run_info.classes)]
    if published := paper_precision_recall_grid(run_info.classes, paper):
        at_threshold.append(published)
    context = {
        **_words(results, run_info, paper, config),
        **_frames(results, run_info, read_color, config),
        **_plots(results, run_info, config),
        "ap_grids": aps,
        "precision_recall": at_threshold,
        "has_precision_recall": any(
            results.has(metric, results.main_iou) for metric in ("precision", "recall")
        ),
        "status": status_grid(counts, results.sequence_ids),
        "losses": losses_grid(complete["losses"], run_info),
        "camera_poses": pose_section(
            *(complete[name] for name in ("pose_quality", "poses", "reference_poses"))
        ),
        "jitter": jitter_section(complete["jitters"]),
        "dictionary": _dictionary(complete),
    }
    out_dir.mkdir(parents=True, exist_ok=True)
    write_text(out_dir / "ap.md", _markdown(aps, _ap_remark(results, run_info, paper)))
    write_text(out_dir / "ap.csv", ap_csv(results, run_info.classes))
    remark = context["threshold_remark"]
    write_text(out_dir / "precision_recall.md", _markdown(at_threshold, remark))
    write_text(out_dir / "precision_recall.csv", precision_recall_csv(results, run_info.classes))
    write_text(out_dir / "status_counts.csv", to_csv(StatusCount._fields, counts))
    if context["camera_poses"]:
        write_text(out_dir / "poses.md", context["camera_poses"].markdown)
        write_text(out_dir / "poses.csv", csv_of(complete["pose_quality"]))
    if context["jitter"]:
        write_text(out_dir / "jitters.csv", csv_of(complete["jitters"]))
    else:
        (out_dir / "jitters.csv").unlink(missing_ok=True)
    write_text(out_dir / PAGE, page("report.html.j2", {**context, "info": run_info}))
    return out_dir / PAGE


def _sequence_ids(tables: Mapping[str, pa.Table]) -> tuple[str, ...]:
    found: set[str] = set()
    for table in tables.values():
        if "sequence_id" in table.column_names:
            found |= set(pc.unique(table["sequence_id"]).to_pylist())
    return tuple(sorted(found))


def _words(
    results: Results, info: RunInfo, paper: tuple[PaperColumn, ...], config: ReportConfig
) -> dict[str, Any]:
    """The sentences of the page."""
    return {
        "what_this_is": _what_this_is(results),
        "problems": _problems(results),
        "lead": _lead(results, config.frame_method),
        "ap_remark": _ap_remark(results, info, paper),
        "threshold_remark": _threshold_remark(results, info, paper),
        "curve_remark": _curve_remark(results, info),
        "main_iou": results.main_iou,
        "styles": [method_style(method) for method in results.methods],
        "paper_mark": MARK,
    }


def _what_this_is(results: Results) -> str:
    tables = results.tables
    n_ignored = tables["annotations"].num_rows - results.annotations.num_rows
    remark = f" ({n_ignored:,} of them ignored)" if n_ignored else ""
    return (
        f"Boxes that a detector found in single frames, scored anew by what all views of the same "
        f"place say. {plural(len(results.sequence_ids), 'sequence')}, "
        f"{plural(tables['frames'].num_rows, 'frame')}, "
        f"{plural(tables['annotations'].num_rows, 'annotation')}{remark}, "
        f"{plural(tables['detections'].num_rows, 'detection')}. Every method scores the same "
        f"boxes; a box that has no place in the world keeps its single-view score. Methods without "
        f"“all frames” know only the frames up to the box's own."
    )


def _problems(results: Results) -> list[str]:
    missing = {
        "frames": "There are no frames.",
        "annotations": "There are no annotations: nothing can be scored, all detections stand "
        "unjudged.",
        "detections": "There are no detections.",
        "poses": "There are no poses: no box has a place in the world.",
        "metrics": "There are no metrics.",
    }
    return [text for name, text in missing.items() if results.tables[name].num_rows == 0]


def _lead(results: Results, frame_method: str) -> str:
    """Mean headline AP of single view, and of the chosen method online and offline."""
    base = frame_method.removesuffix(OFFLINE)
    means = {
        method: results.value(method, MEAN_CLASS_ID, HEADLINE)
        for method in in_order(("single", base, base + OFFLINE))
    }
    single = means.get("single")
    parts = []
    for method, value in means.items():
        if value is None:
            continue
        gain = "" if single is None or method == "single" else f" ({value - single:+.3f})"
        parts.append(f"{method_style(method).name} {number(value)}{gain}")
    return "Mean AP: " + "; ".join(parts) + "." if parts else ""


def _ap_remark(results: Results, info: RunInfo, paper: tuple[PaperColumn, ...]) -> str:
    text = "The best of each row is bold."
    if any(results.n_evaluated(i) == 0 for i in range(len(info.classes))):
        text += (
            " A class without annotations has no AP and is left out of the mean; its false "
            "positives, at any score, are shown."
        )
    if paper:
        text += (
            " The paper's columns were measured on other data, their means over the paper's own "
            "classes: they are no target that these figures meet or miss."
        )
    return text


def _threshold_remark(results: Results, info: RunInfo, paper: tuple[PaperColumn, ...]) -> str:
    step = info.setting("metrics", "threshold_step")
    where = {
        True: "on the very sequences evaluated here, which flatters every method",
        False: "on other sequences than those evaluated",
        None: "on sequences that the metrics do not name",
    }[results.is_tuned_on_test()]
    names = info.setting("metrics", "threshold_sequences")
    named = f" ({', '.join(names)})" if names and not results.is_tuned_on_test() else ""
    steps = f", in steps of {step}," if step else ""
    means = (
        " The paper's own columns count background as one more row in their means of precision and "
        "recall; ours do not."
        if any(column.precision_recall for column in paper)
        else ""
    )
    return (
        f"Read at the threshold per class and method (“≥”){steps} that maximises F1, tuned "
        f"{where}{named}. Background is counted in pixels: all outside the kept boxes.{means}"
    )


def _curve_remark(results: Results, info: RunInfo) -> str:
    """Says so if the curves stand on other annotations than the metrics."""
    class_ids = range(len(info.classes))
    drawn, evaluated = (
        sum(count(i) for i in class_ids) for count in (results.n_annotations, results.n_evaluated)
    )
    is_elsewhere = results.is_tuned_on_test() is False
    elsewhere = (
        " The curves stand on all sequences, the dots on those that the thresholds were not tuned "
        "on, so a dot may lie beside its curve."
        if is_elsewhere
        else ""
    )
    if drawn == evaluated:
        return elsewhere
    return elsewhere + (
        f" The curves stand on the {drawn:,} annotations of all sequences, the metrics on "
        f"{evaluated:,} of them."
    )


def _frames(
    results: Results, info: RunInfo, read_color: ReadColor, config: ReportConfig
) -> dict[str, Any]:
    """Frames under single view beside the chosen method, and why they may be absent."""
    wanted = dict.fromkeys(("single", config.frame_method))
    methods = [method for method in wanted if method in results.methods]
    size = {"n_frames": config.n_frames, "max_width_px": config.max_image_width_px}
    shown = gallery(results, info, methods, read_color, **size) if methods else []
    reason = "No frame has annotations, so no box can be called right or wrong."
    if config.n_frames == 0:
        reason = "None were asked for (report.n_frames = 0)."
    elif not methods:
        reason = f"Neither single nor {config.frame_method} was scored."
    unlimited = [
        name
        for i, name in enumerate(info.classes)
        if any(results.value(method, i, "threshold") is None for method in methods)
    ]
    remark = "Boxes whose score reaches the method's tuned threshold for the class."
    if absent := [method for method in wanted if method not in methods]:
        remark += f" Not scored in this run: {', '.join(absent)}."
    if unlimited:
        remark += f" Without a tuned threshold, and so not drawn: {', '.join(unlimited)}."
    return {
        "frames": shown,
        "no_frames_reason": reason,
        "frames_remark": remark,
        "box_colors": COLORS,
    }


def _plots(results: Results, info: RunInfo, config: ReportConfig) -> dict[str, Any]:
    views, legend, n_left = maps(results, info, config.frame_method)
    remark = f"Objects of {method_style(config.frame_method).name} after all frames, +z towards "
    remark += "the reader; a stroke points along the object's own x axis where its yaw is known."
    if n_left:
        remark += f" {plural(n_left, 'more sequence')} not drawn."
    return {
        "curves": precision_recall_plots(results, info.classes),
        "sweep": sweep_plot(results.tables["sweeps"], info),
        "maps": views,
        "class_legend": legend,
        "map_remark": remark,
    }


def _dictionary(tables: Mapping[str, pa.Table]) -> list[tuple[str, str, str, str]]:
    """(table, rows, key, other columns) of every table."""
    return [
        (
            name,
            f"{tables[name].num_rows:,}",
            ", ".join(spec.key),
            ", ".join(column.name for column in spec.columns if column.name not in spec.key),
        )
        for name, spec in TABLES.items()
    ]


def _markdown(grids: list[Grid], remark: str) -> str:
    return "\n".join(grid.markdown() for grid in grids) + f"\n{remark}\n"
