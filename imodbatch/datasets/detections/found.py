"""What every detection format comes down to, and which of it is kept."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.boxes import area, clip
from imodbatch.core.detections import Detections, one_hot
from imodbatch.core.errors import DataError
from imodbatch.datasets.base import Footage
from imodbatch.datasets.names import NO_AREA, OUTSIDE_IMAGE, UNKNOWN_FRAMES, Place, sharing

KEY = "detections.path"
OTHER_SEQUENCES = "other sequences"
OTHER_CLASSES = "other classes"


@dataclass(frozen=True)
class Grid:
    """What a score vector has an entry for: K classes x M elevations x N azimuths."""

    n_classes: int
    n_elevations: int
    n_azimuths: int

    @property
    def n_scores(self) -> int:
        """K·M·N."""
        return self.n_classes * self.n_elevations * self.n_azimuths


@dataclass(frozen=True, eq=False)
class ImportedDetections(Detections):
    """Detections of a sequence in the order of the file, cut at the image's border.

    Attributes:
        frame_index: (R,) int64 frame numbers.
        left_out: reason → number of entries of the file that gave no detection.
    """

    frame_index: NDArray[np.int64]
    left_out: Counter[str]


@dataclass(frozen=True)
class Entries:
    """The entries of a file, for errors; `name` says what to call the entry of a number."""

    path: Path
    name: Callable[[int], str]

    def refuse(self, faulty: ArrayLike, fault: Callable[[int], str], cure: str) -> None:
        """Refuse the file for its first faulty entry, if there is one.

        Args:
            faulty: (R,) bool.
            fault: number of an entry → what is wrong with it.
            cure: what to do about it.

        Raises:
            DataError: there is one.
        """
        rows = np.flatnonzero(faulty).tolist()
        if rows:
            raise DataError(
                f"{self.path}: {self.name(rows[0])}: {fault(rows[0])} ({len(rows)} such entries). "
                f"{cure}"
            )


@dataclass(frozen=True, eq=False)
class Found:
    """All entries of a file.

    Attributes:
        entries: their names.
        detections: R of them, boxes float64; score rows of other classes are 0.
        places: (R,) where each belongs, or why nowhere.
        place_names: (R,) how the file calls its image, for errors.
        cure: what to do about a box that runs backwards.
    """

    entries: Entries
    detections: Detections
    places: Sequence[Place]
    place_names: Sequence[Any]
    cure: str


def refuse_shared_numbers(footage: Footage, pattern: str, cure: str) -> None:
    """Refuse frame numbers in a file that sequences of different folders read.

    Raises:
        DataError: there are such sequences.
    """
    manifest, sequence = footage.manifest, footage.sequence
    others = sharing(manifest, sequence, pattern)
    if others:
        path = manifest.path_in(sequence, pattern)
        raise DataError(
            f"{path}: is read for {sequence.id} and {others[0].id}, and frame numbers do not say "
            f"whose they are. {cure}, or put {{sequence}} into {KEY}."
        )


def of_classes(
    entries: Entries,
    boxes: NDArray[np.float64],
    class_ids: Sequence[int | None],
    scores: NDArray[np.float64],
    n_classes: int,
) -> Detections:
    """The boxes of a detector that names one class per box.

    Args:
        entries: names of the R boxes.
        boxes: (R, 4) corners in continuous pixels.
        class_ids: (R,) ordinals, None = a class that the manifest does not ask for.
        scores: (R,) scores of these classes.
        n_classes: K.

    Returns:
        The score in the class's column, an exact 0 elsewhere; what it leaves of 1 is background.

    Raises:
        DataError: a score is no probability.
    """
    check_scores(entries, scores)
    ordinals = np.array([-1 if k is None else k for k in class_ids], dtype=np.int64)
    of_views = one_hot(ordinals, scores, n_classes)
    return Detections(boxes, of_views, (1.0 - scores).astype(np.float32))


def asked_for(places: Sequence[Place], class_ids: Sequence[int | None]) -> list[Place]:
    """The places of boxes, nowhere where the manifest does not ask for the class (None)."""
    other = Place(None, OTHER_CLASSES)
    return [
        other if class_id is None and not place.reason else place
        for place, class_id in zip(places, class_ids, strict=True)
    ]


def check_scores(entries: Entries, scores: NDArray[Any]) -> None:
    """Refuse scores (R,) or (R, S) that are no probabilities.

    Raises:
        DataError: one is not finite or outside [0, 1].
    """
    table = scores if scores.ndim == 2 else scores[:, None]
    wrong = ~((table >= 0) & (table <= 1))  # True for NaN too.

    def fault(row: int) -> str:
        return f"the score {table[row][wrong[row]][0]:g} is not within 0 to 1"

    is_finite = np.isfinite(table[wrong][:1]).all()
    hint = "Are these logits or percent? Give scores after softmax or sigmoid."
    entries.refuse(wrong.any(axis=1), fault, hint if is_finite else "Give finite scores.")


def select(
    found: Found, unknown_frames: Literal["error", "skip"], size_px: tuple[int, int]
) -> ImportedDetections:
    """Check the boxes, cut them at the image's border, and keep what belongs to the slice.

    Raises:
        DataError: a box is not finite or runs backwards; a frame is unknown and that is an error.
    """
    _check_boxes(found)
    reasons = np.array([place.reason for place in found.places], dtype=object)
    if unknown_frames == "error":
        found.entries.refuse(
            reasons == UNKNOWN_FRAMES,
            lambda row: f"the dataset has no frame {found.place_names[row]!r}",
            "Check which images the file speaks of (detections.images), or leave them out with "
            'detections.unknown_frames = "skip".',
        )
    given = found.detections
    boxes = clip(given.boxes, *size_px)
    for left, reason in ((given.boxes, NO_AREA), (boxes, OUTSIDE_IMAGE)):
        reasons[(reasons == "") & (area(left) <= 0)] = reason
    kept = np.flatnonzero(reasons == "")
    return ImportedDetections(
        boxes[kept],
        given.scores[kept],
        given.background[kept],
        np.array([found.places[i].frame_index for i in kept.tolist()], dtype=np.int64),
        Counter(reasons[reasons != ""].tolist()),
    )


def _check_boxes(found: Found) -> None:
    boxes = found.detections.boxes

    def box(row: int) -> str:
        return f"the box {boxes[row].tolist()}"

    found.entries.refuse(
        ~np.isfinite(boxes).all(axis=1),
        lambda row: f"{box(row)} is not finite",
        "Correct it or take it out.",
    )
    found.entries.refuse(
        (boxes[:, 2:] < boxes[:, :2]).any(axis=1),
        lambda row: f"{box(row)} (x0 y0 x1 y1) runs backwards",
        found.cure,
    )
