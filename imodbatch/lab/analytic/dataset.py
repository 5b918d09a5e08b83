"""Write the dataset whole or not at all.

Everything is made in a hidden folder beside the target, which takes the target's name when it is
complete. `DONE` is written last; it holds the settings and every file's size, so a run that broke
off, a lost file and other settings are all noticed, and the dataset is made again.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from imodbatch.core.errors import DataError
from imodbatch.lab.analytic.files import (
    detection_rows,
    write_annotations,
    write_detections,
    write_images,
    write_trajectory,
)
from imodbatch.lab.analytic.sequence import Walk, make_walk
from imodbatch.tables.atomic import replacing_folder, write_text

VERSION = 1
"""Raised when the same seed gives another dataset than before."""
DONE = "DONE"
DETECTIONS = "detections.parquet"
Progress = Callable[[int, int], None]


def _silent(_done: int, _total: int) -> None:
    """No progress bar."""


def write_dataset(
    folder: Path,
    seed: int = 0,
    n_sequences: int = 3,
    n_frames: int = 40,
    progress: Progress = _silent,
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
    if is_complete(folder, settings):
        return
    _check_is_ours(folder)
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
        done = {"settings": settings, "bytes": _sizes(unfinished)}
        write_text(unfinished / DONE, json.dumps(done, indent=1) + "\n")


def is_complete(folder: Path, settings: dict[str, int]) -> bool:
    """Whether the dataset of these settings lies there with every file in its full length."""
    try:
        done = json.loads((folder / DONE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return bool(done == {"settings": settings, "bytes": _sizes(folder)})


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


def _sizes(folder: Path) -> dict[str, int]:
    """Every file's length in bytes, by path within the folder; `DONE` itself is left out."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    sizes = {path.relative_to(folder).as_posix(): path.stat().st_size for path in files}
    return {name: size for name, size in sizes.items() if name != DONE}


def _check_is_ours(folder: Path) -> None:
    """Refuse to replace a folder that holds anything which this module does not write."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise DataError(f"{folder}: is a file, expected a folder. Name another --out.")
    foreign = sorted(
        path.name
        for path in folder.iterdir()
        if path.name not in (DONE, DETECTIONS) and not path.name.startswith("walk_")
    )
    if foreign:
        raise DataError(
            f"{folder}: holds {foreign[0]!r}, which is no part of an analytic dataset. "
            "Name an empty or new folder."
        )
