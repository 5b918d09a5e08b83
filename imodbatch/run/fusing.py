"""From boxes to fused scores as steps: lift, then fuse."""

from typing import Any

from imodbatch.fusion import fuse, lift
from imodbatch.run.plan import Plan
from imodbatch.run.step import Tables
from imodbatch.tables.columns import Progress, StageResult


def lift_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Each box of a sequence gets a place in the world."""
    return lift.run(
        tables["frames"],
        tables["poses"],
        tables["detections"],
        part.read_depth,
        part.pipeline.viewpoint,
        part.pipeline.lift,
        progress,
    )


def fuse_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Fused scores and objects of a sequence."""
    del progress
    return fuse.run(
        tables["frames"],
        tables["detections"],
        tables["observations"],
        part.n_classes,
        part.pipeline.viewpoint,
        part.pipeline.fuse,
    )
