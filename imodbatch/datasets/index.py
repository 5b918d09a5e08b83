"""index: dataset folder → frames, annotations.

Only file headers are read here, so that wrong sizes and 8-bit depth show at once and not hours
later.
"""

from collections import Counter
from pathlib import Path

from imodbatch.core.errors import DataError
from imodbatch.datasets.annotations import read_annotations
from imodbatch.datasets.base import CameraModel, FrameFile
from imodbatch.datasets.images import (
    UnreadableImageError,
    check_color_mode,
    check_depth_mode,
    probe,
)
from imodbatch.datasets.registry import annotated, camera_model, layout_of, miscount
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.tables.columns import Progress, StageResult, tally
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import ANNOTATIONS, FRAMES


def run(
    manifest: Manifest, sequence: SequenceSection, progress: Progress[FrameFile] = iter
) -> StageResult:
    """List the frames of a sequence and read its annotations.

    Raises:
        DataError: no frame, or an image of another size or kind than the manifest says.
    """
    files = _frame_files(manifest, sequence)
    model = camera_model(manifest, sequence)
    counted = miscount(manifest, sequence)
    warnings = [f"{sequence.id}: {counted[1]}"] if counted else []
    warnings += [w for file in progress(files) for w in _check(manifest.root_path, file, model)]
    reading = read_annotations(
        annotated(manifest, sequence), sequence, files, model.color.width_px, model.color.height_px
    )
    frames = from_rows(FRAMES, [_frame_row(sequence.id, file, model) for file in files])
    annotations = from_rows(
        ANNOTATIONS, [{"sequence_id": sequence.id, **row} for row in reading.rows]
    )
    with_depth = sum(file.depth_path is not None for file in files)
    ignored = sum(row["is_ignored"] for row in reading.rows)
    entries = Counter({"counted": len(reading.rows) - ignored, "ignored": ignored})
    entries.update({f"left out ({why})": n for why, n in reading.left_out.items()})
    summary = "; ".join(
        [
            tally(
                len(files),
                "frames",
                {"with depth": with_depth, "without": len(files) - with_depth},
            ),
            tally(sum(entries.values()), "annotations", entries),
        ]
    )
    return StageResult({"frames": frames, "annotations": annotations}, summary, warnings)


def image_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """Every image of a sequence, for provenance.

    Raises:
        DataError: there is none.
    """
    files = _frame_files(manifest, sequence)
    paths = [path for file in files for path in (file.color_path, file.depth_path) if path]
    return [manifest.root_path / path for path in paths]


def _frame_files(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    files = layout_of(manifest).frames(manifest, sequence)
    if not files:
        raise DataError(_why_empty(manifest, sequence))
    return files


def _check(root: Path, file: FrameFile, model: CameraModel) -> list[str]:
    """Hold the headers of a frame's images against the cameras; damaged files only warn."""
    warnings = []
    for path, camera, section in (
        (file.color_path, model.color, "camera.color"),
        (file.depth_path, model.depth, "camera.depth"),
    ):
        if path is None:
            continue
        try:
            width, height, mode = probe(root / path)
        except UnreadableImageError as error:
            warnings.append(str(error))
            continue
        if (width, height) != (camera.width_px, camera.height_px):
            raise DataError(
                f"{root / path}: image is {width}×{height}, expected {camera.width_px}×"
                f"{camera.height_px}. Correct {section} in the manifest, or the file."
            )
        check = check_color_mode if path == file.color_path else check_depth_mode
        check(root / path, mode)
    return warnings


def _frame_row(sequence_id: str, file: FrameFile, model: CameraModel) -> dict[str, object]:
    row: dict[str, object] = {
        "sequence_id": sequence_id,
        "frame_index": file.frame_index,
        "timestamp_ns": file.timestamp_ns,
        "color_path": file.color_path,
        "depth_path": file.depth_path,
        "depth_scale_m": model.depth_scale_m,
    }
    for prefix, camera in (("", model.color), ("depth_", model.depth)):
        row |= {f"{prefix}{name}": value for name, value in vars(camera).items()}
    if model.color_from_depth is not None:
        row["color_from_depth"] = model.color_from_depth.ravel().tolist()
    return row


def _why_empty(manifest: Manifest, sequence: SequenceSection) -> str:
    folder = manifest.root_path / sequence.path
    if not folder.is_dir():
        return (
            f"{folder}: no such folder (sequence {sequence.id!r}). Correct root or sequences.path."
        )
    if sequence.frames is not None:
        return (
            f"{folder}: no frame of sequence {sequence.id!r} lies in the slice "
            f"{sequence.frames!r}. Widen sequences.frames, or check the adapter's file names."
        )
    return (
        f"{folder}: empty sequence {sequence.id!r}: no colour image fits the adapter "
        f"{manifest.adapter!r}. Check sequences.path and images.color."
    )
