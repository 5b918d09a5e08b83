"""For every setting, the tables that depend on it at first hand; a step welded to another shows."""

from pathlib import Path
from typing import Any

import pytest

from imodbatch.run.plan import Plan
from imodbatch.run.steps import STEPS
from imodbatch.settings.config import Pipeline
from imodbatch.settings.manifest import load_manifest

MANIFEST = Path(__file__).parents[2] / "manifests" / "analytic.toml"
FUSED = {"fused", "objects"}
AGAIN = {"sweeps", "losses", "jitters"}
"""Fused and scored once more."""
JUDGED = {"pose_quality", "reference_poses"}
GRID = {"detections", "observations", *FUSED, *AGAIN}
NOTHING: set[str] = set()
ODOMETRY, SLAM, SFM = ({"poses": {"source": name}} for name in ("odometry", "slam", "sfm"))
DETECTOR = {"detect": {"weights": "robot17_3x16"}}
Case = tuple[dict[str, Any], str, Any, set[str]]
CASES: list[Case] = [
    (ODOMETRY, "poses.source", "slam", {"poses", *JUDGED}),
    (ODOMETRY, "poses.max_gap_ms", 1.0, {"poses", *JUDGED}),
    (SLAM, "poses.max_gap_ms", 1.0, JUDGED),
    (ODOMETRY, "poses.interpolate", "never", {"poses", *JUDGED}),
    (SFM, "poses.interpolate", "never", JUDGED),
    (ODOMETRY, "poses.max_interpolation_gap_ms", 1.0, {"poses", *JUDGED}),
    (ODOMETRY, "poses.levelling_frames", 5, {"poses", *JUDGED}),
    (SLAM, "poses.levelling_frames", 5, {"poses", *JUDGED}),
    (SLAM, "pose_quality.rpe_delta_frames", 5, JUDGED),
    (ODOMETRY, "slam.n_features", 500, NOTHING),
    (SLAM, "slam.n_features", 500, {"poses"}),
    (SFM, "slam.n_features", 500, NOTHING),
    (SLAM, "sfm.mapper", "global", NOTHING),
    (SFM, "sfm.mapper", "global", {"poses"}),
    (SFM, "sfm.max_features", 500, {"poses"}),
    (SFM, "sfm.keyframe_motion_percent", 9.0, {"poses"}),
    (SFM, "sfm.next_keyframes", 3, {"poses"}),
    (SFM, "sfm.alike_keyframes", 3, {"poses"}),
    (SFM, "sfm.adjust_to_depth", False, {"poses"}),
    (SFM, "sfm.max_gap_frames", 1, {"poses"}),
    ({}, "detect.weights", "robot17_3x16", {"detections"}),
    (DETECTOR, "detect.device", "cuda", NOTHING),
    (DETECTOR, "detect.batch_size", 1, NOTHING),
    (DETECTOR, "detect.score_threshold", 0.3, {"detections"}),
    ({}, "detect.nms_iou", 0.3, {"detections"}),
    ({}, "detect.max_per_frame", 3, {"detections"}),
    ({}, "detect.unreadable_color", "skip", NOTHING),
    (DETECTOR, "detect.unreadable_color", "skip", {"detections"}),
    ({}, "viewpoint.n_azimuths", 8, GRID),
    ({}, "viewpoint.elevations_deg", (30.0,), GRID),
    ({}, "viewpoint.elevation_margin_deg", 10.0, {"observations", "jitters"}),
    ({}, "lift.depth", "center", {"observations"}),
    ({}, "lift.window", 0.5, {"observations"}),
    ({}, "lift.foreground_bin_m", 0.1, {"observations"}),
    ({}, "lift.push_fraction", 1.0, {"observations"}),
    ({}, "lift.max_depth_m", 3.0, {"observations", "jitters"}),
    ({}, "lift.voxel_size_m", 0.3, {"observations", "jitters"}),
    ({}, "fuse.methods", ("single",), {*FUSED, *AGAIN}),
    ({}, "fuse.mode", "online", {*FUSED, *AGAIN}),
    ({}, "fuse.cell_reduce", "max", {*FUSED, *AGAIN}),
    ({}, "fuse.takers", "all", {*FUSED, *AGAIN}),
    ({}, "fuse.probability_floor", 1e-3, {*FUSED, *AGAIN}),
    ({}, "matching.iou_percents", (30, 50), {"matches", "metrics", *AGAIN}),
    ({}, "matching.iou_percents", (50, 75), {"matches", "metrics"}),
    ({}, "matching.rule", "coco", {"matches", "metrics", *AGAIN}),
    ({}, "metrics.names", ("ap_area",), {"metrics"}),
    ({}, "metrics.threshold_step", 0.1, {"metrics"}),
    ({}, "metrics.threshold_sequences", ("walk_1",), {"metrics"}),
    ({}, "diagnose.enabled", False, NOTHING),
    ({}, "sweep.voxel_sizes_m", (0.3,), {"sweeps"}),
    ({}, "jitter.shifts_m", (0.1,), {"jitters"}),
    ({}, "jitter.turns_deg", (1.0,), {"jitters"}),
    ({}, "jitter.repeats", 5, {"jitters"}),
    ({}, "report.n_frames", 1, NOTHING),
    ({}, "report.frame_method", "naive", NOTHING),
    ({}, "report.max_image_width_px", 300, NOTHING),
    ({}, "report.paper", "table1", NOTHING),
]
"""A pipeline, another value of one of its settings, and the tables whose own step it belongs to."""


def settings_of_steps(pipeline: Pipeline) -> dict[str, Any]:
    manifest = load_manifest(MANIFEST)
    part = Plan(manifest, pipeline, Path("run"), manifest.sequences[:1])
    return {name: step.depends_on(part) for step in STEPS for name in step.writes}


def test_every_setting_is_listed() -> None:
    known = {f"{s}.{key}" for s, model in Pipeline() for key in type(model).model_fields}
    assert {name for _, name, _, _ in CASES} == known


@pytest.mark.parametrize(("base", "name", "value", "tables"), CASES)
def test_a_setting_concerns_its_own_steps_only(
    base: dict[str, Any], name: str, value: Any, tables: set[str]
) -> None:
    section, key = name.split(".")
    pipeline = Pipeline.model_validate(base)
    changed = pipeline.model_dump()
    assert changed[section][key] != value
    changed[section][key] = value
    before = settings_of_steps(pipeline)
    after = settings_of_steps(Pipeline.model_validate(changed))
    assert {table for table in before if before[table] != after[table]} == tables
