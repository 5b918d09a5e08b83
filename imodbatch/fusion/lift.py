"""lift: each box of a frame → a place in the world, by the depth inside it (Konno 2020, Sec. 3.4).

Every detection gives one row. What could not be placed says why: its frame has no pose, its box
holds no depth, its depth image cannot be read, or it lies beyond the range or the elevations asked.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage, box_depth
from imodbatch.core.frames import apply
from imodbatch.core.placing import place
from imodbatch.datasets.images import UnreadableImageError
from imodbatch.settings.config import LiftConfig, ViewpointConfig
from imodbatch.tables.columns import (
    Progress,
    StageResult,
    boxes_of,
    rows_by_frame,
    tally,
    world_from_cam_of,
)
from imodbatch.tables.parquet import from_columns
from imodbatch.tables.schemas import OBSERVATIONS

FrameRow = Mapping[str, Any]
ReadDepth = Callable[[FrameRow], DepthImage]
STATUSES = ("placed", "no_depth", "unreadable_depth", "no_pose", "out_of_range")


def run(
    frames: pa.Table,
    poses: pa.Table,
    detections: pa.Table,
    read_depth: ReadDepth,
    viewpoint: ViewpointConfig,
    config: LiftConfig,
    progress: Progress[Any] = iter,
) -> StageResult:
    """Place the boxes of one sequence in world voxels.

    Args:
        frames: frames table; its rows go to `read_depth`.
        poses: poses table.
        detections: detections table.
        read_depth: frame row → z-depth in the colour camera, (H, W) metres, NaN = none.
        viewpoint: the grid of azimuths and elevations.
        config: which depth a box gets, and the size of voxels.
        progress: wraps the loop over frames.
    """
    boxes = boxes_of(detections)
    world_from_cam = world_from_cam_of(poses)
    frame_row = {row["frame_index"]: row for row in frames.to_pylist()}
    status = np.full(len(boxes), "no_pose", dtype="<U16")
    depth_m = np.full(len(boxes), np.nan)
    points_cam, points_world, cameras_world = (np.full((len(boxes), 3), np.nan) for _ in range(3))
    warnings = []
    for frame_index, rows in progress(list(rows_by_frame(detections))):
        row = frame_row[frame_index]
        try:
            depth_image = _no_depth(row) if row["depth_path"] is None else read_depth(row)
        except UnreadableImageError as error:
            warnings.append(str(error))
            status[rows] = "unreadable_depth"
            continue
        depth_m[rows] = [
            box_depth(depth_image, box, config.depth, config.window, config.foreground_bin_m)
            for box in boxes[rows]
        ]
        points_cam[rows] = _box_points(boxes[rows], depth_m[rows], row, config.push_fraction)
        if frame_index in world_from_cam:
            points_world[rows] = apply(world_from_cam[frame_index], points_cam[rows])
            cameras_world[rows] = world_from_cam[frame_index][:3, 3]
            status[rows] = "placed"
    places = place(points_world, cameras_world, viewpoint.grid(), config.voxel_size_m)
    is_open = status == "placed"
    status[is_open & np.isnan(depth_m)] = "no_depth"
    too_far = depth_m > config.max_depth_m
    too_steep = places.is_too_steep(viewpoint.elevation_margin_deg)
    status[is_open & (too_far | too_steep)] = "out_of_range"
    placed = status == "placed"

    has_place = placed | (status == "out_of_range")
    table = from_columns(
        OBSERVATIONS,
        {
            **{name: detections[name] for name in OBSERVATIONS.key},
            "status": status.tolist(),
            "depth_m": pa.array(depth_m, mask=np.isnan(depth_m)),
            **_masked(points_world, ("x_m", "y_m", "z_m"), has_place),
            **_masked(places.voxel, ("voxel_i", "voxel_j", "voxel_k"), placed),
            "azimuth_rad": pa.array(places.azimuth_rad, mask=~has_place),
            "elevation_rad": pa.array(places.elevation_rad, mask=~has_place),
            "azimuth_bin": pa.array(places.azimuth_bin, mask=~placed),
            "elevation_bin": pa.array(places.elevation_bin, mask=~placed),
        },
    )
    counts = {name: int((status == name).sum()) for name in STATUSES}
    return StageResult({"observations": table}, tally(len(boxes), "detections", counts), warnings)


def _box_points(
    boxes: NDArray[np.float64], depth_m: NDArray[np.float64], row: FrameRow, push_fraction: float
) -> NDArray[np.float64]:
    """Camera-frame points (n, 3) behind the centres of boxes.

    The point on the front surface is pushed along the view ray by a fraction of half the box's
    metric width or height, whichever is smaller: 1 reaches the middle of a ball.
    """
    camera = color_camera(row)
    centers = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    surface = camera.unproject(centers, depth_m)
    width_m = (boxes[:, 2] - boxes[:, 0]) * depth_m / camera.fx_px
    height_m = (boxes[:, 3] - boxes[:, 1]) * depth_m / camera.fy_px
    push_m = push_fraction * 0.5 * np.minimum(width_m, height_m)
    distance_m = np.linalg.norm(surface, axis=-1)
    return surface * (1 + push_m / distance_m)[:, None]


def color_camera(row: FrameRow) -> PinholeCamera:
    """The colour camera of a frame row."""
    return PinholeCamera(**{name: row[name] for name in PinholeCamera.__dataclass_fields__})


def _no_depth(row: FrameRow) -> DepthImage:
    return np.full((row["height_px"], row["width_px"]), np.nan, dtype=np.float32)


def _masked(
    values: NDArray[Any], names: tuple[str, ...], known: NDArray[np.bool_]
) -> dict[str, pa.Array]:
    return {name: pa.array(values[:, i], mask=~known) for i, name in enumerate(names)}
