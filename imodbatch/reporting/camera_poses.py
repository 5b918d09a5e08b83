"""How good the camera poses are: figures per sequence, and paths from above with the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from markupsafe import Markup
from numpy.typing import NDArray

from imodbatch.core.trajectory import DENSE, INTERPOLATED, LOST, STATUSES
from imodbatch.reporting.figures import PATH_COLOR, REFERENCE_COLOR, PathView, path_svg
from imodbatch.reporting.grids import Cell, Column, Grid, Row
from imodbatch.reporting.names import DASH, number, plural
from imodbatch.reporting.results import centers_from_above

MOST_PATHS = 24
MARKS = {DENSE: "#d97706", INTERPOLATED: "#9d4edd"}
"""Colours of frames whose pose is not simply tracked."""
WALK, IMAGES, TRUTH = "walk", "against the images", "against true poses"
COUNTS = ("frames", *STATUSES)


@dataclass(frozen=True)
class _Shown:
    """How a metric is shown: heading, the group it stands in, factor and digits."""

    heading: str
    group: str
    factor: float = 1.0
    digits: int = 1


SHOWN = {
    "path_length_m": _Shown("length (m)", WALK),
    "duration_s": _Shown("time (s)", WALK),
    "reprojection_median_px": _Shown("features off (px)", IMAGES),
    "reprojection_p90_px": _Shown("features off, 90 % (px)", IMAGES),
    "depth_consistency_median_m": _Shown("depth apart (cm)", IMAGES, 100),
    "depth_consistency_share": _Shown("depth agrees (%)", IMAGES, 100),
    "loop_error_median_m": _Shown("on return (cm)", IMAGES, 100),
    "loop_error_median_deg": _Shown("on return (°)", IMAGES),
    "ate_se3_rmse_m": _Shown("ATE (cm)", TRUTH, 100),
    "ate_se3_max_m": _Shown("ATE, largest (cm)", TRUTH, 100),
    "ate_sim3_rmse_m": _Shown("ATE, scaled (cm)", TRUTH, 100),
    "sim3_scale": _Shown("scale to truth", TRUTH, digits=3),
    "rpe_translation_rmse_m": _Shown("RPE (cm)", TRUTH, 100),
    "rpe_rotation_rmse_deg": _Shown("RPE (°)", TRUTH, digits=2),
    "up_error_deg": _Shown("up off by (°)", TRUTH, digits=2),
}
"""In the order of the columns; a metric neither here nor below is one of the source's own."""
HIDDEN = (*COUNTS, "depth_overlap_share", "loop_pairs", "ate_se3_median_m")
WITH_N = ("loop_error_median_m",)
OWN = _Shown("", "", digits=3)
Figures = dict[tuple[str, str], dict[str, float]]
"""By sequence and metric, rows of pose_quality."""


@dataclass(frozen=True)
class PoseSection:
    """The page's section: its tables, paths as (sequence, remark, SVG), and a legend of marks."""

    grids: list[Grid]
    paths: list[tuple[str, str, Markup]]
    marks: list[tuple[str, str]]
    has_truth: bool
    n_left: int
    colors: tuple[str, str] = (PATH_COLOR, REFERENCE_COLOR)

    @property
    def markdown(self) -> str:
        """The tables."""
        return "\n".join(grid.markdown() for grid in self.grids)


def pose_section(
    quality: pa.Table, poses: pa.Table, reference_poses: pa.Table
) -> PoseSection | None:
    """The section on poses; None where nothing was judged.

    Args:
        quality: the pose_quality table of all sequences.
        poses: the poses table of all sequences.
        reference_poses: true poses, aligned; sequences without any have no rows.
    """
    if quality.num_rows == 0:
        return None
    figures = {(row["sequence_id"], row["metric"]): row for row in quality.to_pylist()}
    sequence_ids = sorted({sequence_id for sequence_id, _ in figures})
    paths, kinds = [], set()
    for sequence_id in sequence_ids[:MOST_PATHS]:
        is_here = pc.field("sequence_id") == sequence_id
        here = poses.filter(is_here).sort_by("frame_index")
        true = reference_poses.filter(is_here).sort_by("frame_index")
        status = np.array(here["status"].to_pylist(), dtype=np.str_)
        kinds |= set(status.tolist())
        path = centers_from_above(here)
        marks = [(path[status == kind], color) for kind, color in MARKS.items()]
        view = PathView(path, centers_from_above(true), marks)
        paths.append((sequence_id, _remark(status), path_svg(sequence_id, view)))
    return PoseSection(
        _grids(figures, sequence_ids),
        paths,
        [(kind, color) for kind, color in MARKS.items() if kind in kinds],
        reference_poses.num_rows > 0,
        max(0, len(sequence_ids) - MOST_PATHS),
    )


def _grids(figures: Figures, sequence_ids: Sequence[str]) -> list[Grid]:
    """Sequences down, figures across; then what the source says of itself, the other way round.

    A figure that no sequence has is left out, and so is a source that says nothing.
    """
    known = (metric for (_, metric), row in figures.items() if row["value"] is not None)
    found = dict.fromkeys(known)
    shown = {metric: looks for metric, looks in SHOWN.items() if metric in found}
    rows = tuple(
        Row(name, tuple(_cell(m, looks, figures.get((name, m))) for m, looks in shown.items()))
        for name in sequence_ids
    )
    columns = tuple(Column(looks.heading, looks.group) for looks in shown.values())
    grids = [Grid("poses", "How good the camera poses are", "sequence", columns, rows)]
    own = [metric for metric in found if metric not in SHOWN and metric not in HIDDEN]
    rows = tuple(
        Row(m.replace("_", " "), tuple(_cell(m, OWN, figures.get((s, m))) for s in sequence_ids))
        for m in own
    )
    title = "What the source of the poses says of itself"
    columns = tuple(map(Column, sequence_ids))
    return [*grids, Grid("poses-source", title, "figure", columns, rows)] if own else grids


def _cell(metric: str, looks: _Shown, row: dict[str, float] | None) -> Cell:
    if row is None or row["value"] is None:
        return Cell(DASH)
    note = plural(int(row["n"]), "pair") if metric in WITH_N else ""
    value = looks.factor * row["value"]
    is_count = looks is OWN and float(value).is_integer()
    return Cell(f"{int(value):,}" if is_count else number(value, looks.digits), note)


def _remark(status: NDArray[np.str_]) -> str:
    counts = {kind: int((status == kind).sum()) for kind in (DENSE, INTERPOLATED, LOST)}
    parts = [f"{n:,} {kind}" for kind, n in counts.items() if n]
    return ", ".join([plural(len(status), "frame"), *parts])
