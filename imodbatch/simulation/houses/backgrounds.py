"""Pictures of houses without targets, as backgrounds to compose training images on."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.simulation.analytic.path import look_at
from imodbatch.simulation.houses.drive import HIGHEST_M, LOWEST_M
from imodbatch.simulation.houses.files import write_color
from imodbatch.simulation.houses.planner import FreeSpace
from imodbatch.simulation.houses.sensor import ColorCamera
from imodbatch.simulation.houses.sequence import CAMERA, SETTINGS
from imodbatch.simulation.houses.world import DRIVE_STREAM, SENSOR_STREAM, House, make_house

FRAMES_PER_HOUSE = 6
FIRST_HOUSE = 1000
"""Backgrounds' houses are numbered from here: none is a sequence's."""
Picture = NDArray[np.uint8]


def background_frames(
    split: str = "train", n: int = 100, seed: int = 0, camera: PinholeCamera = CAMERA
) -> Iterator[Picture]:
    """Colour images (H, W, 3) of houses of a split that hold no target, six of each house.

    The robot stands at random free places and looks at a table, a shelf or somewhere else.
    """
    for number in range(0, n, FRAMES_PER_HOUSE):
        house = make_house(split, FIRST_HOUSE + number // FRAMES_PER_HOUSE, seed, [])
        yield from _of_house(house, min(FRAMES_PER_HOUSE, n - number), camera)


def write_backgrounds(
    folder: Path,
    split: str = "train",
    n: int = 100,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> list[Path]:
    """Write `background_frames` as ``background_00000.jpg``, …; returns the files."""
    paths = []
    for number, color in enumerate(background_frames(split, n, seed)):
        paths.append(folder / f"background_{number:05d}.jpg")
        write_color(paths[-1], color)
        progress(number + 1, n)
    return paths


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
