"""Which step gets which tables, settings, files and engines: the pipeline as a list.

A stage of the command line is one or more steps. Each step reads tables, depends on some sections
of the pipeline and manifest and on some files, and writes tables; the runner does the rest.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.context import Context
from imodbatch.core.scoring import Candidates, Truth
from imodbatch.datasets.annotations import annotation_files
from imodbatch.datasets.detections import detection_files, read_detections
from imodbatch.datasets.registry import adapter_of, annotated, camera_model, layout_files
from imodbatch.engines.detector.card import weights_digest
from imodbatch.errors import ConfigError
from imodbatch.manifest import SequenceSection
from imodbatch.posing import pose_files, pose_step
from imodbatch.stages import detect, fuse, index, jitter, lift, limits, score
from imodbatch.stages.base import Progress, StageResult
from imodbatch.stages.refusion import Evidence
from imodbatch.weights import find_weights

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
    """

    stage: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    execute: Execute
    depends_on: Sections
    files: Files = lambda context, sequence: ()  # noqa: ARG005
    per_run: bool = False


def _index(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del tables
    return index.run(context.manifest, sequence, progress)


def _index_files(context: Context, sequence: SequenceSection) -> Iterable[Path]:
    manifest = context.manifest
    return [
        *index.image_files(manifest, sequence),
        *layout_files(manifest, sequence),
        *annotation_files(annotated(manifest, sequence), sequence),
    ]


def _pose_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    source = context.pipeline.poses.source
    own = ("@odometry",) if source == "odometry" else (source,)
    return _settings("poses", "@world", "@camera", "@reference", *own)(context, sequence)


def _detect(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    manifest, config = context.manifest, context.pipeline.detect
    if manifest.detections is not None and config.weights is None:
        camera = camera_model(manifest, sequence).color
        viewpoint = context.pipeline.viewpoint
        imported = read_detections(
            annotated(manifest, sequence),
            sequence,
            adapter_of(manifest).frames(manifest, sequence),
            camera.width_px,
            camera.height_px,
            (len(viewpoint.elevations_deg), viewpoint.n_azimuths),
        )
        return detect.run_imported(sequence.id, imported, context.n_classes, config)
    weights = _weights(context)
    detector = _detector(weights, config.device, weights_digest(weights))
    _check_card(detector.card, context)
    return detect.run_detector(
        tables["frames"], context.read_color, detector, context.n_classes, config, progress
    )


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
def _detector(weights: Path, device: str, digest: str) -> Any:
    """One detector for all sequences of a process; `digest` tells other weights of that name."""
    from imodbatch.engines.detector.inference import load_detector

    del digest
    return load_detector(weights, device)


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
    if context.manifest.detections is not None and context.pipeline.detect.weights is None:
        return detection_files(annotated(context.manifest, sequence), sequence)
    weights = _weights(context)
    return [weights, weights.with_suffix(".json")]


def _detect_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    del sequence
    speed = {"device", "batch_size"}  # change nothing in the result
    return {
        "detect": context.pipeline.detect.model_dump(exclude=speed),
        "viewpoint": _dump(context.pipeline.viewpoint),
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
    return score.match(
        tables["fused"], tables["detections"], tables["annotations"], context.pipeline.score
    )


def _summarise(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence, progress
    return score.summarise(
        tables["frames"],
        tables["annotations"],
        tables["detections"],
        tables["matches"],
        context.manifest.classes,
        _coco_ap,
        context.pipeline.score,
    )


def _coco_ap(
    candidates: Candidates, scores: NDArray[np.float64], truth: Truth, n_classes: int
) -> NDArray[np.float64]:
    from imodbatch.engines.coco import CocoAnnotations, CocoDetections, coco_ap

    detections = CocoDetections(candidates.image, candidates.class_id, candidates.boxes, scores)
    annotations = CocoAnnotations(
        truth.image, truth.class_id, truth.boxes, truth.is_ignored, truth.is_crowd
    )
    return coco_ap(detections, annotations, n_classes)


def _evidence(context: Context, tables: Tables) -> Evidence:
    return Evidence(
        tables["frames"],
        tables["annotations"],
        tables["detections"],
        tables["observations"],
        context.n_classes,
        context.pipeline,
    )


def _limits(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence
    evidence = _evidence(context, tables)
    swept = limits.sweep(evidence, progress)
    lost = limits.losses(evidence, tables["poses"], context.manifest.classes)
    return StageResult({**swept.tables, **lost.tables}, f"{swept.summary}; {lost.summary}")


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


JITTER_KEYS = frozenset({"jitter_m", "jitter_deg", "jitter_repeats"})


def _score_settings(*names: str) -> Sections:
    """`_settings` with all of ``[score]`` but what concerns the step `_jitter` alone."""

    def collect(context: Context, sequence: SequenceSection) -> dict[str, Any]:
        score_section = context.pipeline.score.model_dump(mode="json", exclude=set(JITTER_KEYS))
        return {**_settings(*names)(context, sequence), "score": score_section}

    return collect


def _jitter_settings(context: Context, sequence: SequenceSection) -> dict[str, Any]:
    keys = {"iou_percents", "matching", *JITTER_KEYS}
    score_section = context.pipeline.score.model_dump(mode="json", include=keys)
    others = _settings("fuse", "viewpoint", "lift", "@classes")(context, sequence)
    return {**others, "score": score_section}


STEPS: tuple[Step, ...] = (
    Step("index", (), ("frames", "annotations"), _index, _index_settings, _index_files),
    Step(
        "poses",
        ("frames",),
        ("poses", "pose_quality", "reference_poses"),
        pose_step,
        _pose_settings,
        pose_files,
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
        _settings("viewpoint", "fuse", "@classes"),
    ),
    Step(
        "score",
        ("fused", "detections", "annotations"),
        ("matches",),
        _match,
        _score_settings(),
    ),
    Step(
        "score",
        ("frames", "annotations", "detections", "matches"),
        ("metrics",),
        _summarise,
        _score_settings("@classes"),
        per_run=True,
    ),
    Step(
        "score",
        ("frames", "annotations", "poses", "detections", "observations"),
        ("sweeps", "losses"),
        _limits,
        _score_settings("fuse", "viewpoint", "lift", "@classes"),
        per_run=True,
    ),
    Step(
        "score",
        ("frames", "annotations", "poses", "detections", "observations"),
        ("jitters",),
        _jitter,
        _jitter_settings,
        per_run=True,
    ),
)
STAGES = (*dict.fromkeys(step.stage for step in STEPS), "report")
