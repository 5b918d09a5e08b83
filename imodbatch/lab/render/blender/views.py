"""An object and its views → pictures, all in one start of Blender."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.render.blender.program import run_blender
from imodbatch.lab.render.blender.request import read_light, write_request
from imodbatch.lab.render.raycast.interface import Floats, Mesh, View
from imodbatch.lab.render.raycast.tone import expose

VERSION = 1
"""Raise it when the same views give other pictures."""
LEAST_COVERAGE = np.float32(1 / 255)


def render_views(mesh: Mesh, views: Sequence[View]) -> Iterator[NDArray[np.uint8]]:
    """One picture per view, (size, size, 4) uint8 RGBA, transparent around the object.

    Raises:
        ConfigError: Blender is not there, or failed.
    """
    with TemporaryDirectory(prefix="imodbatch-blender-") as name:
        folder = Path(name)
        run_blender(write_request(folder, mesh, views))
        for index, view in enumerate(views):
            yield picture_of(read_light(folder, index), view.settings.exposure)


def picture_of(light: Floats, exposure: float | None) -> NDArray[np.uint8]:
    """What a camera shows (H, W, 4) uint8 RGBA of light (H, W, 4).

    Args:
        light: linear RGB, weighted with the coverage, and the coverage.
        exposure: factor on the light.
    """
    coverage = np.clip(light[..., 3], 0, 1)
    whole = np.maximum(light[..., :3], 0) / np.maximum(coverage, LEAST_COVERAGE)[..., None]
    picture = np.empty(light.shape, np.uint8)
    picture[..., :3] = expose(whole, exposure)
    picture[..., 3] = np.rint(255 * coverage)
    picture[picture[..., 3] == 0] = 0
    return picture
