"""Write walks about tables as a dataset, whole sequences or none.

A sequence's record lies beside its truth and comes last: a run that broke off goes on with the next
sequence; other settings or a lost file make it anew.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.lab.disk.folders import refuse_file
from imodbatch.lab.disk.record import Settings, Sizes, is_whole, write_record
from imodbatch.lab.houses.sequence import frames
from imodbatch.lab.houses.styles import check_split
from imodbatch.lab.processes import results
from imodbatch.lab.progress import Progress, silent
from imodbatch.lab.tabletop.files import TRUTH, Place, write_boxes, write_frame, write_truth
from imodbatch.lab.tabletop.manifest import manifest_text
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
    progress: Progress = silent,
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
    check_split(split)
    if (n_worlds is not None and n_worlds < 1) or (n_frames is not None and n_frames < 4):
        raise DataError("A dataset needs at least 1 world and 4 frames per world.")
    refuse_file(folder)
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    sweep(folder)
    jobs = _jobs(n_worlds, n_frames)
    common = {"version": VERSION, "split": split, "seed": seed, "camera": asdict(camera)}
    total = sum(job.n_frames for job in jobs)
    todo = [job for job in jobs if not _is_whole(folder, job, common)]
    n_done = total - sum(job.n_frames for job in todo)
    progress(n_done, total)
    calls = [(folder, job, common, camera) for job in todo]
    for n_frames_done in results(_write_sequence, calls, n_processes):
        n_done += n_frames_done
        progress(n_done, total)
    lengths = {job.place: job.n_frames for job in jobs}
    write_text(folder / MANIFEST, manifest_text(folder.name, split, camera, lengths))


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


def _write_sequence(root: Path, job: _Job, common: Settings, camera: PinholeCamera) -> int:
    """One sequence; its number of frames."""
    _record(root, job).unlink(missing_ok=True)
    house = make_tabletop(common["split"], job.index, common["seed"])
    walk = make_walk(house, job.place.kind, job.n_frames)
    seen_by_frame = []
    for frame_index, frame in enumerate(frames(house, walk, camera, job.shutter, NOISE)):
        write_frame(root, job.place, frame_index, frame)
        seen_by_frame.append(frame.seen)
    write_boxes(root / job.place.boxes_file, seen_by_frame)
    classes = {name: class_symmetry(name) for name in CLASSES}
    write_truth(root, job.place, house, camera, walk, seen_by_frame, classes)
    write_record(_record(root, job), _settings(job, common), _sizes(root, job))
    return job.n_frames


def _record(root: Path, job: _Job) -> Path:
    return root / TRUTH / job.place.path / DONE


def _is_whole(root: Path, job: _Job, common: Settings) -> bool:
    return is_whole(_record(root, job), _settings(job, common), _sizes(root, job))


def _settings(job: _Job, common: Settings) -> Settings:
    return {**common, "index": job.index, "n_frames": job.n_frames}


def _sizes(root: Path, job: _Job) -> Sizes:
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
