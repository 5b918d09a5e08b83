"""What a manifest says besides its sequences, one model per section."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import is_rigid
from imodbatch.settings.toml import StrictModel

Pixels = Annotated[int, Field(ge=1)]
Focal = Annotated[float, Field(gt=0)]
Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]
Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class Intrinsics(StrictModel):
    """Image size and pinhole intrinsics."""

    width_px: Pixels
    height_px: Pixels
    fx_px: Focal
    fy_px: Focal
    cx_px: float
    cy_px: float

    def camera(self, pixel_origin: str) -> PinholeCamera:
        """The camera in continuous pixels; `pixel_origin` says where cx and cy count from."""
        shift = 0.5 if pixel_origin == "center" else 0.0
        return PinholeCamera(
            self.width_px,
            self.height_px,
            self.fx_px,
            self.fy_px,
            self.cx_px + shift,
            self.cy_px + shift,
        )


class DepthSection(StrictModel):
    """`camera.depth`: what the numbers mean, and intrinsics where they differ from the colour's.

    Without intrinsics the depth image is registered to the colour image.
    """

    scale_m: Annotated[float, Field(gt=0)] = 0.001
    invalid: tuple[int, ...] = (0,)
    width_px: Pixels | None = None
    height_px: Pixels | None = None
    fx_px: Focal | None = None
    fy_px: Focal | None = None
    cx_px: float | None = None
    cy_px: float | None = None

    @model_validator(mode="after")
    def _all_or_none(self) -> "DepthSection":
        missing = [name for name in Intrinsics.model_fields if getattr(self, name) is None]
        if missing and len(missing) < len(Intrinsics.model_fields):
            raise ValueError(f"{', '.join(missing)} missing; give all six intrinsics or none")
        return self

    def intrinsics(self) -> Intrinsics | None:
        """The depth camera's own intrinsics, if it has any."""
        values = {name: getattr(self, name) for name in Intrinsics.model_fields}
        return None if values["width_px"] is None else Intrinsics(**values)


class CameraSection(StrictModel):
    """`[camera]`: overrides what the dataset says of its cameras."""

    color: Intrinsics | None = None
    depth: DepthSection | None = None
    pixel_origin: Literal["corner", "center"] = "corner"
    color_from_depth: tuple[Row, Row, Row, Row] | None = None

    @field_validator("color_from_depth")
    @classmethod
    def _is_rigid(cls, rows: tuple[Row, ...] | None) -> tuple[Row, ...] | None:
        if rows is not None and not is_rigid(np.array(rows)):
            raise ValueError("must be a 4×4 rigid transform in metres, row by row")
        return rows


def _direction(axis: str | Vector) -> Vector:
    """A direction given as an axis, such as ``-y``, or as it is."""
    if not isinstance(axis, str):
        return axis
    sign = 1.0 if axis[0] == "+" else -1.0
    x, y, z = (sign * (name == axis[1]) for name in "xyz")
    return (x, y, z)


def _checked_direction(up: str | Vector | None) -> str | Vector | None:
    if up is not None and not isinstance(up, str) and not np.linalg.norm(up) > 0:
        raise ValueError("must be a direction such as '+z' or [0.0, -1.0, 0.1]")
    return up


class WorldSection(StrictModel):
    """`[world]`: which direction of the poses' world points up.

    `up` is of the world of the poses that come with the dataset; `first_camera_up` is that
    direction in the camera of the first frame with a pose, for poses estimated from the images.
    """

    up: Axis | Literal["estimate"] | Vector = "+z"
    first_camera_up: Vector | None = None

    _is_a_direction = field_validator("up", "first_camera_up")(_checked_direction)

    def direction(self) -> Vector | None:
        """The up direction in the poses' world; None = to be estimated."""
        return None if self.up == "estimate" else _direction(self.up)


class ImagesSection(StrictModel):
    """`[images]` of a plain folder: patterns below a sequence's path; other layouts know theirs.

    ``{frame}`` is an integer (zero-padded or not), ``{stamp}`` a time in seconds, ``{name}`` any
    name, numbered in natural order.
    """

    color: str | None = None
    depth: str | None = None
    timestamps: str | None = None
    frames_per_second: Annotated[float, Field(gt=0)] | None = None
    max_gap_ms: Annotated[float, Field(ge=0)] = 20.0

    @field_validator("color", "depth")
    @classmethod
    def _is_below_the_root(cls, pattern: str | None) -> str | None:
        return pattern if pattern is None else below_root(pattern)


