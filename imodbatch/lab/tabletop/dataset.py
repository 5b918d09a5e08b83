"""Write walks about tables as a dataset, whole sequences or none.

What a sequence was made with, and every file's size, lies beside its truth and comes last: a run
that broke off goes on with the next sequence; other settings or a lost file make it anew.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.lab.houses.manifests import safe_name
from imodbatch.lab.houses.processes import results
from imodbatch.lab.houses.sequence import frames
from imodbatch.lab.houses.styles import STYLES
from imodbatch.lab.tabletop.files import SCENES, TRUTH, Place, write_boxes, write_frame, write_truth
from imodbatch.lab.tabletop.walk import SWEEP_DEG, make_walk
from imodbatch.lab.tabletop.world import CLASSES, class_symmetry, make_tabletop
from imodbatch.tables.atomic import sweep, write_text

VERSION = 1
"""Raised when the same seed gives another dataset than before."""
CAMERA = PinholeCamera(640, 480, 570.3, 570.3, 319.5, 239.5)
"""The UW dataset's Kinect; depth is registered to colour."""
SHUTTER = 0.2
"""A thirtieth of a second, as a Kinect takes in dim rooms, at six frames a second."""
NOISE = 2.0
"""Of a Kinect's colour, as a multiple of the robot's camera."""
UW_SEQUENCES: tuple[tuple[str, int, int], ...] = (
    ("desk", 1, 98),
    ("desk", 2, 190),
    ("desk", 3, 228),
    ("kitchen_small", 1, 180),
    ("meeting_small", 1, 180),
    ("table", 1, 125),
    ("table_small", 1, 199),
    ("table_small", 2, 234),
)
"""Kind, number and frames of the real dataset's sequences."""
MANIFEST, DONE = "manifest.toml", "done.json"
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class _Job:
    """One sequence: `index` decides its world; the real one has `n_usual` frames."""

    index: int
    place: Place
    n_frames: int
    n_usual: int

    @property
    def shutter(self) -> float:
        """As if the usual number of frames were taken and the others left out."""
        return SHUTTER * min(1.0, self.n_frames / self.n_usual)


def write_scenes(
    folder: Path,
    split: str = "test",
    seed: int = 0,
    n_worlds: int | None = None,
    n_frames: int | None = None,
    progress: Progress = lambda _done, _total: None,
    n_processes: int = 1,
    camera: PinholeCamera = CAMERA,
) -> None:
    """Write a split; sequences that lie there complete are kept.

    Args:
        folder: the dataset's root, made if needed.
        split: ``train``, ``val`` or ``test``; they share no object, furniture, surface or light.
        seed: decides everything that is random.
        n_worlds: sequences; None = eight, named as in the real dataset.
        n_frames: per sequence; None = as many as in the real dataset.
        progress: called with the number of frames done and in all.
        n_processes: sequences at a time.
        camera: that is carried.

    Raises:
        DataError: no such split, too few frames, or `folder` is a file.
    """
    if split not in STYLES:
        raise DataError(f"No split is called {split!r}; there are {', '.join(STYLES)}.")
    if (n_worlds is not None and n_worlds < 1) or (n_frames is not None and n_frames < 4):
        raise DataError("A dataset needs at least 1 world and 4 frames per world.")
    if folder.exists() and not folder.is_dir():
        raise DataError(f"{folder}: is a file, expected a folder. Name another.")
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    sweep(folder)
    jobs = _jobs(n_worlds, n_frames)
    common = {"version": VERSION, "split": split, "seed": seed, "camera": asdict(camera)}
    total = sum(job.n_frames for job in jobs)
    todo = [job for job in jobs if not _is_complete(folder, job, _settings(job, common))]
    n_done = total - sum(job.n_frames for job in todo)
    progress(n_done, total)
    calls = [(folder, job, common, camera) for job in todo]
    for n_frames_done in results(_write_sequence, calls, n_processes):
        n_done += n_frames_done
        progress(n_done, total)
    text = _manifest_text(folder.name, split, camera, jobs)
    write_text(folder / MANIFEST, text)


