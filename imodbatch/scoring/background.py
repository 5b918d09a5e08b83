"""The background as a class of its own, counted in pixels (Konno et al. 2020, Sec. 5.2)."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.tables.columns import boxes_of, image_shapes

Array = NDArray[np.float64]
BOX_COLUMNS = ("x0_px", "y0_px", "x1_px", "y1_px")
KEY = ("sequence_id", "frame_index", "detection_index")


def background_per_pixel(
    frames: pa.Table, annotations: pa.Table, detections: pa.Table, kept: pa.Table
) -> tuple[float, float]:
    """Precision and recall of the background, counted in pixels over all frames.

    Pixels whose centre lies in a kept box are predicted foreground, all others background; the same
    for the truth. Pixels inside ignored annotations are left out.
    """
    boxes = kept.select(list(KEY)).join(detections.select([*KEY, *BOX_COLUMNS]), keys=list(KEY))
    kept_of, true_of = _boxes_by_image(boxes), _boxes_by_image(annotations)
    ignored = annotations.filter(annotations["is_ignored"])
    ignored_of = _boxes_by_image(ignored)
    both, predicted, true = 0, 0, 0
    for key, shape in image_shapes(frames):
        counts = ~_mask(shape, ignored_of.get(key, ()))
        is_predicted = ~_mask(shape, kept_of.get(key, ())) & counts
        is_true = ~_mask(shape, true_of.get(key, ())) & counts
        both += int((is_predicted & is_true).sum())
        predicted += int(is_predicted.sum())
        true += int(is_true.sum())
    nan = float("nan")
    return both / predicted if predicted else nan, both / true if true else nan


def _boxes_by_image(table: pa.Table) -> dict[tuple[str, int], list[Array]]:
    by_image: dict[tuple[str, int], list[Array]] = {}
    sequences, frames = table["sequence_id"].to_pylist(), table["frame_index"].to_pylist()
    for sequence_id, frame, box in zip(sequences, frames, boxes_of(table), strict=True):
        by_image.setdefault((sequence_id, frame), []).append(box)
    return by_image


def _mask(shape: tuple[int, int], boxes: Sequence[Array]) -> NDArray[np.bool_]:
    """Pixels (H, W) whose centre lies in one of the boxes."""
    mask = np.zeros(shape, dtype=np.bool_)
    for box in boxes:
        x0, y0, x1, y1 = np.maximum(np.ceil(box - 0.5), 0).astype(int)
        mask[y0:y1, x0:x1] = True
    return mask
