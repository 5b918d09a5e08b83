"""The pipeline as a list: which step takes which tables, settings and files, and gives what.

A stage of the command line is one or more steps. The runner does the rest.
"""

from imodbatch.run.detecting import detect_files, detect_settings, detect_step
from imodbatch.run.fusing import fuse_step, lift_step
from imodbatch.run.indexing import index_files, index_settings, index_step
from imodbatch.run.judging import (
    EVIDENCE,
    fusing_again,
    jitter_settings,
    jitter_step,
    losses_step,
    match_step,
    metrics_step,
    sweep_step,
)
from imodbatch.run.plan import Plan
from imodbatch.run.posing import (
    pose_files,
    pose_settings,
    pose_step,
    quality_settings,
    quality_step,
    reference_files,
)
from imodbatch.run.step import Step, sections

DIAGNOSE = "diagnose"
STEPS: tuple[Step, ...] = (
    Step("index", (), ("frames", "annotations"), index_step, index_settings, index_files),
    Step("poses", ("frames",), ("poses",), pose_step, pose_settings, pose_files),
    Step(
        "poses",
        ("frames", "poses"),
        ("pose_quality", "reference_poses"),
        quality_step,
        quality_settings,
        reference_files,
        name="pose_quality",
    ),
    Step("detect", ("frames",), ("detections",), detect_step, detect_settings, detect_files),
    Step(
        "lift",
        ("frames", "poses", "detections"),
        ("observations",),
        lift_step,
        sections("viewpoint", "lift", "@camera"),
    ),
    Step(
        "fuse",
        ("frames", "detections", "observations"),
        ("fused", "objects"),
        fuse_step,
        sections("fuse", "@classes", "grid"),
    ),
    Step(
        "score",
        ("fused", "detections", "annotations"),
        ("matches",),
        match_step,
        sections("matching"),
    ),
    Step(
        "score",
        ("frames", "annotations", "detections", "matches"),
        ("metrics",),
        metrics_step,
        sections("matching", "metrics", "@classes"),
        per_run=True,
    ),
    Step(DIAGNOSE, EVIDENCE, ("sweeps",), sweep_step, fusing_again("sweep"), per_run=True),
    Step(DIAGNOSE, (*EVIDENCE, "poses"), ("losses",), losses_step, fusing_again(), per_run=True),
    Step(DIAGNOSE, (*EVIDENCE, "poses"), ("jitters",), jitter_step, jitter_settings, per_run=True),
)
STAGES = (*dict.fromkeys(step.stage for step in STEPS), "report")


def stages_of(plan: Plan) -> tuple[str, ...]:
    """The stages of a run: all, or all but `diagnose` where the pipeline leaves it out."""
    is_diagnosed = plan.pipeline.diagnose.enabled
    return tuple(stage for stage in STAGES if is_diagnosed or stage != DIAGNOSE)
