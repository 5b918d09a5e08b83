"""Rows of tables made by hand: a case says what matters, the rest is filled in, always the same."""

from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import TABLES


def table(name, rows):
    return from_rows(TABLES[name], list(rows))


def corners(x0, y0, x1, y1):
    return {"x0_px": x0, "y0_px": y0, "x1_px": x1, "y1_px": y1}


def frame(sequence_id, index, width=20, height=10, fx=100.0, fy=50.0):
    camera = {"width_px": width, "height_px": height, "fx_px": fx, "fy_px": fy}
    camera |= {"cx_px": width / 2, "cy_px": height / 2}
    return {
        **{"sequence_id": sequence_id, "frame_index": index, "color_path": "c"},
        **{"depth_scale_m": 0.001, **camera},
        **{f"depth_{name}": value for name, value in camera.items()},
    }


def pose(sequence_id, index, center, status="tracked"):
    row = {"sequence_id": sequence_id, "frame_index": index, "status": status}
    if status == "lost":
        return row
    turn = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
    return row | dict(zip(("tx_m", "ty_m", "tz_m"), center, strict=True)) | turn


def annotation(sequence_id, index, number, class_id, box, **other):
    flags = {"is_ignored": False, "is_crowd": False}
    key = {"sequence_id": sequence_id, "frame_index": index, "annotation_index": number}
    return {**key, "class_id": class_id, **corners(*box), **flags, **other}


def detection(sequence_id, index, number, box, scores, class_ids=(0,)):
    key = {"sequence_id": sequence_id, "frame_index": index, "detection_index": number}
    said = {"class_ids": list(class_ids), "view_scores": list(scores), "background_score": 0.0}
    return {**key, **corners(*box), **said}


def observation(sequence_id, index, number, xyz=None, voxel=(0, 0, 0), bins=(0, 0), depth_m=1.0):
    """A box placed at xyz, seen from bins (azimuth, elevation); None: it has no depth."""
    row = {"sequence_id": sequence_id, "frame_index": index, "detection_index": number}
    if xyz is None:
        return row | {"status": "no_depth"}
    row |= {"status": "placed", "depth_m": depth_m, "azimuth_rad": 0.0, "elevation_rad": 0.0}
    row |= dict(zip(("x_m", "y_m", "z_m"), xyz, strict=True))
    row |= dict(zip(("voxel_i", "voxel_j", "voxel_k"), voxel, strict=True))
    return row | dict(zip(("azimuth_bin", "elevation_bin"), bins, strict=True))


def fused(sequence_id, index, number, class_id, score, method="imod"):
    key = {"sequence_id": sequence_id, "frame_index": index, "detection_index": number}
    return {**key, "method": method, "class_id": class_id, "score": score, "n_cells": 1}


def match(
    sequence_id, index, number, class_id, score, outcome, method="imod", iou_percent=50, found=0
):
    """What became of a box; `found` is the annotation's number where it is not a false positive."""
    key = {"sequence_id": sequence_id, "frame_index": index, "detection_index": number}
    name = {"T": "true_positive", "F": "false_positive", "I": "ignored"}[outcome]
    said = {"method": method, "class_id": class_id, "iou_percent": iou_percent, "score": score}
    return {**key, **said, "outcome": name, "annotation_index": None if outcome == "F" else found}


def metric(name, class_id, value, method="imod", iou_percent=50, n_annotations=4, n_detections=5):
    return {
        **{"method": method, "class_id": class_id, "iou_percent": iou_percent, "metric": name},
        **{"class_name": {-1: "mean", -2: "background"}.get(class_id, f"class {class_id}")},
        **{"value": value, "n_annotations": n_annotations, "n_detections": n_detections},
    }
