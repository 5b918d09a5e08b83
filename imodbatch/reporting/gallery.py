"""Which frames are shown, and which boxes in them: what a method keeps at its tuned thresholds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.matching import OUTCOME_NAMES, Outcome
from imodbatch.reporting.names import method_style
from imodbatch.reporting.pictures import DrawnBox, Kind, draw_boxes, jpeg_data_uri
from imodbatch.reporting.results import MatchColumns, Results
from imodbatch.reporting.run_info import RunInfo

ReadColor = Callable[[str], NDArray[np.uint8]]
FrameKey = tuple[str, int]
KINDS: dict[int, Kind] = {
    Outcome.TRUE_POSITIVE: "true_positive",
    Outcome.FALSE_POSITIVE: "false_positive",
    Outcome.IGNORED: "ignored",
}
if set(KINDS.values()) != set(OUTCOME_NAMES):
    raise AssertionError("every outcome needs a colour")


@dataclass(frozen=True)
class Picture:
    """One frame under one method."""

    method_name: str
    color: str
    source: str
    n_true_positives: int
    n_false_positives: int
    n_missed: int


@dataclass(frozen=True)
class FramePictures:
    """One frame, side by side; `problem` says why there are no pictures."""

    sequence_id: str
    frame_index: int
    pictures: tuple[Picture, ...]
    problem: str = ""


def gallery(
    results: Results,
    info: RunInfo,
    methods: Sequence[str],
    read_color: ReadColor,
    *,
    n_frames: int,
    max_width_px: int,
) -> list[FramePictures]:
    """Pictures of frames chosen by `choose_frames`, one per method."""
    kept = {method: results.kept(method) for method in methods}
    annotated = _annotated_frames(results)
    differing = _differing_frames(list(kept.values()), results.sequence_ids)
    shown = []
    for key in choose_frames(annotated, differing, n_frames):
        rows = _of_frame(results, "frames", key)
        if not rows:
            shown.append(FramePictures(*key, (), "the frames table has no such frame"))
            continue
        try:
            image = read_color(rows[0]["color_path"])
        except DataError as error:
            shown.append(FramePictures(*key, (), str(error)))
            continue
        pictures = (
            _picture(results, info, method, matches, key, image, max_width_px)
            for method, matches in kept.items()
        )
        shown.append(FramePictures(*key, tuple(pictures)))
    return shown


def choose_frames(
    annotated: Sequence[FrameKey], differing: set[FrameKey], n_frames: int
) -> list[FrameKey]:
    """Frames spread evenly over the annotated ones, preferably where the methods differ.

    The annotated frames are cut into `n_frames` runs of equal length. Each run gives the differing
    frame nearest its middle, or its middle if none differs.
    """
    n_frames = min(n_frames, len(annotated))
    edges = [i * len(annotated) // n_frames for i in range(n_frames + 1)] if n_frames else []
    chosen = []
    for start, stop in pairwise(edges):
        run = annotated[start:stop]
        middle = (len(run) - 1) / 2
        order = sorted(range(len(run)), key=lambda i: (run[i] not in differing, abs(i - middle), i))
        chosen.append(run[order[0]])
    return chosen


def _annotated_frames(results: Results) -> list[FrameKey]:
    keys = results.tables["annotations"].select(["sequence_id", "frame_index"])
    groups = keys.group_by(["sequence_id", "frame_index"]).aggregate([]).to_pylist()
    return sorted((group["sequence_id"], group["frame_index"]) for group in groups)


def _differing_frames(kept: list[MatchColumns], sequence_ids: Sequence[str]) -> set[FrameKey]:
    """Frames in which not all methods keep the same boxes for the same classes."""
    columns = ("sequence", "frame", "detection", "class_id")
    boxes: list[set[tuple[int, ...]]] = [
        set(zip(*(getattr(m, c).tolist() for c in columns), strict=True)) for m in kept
    ]
    if not boxes:
        return set()
    unshared = boxes[0].union(*boxes) - boxes[0].intersection(*boxes)
    return {(sequence_ids[sequence], frame) for sequence, frame, _, _ in unshared}


def _picture(
    results: Results,
    info: RunInfo,
    method: str,
    kept: MatchColumns,
    key: FrameKey,
    image: NDArray[np.uint8],
    max_width_px: int,
) -> Picture:
    sequence = results.sequence_ids.index(key[0])
    here = kept.take((kept.sequence == sequence) & (kept.frame == key[1]))
    here = here.take(np.argsort(here.score, kind="stable"))  # the best label is drawn last
    boxes = {row["detection_index"]: row for row in _of_frame(results, "detections", key)}
    drawn = [
        DrawnBox(
            _box(boxes[here.detection[i]]),
            KINDS[int(here.outcome[i])],
            f"{info.class_name(int(here.class_id[i]))} {here.score[i]:.2f}",
        )
        for i in range(len(here.score))
    ]
    is_found = here.outcome == Outcome.TRUE_POSITIVE
    found = set(here.annotation[is_found].tolist())
    missed = [
        DrawnBox(_box(row), "missed")
        for row in _of_frame(results, "annotations", key)
        if not (row["is_ignored"] or row["is_crowd"] or row["annotation_index"] in found)
    ]
    style = method_style(method)
    return Picture(
        style.name,
        style.color,
        jpeg_data_uri(draw_boxes(image, [*missed, *drawn], max_width_px)),
        int(is_found.sum()),
        int((here.outcome == Outcome.FALSE_POSITIVE).sum()),
        len(missed),
    )


def _of_frame(results: Results, table: str, key: FrameKey) -> list[dict[str, Any]]:
    is_here = (pc.field("sequence_id") == key[0]) & (pc.field("frame_index") == key[1])
    chosen = results.tables[table].filter(is_here)
    heavy = {"view_scores"} & set(chosen.column_names)
    rows: list[dict[str, Any]] = chosen.drop_columns(sorted(heavy)).to_pylist()
    return rows


def _box(row: dict[str, Any]) -> tuple[float, float, float, float]:
    return row["x0_px"], row["y0_px"], row["x1_px"], row["y1_px"]
