"""The data dictionary: every table that flows between stages, its columns, key and version.

Rules: keys hold no floats and never repeat; null means unknown, never 0 or −1; units live in names
(_m, _px, _rad, _ns); every ordinal counts from 0. `RUN_DIR/<table>/<sequence_id>.parquet` holds one
sequence, so ``pandas.read_parquet(RUN_DIR / "fused")`` reads a whole run.
"""

from dataclasses import dataclass
from functools import cached_property

import pyarrow as pa

MEAN_CLASS_ID = -1
"""`metrics.class_id` of a mean over the classes that have the metric."""
BACKGROUND_CLASS_ID = -2
"""`metrics.class_id` of the background, counted in pixels."""
SEVERAL_IOUS = 0
"""`metrics.iou_percent` of a metric averaged over IoU .50 to .95."""


@dataclass(frozen=True)
class Column:
    """One column: Arrow type, meaning, and whether null (= unknown) is allowed."""

    name: str
    dtype: pa.DataType
    meaning: str
    nullable: bool = False


@dataclass(frozen=True)
class TableSpec:
    """A table: the columns that form its key, those that follow, and the schema's version."""

    name: str
    key_columns: tuple[Column, ...]
    other_columns: tuple[Column, ...]
    per_run: bool = False
    version: int = 1

    @property
    def key(self) -> tuple[str, ...]:
        """Names of the columns of the key."""
        return tuple(column.name for column in self.key_columns)

    @property
    def columns(self) -> tuple[Column, ...]:
        """All of them in their order."""
        return self.key_columns + self.other_columns

    @cached_property
    def schema(self) -> pa.Schema:
        """The Arrow schema; a field's metadata carries its meaning."""
        return pa.schema(
            [
                pa.field(c.name, c.dtype, c.nullable, metadata={"meaning": c.meaning})
                for c in self.columns
            ]
        )


def _columns(dtype: pa.DataType, nullable: bool, **meanings: str) -> tuple[Column, ...]:
    return tuple(Column(name, dtype, meaning, nullable) for name, meaning in meanings.items())


STRING, I64, I32, I16 = pa.string(), pa.int64(), pa.int32(), pa.int16()
F64, F32, BOOL = pa.float64(), pa.float32(), pa.bool_()

SEQUENCE_KEY = (Column("sequence_id", STRING, "sequence, as named in the manifest"),)
FRAME_KEY = (*SEQUENCE_KEY, Column("frame_index", I32, "the dataset's own frame number"))
DETECTION_KEY = (*FRAME_KEY, Column("detection_index", I32, "ordinal of the box in its frame"))
METHOD = Column("method", STRING, "single, naive, naive_log, imod; *_offline: all frames are seen")
CLASS_ID = Column("class_id", I16, "ordinal of the class in the manifest's list")
FUSED_KEY = (*DETECTION_KEY, METHOD, CLASS_ID)
MEAN_AP = Column("metric", STRING, "ap_voc07_11pt, mean over classes")
IOU_PERCENT = Column("iou_percent", I16, "IoU from which on a box counts as right, percent")
BOX = _columns(
    F32,
    False,
    x0_px="left edge, continuous pixels (image corner = 0)",
    y0_px="top edge",
    x1_px="right edge",
    y1_px="bottom edge",
)


def _intrinsics(prefix: str, camera: str) -> tuple[Column, ...]:
    size = _columns(I32, False, width_px="image width", height_px="image height")
    rays = _columns(
        F64,
        False,
        fx_px="focal length, x",
        fy_px="focal length, y",
        cx_px="principal point, x, continuous pixels",
        cy_px="principal point, y, continuous pixels",
    )
    return tuple(
        Column(prefix + column.name, column.dtype, f"{camera} {column.meaning}")
        for column in size + rays
    )


def _pose_columns(remark: str) -> tuple[Column, ...]:
    return _columns(
        F64,
        True,
        tx_m=f"camera centre in the levelled world (+z up), x; {remark}",
        ty_m="camera centre, y",
        tz_m="camera centre, z",
        qw="rotation world_from_cam, quaternion w",
        qx="quaternion x",
        qy="quaternion y",
        qz="quaternion z",
    )


