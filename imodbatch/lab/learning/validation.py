"""How good the detector is in the middle of a training: AP per class, and the viewpoints it names.

Boxes are kept as the pipeline's `detect` keeps them (threshold and NMS per class on the marginal
score) and matched as `score` matches them, so the figures mean the same. The azimuth is judged on
the boxes that found an object at IoU ≥ 0.5: the bin with the largest score of that class, summed
over elevations. A class of n-fold symmetry is right if one of its n equal bins is named; a fully
symmetric one has no azimuth and is left out.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.boxes import nms_per_category
from imodbatch.core.detections import Detections
from imodbatch.core.matching import Outcome
from imodbatch.core.precision import ap_voc07_11pt
from imodbatch.core.scoring import (
    Candidates,
    ScoredBoxes,
    Truth,
    average_precisions,
    match_all,
    mean_over_classes,
)
from imodbatch.core.symmetry import Symmetry, n_fold
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.learning.recipes import ValidationSection
from imodbatch.lab.learning.samples import Sample

IOU_THRESHOLD = 0.5
Predict = Callable[[list[NDArray[np.uint8]]], list[Detections]]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Validation:
    """What a validation found.

    Attributes:
        classes: K names.
        ap: (K,) ap_voc07_11pt of the marginal score, NaN without annotations.
        n_annotations: (K,) that count.
        azimuth_confusion: (K, N, N) boxes by true and named azimuth bin; 0 for a fully symmetric
            class. The named bin of an n-fold class is turned to the equal one next to the truth.
        elevation_confusion: (K, M, M) likewise.
    """

    classes: tuple[str, ...]
    ap: NDArray[np.float64]
    n_annotations: IntArray
    azimuth_confusion: IntArray
    elevation_confusion: IntArray

    @property
    def mean_ap(self) -> float:
        """Mean over the classes with annotations."""
        return mean_over_classes(self.ap)

    def azimuth_accuracy(self, tolerance_bins: int = 0) -> NDArray[np.float64]:
        """(K,) share of boxes whose azimuth is at most so many bins off; NaN where unknown."""
        n = self.azimuth_confusion.shape[1]
        off = np.abs(np.arange(n)[:, None] - np.arange(n)[None])
        right = np.minimum(off, n - off) <= tolerance_bins
        return _shares(self.azimuth_confusion, right)

    def elevation_accuracy(self) -> NDArray[np.float64]:
        """(K,) share of boxes with the right elevation bin; NaN where unknown."""
        return _shares(self.elevation_confusion, np.eye(self.elevation_confusion.shape[1]) > 0)

    def figures(self) -> dict[str, Any]:
        """The same as plain numbers for a card or a log; what is not known is None."""
        exact, near = self.azimuth_accuracy(0), self.azimuth_accuracy(1)
        return {
            "mean_ap_voc07_11pt": _plain(self.mean_ap),
            "azimuth_exact": _plain(mean_over_classes(exact)),
            "azimuth_within_1_bin": _plain(mean_over_classes(near)),
            "elevation_exact": _plain(mean_over_classes(self.elevation_accuracy())),
            "classes": {
                name: {
                    "ap_voc07_11pt": _plain(self.ap[k]),
                    "n_annotations": int(self.n_annotations[k]),
                    "azimuth_exact": _plain(exact[k]),
                    "azimuth_within_1_bin": _plain(near[k]),
                }
                for k, name in enumerate(self.classes)
            },
        }


def validate_detector(
    predict: Predict,
    samples: Iterable[Sample],
    classes: tuple[str, ...],
    symmetries: tuple[Symmetry, ...],
    grid: ViewGrid,
    config: ValidationSection,
) -> Validation:
    """Run a detector over samples and hold it against their truth.

    Args:
        predict: images → raw detections.
        samples: images with truth.
        classes: K names.
        symmetries: of each class.
        grid: the detector's viewpoint grid.
        config: threshold and NMS.
    """
    truth, found = _Rows(), _Rows()
    for number, sample in enumerate(samples):
        (raw,) = predict([sample.image])
        cells = raw.scores.reshape(len(raw), len(classes), grid.n_elevations, grid.n_azimuths)
        marginal = cells.sum(axis=(2, 3))
        kept = nms_per_category(raw.boxes, marginal, config.score_threshold, config.nms_iou)
        rois, ks = np.nonzero(kept)
        chosen = cells[rois, ks]
        found.add(
            number,
            ks,
            raw.boxes[rois],
            marginal[rois, ks],
            chosen.sum(axis=1).argmax(axis=1),
            chosen.sum(axis=2).argmax(axis=1),
        )
        known = ~(np.isnan(sample.azimuth_rad) | np.isnan(sample.elevation_rad))
        truth.add(
            number,
            sample.class_ids,
            sample.boxes,
            sample.is_ignored,
            np.where(known, grid.azimuth_bins(np.nan_to_num(sample.azimuth_rad)), -1),
            np.where(known, grid.elevation_bins(np.nan_to_num(sample.elevation_rad)), -1),
        )
    return _judge(found, truth, classes, symmetries, grid)


class _Rows:
    """Rows collected image by image: image, class, box, a value, azimuth bin, elevation bin."""

    def __init__(self) -> None:
        self._parts: list[list[NDArray[Any]]] = [[] for _ in range(6)]

    def add(self, image: int, *columns: NDArray[Any]) -> None:
        first = np.full(len(columns[0]), image)
        for part, column in zip(self._parts, (first, *columns), strict=True):
            part.append(np.asarray(column))

    def join(self, column: int, dtype: type) -> NDArray[Any]:
        parts = self._parts[column]
        return np.concatenate(parts).astype(dtype) if parts else np.zeros(0, dtype=dtype)

    def boxes(self) -> NDArray[np.float64]:
        return self.join(2, np.float64).reshape(-1, 4)


def _judge(
    found: _Rows,
    truth: _Rows,
    classes: tuple[str, ...],
    symmetries: tuple[Symmetry, ...],
    grid: ViewGrid,
) -> Validation:
    ignored = truth.join(3, np.bool_)
    true_rows = Truth(
        truth.join(0, np.int64),
        truth.join(1, np.int64),
        truth.boxes(),
        ignored,
        np.zeros(len(ignored), dtype=np.bool_),
    )
    rows = Candidates(found.join(0, np.int64), found.join(1, np.int64), found.boxes())
    scores = found.join(3, np.float64)
    matches = match_all(rows, scores, true_rows, IOU_THRESHOLD, "voc")
    n_annotations = true_rows.counted(len(classes))
    boxes = ScoredBoxes.ranked(scores, matches.outcome, rows.class_id, rows.image)
    ap = average_precisions(boxes, n_annotations, ap_voc07_11pt)
    azimuth = np.zeros((len(classes), grid.n_azimuths, grid.n_azimuths), dtype=np.int64)
    elevation = np.zeros((len(classes), grid.n_elevations, grid.n_elevations), dtype=np.int64)
    true_azimuth, true_elevation = truth.join(4, np.int64), truth.join(5, np.int64)
    named_azimuth, named_elevation = found.join(4, np.int64), found.join(5, np.int64)
    for row in np.flatnonzero(matches.outcome == Outcome.TRUE_POSITIVE):
        annotation, k = matches.annotation_index[row], rows.class_id[row]
        a, e = true_azimuth[annotation], true_elevation[annotation]
        if a < 0:
            continue
        elevation[k, e, named_elevation[row]] += 1
        turns = n_fold(symmetries[k])
        if turns is not None:
            b = _nearest_equal(int(named_azimuth[row]), int(a), turns, grid.n_azimuths)
            azimuth[k, a, b] += 1
    return Validation(classes, ap, n_annotations, azimuth, elevation)


def _nearest_equal(named: int, true: int, n_turns: int, n_azimuths: int) -> int:
    """Of the bins that look the same as the named one, the one nearest to the truth."""
    turns = np.arange(n_turns) * (n_azimuths / n_turns)
    equal = np.floor(named + turns + 0.5).astype(np.int64) % n_azimuths
    off = np.abs(equal - true)
    return int(equal[np.argmin(np.minimum(off, n_azimuths - off))])


def _shares(confusion: IntArray, right: NDArray[np.bool_]) -> NDArray[np.float64]:
    total = confusion.sum(axis=(1, 2))
    hits = np.where(right, confusion, 0).sum(axis=(1, 2))
    return np.where(total > 0, hits / np.maximum(total, 1), np.nan)


def _plain(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
