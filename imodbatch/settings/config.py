"""What can be turned: one frozen, checked model per stage, and all of them as a pipeline file.

Every key has a default and a unit in its name.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from imodbatch.core.depth import DepthMode
from imodbatch.core.errors import ConfigError
from imodbatch.core.fusion import Method
from imodbatch.core.slots import CellReduce
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.settings.toml import StrictModel, apply_settings, read_toml, validate

Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
Percent = Annotated[int, Field(ge=1, le=100)]
Thousandths = Annotated[float, Field(ge=0.001)]


class PosesConfig(StrictModel):
    """Where frames get their poses from, and how those of a file belong to them."""

    source: Literal["odometry", "slam", "sfm"] = "odometry"
    max_gap_ms: Annotated[float, Field(ge=0)] = 20.0
    interpolate: Literal["never", "gaps", "always"] = "gaps"
    max_interpolation_gap_ms: Annotated[float, Field(ge=0)] = 200.0
    levelling_frames: Annotated[int, Field(ge=1)] = 20


class PoseQualityConfig(StrictModel):
    """How poses are judged; changes none of them."""

    rpe_delta_frames: Annotated[int, Field(ge=1)] = 30


class SlamConfig(StrictModel):
    """How `poses.source = "slam"` tracks the camera."""

    n_features: Annotated[int, Field(ge=100)] = 1000


class SfmConfig(StrictModel):
    """How `poses.source = "sfm"` reconstructs the camera's path."""

    mapper: Literal["incremental", "global"] = "incremental"
    max_features: Annotated[int, Field(ge=100)] = 2000
    keyframe_motion_percent: Annotated[float, Field(gt=0, le=50)] = 5.0
    next_keyframes: Annotated[int, Field(ge=1)] = 6
    alike_keyframes: Annotated[int, Field(ge=0)] = 6
    adjust_to_depth: bool = True
    max_gap_frames: Annotated[int, Field(ge=0)] = 3


class DetectConfig(StrictModel):
    """Which detector runs, and which of its boxes are kept."""

    weights: str | None = None
    device: str = "cpu"
    batch_size: Annotated[int, Field(ge=1)] = 4
    score_threshold: Fraction = 0.02
    nms_iou: Fraction = 0.7
    max_per_frame: Annotated[int, Field(ge=1)] = 100
    unreadable_color: Literal["error", "skip"] = "error"


class ViewpointConfig(StrictModel):
    """The grid of viewpoints, shared by geometry and detector."""

    n_azimuths: Annotated[int, Field(ge=1)] = 16
    elevations_deg: tuple[Annotated[float, Field(ge=-90, le=90)], ...] = (10.0, 30.0, 50.0)
    elevation_margin_deg: Annotated[float, Field(ge=0)] = 90.0

    @model_validator(mode="after")
    def _has_elevations(self) -> "ViewpointConfig":
        if not self.elevations_deg or list(self.elevations_deg) != sorted(set(self.elevations_deg)):
            raise ValueError("elevations_deg must rise and hold at least one angle")
        return self

    def grid(self) -> ViewGrid:
        """The same in radians, for the core."""
        return ViewGrid(self.n_azimuths, tuple(math.radians(e) for e in self.elevations_deg))


class LiftConfig(StrictModel):
    """How a box becomes a place in the world."""

    depth: DepthMode = "window_median"
    window: Annotated[float, Field(gt=0, le=1)] = 0.3
    foreground_bin_m: Positive = 0.02
    push_fraction: Annotated[float, Field(ge=0, le=2)] = 0.0
    max_depth_m: Positive = 10.0
    voxel_size_m: Positive = 0.2


class FuseConfig(StrictModel):
    """Which rules fuse the boxes of a voxel."""

    methods: tuple[Method, ...] = ("single", "naive", "naive_log", "imod")
    mode: Literal["online", "offline", "both"] = "both"
    cell_reduce: CellReduce = "mean"
    takers: Literal["best", "all"] = "best"
    probability_floor: Annotated[float, Field(gt=0, lt=0.5)] = 1e-4


