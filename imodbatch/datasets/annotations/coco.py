"""COCO instances: one JSON file; `bbox` is left, top, width, height in continuous pixels.

Two keys beyond COCO are read where they are: `azimuth_deg` of an annotation, the camera's azimuth
in the object's own frame, and `symmetry` of a category: "none", "full", or how often it looks the
same in a turn.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from imodbatch.datasets.annotations.entries import Entry
from imodbatch.datasets.base import FrameFile
from imodbatch.datasets.coco import (
    FrameNames,
    JsonId,
    category_names,
    coco_images,
    entries_of,
    id_of,
    missing_file,
    number_of,
    read_json,
    xywh_of,
)
from imodbatch.errors import DataError
from imodbatch.manifest import Manifest, SequenceSection

KEY = "annotations.path"


def files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The one file.

    Raises:
        DataError: it is missing.
    """
    path = manifest.path_in(sequence, manifest.annotations.path or "")
    if not path.is_file():
        raise missing_file(path, KEY)
    return [path]


def read_entries(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],
    width_px: int,
    height_px: int,
) -> Iterator[Entry]:
    """The entries of the file, those of other images without a frame.

    Raises:
        DataError: see `imodbatch.datasets.annotations.read_annotations`.
    """
    path = files(manifest, sequence)[0]
    document = read_json(path, KEY)
    names = FrameNames(manifest, sequence, frames, KEY, manifest.annotations.path or "")
    images = coco_images(document, path, names, width_px, height_px)
    categories = category_names(document, path)
    symmetries = _symmetries(document, path)
    for number, entry in enumerate(entries_of(document, "annotations", path)):
        where = f"{path}: annotations[{number}]"
        x, y, width, height = xywh_of(entry, where)
        instance = entry.get("instance_id", entry.get("instance"))
        yield Entry(
            where,
            _listed(images, entry, "image_id", "images", where).frame_index,
            _listed(categories, entry, "category_id", "categories", where),
            (x, y, x + width, y + height),
            is_ignored=_flag(entry, "ignore", where),
            is_crowd=_flag(entry, "iscrowd", where),
            instance_id=None if instance is None else str(instance),
            own_azimuth_rad=_azimuth_rad(entry, where),
            symmetry=symmetries[entry["category_id"]],
        )


def _listed(
    known: dict[JsonId, Any], entry: dict[str, Any], key: str, table: str, where: str
) -> Any:
    """What an id of an entry points to."""
    identifier = id_of(entry, key, where)
    if identifier not in known:
        raise DataError(f'{where}: {key} {identifier!r} is not in "{table}". Add it there.')
    return known[identifier]


def _flag(entry: dict[str, Any], key: str, where: str) -> bool:
    value = entry.get(key, 0)
    if value not in (0, 1, None):
        raise DataError(f'{where}: "{key}" is {value!r}. Expected 0 or 1.')
    return bool(value)


def _azimuth_rad(entry: dict[str, Any], where: str) -> float | None:
    """`azimuth_deg` of an entry in radians, [0, 2π); None = not given."""
    if entry.get("azimuth_deg") is None:
        return None
    azimuth_deg = number_of(entry, "azimuth_deg", where)
    if not math.isfinite(azimuth_deg):
        raise DataError(
            f'{where}: "azimuth_deg" is {azimuth_deg}. Expected degrees, or take it out.'
        )
    return math.radians(azimuth_deg % 360.0)


def _symmetries(document: Any, path: Path) -> dict[JsonId, str | None]:
    """Category id → its `symmetry`; None = not given."""
    found: dict[JsonId, str | None] = {}
    for number, entry in enumerate(entries_of(document, "categories", path)):
        value = entry.get("symmetry")
        is_count = isinstance(value, int) and not isinstance(value, bool) and value >= 1
        if not (value in (None, "none", "full") or is_count):
            raise DataError(
                f'{path}: categories[{number}]: "symmetry" is {value!r}. Expected "none", "full", '
                "or how often it looks the same in a turn."
            )
        found[entry["id"]] = None if value is None else str(value)
    return found
