"""How a walk lies on disk: PNG images, a TUM trajectory, COCO annotations, Parquet detections."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from imodbatch.datasets.coco import box_entry, coco_text, image_entry
from imodbatch.lab.analytic.catalogue import CLASSES
from imodbatch.lab.analytic.detector import Detection
from imodbatch.lab.analytic.sequence import CAMERA, Frame
from imodbatch.lab.analytic.truth import TrueObject
from imodbatch.lab.disk.images import write_depth, write_image
from imodbatch.lab.disk.trajectory import write_tum
from imodbatch.tables.atomic import replacing, write_text
from imodbatch.tables.schemas import BOX

FRAMES_PER_SECOND = 10
BOX_COLUMNS = tuple(column.name for column in BOX)


def frame_file(kind: str, frame_index: int) -> str:
    """An image's path within its sequence; kind is ``color`` or ``depth``."""
    return f"{kind}/{frame_index:06d}.png"


def write_images(sequence_folder: Path, frame_index: int, frame: Frame) -> None:
    """Colour as 8-bit RGB, measured depth as 16-bit millimetres (0 = none)."""
    write_image(sequence_folder / frame_file("color", frame_index), frame.color)
    write_depth(sequence_folder / frame_file("depth", frame_index), frame.measured_depth_m)


def write_trajectory(path: Path, world_from_cam: NDArray[np.float64]) -> None:
    """Poses (F, 4, 4), world_from_cam."""
    comment = "stamp_s tx_m ty_m tz_m qx qy qz qw: camera in the world, +z up"
    write_tum(path, world_from_cam, FRAMES_PER_SECOND, comment, digits=12)


def write_annotations(path: Path, seen_by_frame: Sequence[Sequence[TrueObject]]) -> None:
    """True boxes as COCO; `ignore` = 1 where an object is cut off or mostly hidden."""
    size_px = CAMERA.width_px, CAMERA.height_px
    text = coco_text(
        {"description": "Analytic scene: exact boxes, continuous pixels (corner = 0)."},
        dict.fromkeys(CLASSES),
        [image_entry(k, frame_file("color", k), size_px) for k in range(len(seen_by_frame))],
        [[_box(true) for true in seen] for seen in seen_by_frame],
    )
    write_text(path, text)


def _box(true: TrueObject) -> dict[str, Any]:
    return box_entry(
        true.class_id,
        true.box_px,
        true.n_pixels,
        is_ignored=true.is_ignored,
        instance=true.instance_id,
    )


def detection_rows(
    sequence_id: str, frame_index: int, detections: Sequence[Detection]
) -> list[dict[str, Any]]:
    """Rows of the detections' table."""
    return [
        {
            "sequence_id": sequence_id,
            "frame_index": frame_index,
            **dict(zip(BOX_COLUMNS, found.box_px.tolist(), strict=True)),
            "view_scores": found.view_scores.ravel(),
            "background_score": found.background_score,
        }
        for found in detections
    ]


def write_detections(path: Path, rows: list[dict[str, Any]]) -> None:
    """Boxes and whole score vectors, C order of [class, elevation, azimuth]."""
    schema = pa.schema(
        [
            ("sequence_id", pa.string()),
            ("frame_index", pa.int32()),
            *((name, pa.float32()) for name in BOX_COLUMNS),
            ("view_scores", pa.list_(pa.float32())),
            ("background_score", pa.float32()),
        ]
    )
    with replacing(path) as file:
        pq.write_table(pa.Table.from_pylist(rows, schema=schema), file, compression="zstd")
