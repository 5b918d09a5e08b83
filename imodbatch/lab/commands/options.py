"""What stands on the command line of `imodbatch synth` → what it means."""

from collections.abc import Collection
from itertools import pairwise

import numpy as np

from imodbatch.core.errors import ConfigError
from imodbatch.core.symmetry import Symmetry, parse_symmetry
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.pictures.settings import ComposeSettings


def grid_of(n_azimuths: int, elevations_deg: str) -> ViewGrid:
    """A grid from what stands on the command line.

    Raises:
        ConfigError: the elevations are not numbers from −90 to 90 in ascending order.
    """
    try:
        degrees = [float(part) for part in elevations_deg.split(",")]
    except ValueError:
        degrees = []
    ascending = all(a < b for a, b in pairwise(degrees))
    if not degrees or not ascending or not all(-90 <= e <= 90 for e in degrees):
        raise ConfigError(
            f"--elevations {elevations_deg}: expected ascending degrees such as 10,30,50."
        )
    return ViewGrid(n_azimuths, tuple(float(np.deg2rad(e)) for e in degrees))


def compose_settings(size: str, scale: str, per_picture: str) -> ComposeSettings:
    """What pictures are like, from what stands on the command line.

    Raises:
        ConfigError: a text is not two numbers, or they cannot be meant.
    """
    width, height = _pair("--size", size, "480,360")
    low, high = _pair("--scale", scale, "0.1,1.0")
    fewest, most = _pair("--per-picture", per_picture, "1,5")
    return ComposeSettings(
        width_px=int(width),
        height_px=int(height),
        scale_range=(low, high),
        min_objects=int(fewest),
        max_objects=int(most),
    )


def _pair(option: str, text: str, example: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"{option} {text}: expected two numbers such as {example}.") from None
    return first, second


def parse_symmetries(texts: Collection[str]) -> dict[str, Symmetry]:
    """``NAME=full`` or ``NAME=4`` or ``NAME=none`` → how symmetric classes are.

    Raises:
        ConfigError: a text has another form.
    """
    result: dict[str, Symmetry] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            if not name:
                raise ValueError(text)
            result[name] = parse_symmetry(value)
        except ValueError:
            raise ConfigError(
                f"--symmetry {text}: expected NAME=full, NAME=none or NAME=4."
            ) from None
    return result
