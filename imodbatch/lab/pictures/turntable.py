"""UW RGB-D Object turntable pictures → cutouts.

``<category>/<category>_<i>/<category>_<i>_<sequence>_<frame>_crop.png`` with ``_maskcrop.png``
(object > 0) and ``_pose.txt`` (azimuth in degrees, missing for some frames). Sequences 1, 2 and 4
were taken from 30°, 45° and 60° above the horizon.

Where there is no crop, the whole picture ``<stem>.png`` is taken, with ``_mask.png``, or with
``_maskcrop.png`` put where ``_loc.txt`` says ("x,y" of its top left pixel, counted from 1). Depth
is not read: a cutout needs none.
"""

import hashlib
import json
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from imodbatch.core.errors import DataError
from imodbatch.core.symmetry import Symmetry
from imodbatch.core.viewpoint import FULL_TURN_RAD
from imodbatch.datasets.images import is_listed
from imodbatch.lab.pictures.cutouts import (
    Cutout,
    Pixels,
    crop_to_object,
    load_cutouts,
    write_cutouts,
)
from imodbatch.tables.atomic import write_text

ELEVATION_DEG = {1: 30.0, 2: 45.0, 4: 60.0}
"""Of the camera, by the number of the sequence."""
VERSION = 2
PICTURE = re.compile(r"(?P<stem>.+_(?P<sequence>\d+)_(?P<frame>\d+))(_crop)?\.png")
USED, NO_POSE, NO_MASK, BAD, OTHER = (
    "used", "without pose", "without mask", "unreadable or empty", "of another sequence",
)  # fmt: skip


@dataclass
class TurntableCounts:
    """What became of the pictures, one per frame; they add up."""

    by_outcome: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys((USED, NO_POSE, NO_MASK, BAD, OTHER), 0)
    )

    def add(self, outcome: str, n: int = 1) -> None:
        """Count one or more pictures."""
        self.by_outcome[outcome] += n

    def __str__(self) -> str:
        parts = [f"{n:,} {name}" for name, n in self.by_outcome.items() if n or name == USED]
        return f"{sum(self.by_outcome.values()):,} pictures = " + " + ".join(parts)


def read_turntable(
    folder: Path,
    cache: Path,
    *,
    categories: Collection[str] | None = None,
    instances: Collection[str] | None = None,
    without: Collection[str] = (),
    symmetries: Mapping[str, Symmetry] | None = None,
    azimuth_sign: int = 1,
) -> tuple[list[Path], TurntableCounts]:
    """Make cutouts of turntable pictures, one pair of files per instance.

    Args:
        folder: ``rgbd-dataset``, which holds a folder per category.
        cache: where cutouts go; what is there already is not made again.
        categories: only these; None = all.
        instances: only these (``bowl_1``); None = all. For training and test sets that share no
            object, name some here and the same ones as `without` there.
        without: not these instances.
        symmetries: by category; ``none`` where not said.
        azimuth_sign: −1 if the dataset's angles grow clockwise seen from above.

    Returns:
        Per instance the path that `load_cutouts` takes, sorted by category and number; and counts.

    Raises:
        DataError: the folder is missing, or holds nothing of what was asked for.
    """
    found = _instance_folders(folder, categories, instances, without)
    counts, tables = TurntableCounts(), []
    for path in found:
        category = path.parent.name
        symmetry = (symmetries or {}).get(category, "none")
        stem = cache / f"{path.name}-{_digest(path, symmetry, azimuth_sign)}"
        table, tally = stem.with_name(f"{stem.name}.json"), stem.with_name(f"{stem.name}.counts")
        if not (table.is_file() and tally.is_file()):
            own = TurntableCounts()
            cutouts = list(_cutouts(path, azimuth_sign, own))
            tally.parent.mkdir(parents=True, exist_ok=True)
            write_text(tally, json.dumps(own.by_outcome))
            if cutouts:
                write_cutouts(stem, category, path.name, symmetry, cutouts)
        for outcome, n in json.loads(tally.read_text(encoding="utf-8")).items():
            counts.add(outcome, n)
        if table.is_file():
            tables.append(table)
    if not tables:
        raise DataError(f"{folder}: no picture is of use ({counts}). Are masks and poses unpacked?")
    return tables, counts


def class_names_of(tables: list[Path]) -> list[str]:
    """Categories in their order, each once."""
    return list(dict.fromkeys(load_cutouts(table).class_name for table in tables))


def _instance_folders(
    folder: Path,
    categories: Collection[str] | None,
    instances: Collection[str] | None,
    without: Collection[str],
) -> list[Path]:
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder of turntable pictures. Correct the path.")
    known = sorted(p for p in folder.iterdir() if p.is_dir())
    for name in categories or ():
        if name not in {p.name for p in known}:
            raise DataError(f"{folder}: no category {name!r}. There are: {_some(known)}.")
    chosen = [p for p in known if categories is None or p.name in categories]
    found = [p for path in chosen for p in sorted(path.iterdir(), key=_by_number) if p.is_dir()]
    for name in [*(instances or ()), *without]:
        if name not in {p.name for p in found}:
            raise DataError(f"{folder}: no instance {name!r}. There are: {_some(found)}.")
    found = [p for p in found if p.name not in without]
    found = [p for p in found if instances is None or p.name in instances]
    if not found:
        raise DataError(f"{folder}: no instances. Expected <category>/<category>_<i>/*_crop.png.")
    return found


