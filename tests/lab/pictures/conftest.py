"""Cutouts of three objects, rendered once, and a few backgrounds."""

import cv2
import numpy as np
import pytest

from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.objects import load_object
from imodbatch.lab.pictures import Recipe, ViewSettings, prepare_views

SETTINGS = ViewSettings(
    grid=ViewGrid(8, (0.3, 0.8)), n_variants=2, size_px=72, distance_m=(0.5, 3.0)
)
NAMES = ("kidney_beans_doll", "ball_pink", "square_bowl")


@pytest.fixture(scope="session")
def recipe(tmp_path_factory):
    folder = tmp_path_factory.mktemp("training")
    tables = prepare_views([load_object(name) for name in NAMES], folder / "cache", SETTINGS)
    rng = np.random.default_rng(0)
    backgrounds = []
    for i, shape in enumerate([(480, 640), (300, 300), (200, 500)]):
        coarse = rng.integers(60, 200, (6, 8, 3), dtype=np.uint8)
        picture = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
        backgrounds.append(folder / f"{i}.png")
        cv2.imwrite(str(backgrounds[-1]), picture)
    return Recipe(tuple(tables), tuple(backgrounds), SETTINGS.grid)