class OdometrySection(StrictModel):
    """`[odometry]`: camera poses that come with the dataset.

    Without `quaternion_order` it is the format's own: w last in TUM files, w first in UW files.
    `clock_offset_ms` is added to the trajectory's stamps.
    """

    format: Literal["tum", "kitti", "uw", "matrix", "csv"]
    path: str
    convention: Literal["world_from_cam", "cam_from_world"] = "world_from_cam"
    camera: Literal["color", "depth"] = "color"
    quaternion_order: Literal["xyzw", "wxyz"] | None = None
    clock_offset_ms: float = 0.0
    unit_m: Annotated[float, Field(gt=0)] = 1.0
    columns: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _says_nothing_in_vain(self) -> "OdometrySection":
        for name, formats in (
            ("quaternion_order", ("tum", "uw")),
            ("clock_offset_ms", ("tum", "csv")),
            ("columns", ("csv",)),
        ):
            if getattr(self, name) and self.format not in formats:
                raise ValueError(
                    f"{name} means nothing in the format {self.format!r}, "
                    f"only in {' and '.join(map(repr, formats))}"
                )
        return self

    @property
    def scalar_is_last(self) -> bool:
        """Whether quaternions stand as x y z w."""
        return (self.quaternion_order or ("wxyz" if self.format == "uw" else "xyzw")) == "xyzw"


class ReferenceSection(OdometrySection):
    """`[reference]`: true poses, used only to judge those that the pipeline works with.

    `up` is the direction of their world that points up, if it is known.
    """

    up: Axis | Vector | None = None

    _is_a_direction = field_validator("up")(_checked_direction)

    def up_direction(self) -> Vector | None:
        """The up direction of the reference's world; None = unknown."""
        return None if self.up is None else _direction(self.up)


class AnnotationsSection(StrictModel):
    """`[annotations]`: true boxes.

    `cluster_gap_m` is of labelled clouds: points of one class nearer than this are one object.
    """

    format: Literal["coco", "voc", "yolo", "uw_mat", "uw_labelled_cloud", "none"] = "none"
    path: str | None = None
    rename: dict[str, str] = Field(default_factory=dict)
    names: tuple[str, ...] = ()
    cluster_gap_m: Annotated[float, Field(gt=0)] = 0.03
    unknown_classes: Literal["error", "skip"] = "skip"
    outside: Literal["error", "clip"] = "clip"

    @model_validator(mode="after")
    def _has_path(self) -> "AnnotationsSection":
        if self.format != "none" and self.path is None:
            raise ValueError("path is needed with this format")
        return self


class DetectionsSection(StrictModel):
    """`[detections]`: another detector's results in place of running one."""

    format: Literal["coco", "parquet", "csv"]
    path: str
    images: str | None = None
    rename: dict[str, str] = Field(default_factory=dict)
    unknown_frames: Literal["error", "skip"] = "error"
    n_azimuths: Annotated[int, Field(ge=1)] = 1
    elevations_deg: tuple[float, ...] = ()


class SimulateSection(StrictModel):
    """`[simulate]`: the arguments with which `imodbatch simulate` makes the data.

    `folder`, relative to the root, is where it writes; the other keys are its options.
    """

    folder: str = "."
    world: Literal["analytic", "house"] | None = None
    layout: Literal["rgbd_scenes_v1"] | None = None
    split: Literal["train", "val", "test"] = "test"
    seed: int = 0
    worlds: Annotated[int, Field(ge=1)] | None = None
    frames: Annotated[int, Field(ge=4)] | None = None

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> "SimulateSection":
        if (self.world is None) == (self.layout is None):
            raise ValueError("give either world or layout")
        return self

    def options(self) -> list[str]:
        """As on the command line, without the folder."""
        options = self.model_dump(exclude={"folder"}, exclude_none=True)
        return [text for name, value in options.items() for text in (f"--{name}", str(value))]


def below_root(path: str) -> str:
    """A path of the manifest, which must be relative to its root."""
    if Path(path).is_absolute():
        raise ValueError("must be relative to root; set root to a folder that holds all images")
    return path
