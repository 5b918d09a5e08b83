"""For every setting, the tables that depend on it at first hand; a step welded to another shows."""

from pathlib import Path
from typing import Any

import pytest

from imodbatch.config import Pipeline, load_pipeline
from imodbatch.context import Context
from imodbatch.manifest import load_manifest
from imodbatch.wiring import STEPS

MANIFEST = Path(__file__).parents[1] / "manifests" / "analytic.toml"
AGAIN = {"sweeps", "losses", "jitters"}
"""Fused and scored once more."""
POSES = {"poses"}
NOTHING: set[str] = set()
DEPENDENT = {
    "poses.source": ("slam", POSES),
    "poses.max_gap_ms": (1.0, POSES),
    "poses.interpolate": ("never", POSES),
    "poses.max_interpolation_gap_ms": (1.0, POSES),
    "poses.levelling_frames": (5, POSES),
    "pose_quality.rpe_delta_frames": (5, {"pose_quality", "reference_poses"}),
    "slam.n_features": (500, NOTHING),
    "sfm.mapper": ("global", NOTHING),
    "sfm.max_features": (500, NOTHING),
    "sfm.keyframe_motion_percent": (9.0, NOTHING),
    "sfm.next_keyframes": (3, NOTHING),
    "sfm.alike_keyframes": (3, NOTHING),
    "sfm.adjust_to_depth": (False, NOTHING),
    "sfm.max_gap_frames": (1, NOTHING),
    "detect.weights": ("robot17_3x16", {"detections"}),
    "detect.device": ("cuda", NOTHING),
    "detect.batch_size": (1, NOTHING),
    "detect.score_threshold": (0.3, {"detections"}),
    "detect.nms_iou": (0.3, {"detections"}),
    "detect.max_per_frame": (3, {"detections"}),
    "detect.unreadable_color": ("skip", {"detections"}),
    "viewpoint.n_azimuths": (8, {"detections", "observations", "fused", "objects", *AGAIN}),
    "viewpoint.elevations_deg": (
        (30.0,),
        {"detections", "observations", "fused", "objects", *AGAIN},
    ),
    "viewpoint.elevation_margin_deg": (10.0, {"observations", "jitters"}),
    "lift.depth": ("center", {"observations"}),
    "lift.window": (0.5, {"observations"}),
    "lift.foreground_bin_m": (0.1, {"observations"}),
    "lift.push_fraction": (1.0, {"observations"}),
    "lift.max_depth_m": (3.0, {"observations", "jitters"}),
    "lift.voxel_size_m": (0.3, {"observations", "jitters"}),
    "fuse.methods": (("single",), {"fused", "objects", *AGAIN}),
    "fuse.mode": ("online", {"fused", "objects", *AGAIN}),
    "fuse.cell_reduce": ("max", {"fused", "objects", *AGAIN}),
    "fuse.takers": ("all", {"fused", "objects", *AGAIN}),
    "fuse.probability_floor": (1e-3, {"fused", "objects", *AGAIN}),
    "matching.iou_percents": ((30, 50), {"matches", "metrics", *AGAIN}),
    "matching.rule": ("coco", {"matches", "metrics", *AGAIN}),
    "metrics.names": (("ap_area",), {"metrics"}),
    "metrics.threshold_step": (0.1, {"metrics"}),
    "metrics.threshold_sequences": (("walk_1",), {"metrics"}),
    "diagnose.enabled": (False, NOTHING),
    "sweep.voxel_sizes_m": ((0.3,), {"sweeps"}),
    "jitter.shifts_m": ((0.1,), {"jitters"}),
    "jitter.turns_deg": ((1.0,), {"jitters"}),
    "jitter.repeats": (5, {"jitters"}),
    "report.n_frames": (1, NOTHING),
    "report.frame_method": ("naive", NOTHING),
    "report.max_image_width_px": (300, NOTHING),
    "report.paper": ("table1", NOTHING),
}
"""Another value of each setting, and the tables whose own step it belongs to."""


def settings_of_steps(pipeline: Pipeline) -> dict[str, Any]:
    context = Context(load_manifest(MANIFEST), pipeline, Path("run"))
    (first, *_) = context.manifest.sequences
    return {name: step.depends_on(context, first) for step in STEPS for name in step.writes}


def test_every_setting_is_listed() -> None:
    known = {
        f"{section}.{key}" for section, model in Pipeline() for key in type(model).model_fields
    }
    assert set(DEPENDENT) == known


@pytest.mark.parametrize("name", DEPENDENT)
def test_a_setting_concerns_its_own_steps_only(name: str) -> None:
    value, tables = DEPENDENT[name]
    section, key = name.split(".")
    changed = load_pipeline(None).model_dump()
    assert changed[section][key] != value
    changed[section][key] = value
    before = settings_of_steps(Pipeline())
    after = settings_of_steps(Pipeline.model_validate(changed))
    assert {table for table in before if before[table] != after[table]} == tables
