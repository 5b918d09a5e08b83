"""detect, lift, fuse and score on arrays and tables in memory.

Each gives the stage what it takes on the command line, and nothing of the stages is said again.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.datasets.images import UnreadableImageError
from imodbatch.detection import detect as detect_stage
from imodbatch.detection.files import read_checkpoint
from imodbatch.detection.weights import find_weights
from imodbatch.fusion import fuse as fuse_stage
from imodbatch.fusion import lift as lift_stage
from imodbatch.run.detecting import shared_detector
from imodbatch.run.library.fitting import boxes_and_poses, boxes_and_sightings, results_and_truth
from imodbatch.run.library.images import Images, color_reader, depth_reader, frame_numbers
from imodbatch.run.library.settings import (
    GRID,
    FuseSettings,
    LiftSettings,
    ScoreSettings,
    classes_of,
    settings_of,
)
from imodbatch.run.library.tables import NO_CAMERA, SEQUENCE, Table, frames_of, told
from imodbatch.scoring import match as match_stage
from imodbatch.scoring import metrics as metrics_stage
from imodbatch.scoring.coco import coco_ap
from imodbatch.settings.config import DetectConfig
from imodbatch.tables.columns import Progress, StageResult, column


def detect(
    colors: Images,
    weights: str | Path,
    *,
    frame_index: ArrayLike | None = None,
    sequence_id: str = SEQUENCE,
    progress: Progress[Any] = iter,
    **settings: Any,
) -> pd.DataFrame:
    """Run a detector of this package over images.

    Args:
        colors: F images (H, W, 3) uint8 RGB in order, or a function from a frame's number to its
            image; None = the frame has none (see `unreadable_color`).
        weights: name of a shipped detector, or path of a checkpoint (.safetensors and its card).
        frame_index: (F,) rising numbers of the frames; None = 0, 1, 2, …
        sequence_id: names the sequence in tables.
        progress: wraps the loop over batches, as tqdm does.
        settings: keys of ``[detect]`` of a pipeline file.

    Returns:
        The table `detections`. Its `attrs` hold the detector's classes and, if it tells viewpoints
        apart, n_azimuths and elevations_deg.

    Raises:
        ImodError: no such detector, an unknown setting, or an image of another type.
    """
    config = settings_of(DetectConfig, {**settings, "weights": str(weights)}, "detect")
    path = find_weights(str(weights))
    detector = shared_detector(read_checkpoint(path), config.device)
    card = detector.card
    numbers = frame_numbers(frame_index, colors=colors)
    read = color_reader(colors, numbers)

    def color(position: str) -> NDArray[np.uint8]:
        image = read(int(position))
        if image is None:
            raise UnreadableImageError(f"colors: frame {numbers[int(position)]} has no image.")
        return image

    frames = frames_of(NO_CAMERA, numbers, sequence_id)
    shape = (max(len(card.elevations_deg), 1), card.n_azimuths)
    result = detect_stage.run_detector(
        frames, color, detector, len(card.classes), shape, config, progress
    )
    grid = {"n_azimuths": card.n_azimuths, "elevations_deg": tuple(card.elevations_deg)}
    has_views = len(card.elevations_deg) * card.n_azimuths > 1
    return told(result, "detections", classes=tuple(card.classes), **(grid if has_views else {}))


def lift(
    detections: Table,
    depths: Images,
    poses: Table | ArrayLike,
    camera: PinholeCamera,
    *,
    frame_index: ArrayLike | None = None,
    progress: Progress[Any] = iter,
    **settings: Any,
) -> pd.DataFrame:
    """Place the boxes of one sequence in the world, by the depth inside them.

    Args:
        detections: table with frame_index and x0_px, y0_px, x1_px, y1_px; without detection_index
            a box's ordinal in its frame is the order of rows.
        depths: F images (H, W) of z-depth in metres, registered to colour, in the order of frames,
            or a function from a frame's number to its image; NaN, 0, negative, infinite or no
            image = unknown.
        poses: the table `poses`, or world_from_cam (F, 4, 4) in a world with +z up, NaN = lost.
        camera: of the images.
        frame_index: (F,) rising numbers of the frames; None = those of `poses`, 0, 1, 2, … for
            matrices.
        progress: wraps the loop over frames, as tqdm does.
        settings: keys of ``[lift]`` and ``[viewpoint]`` of a pipeline file; the grid of viewpoints
            is by default that of `detect`'s table.

    Returns:
        The table `observations`: a row per detection in their order, with a status that says why
        where it has no place.

    Raises:
        ImodError: tables, images and poses do not fit each other, or an unknown setting.
    """
    config = settings_of(LiftSettings, settings, "lift", detections, brought=GRID)
    numbers, boxes, placed = boxes_and_poses(detections, poses, frame_index, depths)
    read = depth_reader(depths, numbers, camera)

    def depth(row: Any) -> DepthImage:
        image = read(int(row["depth_path"]))
        shape = (camera.height_px, camera.width_px)
        return np.full(shape, np.nan, dtype=np.float32) if image is None else image

    sequence_id = placed["sequence_id"][0].as_py()
    frames = frames_of(camera, numbers, sequence_id)
    result = lift_stage.run(frames, placed, boxes, depth, config, config, progress)
    grid = {name: getattr(config, name) for name in GRID}
    return told(result, "observations", **grid)


def fuse(
    detections: Table,
    observations: Table,
    camera: PinholeCamera,
    classes: Sequence[str] | None = None,
    **settings: Any,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Fuse the boxes that met in a voxel: one score per box, class and method.

    Args:
        detections: the table `detections`, or a box per row with a score in [0, 1] and class_id or
            class_name. One sequence or several.
        observations: what `lift` made of these detections; those of other boxes are of no matter.
        camera: of the images; tells the metric extent of objects.
        classes: K names by class id; None = those of `detect`'s table.
        settings: keys of ``[fuse]`` and ``[viewpoint]`` of a pipeline file; the grid of viewpoints
            is by default that of `observations`.

    Returns:
        The tables `fused` and `objects`.

    Raises:
        ImodError: a detection has no observation, scores fit neither classes nor viewpoints, or an
            unknown class or setting.
    """
    names = classes_of(classes, "fuse", detections)
    tables = (observations, detections)
    config = settings_of(FuseSettings, settings, "fuse", *tables, brought=GRID)
    boxes, seen = boxes_and_sightings(detections, observations, names, config.grid())
    results = []
    for sequence_id in pc.unique(boxes["sequence_id"]).to_pylist() or [SEQUENCE]:
        own, own_seen = (t.filter(pc.equal(t["sequence_id"], sequence_id)) for t in (boxes, seen))
        frames = frames_of(camera, np.unique(column(own, "frame_index")), sequence_id)
        results.append(fuse_stage.run(frames, own, own_seen, len(names), config, config))
    fused, objects = _joined(results, "fused"), _joined(results, "objects")
    silent = StageResult(objects.tables, "")  # both have the same summary
    return told(fused, "fused", classes=names), told(silent, "objects", classes=names)


