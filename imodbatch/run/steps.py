"""Which step gets which tables, settings, files and engines: the pipeline as a list.

A stage of the command line is one or more steps. Each step reads tables, depends on some sections
of the pipeline and manifest and on some files, and writes tables; the runner does the rest.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import pyarrow as pa

from imodbatch.core.errors import ConfigError
from imodbatch.datasets import index
from imodbatch.datasets.annotations import annotation_files
from imodbatch.datasets.detections import detection_files, read_detections
from imodbatch.datasets.registry import annotated, camera_model, layout_of
from imodbatch.detection import detect
from imodbatch.detection.card import Checkpoint, checkpoint_files, read_checkpoint
from imodbatch.detection.weights import find_weights
from imodbatch.fusion import fuse, lift
from imodbatch.run.context import Context
from imodbatch.run.posing import pose_files, pose_step, quality_step, reference_files
from imodbatch.scoring import jitter, losses, match, metrics, sweep
from imodbatch.scoring.coco import coco_ap
from imodbatch.scoring.rescoring import Evidence
from imodbatch.settings.manifest import SequenceSection
from imodbatch.tables.columns import Progress, StageResult

Tables = dict[str, pa.Table]


Execute = Callable[[Context, SequenceSection, Tables, Progress[Any]], StageResult]
Sections = Callable[[Context, SequenceSection], dict[str, Any]]
Files = Callable[[Context, SequenceSection], Iterable[Path]]


@dataclass(frozen=True)
class Step:
    """One arrow of the pipeline.

    Attributes:
        stage: the command-line stage it belongs to.
        reads: tables it takes; a table of the run when `per_run`, else of one sequence.
        writes: tables it gives, all of them every time.
        execute: does it. A per-run step gets the first sequence as a stand-in.
        depends_on: the settings its result depends on.
        files: the files outside the run folder that its result depends on.
        per_run: whether it is done once for the run.
        name: where it is not the stage's main step.
    """

    stage: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    execute: Execute
    depends_on: Sections
    files: Files = lambda context, sequence: ()  # noqa: ARG005
    per_run: bool = False
    name: str = ""

    @property
    def title(self) -> str:
        """What its lines begin with."""
        return self.name or self.stage


def _index(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del tables
    return index.run(context.manifest, sequence, progress)


def _index_files(context: Context, sequence: SequenceSection) -> Iterable[Path]:
    manifest = context.manifest
    return [
        *index.image_files(manifest, sequence),
        *layout_of(manifest).other_files(manifest, sequence),
        *annotation_files(annotated(manifest, sequence), sequence),
    ]


def _pose_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    """Of the source in use; how frames find poses in a file matters to that source alone."""
    config = context.pipeline.poses
    if config.source == "odometry":
        return _settings("poses", "@odometry", "@world", "@camera")(context, sequence)
    own = config.model_dump(include={"source", "levelling_frames"})
    return {"poses": own, **_settings(config.source, "@world", "@camera")(context, sequence)}


def _quality_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    """The reference is a file, whatever the source of the poses."""
    names = ("pose_quality", "poses", "@world", "@camera", "@reference")
    return _settings(*names)(context, sequence)


def _detect(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    manifest, config = context.manifest, context.pipeline.detect
    viewpoint = context.pipeline.viewpoint
    grid = (len(viewpoint.elevations_deg), viewpoint.n_azimuths)
    if _is_imported(context):
        camera = camera_model(manifest, sequence).color
        imported = read_detections(
            annotated(manifest, sequence),
            sequence,
            layout_of(manifest).frames(manifest, sequence),
            camera.width_px,
            camera.height_px,
            grid,
        )
        return detect.run_imported(sequence.id, imported, context.n_classes, grid, config)
    detector = shared_detector(read_checkpoint(_weights(context)), config.device)
    _check_card(detector.card, context)
    return detect.run_detector(
        tables["frames"], context.read_color, detector, context.n_classes, grid, config, progress
    )


def _is_imported(context: Context) -> bool:
    """Whether another detector's results are taken in place of running one."""
    return context.manifest.detections is not None and context.pipeline.detect.weights is None


