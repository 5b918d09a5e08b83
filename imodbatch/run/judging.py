"""Results held against annotations as steps: score, and what holds fusion back."""

from typing import Any

from imodbatch.run.plan import Plan
from imodbatch.run.step import Settings, Tables, sections
from imodbatch.scoring import jitter, losses, match, metrics, sweep
from imodbatch.scoring.coco import coco_ap
from imodbatch.scoring.rescoring import Evidence
from imodbatch.tables.columns import Progress, StageResult

EVIDENCE = ("frames", "annotations", "detections", "observations")


def match_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Which fused box of a sequence finds which annotation."""
    del progress
    return match.run(
        tables["fused"], tables["detections"], tables["annotations"], part.pipeline.matching
    )


def metrics_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Figures of the whole run."""
    del progress
    return metrics.run(
        tables["frames"],
        tables["annotations"],
        tables["detections"],
        tables["matches"],
        part.manifest.classes,
        coco_ap,
        part.pipeline.matching,
        part.pipeline.metrics,
    )


def sweep_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Fused and scored again at other voxel sizes."""
    return sweep.run(_evidence(part, tables), progress)


def losses_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """On the way from annotation to fused score, what is lost where."""
    del progress
    return losses.run(_evidence(part, tables), tables["poses"], part.manifest.classes)


def jitter_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Fused and scored again with disturbed poses."""
    return jitter.run(_evidence(part, tables), tables["poses"], progress)


def _evidence(part: Plan, tables: Tables) -> Evidence:
    frames, annotations, detections, observations = (tables[name] for name in EVIDENCE)
    return Evidence(frames, annotations, detections, observations, part.n_classes, part.pipeline)


def fusing_again(*names: str) -> Settings:
    """What fusing and scoring once more depends on, whatever for, and more sections by name."""

    def collect(part: Plan) -> dict[str, Any]:
        matching = part.pipeline.matching
        return {
            **sections("fuse", "@classes", "grid", *names)(part),
            "matching": {"iou_percent": matching.iou_percents[0], "rule": matching.rule},
        }

    return collect


def jitter_settings(part: Plan) -> dict[str, Any]:
    """Disturbed boxes are placed again."""
    placing = part.pipeline.lift.model_dump(include={"max_depth_m", "voxel_size_m"})
    return {**fusing_again("jitter", "viewpoint")(part), "lift": placing}