class MatchingConfig(StrictModel):
    """Which box finds which annotation."""

    iou_percents: Annotated[tuple[Percent, ...], Field(min_length=1)] = (50,)
    rule: Literal["voc", "coco"] = "voc"


class MetricsConfig(StrictModel):
    """What is computed from the matches."""

    names: tuple[Literal["ap_voc07_11pt", "ap_area", "ap_coco"], ...] = (
        "ap_voc07_11pt",
        "ap_area",
        "ap_coco",
    )
    threshold_step: Positive = 0.01
    threshold_sequences: tuple[str, ...] = ()


class DiagnoseConfig(StrictModel):
    """Whether the stage `diagnose` is run: sweeps, losses and jitters."""

    enabled: bool = True


class SweepConfig(StrictModel):
    """At which voxel sizes the run is fused and scored again."""

    voxel_sizes_m: tuple[Positive, ...] = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4)


class JitterConfig(StrictModel):
    """Under which disturbances of the poses the run is fused and scored again."""

    shifts_m: tuple[Thousandths, ...] = ()
    turns_deg: tuple[Thousandths, ...] = ()
    repeats: Annotated[int, Field(ge=1)] = 3


class ReportConfig(StrictModel):
    """What the report shows."""

    n_frames: Annotated[int, Field(ge=0, le=60)] = 6
    frame_method: str = "imod"
    max_image_width_px: Annotated[int, Field(ge=100)] = 480
    paper: Literal["none", "table1", "table2"] = "none"


class Pipeline(StrictModel):
    """One experiment: one section or more per stage."""

    poses: PosesConfig = PosesConfig()
    pose_quality: PoseQualityConfig = PoseQualityConfig()
    slam: SlamConfig = SlamConfig()
    sfm: SfmConfig = SfmConfig()
    detect: DetectConfig = DetectConfig()
    viewpoint: ViewpointConfig = ViewpointConfig()
    lift: LiftConfig = LiftConfig()
    fuse: FuseConfig = FuseConfig()
    matching: MatchingConfig = MatchingConfig()
    metrics: MetricsConfig = MetricsConfig()
    diagnose: DiagnoseConfig = DiagnoseConfig()
    sweep: SweepConfig = SweepConfig()
    jitter: JitterConfig = JitterConfig()
    report: ReportConfig = ReportConfig()


MOVED = {
    "poses.rpe_delta_frames": "pose_quality.rpe_delta_frames",
    "score.iou_percents": "matching.iou_percents",
    "score.matching": "matching.rule",
    "score.metrics": "metrics.names",
    "score.threshold_step": "metrics.threshold_step",
    "score.threshold_sequences": "metrics.threshold_sequences",
    "score.voxel_sweep_m": "sweep.voxel_sizes_m",
    "score.jitter_m": "jitter.shifts_m",
    "score.jitter_deg": "jitter.turns_deg",
    "score.jitter_repeats": "jitter.repeats",
}
"""Settings by the names of version 0.1, and theirs since."""


def load_pipeline(path: Path | None, settings: Sequence[str] = ()) -> Pipeline:
    """Read a pipeline file (None = all defaults) and lay ``stage.key=value`` settings over it.

    Raises:
        ConfigError: the file is missing or not TOML, a key is unknown, a value has the wrong form.
    """
    data = {} if path is None else read_toml(path)
    where = "pipeline" if path is None else str(path)
    data = apply_settings(data, settings)
    _refuse_moved(data, where)
    return validate(Pipeline, data, where)


def _refuse_moved(data: dict[str, Any], where: str) -> None:
    """Say of a setting that bears its old name what it is called."""
    for old, name in MOVED.items():
        section, key = old.split(".")
        values = data.get(section)
        if isinstance(values, dict) and key in values:
            raise ConfigError(f"{where}: {old} is now {name}. Rename it.")
