"""How detections come about: a detector is run, or another one's results are taken."""

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from imodbatch.core.errors import ConfigError
from imodbatch.datasets.detections import detection_files, read_detections
from imodbatch.datasets.registry import annotated, camera_model, layout_of
from imodbatch.detection import detect
from imodbatch.detection.card import DetectorCard
from imodbatch.detection.files import Checkpoint, checkpoint_files, read_checkpoint
from imodbatch.detection.weights import find_weights
from imodbatch.run.plan import Plan
from imodbatch.run.step import Tables, dump, sections
from imodbatch.tables.columns import Progress, StageResult


def detect_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Detections of a sequence."""
    config, viewpoint = part.pipeline.detect, part.pipeline.viewpoint
    shape = (len(viewpoint.elevations_deg), viewpoint.n_azimuths)
    if _is_imported(part):
        manifest, sequence = part.manifest, part.sequence
        camera = camera_model(manifest, sequence).color
        imported = read_detections(
            annotated(manifest, sequence),
            sequence,
            layout_of(manifest).frames(manifest, sequence),
            camera.width_px,
            camera.height_px,
            shape,
        )
        return detect.run_imported(sequence.id, imported, part.n_classes, shape, config)
    detector = shared_detector(read_checkpoint(_weights(part)), config.device)
    _check_card(detector.card, part)
    return detect.run_detector(
        tables["frames"], part.read_color, detector, part.n_classes, shape, config, progress
    )


def _is_imported(part: Plan) -> bool:
    """Whether another detector's results are taken in place of running one."""
    return part.manifest.detections is not None and part.pipeline.detect.weights is None


def _weights(part: Plan) -> Path:
    weights = part.pipeline.detect.weights
    if weights is None:
        raise ConfigError(
            f"manifest {part.manifest.name}: no detector. Set detect.weights in the pipeline to "
            "a shipped detector's name or a checkpoint (.safetensors with its .json card), or give "
            "[detections] in the manifest."
        )
    return find_weights(weights)


@lru_cache(maxsize=1)
def shared_detector(checkpoint: Checkpoint, device: str) -> Any:
    """One detector for all sequences of a process; other bytes under the same name are another."""
    from imodbatch.detection.inference import make_detector

    return make_detector(checkpoint, device)


def _check_card(card: DetectorCard, part: Plan) -> None:
    """The detector's classes and grid must be the manifest's and the pipeline's."""
    manifest, viewpoint = part.manifest, part.pipeline.viewpoint
    if card.classes != manifest.classes:
        raise ConfigError(
            f"manifest {manifest.name}: classes {list(manifest.classes)} differ from the "
            f"detector's {list(card.classes)}. Copy the detector's list, in its order."
        )
    grid = (viewpoint.n_azimuths, viewpoint.elevations_deg)
    if card.has_viewpoints and (card.n_azimuths, card.elevations_deg) != grid:
        raise ConfigError(
            f"the detector knows {card.n_azimuths} azimuths at {list(card.elevations_deg)}°; set "
            "viewpoint.n_azimuths and viewpoint.elevations_deg to them."
        )


def detect_files(part: Plan) -> Iterable[Path]:
    """The results that are taken, or the detector's weights and card."""
    if _is_imported(part):
        return detection_files(annotated(part.manifest, part.sequence), part.sequence)
    return checkpoint_files(_weights(part))


def detect_settings(part: Plan) -> dict[str, Any]:
    """All but those that change nothing in the result."""
    aside = {"device", "batch_size"}
    if _is_imported(part):
        aside.add("unreadable_color")
    return {
        "detect": part.pipeline.detect.model_dump(exclude=aside),
        "grid": sections("grid")(part)["grid"],
        "classes": part.manifest.classes,
        "detections": dump(part.manifest.detections),
    }
