"""fuse: boxes that met in a voxel → one score per box, class and method; and the objects found."""

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.fusion import FusedScores, Method, Sightings
from imodbatch.core.viewpoint import yaw_from_pose_bin
from imodbatch.fusion.evidence import (
    everywhere,
    fuse_methods,
    places_of,
    shaped_scores,
    sightings_of,
    survival,
    taken,
    voxels_of,
)
from imodbatch.settings.config import FuseConfig, ViewpointConfig
from imodbatch.tables.columns import StageResult, boxes_of, column, stacked, tally
from imodbatch.tables.parquet import empty, from_columns, from_rows
from imodbatch.tables.schemas import DETECTIONS, FUSED, OBJECTS


def run(
    frames: pa.Table,
    detections: pa.Table,
    observations: pa.Table,
    n_classes: int,
    viewpoint: ViewpointConfig,
    config: FuseConfig,
) -> StageResult:
    """Fuse one sequence.

    A box that was not placed keeps its single-view score, with ``n_cells`` 0.

    Raises:
        DataError: the score vectors do not fit the viewpoint grid.
    """
    scores = shaped_scores(detections, n_classes, viewpoint)
    placed = np.flatnonzero(column(observations, "status") == "placed")
    seen = observations.take(placed)
    moments = column(seen, "frame_index")
    sightings = sightings_of(seen, scores[placed], voxels_of(seen), moments)
    survives = survival(detections, n_classes)
    box, class_id = np.nonzero(survives)
    fused = fuse_methods(sightings, config)
    parts = [
        _fused_rows(name, detections, box, class_id, everywhere(result, placed, scores))
        for name, result in taken(fused, sightings, survives[placed], config).items()
    ]
    final: dict[Method, FusedScores] = {
        method: of_mode["offline"] for method, of_mode in fused.items() if method != "single"
    }
    objects = _objects(frames, detections.take(placed), seen, sightings, final)
    table = pa.concat_tables(parts) if parts else empty(FUSED)
    n_voxels = len(np.unique(sightings.voxel))
    counts = {"fused": len(placed), "single-view": detections.num_rows - len(placed)}
    summary = f"{tally(detections.num_rows, 'detections', counts)}; {n_voxels:,} voxels"
    return StageResult({"fused": table, "objects": objects}, summary)


def _fused_rows(
    name: str,
    detections: pa.Table,
    box: NDArray[np.int64],
    class_id: NDArray[np.int64],
    fused: FusedScores,
) -> pa.Table:
    pose_bin = fused.pose_bin[box, class_id]
    keys = detections.select(list(DETECTIONS.key)).take(box)
    return from_columns(
        FUSED,
        {
            **{key: keys[key] for key in keys.column_names},
            "method": [name] * len(box),
            "class_id": class_id,
            "score": fused.score[box, class_id],
            "pose_bin": pa.array(pose_bin, mask=pose_bin < 0),
            "n_cells": fused.n_cells[box, class_id],
        },
    )


def _objects(
    frames: pa.Table,
    boxes: pa.Table,
    seen: pa.Table,
    sightings: Sightings,
    fused: Mapping[Method, FusedScores],
) -> pa.Table:
    """One object per voxel and method: its best class after all frames."""
    if seen.num_rows == 0 or not fused:
        return empty(OBJECTS)
    xyz, extent = places_of(seen), _extents(frames, boxes, seen)
    n_azimuths = sightings.view_scores.shape[-1]
    order = np.argsort(sightings.voxel, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(sightings.voxel[order])) + 1)
    first = np.array([rows[0] for rows in groups])
    objects = []
    for method, result in fused.items():
        best = result.score[first].argmax(axis=-1)
        value, pose_bin, n_cells = (
            of_box[first, best] for of_box in (result.score, result.pose_bin, result.n_cells)
        )
        yaw = yaw_from_pose_bin(pose_bin, n_azimuths)
        for index, g in enumerate(np.argsort(-value, kind="stable")):
            rows = groups[g]
            center, size = xyz[rows].mean(axis=0), np.median(extent[rows], axis=0)
            objects.append(
                {
                    "sequence_id": seen["sequence_id"][0].as_py(),
                    "method": method,
                    "object_index": index,
                    "class_id": best[g],
                    "score": value[g],
                    **dict(zip(("x_m", "y_m", "z_m"), center, strict=True)),
                    "yaw_rad": None if pose_bin[g] < 0 else yaw[g],
                    **dict(zip(("extent_x_m", "extent_z_m"), size, strict=True)),
                    "n_detections": len(rows),
                    "n_cells": n_cells[g],
                    "first_frame_index": sightings.frame[rows].min(),
                    "last_frame_index": sightings.frame[rows].max(),
                }
            )
    return from_rows(OBJECTS, objects)


def _extents(frames: pa.Table, boxes: pa.Table, seen: pa.Table) -> NDArray[np.float64]:
    """Metric width and height (V, 2) of boxes at their depth."""
    numbers = column(frames, "frame_index")
    row = np.searchsorted(numbers, column(boxes, "frame_index"))
    corners, depth_m = boxes_of(boxes), column(seen, "depth_m").astype(np.float64)
    focal = stacked(frames, "fx_px", "fy_px")[row]
    return (corners[:, 2:] - corners[:, :2]) * depth_m[:, None] / focal
