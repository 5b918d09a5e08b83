"""An object seen from many viewpoints: RGBA pictures, their angles, and one file pair to keep them.

The pictures lie as PNGs back to back in ``<stem>.bin``, which is mapped into memory, so that many
processes share it; angles and places are in ``<stem>.json``, which is written last: where it
exists, the pair is whole.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.symmetry import Symmetry
from imodbatch.lab.masks import bounds_of
from imodbatch.tables.atomic import replacing, write_text

Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Cutout:
    """One picture of an object and from where it was taken.

    Attributes:
        rgba: (h, w, 4) uint8, cropped to the pixels that show the object; colours not multiplied
            by alpha.
        azimuth_rad: of the camera about the object's +z, from its front.
        elevation_rad: of the camera above the object's horizon.
    """

    rgba: Pixels
    azimuth_rad: float
    elevation_rad: float


@dataclass(frozen=True, eq=False)
class Cutouts:
    """All pictures of one object (instance) of a class.

    Attributes:
        class_name: what the detector is to call it.
        instance: which of the class's objects it is.
        symmetry: ``full`` | n (looks the same after 1/n of a turn) | ``none``.
        azimuth_rad: (V,) of the camera.
        elevation_rad: (V,).
        png_ends: (V,) where each PNG ends in `pngs`.
        pngs: (bytes,) all PNGs, back to back, mapped from the file.
        table: the JSON file; another process that is sent this opens it by itself.
    """

    class_name: str
    instance: str
    symmetry: Symmetry
    azimuth_rad: NDArray[np.float64]
    elevation_rad: NDArray[np.float64]
    png_ends: NDArray[np.int64]
    pngs: Pixels
    table: Path

    def __reduce__(self) -> tuple[Callable[[Path], "Cutouts"], tuple[Path]]:
        return load_cutouts, (self.table,)

    def __len__(self) -> int:
        return len(self.azimuth_rad)

    def rgba(self, index: int) -> Pixels:
        """Picture (h, w, 4) of one viewpoint."""
        start = int(self.png_ends[index - 1]) if index else 0
        png = np.asarray(self.pngs[start : int(self.png_ends[index])])
        return cv2.cvtColor(cv2.imdecode(png, cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA)


def crop_to_object(rgba: Pixels) -> Pixels | None:
    """The smallest part that holds all pixels with alpha > 0; None if there is none."""
    bounds = bounds_of(rgba[..., 3] > 0)
    if bounds is None:
        return None
    left, top, right, bottom = bounds
    return rgba[top:bottom, left:right]


def resize_cutout(rgba: Pixels, longer_side_px: float) -> Pixels:
    """A cutout at another size; colours of transparent pixels do not bleed into the rest."""
    h, w = rgba.shape[:2]
    factor = longer_side_px / max(h, w)
    size = (max(1, round(w * factor)), max(1, round(h * factor)))
    how = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    resized = cv2.resize(cv2.multiply(rgba, _weights(rgba), scale=1 / 255), size, interpolation=how)
    return cv2.divide(resized, _weights(resized), scale=255)


def _weights(rgba: Pixels) -> Pixels:
    """Alpha for the colours, 255 for alpha itself."""
    alpha = rgba[..., 3]
    return cv2.merge([alpha, alpha, alpha, np.full_like(alpha, 255)])


def write_cutouts(
    stem: Path, class_name: str, instance: str, symmetry: Symmetry, cutouts: Iterable[Cutout]
) -> Path:
    """Write a pair of files, whole or not at all.

    Returns:
        The JSON's path, which `load_cutouts` takes.
    """
    stem.parent.mkdir(parents=True, exist_ok=True)
    binary, table = _files(stem)
    ends: list[int] = []
    azimuths: list[float] = []
    elevations: list[float] = []
    with replacing(binary) as file:
        for cutout in cutouts:
            bgra = cv2.cvtColor(cutout.rgba, cv2.COLOR_RGBA2BGRA)
            png = cv2.imencode(".png", bgra, [cv2.IMWRITE_PNG_COMPRESSION, 4])[1]
            file.write(png.tobytes())
            ends.append(file.tell())
            azimuths.append(cutout.azimuth_rad)
            elevations.append(cutout.elevation_rad)
    content = {
        "class_name": class_name,
        "instance": instance,
        "symmetry": symmetry,
        "azimuth_rad": azimuths,
        "elevation_rad": elevations,
        "png_ends": ends,
    }
    write_text(table, json.dumps(content) + "\n")
    return table


def load_cutouts(table: Path) -> Cutouts:
    """Read a pair of files by the path of its JSON.

    Raises:
        DataError: one is missing or they do not belong together.
    """
    try:
        content = json.loads(table.read_text(encoding="utf-8"))
        pngs = np.memmap(table.with_suffix(".bin"), np.uint8, mode="r")
        loaded = Cutouts(
            content["class_name"],
            content["instance"],
            content["symmetry"],
            np.array(content["azimuth_rad"], np.float64),
            np.array(content["elevation_rad"], np.float64),
            np.array(content["png_ends"], np.int64),
            pngs,
            table,
        )
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"{table}: damaged cutouts ({error}). Delete the file; run again."
        ) from None
    if not len(loaded) or loaded.png_ends[-1] != len(pngs):
        raise DataError(f"{table}: does not fit its .bin file. Delete both and run again.")
    return loaded


def _files(stem: Path) -> tuple[Path, Path]:
    # Not with_suffix: names may hold dots.
    return stem.with_name(f"{stem.name}.bin"), stem.with_name(f"{stem.name}.json")
