"""Write a split's houses as a dataset, whole sequences or none.

    FOLDER/manifest.toml  manifest_true.toml  camera.json  DONE
    FOLDER/house_1/color/000000.jpg  depth/000000.png (16-bit mm, 0 = none)
    FOLDER/house_1/odometry.txt  trajectory_true.txt (TUM)  annotations.json (COCO)  objects.json

A sequence is made in a hidden folder that takes its name when complete, with a record ``DONE`` of
its own. So a run that broke off goes on with the next sequence, other settings or a lost file make
a sequence anew, and the dataset's ``DONE`` comes last.
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.lab.disk.folders import refuse_foreign
from imodbatch.lab.disk.record import Settings, is_whole, write_record
from imodbatch.lab.houses.drive import make_drive
from imodbatch.lab.houses.files import (
    ODOMETRY_FILE,
    TRUE_POSES_FILE,
    true_place,
    write_annotations,
    write_camera,
    write_images,
    write_trajectory,
)
from imodbatch.lab.houses.manifests import MANIFEST, MANIFEST_TRUE, manifest_texts
from imodbatch.lab.houses.odometry import odometry
from imodbatch.lab.houses.sequence import CAMERA, frames
from imodbatch.lab.houses.styles import check_split
from imodbatch.lab.houses.world import SENSOR_STREAM, House, make_house
from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.catalogue import OBJECTS, load_object
from imodbatch.lab.processes import results
from imodbatch.lab.progress import Progress, silent
from imodbatch.tables.atomic import replacing_folder, sweep, write_text

VERSION = 2
"""Raised when the same seed gives another dataset than before."""
DONE, CAMERA_FILE = "DONE", "camera.json"
FILES = (DONE, CAMERA_FILE, MANIFEST, MANIFEST_TRUE)
N_WORLDS, N_FRAMES = 4, 75
ODOMETRY_STREAM = SENSOR_STREAM + 2


def _advance(progress: Progress, n_before: int, total: int, n_here: int) -> None:
    """Progress within a sequence as progress of the whole."""
    progress(n_before + n_here, total)


def write_house_dataset(
    folder: Path,
    split: str = "test",
    seed: int = 0,
    n_worlds: int = N_WORLDS,
    n_frames: int = N_FRAMES,
    models: Sequence[ObjectModel] | None = None,
    progress: Progress = silent,
    n_processes: int = 1,
    camera: PinholeCamera = CAMERA,
) -> None:
    """Write a split; sequences that lie there complete are kept. Same arguments, same bytes.

    Args:
        folder: the dataset's root, made if needed.
        split: ``train``, ``val`` or ``test``.
        seed: decides everything that is random.
        n_worlds: sequences ``house_1``, ``house_2``, …, one per house.
        n_frames: per sequence.
        models: the targets, in the order of classes; None = the seventeen of the catalogue.
        progress: called with the number of frames done and in all.
        n_processes: sequences at a time. One process already uses all processors to render.
        camera: of the robot.

    Raises:
        DataError: no such split, or the folder holds files that are not ours.
    """
    check_split(split)
    if n_worlds < 1 or n_frames < 4:
        raise DataError("A dataset needs at least 1 world and 4 frames per world.")
    chosen = catalogue() if models is None else list(models)
    settings = {
        "version": VERSION,
        "split": split,
        "seed": seed,
        "n_frames": n_frames,
        "camera": asdict(camera),
        "models": [f"{model.name} {digest(model)}" for model in chosen],
    }
    folder = folder.resolve()
    refuse_foreign(folder, FILES, r"house_\d+|\..+\.partial", "a house dataset")
    folder.mkdir(parents=True, exist_ok=True)
    total = n_worlds * n_frames
    todo = [
        index
        for index in range(n_worlds)
        if not is_whole(folder / sequence_id(index) / DONE, {**settings, "index": index})
    ]
    whole = {**settings, "n_worlds": n_worlds}
    if not todo and is_whole(folder / DONE, whole):
        return
    (folder / DONE).unlink(missing_ok=True)
    _drop_others(folder, n_worlds)
    n_done = (n_worlds - len(todo)) * n_frames
    progress(n_done, total)
    if n_processes == 1 or len(todo) < 2:
        for index in todo:
            advance = partial(_advance, progress, n_done, total)
            _write_sequence(folder, index, settings, chosen, camera, advance)
            n_done += n_frames
    else:
        calls = [(folder, index, settings, chosen, camera) for index in todo]
        for _ in results(_write_sequence, calls, n_processes):
            n_done += n_frames
            progress(n_done, total)
    write_camera(folder / CAMERA_FILE, camera)
    sequence_ids = [sequence_id(index) for index in range(n_worlds)]
    classes = [model.name for model in chosen]
    texts = manifest_texts(folder.name, split, classes, camera, sequence_ids)
    for name, text in texts.items():
        write_text(folder / name, text)
    write_record(folder / DONE, whole)


def catalogue() -> list[ObjectModel]:
    """The seventeen objects."""
    return [load_object(name) for name in OBJECTS]


def sequence_id(index: int) -> str:
    """The name of the index-th house, from 0."""
    return f"house_{index + 1}"


def digest(model: ObjectModel) -> str:
    """Tells models apart by shape and texture."""
    parts = (model.mesh.vertices, model.mesh.faces, model.mesh.corner_uvs, model.mesh.texture)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()[:12]


def _write_sequence(
    root: Path,
    index: int,
    settings: Settings,
    models: Sequence[ObjectModel],
    camera: PinholeCamera,
    advance: Callable[[int], None] | None = None,
) -> None:
    """One house: everything of it, then its name."""
    house = make_house(settings["split"], index, settings["seed"], models)
    drive = make_drive(house, settings["n_frames"])
    with replacing_folder(root / sequence_id(index)) as unfinished:
        seen_by_frame = []
        for frame_index, frame in enumerate(frames(house, drive.world_from_cam, camera)):
            write_images(unfinished, frame_index, frame)
            seen_by_frame.append(frame.seen)
            if advance is not None:
                advance(frame_index + 1)
        measured = odometry(drive, house.random(ODOMETRY_STREAM))
        write_trajectory(unfinished / ODOMETRY_FILE, measured, "wheel odometry")
        write_trajectory(unfinished / TRUE_POSES_FILE, drive.world_from_cam, "true poses")
        classes = {model.name: model.symmetry for model in models}
        write_annotations(unfinished / "annotations.json", camera, classes, seen_by_frame)
        write_text(unfinished / "objects.json", _objects(house, drive.kind))
        write_record(unfinished / DONE, {**settings, "index": index})


def _objects(house: House, kind: str) -> str:
    """Where the targets truly stand."""
    objects = [
        {
            **true_place(target),
            "stands_on": house.furniture[target.place].piece.kind if target.place >= 0 else "floor",
        }
        for target in house.targets
    ]
    return json.dumps({"drive": kind, "objects": objects}, indent=1) + "\n"


def _drop_others(folder: Path, n_worlds: int) -> None:
    """Remove our sequences beyond the number wanted, and what an interrupted run left."""
    sweep(folder)
    wanted = {sequence_id(index) for index in range(n_worlds)}
    for path in folder.iterdir():
        if path.is_dir() and path.name not in wanted:
            shutil.rmtree(path)
