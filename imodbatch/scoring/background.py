"""The background as a class of its own, counted in pixels (Konno et al. 2020, Sec. 5.2)."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.tables.columns import boxes_of, column, image_numbers, positions
from imodbatch.tables.schemas import DETECTIONS

Array = NDArray[np.float64]


def background_per_pixel(
    frames: pa.Table, annotations: pa.Table, detections: pa.Table, kept: pa.Table
) -> tuple[float, float]:
    """Precision and recall of the background, counted in pixels over all frames.

    Pixels whose centre lies in a kept box are predicted foreground, all others background; the same
    for the truth. Pixels inside ignored annotations are left out.
    """
    predicted_boxes = detections.take(positions(kept, detections, DETECTIONS.key))
    ignored = annotations.filter(annotations["is_ignored"])
    both, predicted, true = 0, 0, 0
    for height, width, *boxes in zip(
        column(frames, "height_px"),
        column(frames, "width_px"),
        *(_boxes_by_image(frames, table) for table in (predicted_boxes, annotations, ignored)),
        strict=True,
    ):
        is_predicted, is_true, counts = (~_mask((height, width), found) for found in boxes)
        both += int((is_predicted & is_true & counts).sum())
        predicted += int((is_predicted & counts).sum())
        true += int((is_true & counts).sum())
    nan = float("nan")
    return both / predicted if predicted else nan, both / true if true else nan


def _boxes_by_image(frames: pa.Table, table: pa.Table) -> list[Array]:
    """The boxes (n, 4) that a table has in each frame."""
    image, boxes = image_numbers(frames, table), boxes_of(table)
    order = np.argsort(image, kind="stable")
    starts = np.searchsorted(image[order], np.arange(frames.num_rows + 1))
    return [boxes[order[a:b]] for a, b in pairwise(starts)]


def _mask(shape: tuple[int, int], boxes: Sequence[Array]) -> NDArray[np.bool_]:
    """Pixels (H, W) whose centre lies in one of the boxes."""
    mask = np.zeros(shape, dtype=np.bool_)
    for box in boxes:
        x0, y0, x1, y1 = np.maximum(np.ceil(box - 0.5), 0).astype(int)
        mask[y0:y1, x0:x1] = True
    return mask