FRAMES = TableSpec(
    "frames",
    FRAME_KEY,
    (
        Column("timestamp_ns", I64, "moment of the colour image", nullable=True),
        Column("color_path", STRING, "colour image, relative to the manifest's root"),
        Column("depth_path", STRING, "depth image, likewise; null = none", nullable=True),
        Column("depth_scale_m", F64, "metres per unit of the depth image"),
        *_intrinsics("", "colour"),
        *_intrinsics("depth_", "depth"),
        Column(
            "color_from_depth",
            pa.list_(F64),
            "4×4 transform between the cameras, row by row; null = they coincide",
            nullable=True,
        ),
    ),
)
ANNOTATIONS = TableSpec(
    "annotations",
    (*FRAME_KEY, Column("annotation_index", I32, "ordinal of the annotation in its frame")),
    (
        CLASS_ID,
        *BOX,
        Column("is_ignored", BOOL, "counts neither as found nor as missed (difficult, cut off)"),
        Column("is_crowd", BOOL, "one box around several objects; ignored too"),
        Column("instance_id", STRING, "the physical object", nullable=True),
        Column(
            "own_azimuth_rad",
            F32,
            "azimuth of the camera in the object's own frame, about its +z, [0, 2π)",
            nullable=True,
        ),
        Column(
            "symmetry",
            STRING,
            "of the class about +z: none, full, or how often it looks the same in a turn",
            nullable=True,
        ),
    ),
    version=2,
)
POSES = TableSpec(
    "poses",
    FRAME_KEY,
    (
        *_pose_columns("null = lost"),
        Column(
            "status",
            STRING,
            "tracked; dense: by depth and brightness, features being too few; interpolated; lost",
        ),
    ),
)
POSE_QUALITY = TableSpec(
    "pose_quality",
    (
        *SEQUENCE_KEY,
        Column("metric", STRING, "see `poses.quality`; the unit is its ending"),
    ),
    (
        Column("value", F64, "the figure; null = cannot be told", nullable=True),
        Column("n", I64, "cases behind the value; of the source's own figures, frames"),
    ),
)
REFERENCE_POSES = TableSpec(
    "reference_poses",
    FRAME_KEY,
    _pose_columns("aligned to the poses by a rigid transform; null = none"),
)
DETECTIONS = TableSpec(
    "detections",
    DETECTION_KEY,
    (
        *BOX,
        Column("background_score", F32, "softmax value of the background"),
        Column("class_ids", pa.list_(I16), "classes for which the box survived threshold and NMS"),
        Column(
            "view_scores",
            pa.list_(F32),
            "softmax values in C order of [class, elevation, azimuth]; one per class where the "
            "detector knows no viewpoints; an exact 0 = nothing said",
        ),
    ),
)
OBSERVATIONS = TableSpec(
    "observations",
    DETECTION_KEY,
    (
        Column("status", STRING, "placed, no_depth, unreadable_depth, no_pose, out_of_range"),
        Column("depth_m", F32, "z-depth of the box", nullable=True),
        *_columns(
            F64, True, x_m="place in the world, x", y_m="place in the world, y", z_m="height"
        ),
        *_columns(I32, True, voxel_i="voxel index along x", voxel_j="along y", voxel_k="along z"),
        *_columns(
            F32,
            True,
            azimuth_rad="direction from object to camera about +z, [0, 2π)",
            elevation_rad="the same above the horizon",
        ),
        *_columns(
            I16, True, azimuth_bin="geometric azimuth bin", elevation_bin="geometric elevation bin"
        ),
    ),
)
FUSED = TableSpec(
    "fused",
    FUSED_KEY,
    (
        Column("score", F32, "the method's score; the single-view score where n_cells is 0"),
        Column("pose_bin", I16, "best pose hypothesis d; yaw = −d·2π/N", nullable=True),
        Column("n_cells", I16, "slots (imod) or frames (naive) behind it; 0 = not placed"),
    ),
)
OBJECTS = TableSpec(
    "objects",
    (*SEQUENCE_KEY, METHOD, Column("object_index", I32, "ordinal by descending score")),
    (
        CLASS_ID,
        Column("score", F32, "largest fused score of the voxel over classes, after all frames"),
        *_columns(F64, False, x_m="mean place of its boxes, x", y_m="y", z_m="z"),
        Column("yaw_rad", F32, "rotation about +z; null without viewpoint classes", nullable=True),
        Column("extent_x_m", F32, "median width of its boxes at their depth"),
        Column("extent_z_m", F32, "median height of its boxes at their depth"),
        *_columns(I32, False, n_detections="boxes placed in the voxel", n_cells="slots filled"),
        *_columns(I32, False, first_frame_index="first sighting", last_frame_index="last sighting"),
    ),
)
MATCHES = TableSpec(
    "matches",
    (*FUSED_KEY, IOU_PERCENT),
    (
        Column("score", F32, "as in fused"),
        Column("outcome", STRING, "true_positive, false_positive, ignored"),
        Column("annotation_index", I32, "the matched annotation", nullable=True),
        Column("iou", F32, "IoU with it, or the best one of a false positive", nullable=True),
    ),
)
METRICS = TableSpec(
    "metrics",
    (
        METHOD,
        Column("class_id", I16, f"{MEAN_CLASS_ID} = mean, {BACKGROUND_CLASS_ID} = background"),
        IOU_PERCENT,
        Column("metric", STRING, "ap_voc07_11pt, ap_area, ap_coco, precision, recall, f1, …"),
    ),
    (
        Column("class_name", STRING, "class, or mean, or background"),
        Column("value", F64, "the figure; null = no annotation, or no threshold", nullable=True),
        *_columns(I64, False, n_annotations="that count", n_detections="that count"),
    ),
    per_run=True,
)
SWEEPS = TableSpec(
    "sweeps",
    (METHOD, Column("voxel_mm", I32, "voxel edge in millimetres"), MEAN_AP),
    (Column("value", F64, "the figure", nullable=True),),
    per_run=True,
)
JITTERS = TableSpec(
    "jitters",
    (
        METHOD,
        Column("kind", STRING, "jitter: each frame on its own; drift: a random walk"),
        Column("translation_mm", I32, "RMS shift of a camera; of drift, in the last frame"),
        Column("rotation_mdeg", I32, "RMS turn of a camera in thousandths of a degree; likewise"),
        MEAN_AP,
    ),
    (
        Column("value", F64, "the figure, mean over repeats", nullable=True),
        Column("spread", F64, "its standard deviation over repeats; null = one", nullable=True),
        Column("n_repeats", I32, "draws of the noise"),
    ),
    per_run=True,
)
LOSSES = TableSpec(
    "losses",
    (CLASS_ID, Column("cause", STRING, "what holds fusion back: see `core.diagnosis`")),
    (
        Column("value", F64, "share or metres", nullable=True),
        Column("n", I64, "cases behind the value"),
    ),
    per_run=True,
)

TABLES = {
    spec.name: spec
    for spec in (
        *(FRAMES, ANNOTATIONS, POSES, POSE_QUALITY, REFERENCE_POSES, DETECTIONS, OBSERVATIONS),
        *(FUSED, OBJECTS, MATCHES, METRICS, SWEEPS, JITTERS, LOSSES),
    )
}
