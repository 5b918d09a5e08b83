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

from imodbatch.config import Pipeline
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage, register
from imodbatch.core.scoring import Candidates, Truth
from imodbatch.datasets.annotations import annotation_files
from imodbatch.datasets.detections import detection_files, read_detections
from imodbatch.datasets.registry import adapter_of, camera_model
from imodbatch.engines.detector.card import weights_digest
from imodbatch.errors import ConfigError
from imodbatch.images import UnreadableImageError, read_color, read_depth
from imodbatch.manifest import Manifest, SequenceSection
from imodbatch.stages import detect, fuse, index, lift, limits, poses, score
from imodbatch.stages.base import Progress, StageResult
from imodbatch.weights import find_weights

Tables = dict[str, pa.Table]


@dataclass(frozen=True)
class Context:
    """All that a step may use besides its tables."""

    manifest: Manifest
    pipeline: Pipeline

    @property
    def n_classes(self) -> int:
        """K."""
        return len(self.manifest.classes)

    def read_color(self, color_path: str) -> NDArray[np.uint8]:
        """Colour image of a path as the frames table gives it."""
        return read_color(self.manifest.root_path / color_path)

    def read_depth(self, row: Any) -> DepthImage:
        """Depth of a frame row, registered into the colour camera."""
        path = self.manifest.root_path / row["depth_path"]
        depth_m = read_depth(path, row["depth_scale_m"], camera_model(self.manifest).depth_invalid)
        baseline = row["color_from_depth"]
        return register(
            depth_m,
            _camera(row, "depth_"),
            _camera(row, ""),
            None if baseline is None else np.reshape(baseline, (4, 4)),
        )


def _camera(row: Any, prefix: str) -> PinholeCamera:
    names = PinholeCamera.__dataclass_fields__
    return PinholeCamera(**{name: row[f"{prefix}{name}"] for name in names})


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
    return [
        *index.image_files(context.manifest, sequence),
        *annotation_files(context.manifest, sequence),
    ]


def _poses(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    manifest, frames = context.manifest, tables["frames"]
    adapter = adapter_of(manifest)
    files = adapter.frames(manifest, sequence)
    config = context.pipeline.poses

    def estimate_up(world_from_cam: NDArray[np.float64]) -> tuple[NDArray[np.float64], str]:
        from imodbatch.engines.levelling import MAX_DEPTH_M, estimate_up

        rows = frames.to_pylist()
        usable = [
            i
            for i in np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]))
            if rows[i]["depth_path"] is not None
        ]
        picked = np.unique(np.linspace(0, len(usable) - 1, config.levelling_frames).astype(int))
        chosen = [usable[i] for i in picked] if usable else []
        points = [_points_cam(context, rows[i], MAX_DEPTH_M) for i in progress(chosen)]
        up = estimate_up(points, world_from_cam[chosen], sequence.id)
        return up.direction, str(up)

    odometry = adapter.odometry(manifest, sequence, files)
    return poses.run(frames, odometry, manifest.world.direction(), estimate_up, config)


def _points_cam(context: Context, row: Any, max_depth_m: float) -> NDArray[np.float64]:
    """Every fourth pixel of a frame as points (P, 3) in the colour camera; none if unreadable."""
    try:
        depth_m = context.read_depth(row)[::4, ::4]
    except UnreadableImageError:  # lift says so for every box of the frame
        return np.zeros((0, 3))
    pixels = _camera(row, "").pixel_centers()[::4, ::4]
    near = depth_m < max_depth_m
    return _camera(row, "").unproject(pixels[near], depth_m[near])


def _pose_files(context: Context, sequence: SequenceSection) -> Iterable[Path]:
    return adapter_of(context.manifest).odometry_files(context.manifest, sequence)


def _detect(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    manifest, config = context.manifest, context.pipeline.detect
    if manifest.detections is not None and config.weights is None:
        camera = camera_model(manifest).color
        viewpoint = context.pipeline.viewpoint
        imported = read_detections(
            manifest,
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
        return detection_files(context.manifest, sequence)
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


def _limits(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    del sequence
    evidence = limits.Evidence(
        tables["frames"],
        tables["annotations"],
        tables["detections"],
        tables["observations"],
        context.n_classes,
        context.pipeline,
    )
    swept = limits.sweep(evidence, progress)
    lost = limits.losses(evidence, tables["poses"], context.manifest.classes)
    return StageResult({**swept.tables, **lost.tables}, f"{swept.summary}; {lost.summary}")


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


STEPS: tuple[Step, ...] = (
    Step("index", (), ("frames", "annotations"), _index, _index_settings, _index_files),
    Step(
        "poses",
        ("frames",),
        ("poses",),
        _poses,
        _settings("poses", "@world", "@odometry", "@camera"),
        _pose_files,
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
        _settings("score"),
    ),
    Step(
        "score",
        ("frames", "annotations", "detections", "matches"),
        ("metrics",),
        _summarise,
        _settings("score", "@classes"),
        per_run=True,
    ),
    Step(
        "score",
        ("frames", "annotations", "poses", "detections", "observations"),
        ("sweeps", "losses"),
        _limits,
        _settings("score", "fuse", "viewpoint", "lift", "@classes"),
        per_run=True,
    ),
)
STAGES = (*dict.fromkeys(step.stage for step in STEPS), "report")
