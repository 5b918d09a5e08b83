"""Precision and recall of several runs at tuned thresholds: the figures of the paper's Table 2.

Every method scores the same boxes of its detector, so each is tuned on its own: a threshold on
fused scores says nothing of one on single frames.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError
from imodbatch.core.scoring import mean_over_classes
from imodbatch.core.tuning import Counts, counts_at, leave_one_out, reaches, tune_thresholds
from imodbatch.reporting.comparison import Comparison, MethodColumn
from imodbatch.reporting.names import OFFLINE, method_style
from imodbatch.reporting.results import MatchColumns
from imodbatch.reporting.run_folder import FinishedRun

Array = NDArray[np.float64]
Background = Callable[[FinishedRun, pa.Table], tuple[float, float]]
"""A run and the keys of the boxes kept → precision and recall of the background, per pixel."""

ON_TEST, HELD_OUT = "tuned on the test set", "held-out sequences"
TUNINGS = {ON_TEST: tune_thresholds, HELD_OUT: leave_one_out}

WITHOUT_VIEWPOINT = "w/o viewpoint"
SINGLE, MULTI, ALL_FRAMES = "single view", "multi-view", "multi-view, all frames"
SINGLE_METHOD = "single"
NAMES = {
    SINGLE_METHOD: "w/ viewpoint",
    "naive": "Naive",
    "naive_log": "SLAM-aware rule",
    "imod": "Ours",
}
"""Method of a run of a detector that tells viewpoints apart → its column's name in Table 2."""


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """One column under one tuning.

    Attributes:
        thresholds: (K, S) per class and sequence; NaN = none could be tuned.
        counts: what they keep.
        background: precision and recall per pixel; NaN where undefined.
    """

    thresholds: Array
    counts: Counts
    background: tuple[float, float]

    @property
    def mean(self) -> tuple[float, float]:
        """Mean precision and mean recall over the classes that have them and the background."""
        per_class = (self.counts.precision, self.counts.recall)
        pairs = zip(per_class, self.background, strict=True)
        precision, recall = (mean_over_classes(np.append(values, b)) for values, b in pairs)
        return precision, recall

    def n_untuned(self, n_annotations: NDArray[np.int64]) -> NDArray[np.int64]:
        """Annotations per class (K,) in sequences where the class has no threshold."""
        return np.asarray(n_annotations.sum(axis=1) - self.counts.n_annotations)


@dataclass(frozen=True, eq=False)
class Table2Column(MethodColumn):
    """One method of one run; its group is single view, or what a multi-view method has seen.

    Attributes:
        grid: of the detector whose runs are compared, such as ``3×12``.
        points: by tuning; held-out sequences are absent where there is one only.
    """

    grid: str
    run: FinishedRun
    method: str
    points: Mapping[str, OperatingPoint]


def table_2_columns(
    comparison: Comparison, step: float, background: Background
) -> tuple[Table2Column, ...]:
    """Every column of Table 2, detector by detector in the paper's order; others after those.

    Args:
        comparison: runs that go together, one of a detector without viewpoints among them.
        step: between thresholds.
        background: counts pixels.

    Raises:
        ConfigError: there is no run of a detector without viewpoints.
    """
    without = comparison.without_view
    if without is None:
        raise ConfigError(
            f"{comparison.any_run.folder}: Table 2 compares with a detector without viewpoints, "
            "and no run of one is named. Name one beside it, or leave out --table 2."
        )
    found = []
    for grid, run in comparison.groups.items():
        chosen = [(SINGLE, WITHOUT_VIEWPOINT, without, SINGLE_METHOD)]
        chosen += [(*_heading(method), run, method) for method in _methods(run)]
        found += [_column(comparison, grid, *entry, step, background) for entry in chosen]
    return tuple(found)


def _methods(run: FinishedRun) -> list[str]:
    """Methods of a run in the order of the columns."""
    order = [*NAMES, *(name + OFFLINE for name in NAMES)]
    scored = run.results.methods
    return [m for m in order if m in scored] + [m for m in scored if m not in order]


def _heading(method: str) -> tuple[str, str]:
    """Group and name of a method's column."""
    base = method.removesuffix(OFFLINE)
    name = NAMES.get(base) or method_style(base).name
    if method == SINGLE_METHOD:
        return SINGLE, name
    return (MULTI if base == method else ALL_FRAMES), name


def _column(
    comparison: Comparison,
    grid: str,
    group: str,
    name: str,
    run: FinishedRun,
    method: str,
    step: float,
    background: Background,
) -> Table2Column:
    matches = run.results.matches(method)
    boxes = matches.scored()
    annotations = comparison.n_annotations
    points = {}
    for tuning, tune in TUNINGS.items():
        if tuning == HELD_OUT and annotations.shape[1] == 1:
            continue
        thresholds = tune(boxes, annotations, step)
        points[tuning] = OperatingPoint(
            thresholds,
            counts_at(boxes, annotations, thresholds),
            background(run, _kept(matches, thresholds, run.sequence_ids)),
        )
    ranked = comparison.column(group, name, run, method)
    return Table2Column(**vars(ranked), grid=grid, run=run, method=method, points=points)


def _kept(matches: MatchColumns, thresholds: Array, sequence_ids: tuple[str, ...]) -> pa.Table:
    """Keys of the boxes that reach their threshold, those on ignored annotations included."""
    rows = matches.take(reaches(matches.score, matches.class_id, matches.sequence, thresholds))
    return pa.table(
        {
            "sequence_id": pa.array([sequence_ids[s] for s in rows.sequence], pa.string()),
            "frame_index": pa.array(rows.frame, pa.int32()),
            "detection_index": pa.array(rows.detection, pa.int32()),
        }
    )
