"""Several runs of the same data side by side, in the layout of the paper's Table 1.

A run of a detector that tells viewpoints apart gives the columns "w/ view", "Naive" and "Ours" of
its grid; a run of one that does not gives "w/o view", the same for every grid.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError
from imodbatch.core.precision import rank
from imodbatch.core.resampling import pooled_ap
from imodbatch.core.scoring import ScoredBoxes, mean_over_classes
from imodbatch.reporting.results import Results
from imodbatch.reporting.run_folder import FinishedRun
from imodbatch.tables.schemas import MEAN_CLASS_ID

WITHOUT_VIEW, WITH_VIEW, NAIVE, OURS = "w/o view", "w/ view", "Naive", "Ours"
OURS_OFFLINE = "Ours, all frames"
METHODS = {WITH_VIEW: "single", NAIVE: "naive", OURS: "imod", OURS_OFFLINE: "imod_offline"}
"""Column of Table 1 → method of a run, of a detector that tells viewpoints apart."""
DIFFERENCES = ((OURS, WITH_VIEW), (OURS, NAIVE), (WITH_VIEW, WITHOUT_VIEW))


@dataclass(frozen=True, eq=False)
class MethodColumn:
    """One column of figures.

    Attributes:
        group: the heading above it: in Table 1 the detector grid.
        name: as the paper names it.
        boxes: the ranked boxes of each class.
        aps: (K,) 11-point AP of each class, NaN without annotations.
    """

    group: str
    name: str
    boxes: tuple[ScoredBoxes, ...]
    aps: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Mean AP over the classes that have one."""
        return mean_over_classes(self.aps)

    def ap(self, class_id: int) -> float:
        """AP of a class or the mean; NaN = none."""
        return self.mean if class_id == MEAN_CLASS_ID else float(self.aps[class_id])

    def n_false_positives(self, class_id: int) -> int:
        """False positives of a class, or of all, at any score."""
        boxes = self.boxes if class_id == MEAN_CLASS_ID else (self.boxes[class_id],)
        return sum(int((~of_class.is_hit).sum()) for of_class in boxes)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Runs that were scored against the same annotations.

    Attributes:
        groups: a name for each detector grid, with its run; more azimuths first.
        without_view: the run of a detector without viewpoints, None = not among them.
    """

    groups: dict[str, FinishedRun]
    without_view: FinishedRun | None

    @property
    def any_run(self) -> FinishedRun:
        """One of them, for what all share: classes, sequences, annotations."""
        return next(iter(self.groups.values()))

    @property
    def runs(self) -> tuple[FinishedRun, ...]:
        """All of them, that of a detector without viewpoints first."""
        without = () if self.without_view is None else (self.without_view,)
        return (*without, *self.groups.values())

    @cached_property
    def n_annotations(self) -> NDArray[np.int64]:
        """(K, S) annotations that count, per class and sequence."""
        run = self.any_run
        ids = run.results.annotations.select(["class_id", "sequence_id"]).to_pandas()
        counts = pd.crosstab(ids.class_id, ids.sequence_id).reindex(
            index=range(len(run.classes)), columns=list(run.sequence_ids), fill_value=0
        )
        return counts.to_numpy(np.int64)

    def n_counted(self, class_id: int) -> int:
        """Annotations of a class, or of all, that count."""
        rows = slice(None) if class_id == MEAN_CLASS_ID else class_id
        return int(self.n_annotations[rows].sum())

    @cached_property
    def columns(self) -> tuple[MethodColumn, ...]:
        """Every column of figures, group by group in the paper's order."""
        found = []
        for group, run in self.groups.items():
            if self.without_view is not None:
                single = METHODS[WITH_VIEW]
                found.append(self.column(group, WITHOUT_VIEW, self.without_view, single))
            found += [
                self.column(group, name, run, method)
                for name, method in METHODS.items()
                if method in run.results.methods
            ]
        return tuple(found)

    def column(self, group: str, name: str, run: FinishedRun, method: str) -> MethodColumn:
        """The figures of a method of one of the runs."""
        boxes = ranked_boxes(run.results, method, len(run.classes))
        once = np.ones(len(self.any_run.sequence_ids), dtype=np.int64)
        pairs = zip(boxes, self.n_annotations, strict=True)
        aps = np.array([pooled_ap(ranked, n, once) for ranked, n in pairs])
        return MethodColumn(group, name, boxes, aps)


def compare_runs(runs: Sequence[FinishedRun]) -> Comparison:
    """Put runs side by side.

    Raises:
        ConfigError: they were scored against other annotations or at another IoU, none tells
            viewpoints apart, or several do not.
    """
    for run in runs[1:]:
        _require_same_truth(runs[0], run)
    without = [run for run in runs if not run.grid.has_viewpoints]
    aware = sorted((r for r in runs if r.grid.has_viewpoints), key=lambda r: -r.grid.n_azimuths)
    if not aware:
        raise ConfigError(
            f"{runs[0].folder}: its detector tells no viewpoints apart. Name a run of one that "
            "does beside it."
        )
    if len(without) > 1:
        raise ConfigError(
            f"{without[0].folder} and {without[1].folder} are both of detectors without "
            "viewpoints. Name one of them."
        )
    grids = [str(run.grid) for run in aware]
    groups = {
        grid if grids.count(grid) == 1 else f"{grid} {run.folder.name}": run
        for grid, run in zip(grids, aware, strict=True)
    }
    if len(groups) < len(aware):
        raise ConfigError(f"{aware[0].folder}: several runs have this name. Name each once.")
    return Comparison(groups, without[0] if without else None)


def ranked_boxes(results: Results, method: str, n_classes: int) -> tuple[ScoredBoxes, ...]:
    """The boxes of each class under a method, ranked as the metrics rank them."""
    matches = results.matches(method)
    order = rank(matches.score, matches.sequence, matches.frame, matches.detection)
    boxes = matches.take(order).scored()
    return tuple(boxes.of_class(k) for k in range(n_classes))


def _require_same_truth(first: FinishedRun, other: FinishedRun) -> None:
    """Refuse to set figures of different data beside each other."""
    told: dict[str, Callable[[FinishedRun], object]] = {
        "classes": lambda run: run.classes,
        "sequences": lambda run: run.sequence_ids,
        "annotations": lambda run: run.results.tables["annotations"],
        "matching.iou_percents": lambda run: run.results.main_iou,
    }
    for name, of in told.items():
        if of(first) != of(other):
            raise ConfigError(
                f"{first.folder} and {other.folder} differ in {name}. Compare runs of one "
                "manifest, and bring both up to date with `imodbatch run`."
            )
