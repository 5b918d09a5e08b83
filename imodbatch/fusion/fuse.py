"""fuse: boxes that met in a voxel → one score per box, class and method; and the objects found."""

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.fusion import FusedScores, Method, Sightings, fuse
from imodbatch.core.viewpoint import yaw_from_pose_bin
from imodbatch.fusion.evidence import (
    OFFLINE_SUFFIX,
    everywhere,
    fuse_variants,
    places_of,
    shaped_scores,
    sightings_of,
    stand_aside,
    survival,
    voxels_of,
)
from imodbatch.settings.config import FuseConfig, ViewpointConfig
from imodbatch.tables.columns import StageResult, boxes_of, column, tally
from imodbatch.tables.parquet import empty, from_columns
from imodbatch.tables.schemas import FUSED, OBJECTS


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
    fused = fuse_variants(sightings, config)
    parts = [
        _fused_rows(name, detections, box, class_id, everywhere(result, placed, scores))
        for name, result in stand_aside(fused, sightings, survives[placed], config).items()
    ]
    final: dict[Method, FusedScores] = {
        method: fused.get(method + OFFLINE_SUFFIX)
        or fuse(sightings, method, "offline", config.cell_reduce, config.probability_floor)
        for method in config.methods
        if method != "single"
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
    keys = detections.select(["sequence_id", "frame_index", "detection_index"]).take(box)
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
    columns: dict[str, list[object]] = {name: [] for name in OBJECTS.schema.names}
    xyz, extent = places_of(seen), _extents(frames, boxes, seen)
    n_azimuths = sightings.view_scores.shape[-1]
    order = np.argsort(sightings.voxel, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(sightings.voxel[order])) + 1)
    sequence_id = seen["sequence_id"][0].as_py()
    for method, result in fused.items():
        best = [result.score[rows[0]].argmax() for rows in groups]
        value = np.array([result.score[rows[0], k] for rows, k in zip(groups, best, strict=True)])
        for index, g in enumerate(np.argsort(-value, kind="stable")):
            rows, k = groups[g], int(best[g])
            pose_bin = int(result.pose_bin[rows[0], k])
            center, size = xyz[rows].mean(axis=0), np.median(extent[rows], axis=0)
            object_row = {
                "sequence_id": sequence_id,
                "method": method,
                "object_index": index,
                "class_id": k,
                "score": float(value[g]),
                **dict(zip(("x_m", "y_m", "z_m"), center.tolist(), strict=True)),
                "yaw_rad": None if pose_bin < 0 else float(yaw_from_pose_bin(pose_bin, n_azimuths)),
                "extent_x_m": float(size[0]),
                "extent_z_m": float(size[1]),
                "n_detections": len(rows),
                "n_cells": int(result.n_cells[rows[0], k]),
                "first_frame_index": int(sightings.frame[rows].min()),
                "last_frame_index": int(sightings.frame[rows].max()),
            }
            for name, item in object_row.items():
                columns[name].append(item)
    return from_columns(OBJECTS, columns)


def _extents(frames: pa.Table, boxes: pa.Table, seen: pa.Table) -> NDArray[np.float64]:
    """Metric width and height (V, 2) of boxes at their depth."""
    numbers = column(frames, "frame_index")
    row = np.searchsorted(numbers, column(boxes, "frame_index"))
    corners, depth_m = boxes_of(boxes), column(seen, "depth_m").astype(np.float64)
    focal = np.stack([column(frames, "fx_px")[row], column(frames, "fy_px")[row]], axis=-1)
    return (corners[:, 2:] - corners[:, :2]) * depth_m[:, None] / focal