def _some(paths: list[Path]) -> str:
    names = [path.name for path in paths]
    return ", ".join(names[:8]) + (", …" if len(names) > 8 else "") if names else "none"


def _by_number(path: Path) -> tuple[int, str]:
    number = re.search(r"_(\d+)$", path.name)
    return (int(number[1]) if number else 0, path.name)


def _cutouts(folder: Path, azimuth_sign: int, counts: TurntableCounts) -> Iterator[Cutout]:
    for path in _pictures(folder):
        cutout = _cutout(path, azimuth_sign)
        counts.add(cutout if isinstance(cutout, str) else USED)
        if not isinstance(cutout, str):
            yield cutout


def _pictures(folder: Path) -> list[Path]:
    """One picture per frame: the crop, or else the whole picture; crops of odd names as well."""
    crops = {path.name.removesuffix("_crop.png"): path for path in folder.glob("*_crop.png")}
    others = set(folder.glob("*.png")) - set(crops.values())
    whole = {path.stem: path for path in others if PICTURE.fullmatch(path.name)}
    return sorted({**whole, **crops}.values())


def _cutout(path: Path, azimuth_sign: int) -> Cutout | str:
    """A picture's cutout, or why there is none."""
    name = PICTURE.fullmatch(path.name)
    if name is None or int(name["sequence"]) not in ELEVATION_DEG:
        return OTHER
    pose, mask = path.with_name(name["stem"] + "_pose.txt"), _mask(path, name["stem"])
    if not pose.is_file():
        return NO_POSE
    if mask is None:
        return NO_MASK
    azimuth, rgba = _azimuth_rad(pose), _masked(path, *mask)
    if azimuth is None or rgba is None:
        return BAD
    elevation = np.deg2rad(ELEVATION_DEG[int(name["sequence"])])
    return Cutout(rgba, float(azimuth_sign * azimuth % FULL_TURN_RAD), float(elevation))


def _mask(path: Path, stem: str) -> tuple[Path, Path | None] | None:
    """A picture's mask, and the file that says where it lies if it is only of a part."""
    ends = ("_mask.png", "_maskcrop.png", "_loc.txt")
    whole, part, place = (path.with_name(stem + end) for end in ends)
    is_crop = path.name.endswith("_crop.png")
    choices = [(part, None)] if is_crop else [(whole, None), (part, place)]
    return next(
        (
            (mask, where)
            for mask, where in choices
            if mask.is_file() and (where is None or where.is_file())
        ),
        None,
    )


def _azimuth_rad(path: Path) -> float | None:
    """What a pose file says; None if it is no number."""
    try:
        azimuth = np.deg2rad(float(path.read_text(encoding="utf-8").split()[0]))
    except (ValueError, IndexError):
        return None
    return float(azimuth) if np.isfinite(azimuth) else None


def _masked(path: Path, mask_path: Path, place: Path | None) -> Pixels | None:
    """The object alone, RGBA; None if a picture is damaged or shows nothing of it.

    Args:
        path: the picture.
        mask_path: of the same size, or of a part of the picture.
        place: where that part lies; None = the mask is of the picture's size.
    """
    if not (is_listed(path) and is_listed(mask_path)):
        return None
    color, mask = cv2.imread(str(path)), cv2.imread(str(mask_path), cv2.IMREAD_GRAYSCALE)
    if color is not None and mask is not None and place is not None:
        color = _part(color, place, mask.shape)
    if color is None or mask is None or color.shape[:2] != mask.shape:
        return None
    alpha = np.where(mask > 0, 255, 0).astype(np.uint8)
    return crop_to_object(np.dstack([color[..., ::-1], alpha]))


def _part(color: Pixels, place: Path, shape: tuple[int, ...]) -> Pixels | None:
    """The part of a picture whose top left pixel a file names, counted from 1; None if damaged."""
    try:
        x, y = (int(part) for part in place.read_text(encoding="utf-8").split(","))
    except ValueError:
        return None
    return color[y - 1 : y - 1 + shape[0], x - 1 : x - 1 + shape[1]] if min(x, y) >= 1 else None


def _digest(folder: Path, symmetry: Symmetry, azimuth_sign: int) -> str:
    """Names the files by name, size and time: reading them all again would take minutes."""
    files = [(p.name, p.stat().st_size, p.stat().st_mtime_ns) for p in sorted(folder.iterdir())]
    text = json.dumps([VERSION, files, symmetry, azimuth_sign])
    return hashlib.sha256(text.encode()).hexdigest()[:16]