def _jobs(n_worlds: int | None, n_frames: int | None) -> list[_Job]:
    """The real dataset's sequences, or so many, taking the kinds of place in turn."""
    if n_worlds is None:
        named = list(UW_SEQUENCES)
    else:
        kinds = list(SWEEP_DEG)
        n_real = len(UW_SEQUENCES)
        named = [
            (kinds[k % len(kinds)], k // len(kinds) + 1, UW_SEQUENCES[k % n_real][2])
            for k in range(n_worlds)
        ]
    return [
        _Job(index, Place(kind, number), n_frames or n, n)
        for index, (kind, number, n) in enumerate(named)
    ]


def _write_sequence(root: Path, job: _Job, common: dict[str, Any], camera: PinholeCamera) -> int:
    """One sequence; its number of frames."""
    (root / TRUTH / job.place.path / DONE).unlink(missing_ok=True)
    house = make_tabletop(common["split"], job.index, common["seed"])
    walk = make_walk(house, job.place.kind, job.n_frames)
    seen_by_frame = []
    for frame_index, frame in enumerate(frames(house, walk, camera, job.shutter, NOISE)):
        write_frame(root, job.place, frame_index, frame)
        seen_by_frame.append(frame.seen)
    write_boxes(root / job.place.boxes_file, seen_by_frame)
    classes = {name: class_symmetry(name) for name in CLASSES}
    write_truth(root, job.place, house, camera, walk, seen_by_frame, classes)
    done = {"settings": _settings(job, common), "bytes": _sizes(root, job)}
    text = json.dumps(done, indent=1) + "\n"
    write_text(root / TRUTH / job.place.path / DONE, text)
    return job.n_frames


def _settings(job: _Job, common: dict[str, Any]) -> dict[str, Any]:
    return {**common, "index": job.index, "n_frames": job.n_frames}


def _is_complete(root: Path, job: _Job, settings: dict[str, Any]) -> bool:
    """Whether what was made with these settings lies there with every file in its full length."""
    try:
        done = json.loads((root / TRUTH / job.place.path / DONE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return bool(done == {"settings": settings, "bytes": _sizes(root, job)})


def _sizes(root: Path, job: _Job) -> dict[str, int]:
    """Every file's length in bytes, by path below the root."""
    truth = root / TRUTH / job.place.path
    numbered = [
        name(k)
        for k in range(job.n_frames)
        for name in (job.place.color_file, job.place.depth_file)
    ]
    paths = [root / name for name in (*numbered, job.place.boxes_file)]
    paths += [path for path in sorted(truth.glob("*")) if path.name != DONE]
    return {p.relative_to(root).as_posix(): p.stat().st_size for p in paths if p.is_file()}


_TEXT = """\
# Written by `imodbatch simulate --layout rgbd_scenes_v1` with the data; to change it, copy it
# elsewhere and set root. The layout holds no poses: the pipeline estimates them.
name = "{name}"
description = \"\"\"Simulated tables and desks, {split} split: a hand-held RGB-D camera; bowls, \\
caps, cereal boxes, coffee mugs and soda cans among other things.\"\"\"
adapter = "rgbd_scenes_v1"
root = "{scenes}"
classes = [{classes}]

[camera]
color = {{ {camera} }}

[world]
up = "estimate"

[reference]                      # judges the poses, and is used for nothing else
format = "uw"
path = "../{truth}/{{sequence}}/poses.pose"
up = "+z"

[annotations]
format = "uw_mat"
path = "{{sequence}}.mat"
"""
_SEQUENCE = """
[[sequences]]
id = "{sequence_id}"
path = "{path}"
n_frames = {n_frames}
"""


def _manifest_text(folder_name: str, split: str, camera: PinholeCamera, jobs: list[_Job]) -> str:
    """The manifest that lies beside the data."""
    head = _TEXT.format(
        name=safe_name(folder_name),
        split=split,
        scenes=SCENES,
        truth=TRUTH,
        classes=", ".join(f'"{name}"' for name in CLASSES),
        camera=", ".join(f"{field} = {value}" for field, value in asdict(camera).items()),
    )
    return head + "".join(
        _SEQUENCE.format(
            n_frames=job.n_frames, sequence_id=job.place.sequence_id, path=job.place.path
        )
        for job in jobs
    )
