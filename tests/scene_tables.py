"""The scene of `scene.py` as the pipeline's tables: exact boxes and poses, ideal scores."""

from functools import cache

import numpy as np
from scene import CAMERA, GRID, make_scene

from imodbatch.core.frames import quaternion_from_matrix
from imodbatch.fusion import lift
from imodbatch.lab.analytic.catalogue import CLASSES
from imodbatch.scoring.rescoring import Evidence
from imodbatch.settings.config import LiftConfig, Pipeline, ViewpointConfig
from imodbatch.tables.parquet import from_columns, from_rows
from imodbatch.tables.schemas import ANNOTATIONS, DETECTIONS, FRAMES, POSES

SCENE = make_scene()
N_FRAMES, N_OBJECTS = SCENE.boxes_px.shape[:2]
VIEWPOINT = ViewpointConfig(n_azimuths=GRID.n_azimuths, elevations_deg=(10.0, 30.0, 50.0))
# voxels wide enough that all sightings of an object share one or two
LIFT = LiftConfig(depth="window_median", voxel_size_m=0.4)


def frames_table():
    names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    camera = {name: getattr(CAMERA, name) for name in names}
    row = {"sequence_id": "walk", "color_path": "c", "depth_path": "d", "depth_scale_m": 0.001}
    row |= camera | {f"depth_{name}": value for name, value in camera.items()}
    return from_rows(FRAMES, [row | {"frame_index": i} for i in range(N_FRAMES)])


def poses_table():
    quaternion = quaternion_from_matrix(SCENE.world_from_cam[:, :3, :3])
    center = SCENE.world_from_cam[:, :3, 3]
    columns = {"sequence_id": ["walk"] * N_FRAMES, "frame_index": np.arange(N_FRAMES)}
    columns |= {name: quaternion[:, i] for i, name in enumerate(("qw", "qx", "qy", "qz"))}
    columns |= {name: center[:, i] for i, name in enumerate(("tx_m", "ty_m", "tz_m"))}
    return from_columns(POSES, columns | {"status": ["tracked"] * N_FRAMES})


def rows_of_boxes():
    for i in range(N_FRAMES):
        for k in range(N_OBJECTS):
            x0, y0, x1, y1 = SCENE.boxes_px[i, k].tolist()
            corners = {"x0_px": x0, "y0_px": y0, "x1_px": x1, "y1_px": y1}
            yield i, k, {"sequence_id": "walk", "frame_index": i} | corners


def detections_table():
    rows = [
        row
        | {
            "detection_index": k,
            "background_score": float(SCENE.background_score[i, k]),
            "class_ids": [int(SCENE.class_id[k])],
            "view_scores": SCENE.view_scores[i, k].ravel().tolist(),
        }
        for i, k, row in rows_of_boxes()
    ]
    return from_rows(DETECTIONS, rows)


def annotations_table():
    flags = {"is_ignored": False, "is_crowd": False}
    rows = [
        row
        | flags
        | {"annotation_index": k, "class_id": int(SCENE.class_id[k]), "instance_id": f"object {k}"}
        for i, k, row in rows_of_boxes()
    ]
    return from_rows(ANNOTATIONS, rows)


@cache
def observations_table(viewpoint=VIEWPOINT):
    result = lift.run(
        frames_table(),
        poses_table(),
        detections_table(),
        lambda row: SCENE.depth_m[row["frame_index"]].astype(np.float32),
        viewpoint,
        LIFT,
    )
    return result.tables["observations"]


def evidence(observations, **sections):
    pipeline = Pipeline(viewpoint=VIEWPOINT, lift=LIFT, **sections)
    return Evidence(
        frames_table(),
        annotations_table(),
        detections_table(),
        observations,
        len(CLASSES),
        pipeline,
    )
