"""Pictures of houses without targets, as backgrounds to compose training images on.

    FOLDER/rooms.json (how they are made, written first)  FOLDER/DONE (every file's size, last)
    FOLDER/background_00000.jpg …

A run that broke off goes on with the first house of which a picture is missing or damaged.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.lab.analytic.path import look_at
from imodbatch.lab.disk.folders import refuse_file
from imodbatch.lab.houses.dataset import DONE, VERSION
from imodbatch.lab.houses.drive import HIGHEST_M, LOWEST_M
from imodbatch.lab.houses.files import write_color
from imodbatch.lab.houses.planner import FreeSpace
from imodbatch.lab.houses.sensor import ColorCamera
from imodbatch.lab.houses.sequence import CAMERA, SETTINGS
from imodbatch.lab.houses.styles import check_split
from imodbatch.lab.houses.world import DRIVE_STREAM, SENSOR_STREAM, House, make_house
from imodbatch.lab.processes import results
from imodbatch.lab.progress import Progress, silent
from imodbatch.tables.atomic import write_text

N_PICTURES = 300
FRAMES_PER_HOUSE = 6
FIRST_HOUSE = 1000
"""Backgrounds' houses are numbered from here: none is a sequence's."""
ROOMS_FILE = "rooms.json"
Picture = NDArray[np.uint8]


def write_backgrounds(
    folder: Path,
    split: str = "train",
    n: int = N_PICTURES,
    seed: int = 0,
    progress: Progress = silent,
    n_processes: int = 1,
    camera: PinholeCamera = CAMERA,
) -> list[Path]:
    """Write colour images of houses of a split that hold no target, six of each house.

    The robot stands at random free places and looks at a table, a shelf or somewhere else. Pictures
    that lie there whole are kept.

    Args:
        folder: where to, made if needed; pictures of other settings that it holds are replaced.
        split: ``train``, ``val`` or ``test``.
        n: pictures.
        seed: decides everything that is random.
        progress: called with the number of pictures done and in all; first with those kept.
        n_processes: houses at a time.
        camera: of the robot.

    Returns:
        The pictures' files.

    Raises:
        DataError: no such split, or the folder holds such pictures of unknown origin.
    """
    check_split(split)
    settings = _settings(split, seed, camera)
    paths = [folder / _file_name(number) for number in range(n)]
    _claim(folder, settings)
    sizes = _sizes_when_done(folder)
    todo = [
        numbers
        for numbers in _by_house(n)
        if not all(_is_whole(paths[number], sizes) for number in numbers)
    ]
    n_done = n - sum(map(len, todo))
    progress(n_done, n)
    calls = [([paths[i] for i in numbers], split, seed, numbers, camera) for numbers in todo]
    for n_written in results(_write_house, calls, n_processes):
        n_done += n_written
        progress(n_done, n)
    for path in set(_pictures(folder)) - set(paths):
        path.unlink()
    found = {path.name: path.stat().st_size for path in paths}
    if found != sizes:
        write_text(folder / DONE, json.dumps(found, indent=1) + "\n")
    return paths


def backgrounds_digest(
    split: str = "train", n: int = N_PICTURES, seed: int = 0, camera: PinholeCamera = CAMERA
) -> str:
    """Names all that a set of pictures depends on."""
    text = json.dumps({**_settings(split, seed, camera), "n": n}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _settings(split: str, seed: int, camera: PinholeCamera) -> dict[str, Any]:
    return {"version": VERSION, "split": split, "seed": seed, "camera": asdict(camera)}


def _by_house(n: int) -> list[range]:
    """The pictures' numbers, house by house."""
    starts = range(0, n, FRAMES_PER_HOUSE)
    return [range(start, min(start + FRAMES_PER_HOUSE, n)) for start in starts]


def _house(split: str, seed: int, numbers: range) -> House:
    return make_house(split, FIRST_HOUSE + numbers.start // FRAMES_PER_HOUSE, seed, [])


def _write_house(
    paths: Sequence[Path], split: str, seed: int, numbers: range, camera: PinholeCamera
) -> int:
    """Write a house's pictures; one's noise goes on from the last one's, so they come together."""
    pictures = _of_house(_house(split, seed, numbers), len(numbers), camera)
    for path, color in zip(paths, pictures, strict=True):
        write_color(path, color)
    return len(paths)


def _claim(folder: Path, settings: dict[str, Any]) -> None:
    """Make the folder one for pictures of these settings, and remove those of others.

    Raises:
        DataError: it holds pictures and does not say that they are ours.
    """
    refuse_file(folder)
    folder.mkdir(parents=True, exist_ok=True)
    about, pictures = folder / ROOMS_FILE, _pictures(folder)
    if pictures and not about.exists():
        raise DataError(
            f"{folder}: holds {pictures[0].name} and no {ROOMS_FILE} to say how it was made. "
            "Name an empty or new folder."
        )
    if _read(about) == settings:
        return
    for path in (folder / DONE, *pictures):
        path.unlink(missing_ok=True)
    write_text(about, json.dumps(settings, indent=1) + "\n")


def _sizes_when_done(folder: Path) -> dict[str, int]:
    """File name → length when the set was complete; empty if it never was."""
    sizes = _read(folder / DONE)
    return sizes if isinstance(sizes, dict) else {}


def _is_whole(path: Path, sizes: dict[str, int]) -> bool:
    """Whether a picture is there in full length; files are written whole or not at all."""
    return path.is_file() and path.stat().st_size == sizes.get(path.name, path.stat().st_size)


def _read(path: Path) -> Any:
    """A JSON file's content, None if it is missing or damaged."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _file_name(number: int) -> str:
    return f"background_{number:05d}.jpg"


def _pictures(folder: Path) -> list[Path]:
    """All files of a folder that are named like ours, sorted."""
    named = re.compile(r"background_\d{5,}\.jpg")
    return sorted(path for path in folder.iterdir() if named.fullmatch(path.name))


def _of_house(house: House, n: int, camera: PinholeCamera) -> Iterator[Picture]:
    rng, space = house.random(DRIVE_STREAM), FreeSpace(house)
    photographer = ColorCamera(house.random(SENSOR_STREAM))
    renderer = house.renderer(SETTINGS)
    levels = [
        (placed, support)
        for placed in house.furniture
        for support in placed.piece.supports
        if support.height_m < 1.4
    ]
    for _ in range(n):
        placed, support = levels[int(rng.integers(len(levels)))]
        local = np.array([support.x_m, support.y_m, support.height_m])
        target = placed.world_from_piece[:3, :3] @ local + placed.world_from_piece[:3, 3]
        target = target + rng.normal(0, 0.25, 3) * [1, 1, 0.6]
        away = np.linalg.norm(space.points - target[:2], axis=1)
        wanted = rng.uniform(0.7, 3.0)
        near = space.points[np.argsort(np.abs(away - wanted))[:60]]
        place = near[int(rng.integers(len(near)))]
        eye = np.array([*place, rng.uniform(LOWEST_M, HIGHEST_M)])
        color = renderer.render(camera, look_at(eye, target)).color
        yield photographer.photograph(color, (float(rng.normal()), float(rng.normal(0, 0.5))))
