"""Write the dataset whole or not at all.

Everything is made in a hidden folder beside the target, which takes the target's name when it is
complete. Its record `DONE` is written last.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from imodbatch.lab.analytic.files import (
    detection_rows,
    write_annotations,
    write_detections,
    write_images,
    write_trajectory,
)
from imodbatch.lab.analytic.sequence import Walk, make_walk
from imodbatch.lab.disk.folders import refuse_foreign
from imodbatch.lab.disk.record import is_whole, write_record
from imodbatch.lab.progress import Progress, silent
from imodbatch.tables.atomic import replacing_folder

VERSION = 1
"""Raised when the same seed gives another dataset than before."""
DONE = "DONE"
DETECTIONS = "detections.parquet"


def write_dataset(
    folder: Path,
    seed: int = 0,
    n_sequences: int = 3,
    n_frames: int = 40,
    progress: Progress = silent,
) -> None:
    """Write the analytic dataset; nothing is done when it already lies there complete.

    The same arguments give the same bytes. `manifests/analytic.toml` describes the result to the
    ``folder`` adapter for the default three sequences.

    Args:
        folder: the dataset's root, made if needed; an older analytic dataset there is replaced.
        seed: decides everything that is random.
        n_sequences: ``walk_1``, ``walk_2``, …: circles and approaches in turn.
        n_frames: per sequence.
        progress: called after every frame with the number done and the number in all.

    Raises:
        DataError: the folder holds files that are not ours.
    """
    settings = {"version": VERSION, "seed": seed, "n_sequences": n_sequences, "n_frames": n_frames}
    folder = folder.resolve()
    if is_whole(folder / DONE, settings):
        return
    refuse_foreign(folder, (DONE, DETECTIONS), "walk_.*", "an analytic dataset")
    with replacing_folder(folder) as unfinished:
        rows: list[dict[str, Any]] = []
        for index in range(n_sequences):
            walk = make_walk(seed, index, n_frames)
            rows += _write_walk(
                unfinished,
                walk,
                lambda done: progress(done, n_sequences * n_frames),
                index * n_frames,
            )
        write_detections(unfinished / DETECTIONS, rows)
        write_record(unfinished / DONE, settings)


def _write_walk(
    root: Path, walk: Walk, progress: Callable[[int], None], n_done: int
) -> list[dict[str, Any]]:
    """Write a sequence's own files; returns its rows of the detections' table."""
    rows, seen_by_frame = [], []
    for frame_index, frame in enumerate(walk.frames()):
        write_images(root / walk.sequence_id, frame_index, frame)
        rows += detection_rows(walk.sequence_id, frame_index, frame.detections)
        seen_by_frame.append(frame.seen)
        progress(n_done + frame_index + 1)
    write_trajectory(root / walk.sequence_id / "trajectory.txt", walk.world_from_cam)
    write_annotations(root / walk.sequence_id / "annotations.json", seen_by_frame)
    return rows