def _weights(context: Context) -> Path:
    weights = context.pipeline.detect.weights
    if weights is None:
        raise ConfigError(
            f"manifest {context.manifest.name}: no detector. Set detect.weights in the pipeline to "
            "a shipped detector's name or a checkpoint (.safetensors with its .json card), or give "
            "[detections] in the manifest."
        )
    return find_weights(weights)


@lru_cache(maxsize=1)
def shared_detector(checkpoint: Checkpoint, device: str) -> Any:
    """One detector for all sequences of a process; other bytes under the same name are another."""
    from imodbatch.detection.inference import make_detector

    return make_detector(checkpoint, device)


def _check_card(card: Any, context: Context) -> None:
    """The detector's classes and grid must be the manifest's and the pipeline's."""
    manifest, viewpoint = context.manifest, context.pipeline.viewpoint
    if tuple(card.classes) != manifest.classes:
        raise ConfigError(
            f"manifest {manifest.name}: classes {list(manifest.classes)} differ from the "
            f"detector's {list(card.classes)}. Copy the detector's list, in its order."
        )
    has_views = len(card.elevations_deg) * card.n_azimuths > 1
    same = (card.n_azimuths, tuple(card.elevations_deg)) == (
        viewpoint.n_azimuths,
        viewpoint.elevations_deg,
    )
    if has_views and not same:
        raise ConfigError(
            f"the detector knows {card.n_azimuths} azimuths at {list(card.elevations_deg)}°; set "
            "viewpoint.n_azimuths and viewpoint.elevations_deg to them."
        )


def _detect_files(context: Context, sequence: SequenceSection) -> Iterable[Path]:
    if _is_imported(context):
        return detection_files(annotated(context.manifest, sequence), sequence)
    return checkpoint_files(_weights(context))


def _detect_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    del sequence
    aside = {"device", "batch_size"}  # change nothing in the result
    if _is_imported(context):
        aside.add("unreadable_color")
    return {
        "detect": context.pipeline.detect.model_dump(exclude=aside),
        "grid": _grid(context),
        "classes": context.manifest.classes,
        "detections": _dump(context.manifest.detections),
    }


