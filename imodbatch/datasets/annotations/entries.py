"""What every annotation format comes down to, and how it becomes rows."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imodbatch.core.boxes import clip
from imodbatch.core.errors import DataError
from imodbatch.datasets.base import Footage, Reading
from imodbatch.datasets.names import NO_AREA, OTHER_FRAMES, OUTSIDE_IMAGE, ClassNames, existing_file
from imodbatch.settings.manifest import Manifest, SequenceSection

KEY = "annotations.path"
UNKNOWN_CLASS = "unknown class"
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Entry:
    """One annotated box as a file has it.

    Attributes:
        where: file and entry, for errors.
        frame_index: its frame, None = an image outside the slice.
        class_name: as the file says.
        box: x0 y0 x1 y1 in continuous pixels, not yet cut at the image's border.
        is_ignored: counts neither as found nor as missed.
        is_crowd: one box around several objects; is ignored too.
        instance_id: the physical object, None = unknown.
        own_azimuth_rad: azimuth of the camera in the object's own frame, None = unknown.
        symmetry: of the class: ``none``, ``full`` or a number of turns; None = unknown.
        left_out: why the reader itself makes no row of it, "" = it does; `box` has no meaning then.
    """

    where: str
    frame_index: int | None
    class_name: str
    box: Box
    is_ignored: bool = False
    is_crowd: bool = False
    instance_id: str | None = None
    own_azimuth_rad: float | None = None
    symmetry: str | None = None
    left_out: str = ""


def annotation_file(manifest: Manifest, sequence: SequenceSection) -> Path:
    """The one file of a format that has one.

    Raises:
        ConfigError: the path cannot be meant.
        DataError: it is missing.
    """
    return existing_file(manifest.path_in(sequence, manifest.annotations.path or ""), KEY)


def to_reading(footage: Footage, entries: Iterable[Entry]) -> Reading:
    """Rename, cut, count and number the entries.

    Raises:
        ConfigError: a rename to an unknown class.
        DataError: a coordinate is not finite, or what `[annotations]` makes an error.
    """
    manifest = footage.manifest
    classes = ClassNames(manifest, manifest.annotations.rename, "annotations.rename")
    rows: dict[int, list[dict[str, Any]]] = defaultdict(list)
    left_out: Counter[str] = Counter()
    for entry in entries:
        if entry.frame_index is None:
            left_out[OTHER_FRAMES] += 1
            continue
        class_id = classes.find(entry.class_name)
        if class_id is None:
            _refuse_class(manifest, entry, classes)
            left_out[UNKNOWN_CLASS] += 1
            continue
        if entry.left_out:
            left_out[entry.left_out] += 1
            continue
        box, fault = _cut(entry, *footage.size_px)
        if fault:
            _refuse_box(manifest, entry, fault)
            left_out[fault] += 1
            continue
        rows[entry.frame_index].append(
            {
                "frame_index": entry.frame_index,
                "annotation_index": len(rows[entry.frame_index]),
                "class_id": class_id,
                **dict(zip(("x0_px", "y0_px", "x1_px", "y1_px"), box, strict=True)),
                "is_ignored": entry.is_ignored or entry.is_crowd,
                "is_crowd": entry.is_crowd,
                "instance_id": entry.instance_id,
                "own_azimuth_rad": entry.own_azimuth_rad,
                "symmetry": entry.symmetry,
            }
        )
    return Reading([row for index in sorted(rows) for row in rows[index]], left_out)


def _cut(entry: Entry, width_px: int, height_px: int) -> tuple[list[float], str]:
    """The box inside the image, and the reason if nothing is left of it."""
    if not all(map(math.isfinite, entry.box)):
        raise DataError(
            f"{entry.where}: the box {list(entry.box)} is not finite. Correct it or take it out."
        )
    if _is_flat(entry.box):
        return [], NO_AREA
    box = clip(np.array([entry.box]), width_px, height_px)[0].tolist()
    return box, OUTSIDE_IMAGE if _is_flat(box) else ""


def _is_flat(box: Iterable[float]) -> bool:
    x0, y0, x1, y1 = box
    return x1 <= x0 or y1 <= y0


def _refuse_class(manifest: Manifest, entry: Entry, classes: ClassNames) -> None:
    if manifest.annotations.unknown_classes == "error":
        raise DataError(
            f"{entry.where}: {entry.class_name!r} is not a class of manifest {manifest.name}."
            f"{classes.hint(entry.class_name)} Use annotations.rename, or leave such classes out "
            'with annotations.unknown_classes = "skip".'
        )


def _refuse_box(manifest: Manifest, entry: Entry, fault: str) -> None:
    if manifest.annotations.outside == "error":
        box = [round(value, 3) for value in entry.box]
        raise DataError(
            f"{entry.where}: the box {box} (x0 y0 x1 y1 in px): {fault}. Correct it, or leave "
            'such boxes out with annotations.outside = "clip".'
        )
