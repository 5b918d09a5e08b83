"""detect: frames → boxes with whole score vectors, by our detector or from another one's file.

Both ways end in the same rule: per class, boxes under the score threshold are dropped and the rest
thinned out by NMS on the marginal over viewpoints; a box stays if it survives for one class, and
carries the list of classes for which it did.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.boxes import nms_per_category
from imodbatch.core.detections import Detections
from imodbatch.datasets.detections import ImportedDetections
from imodbatch.datasets.images import UnreadableImageError
from imodbatch.settings.config import DetectConfig
from imodbatch.tables.columns import Progress, StageResult, column, tally
from imodbatch.tables.parquet import from_columns
from imodbatch.tables.schemas import DETECTIONS

Grid = tuple[int, int]
"""Elevations and azimuths."""


def run_detector(
    frames: pa.Table,
    read_color: Callable[[str], NDArray[np.uint8]],
    detector: Callable[[list[NDArray[np.uint8]]], Sequence[Detections]],
    n_classes: int,
    grid: Grid,
    config: DetectConfig,
    progress: Progress[Any] = iter,
) -> StageResult:
    """Run a detector over the frames of a sequence.

    Args:
        frames: frames table.
        read_color: colour path → (H, W, 3) RGB.
        detector: list of images → boxes per image.
        n_classes: K.
        grid: M elevations and N azimuths, for a detector that tells viewpoints apart.
        config: threshold, NMS, batch size.
        progress: wraps the loop over batches.

    Raises:
        UnreadableImageError: a colour image is damaged and `unreadable_color` is ``error``.
    """
    warnings: list[str] = []

    def found() -> Iterable[tuple[int, Detections]]:
        numbers, paths = column(frames, "frame_index"), frames["color_path"].to_pylist()
        starts = range(0, len(numbers), config.batch_size)
        for start in progress(starts):
            batch = slice(start, start + config.batch_size)
            images: list[tuple[int, NDArray[np.uint8]]] = []
            for number, path in zip(numbers[batch], paths[batch], strict=True):
                try:
                    images.append((int(number), read_color(path)))
                except UnreadableImageError as error:
                    if config.unreadable_color == "error":
                        cure = "Or set detect.unreadable_color = 'skip' to go on without it."
                        raise UnreadableImageError(f"{error} {cure}") from None
                    warnings.append(str(error))
            if not images:
                continue
            results = detector([image for _, image in images])
            yield from zip([number for number, _ in images], results, strict=True)

    result = _keep(frames["sequence_id"][0].as_py(), found(), n_classes, grid, config, {})
    if not warnings:
        return result
    summary = f"{result.summary}; {len(warnings)} frames skipped (unreadable)"
    return StageResult(result.tables, summary, warnings, result.attributes)


def run_imported(
    sequence_id: str,
    imported: ImportedDetections,
    n_classes: int,
    grid: Grid,
    config: DetectConfig,
) -> StageResult:
    """Take over another detector's boxes."""
    order = np.argsort(imported.frame_index, kind="stable")
    numbers, starts = np.unique(imported.frame_index[order], return_index=True)
    groups = np.split(order, starts[1:]) if len(numbers) else []
    found = ((int(n), imported.take(rows)) for n, rows in zip(numbers, groups, strict=True))
    left_out = {f"left out ({why})": n for why, n in imported.left_out.items()}
    return _keep(sequence_id, found, n_classes, grid, config, left_out)


def _keep(
    sequence_id: str,
    found: Iterable[tuple[int, Detections]],
    n_classes: int,
    grid: Grid,
    config: DetectConfig,
    left_out: dict[str, int],
) -> StageResult:
    """Threshold, NMS per class, the best `max_per_frame` boxes; count what each step drops."""
    columns: dict[str, list[Any]] = {name: [] for name in DETECTIONS.schema.names}
    n_found, n_low, n_suppressed, n_surplus, n_views = 0, 0, 0, 0, 1
    for frame_index, every in found:
        boxes = every.boxes.astype(np.float64)
        n_views = every.scores.shape[1] // n_classes
        scores = every.scores.reshape(len(boxes), n_classes, n_views).sum(axis=-1, dtype=np.float32)
        survives = nms_per_category(boxes, scores, config.score_threshold, config.nms_iou)
        kept = np.flatnonzero(survives.any(axis=1))
        best = np.where(survives, scores, -1.0).max(axis=1, initial=-1.0)
        kept = kept[np.argsort(-best[kept], kind="stable")]
        is_low = (scores < config.score_threshold).all(axis=1)
        n_found += len(boxes)
        n_low += int(is_low.sum())
        n_suppressed += len(boxes) - len(kept) - int(is_low.sum())
        n_surplus += max(len(kept) - config.max_per_frame, 0)
        kept = kept[: config.max_per_frame]
        columns["sequence_id"] += [sequence_id] * len(kept)
        columns["frame_index"] += [frame_index] * len(kept)
        columns["detection_index"] += range(len(kept))
        for i, name in enumerate(("x0_px", "y0_px", "x1_px", "y1_px")):
            columns[name] += boxes[kept, i].tolist()
        columns["background_score"] += every.background[kept].tolist()
        columns["class_ids"] += [np.flatnonzero(row).astype(np.int16) for row in survives[kept]]
        columns["view_scores"] += list(every.scores[kept].astype(np.float32))
    table = from_columns(DETECTIONS, columns)
    counts = {
        "kept": table.num_rows,
        f"below {config.score_threshold:g}": n_low,
        "suppressed": n_suppressed,
        f"beyond {config.max_per_frame} a frame": n_surplus,
        **left_out,
    }
    summary = tally(n_found + sum(left_out.values()), "boxes", counts)
    return StageResult({"detections": table}, summary, attributes=_told_apart(grid, n_views))


def _told_apart(grid: Grid, n_views: int) -> dict[str, int]:
    """How many elevations and azimuths the score vectors hold: one of each without viewpoints."""
    n_elevations, n_azimuths = grid if n_views > 1 else (1, 1)
    return {"n_elevations": n_elevations, "n_azimuths": n_azimuths}