def score(
    fused: Table,
    detections: Table,
    annotations: Table,
    classes: Sequence[str] | None = None,
    camera: PinholeCamera | None = None,
    frames: Table | None = None,
    **settings: Any,
) -> pd.DataFrame:
    """Hold fused boxes against the truth.

    Args:
        fused: of `fuse`, one sequence or several.
        detections: the boxes behind it, as `fuse` took them.
        annotations: a true box per row: frame_index, x0_px, y0_px, x1_px, y1_px and class_id or
            class_name; is_ignored and is_crowd if any are.
        classes: K names by class id; None = those that `fused` brings along.
        camera: of the images; without it precision and recall of the background, which is counted
            in pixels, stay unknown.
        frames: table with the frames looked at, such as `poses`; None = those with a box or an
            annotation. Only the background's figures depend on the others.
        settings: keys of ``[matching]`` and ``[metrics]`` of a pipeline file.

    Returns:
        The table `metrics`: AP, precision, recall and more per method and class.

    Raises:
        ImodError: tables do not fit each other, or an unknown class or setting.
    """
    names = classes_of(classes, "score", fused, detections)
    config = settings_of(ScoreSettings, settings, "score")
    tables = results_and_truth(fused, detections, annotations, frames, camera or NO_CAMERA, names)
    matched = []
    for sequence_id in pc.unique(tables.frames["sequence_id"]).to_pylist():
        fused_rows, boxes, true = (
            table.filter(pc.equal(table["sequence_id"], sequence_id))
            for table in (tables.fused, tables.detections, tables.annotations)
        )
        matched.append(match_stage.run(fused_rows, boxes, true, config))
    matches = _joined(matched, "matches").tables["matches"]
    result = metrics_stage.run(
        tables.frames,
        tables.annotations,
        tables.detections,
        matches,
        names,
        coco_ap,
        config,
        config,
    )
    return told(result, "metrics")


def _joined(results: Sequence[StageResult], name: str) -> StageResult:
    """One table of all sequences."""
    table = pa.concat_tables([result.tables[name] for result in results])
    return StageResult({name: table}, "; ".join(result.summary for result in results))