def _lift(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence
    pipeline = context.pipeline
    return lift.run(
        tables["frames"],
        tables["poses"],
        tables["detections"],
        context.read_depth,
        pipeline.viewpoint,
        pipeline.lift,
        progress,
    )


def _fuse(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence, progress
    pipeline = context.pipeline
    return fuse.run(
        tables["frames"],
        tables["detections"],
        tables["observations"],
        context.n_classes,
        pipeline.viewpoint,
        pipeline.fuse,
    )


def _match(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence, progress
    return match.run(
        tables["fused"], tables["detections"], tables["annotations"], context.pipeline.matching
    )


def _summarise(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence, progress
    return metrics.run(
        tables["frames"],
        tables["annotations"],
        tables["detections"],
        tables["matches"],
        context.manifest.classes,
        coco_ap,
        context.pipeline.matching,
        context.pipeline.metrics,
    )


def _evidence(context: Context, tables: Tables) -> Evidence:
    return Evidence(
        tables["frames"],
        tables["annotations"],
        tables["detections"],
        tables["observations"],
        context.n_classes,
        context.pipeline,
    )


def _sweep(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence
    return sweep.run(_evidence(context, tables), progress)


def _losses(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence, progress
    return losses.run(_evidence(context, tables), tables["poses"], context.manifest.classes)


def _jitter(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence
    return jitter.run(_evidence(context, tables), tables["poses"], progress)


def _dump(section: Any) -> Any:
    return None if section is None else section.model_dump(mode="json")


def _settings(*names: str) -> Sections:
    """Pipeline sections by name; manifest sections by name with a leading ``@``."""

    def collect(context: Context, sequence: SequenceSection) -> dict[str, Any]:
        del sequence
        found: dict[str, Any] = {}
        for name in names:
            owner = context.manifest if name.startswith("@") else context.pipeline
            value = getattr(owner, name.removeprefix("@"))
            found[name] = _dump(value) if hasattr(value, "model_dump") else value
        return found

    return collect


def _index_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    names = ("@adapter", "@root", "@classes", "@camera", "@images", "@annotations")
    return {**_settings(*names)(context, sequence), "sequence": _dump(sequence)}


def _grid(context: Context) -> dict[str, Any]:
    """The viewpoints told apart; how far outside a box may be seen matters to its place alone."""
    return context.pipeline.viewpoint.model_dump(include={"n_azimuths", "elevations_deg"})


def _with_grid(*names: str) -> Sections:
    """`_settings` and the grid of viewpoints."""
    return lambda context, sequence: {
        **_settings(*names)(context, sequence),
        "grid": _grid(context),
    }


def _fusing_again(*names: str) -> Sections:
    """What fusing and scoring once more depends on, whatever for, and more sections by name."""

    def collect(context: Context, sequence: SequenceSection) -> dict[str, Any]:
        matching = context.pipeline.matching
        return {
            **_with_grid("fuse", "@classes", *names)(context, sequence),
            "matching": {"iou_percent": matching.iou_percents[0], "rule": matching.rule},
        }

    return collect


def _jitter_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    """Disturbed boxes are placed again."""
    placing = context.pipeline.lift.model_dump(include={"max_depth_m", "voxel_size_m"})
    return {**_fusing_again("jitter", "viewpoint")(context, sequence), "lift": placing}


DIAGNOSE = "diagnose"
STEPS: tuple[Step, ...] = (
    Step("index", (), ("frames", "annotations"), _index, _index_settings, _index_files),
    Step(
        "poses",
        ("frames",),
        ("poses",),
        pose_step,
        _pose_settings,
        pose_files,
    ),
    Step(
        "poses",
        ("frames", "poses"),
        ("pose_quality", "reference_poses"),
        quality_step,
        _quality_settings,
        reference_files,
        name="pose_quality",
    ),
    Step("detect", ("frames",), ("detections",), _detect, _detect_settings, _detect_files),
    Step(
        "lift",
        ("frames", "poses", "detections"),
        ("observations",),
        _lift,
        _settings("viewpoint", "lift", "@camera"),
    ),
    Step(
        "fuse",
        ("frames", "detections", "observations"),
        ("fused", "objects"),
        _fuse,
        _with_grid("fuse", "@classes"),
    ),
    Step(
        "score",
        ("fused", "detections", "annotations"),
        ("matches",),
        _match,
        _settings("matching"),
    ),
    Step(
        "score",
        ("frames", "annotations", "detections", "matches"),
        ("metrics",),
        _summarise,
        _settings("matching", "metrics", "@classes"),
        per_run=True,
    ),
    Step(
        DIAGNOSE,
        ("frames", "annotations", "detections", "observations"),
        ("sweeps",),
        _sweep,
        _fusing_again("sweep"),
        per_run=True,
    ),
    Step(
        DIAGNOSE,
        ("frames", "annotations", "poses", "detections", "observations"),
        ("losses",),
        _losses,
        _fusing_again(),
        per_run=True,
    ),
    Step(
        DIAGNOSE,
        ("frames", "annotations", "poses", "detections", "observations"),
        ("jitters",),
        _jitter,
        _jitter_settings,
        per_run=True,
    ),
)
STAGES = (*dict.fromkeys(step.stage for step in STEPS), "report")


def stages_of(context: Context) -> tuple[str, ...]:
    """The stages of a run: all, or all but `diagnose` where the pipeline leaves it out."""
    is_diagnosed = context.pipeline.diagnose.enabled
    return tuple(stage for stage in STAGES if is_diagnosed or stage != DIAGNOSE)
