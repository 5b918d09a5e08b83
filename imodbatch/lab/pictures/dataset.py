"""Training pictures on disk: ``images/*.jpg``, ``annotations.json`` (COCO), ``recipe.json``.

Pictures are made in chunks; a chunk's labels are written after its pictures, with every picture's
length. So a run that was killed goes on with the chunks that have none or lack a picture, and ends
with the same bytes.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.datasets.coco import box_entry, coco_text, image_entry
from imodbatch.lab.pictures.composition import Composer, Picture, Recipe
from imodbatch.lab.processes import results
from imodbatch.lab.progress import Progress, silent
from imodbatch.tables.atomic import sweep, write_bytes, write_text

VERSION = 2
CHUNK = 50
JPEG_QUALITY = 95
ANNOTATIONS, RECIPE, CHUNKS = "annotations.json", "recipe.json", ".chunks"


@dataclass(frozen=True)
class Summary:
    """What a training set holds; `str` of it is one line that adds up."""

    n_made: int
    n_found: int
    n_by_blending: dict[str, int]
    n_annotations: int
    n_ignored: int

    def __str__(self) -> str:
        blended = " + ".join(f"{n:,} {name}" for name, n in self.n_by_blending.items())
        return (
            f"{self.n_made + self.n_found:,} pictures = {self.n_made:,} made + "
            f"{self.n_found:,} there already = {blended}; {self.n_annotations:,} objects = "
            f"{self.n_annotations - self.n_ignored:,} to learn + {self.n_ignored:,} ignored"
        )


def write_dataset(
    folder: Path,
    recipe: Recipe,
    n: int,
    *,
    workers: int = 1,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Summary:
    """Write pictures 0 to n − 1 and their labels, except for those that are there.

    Args:
        folder: where to; made if need be.
        recipe: what pictures are made of.
        n: how many; more than before adds to what is there.
        workers: processes.
        overwrite: make all anew, whatever the folder holds.
        progress: called with pictures done and pictures in all.

    Raises:
        ConfigError: n is not positive, or the folder holds pictures of another recipe.
    """
    if n < 1:
        raise ConfigError(f"n: expected at least one picture, found {n}.")
    _check_recipe(folder, recipe, overwrite)
    (folder / "images").mkdir(parents=True, exist_ok=True)
    (folder / CHUNKS).mkdir(exist_ok=True)
    sweep(folder)
    chunks = [range(start, min(start + CHUNK, n)) for start in range(0, n, CHUNK)]
    todo = [chunk for chunk in chunks if overwrite or _labels(folder, chunk) is None]
    n_made = sum(map(len, todo))
    done = n - n_made
    progress(done, n)
    for size in results(_make_chunk, [(folder, recipe, chunk) for chunk in todo], workers):
        done += size
        progress(done, n)
    labels = [label for chunk in chunks for label in _labels(folder, chunk) or []]
    write_text(folder / ANNOTATIONS, _coco(recipe, labels))
    return _summary(labels, n_made)


@cache
def _composer(recipe: Recipe) -> Composer:
    """Opened once per process."""
    return recipe.composer()


def _make_chunk(folder: Path, recipe: Recipe, chunk: range) -> int:
    """A chunk's pictures, then its labels; how many pictures they are."""
    composer = _composer(recipe)
    labels = []
    for index in chunk:
        picture = composer.compose(index)
        jpeg = _jpeg(picture.image)
        write_bytes(folder / image_file(index), jpeg, sync=False)
        labels.append({**_label(index, picture), "bytes": len(jpeg)})
    write_text(_chunk_file(folder, chunk), json.dumps(labels) + "\n")
    return len(chunk)


def image_file(index: int) -> str:
    """A picture's path within the folder."""
    return f"images/{index:06d}.jpg"


def _jpeg(image: Any) -> bytes:
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def _label(index: int, picture: Picture) -> dict[str, Any]:
    """All that is known of a picture."""
    height, width = picture.image.shape[:2]
    return {
        "index": index,
        "width": width,
        "height": height,
        "blending": picture.blending,
        "objects": [_object(picture, i) for i in range(len(picture.boxes))],
    }


def _object(picture: Picture, i: int) -> dict[str, Any]:
    x0, y0, x1, y1 = picture.boxes[i].tolist()
    return box_entry(
        int(picture.class_ids[i]),
        (x0, y0, x1, y1),
        (x1 - x0) * (y1 - y0),
        is_ignored=bool(picture.ignore[i]),
        azimuth_bin=int(picture.azimuth_bins[i]),
        elevation_bin=int(picture.elevation_bins[i]),
        azimuth_deg=round(float(np.rad2deg(picture.azimuth_rad[i])), 4),
        elevation_deg=round(float(np.rad2deg(picture.elevation_rad[i])), 4),
        visibility=round(float(picture.visibility[i]), 4),
        instance=picture.instances[i],
    )


def _coco(recipe: Recipe, labels: list[dict[str, Any]]) -> str:
    composer = _composer(recipe)
    info = {
        "description": "Composed training pictures; boxes of whole objects, clipped to the "
        "picture, in continuous pixels (corner = 0).",
        "n_azimuths": recipe.grid.n_azimuths,
        "elevations_deg": np.rad2deg(recipe.grid.elevations_rad).round(6).tolist(),
    }
    images = [
        {
            **image_entry(x["index"], image_file(x["index"]), (x["width"], x["height"])),
            "blending": x["blending"],
        }
        for x in labels
    ]
    classes = dict(zip(composer.class_names, composer.symmetries, strict=True))
    return coco_text(info, classes, images, [x["objects"] for x in labels], indent=None)


def _chunk_file(folder: Path, chunk: range) -> Path:
    return folder / CHUNKS / f"{chunk.start:06d}.json"


def _labels(folder: Path, chunk: range) -> list[dict[str, Any]] | None:
    """A chunk's labels; None if it has to be made, was shorter when it was, or lacks a picture."""
    try:
        labels: list[dict[str, Any]] = json.loads(_chunk_file(folder, chunk).read_text("utf-8"))
        wanted = {image_file(label["index"]): label["bytes"] for label in labels[: len(chunk)]}
        found = {name: (folder / name).stat().st_size for name in map(image_file, chunk)}
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return labels[: len(chunk)] if found == wanted else None


def _check_recipe(folder: Path, recipe: Recipe, overwrite: bool) -> None:
    """Refuse to mix pictures of two recipes in one folder."""
    path = folder / RECIPE
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder}: is a file, expected a folder for pictures.")
    wanted = {"digest": recipe_digest(recipe), "seed": recipe.seed}
    if path.is_file() and not overwrite:
        try:
            found = json.loads(path.read_text("utf-8")).get("digest")
        except (ValueError, AttributeError):
            raise DataError(f"{path}: damaged. Delete the folder, or use --overwrite.") from None
        if found != wanted["digest"]:
            raise ConfigError(
                f"{folder}: holds pictures made with other objects, backgrounds, settings or seed. "
                "Name another folder, or use --overwrite."
            )
    if overwrite:
        for chunk in (folder / CHUNKS).glob("*.json"):
            chunk.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps({**wanted, "settings": asdict(recipe.settings)}, indent=1) + "\n")


def recipe_digest(recipe: Recipe) -> str:
    """Names all that pictures and labels depend on; cutouts' file names hold their digest."""
    backgrounds = [(path.name, path.stat().st_size) for path in recipe.backgrounds]
    parts = [
        VERSION,
        [path.name for path in recipe.cutouts],
        backgrounds,
        asdict(recipe.grid),
        asdict(recipe.settings),
        recipe.seed,
    ]
    if recipe.distractors:
        parts.append([path.name for path in recipe.distractors])
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def _summary(labels: Iterable[dict[str, Any]], n_made: int) -> Summary:
    labels = list(labels)
    objects = [one for label in labels for one in label["objects"]]
    blended = Counter(label["blending"] for label in labels)
    return Summary(
        n_made,
        len(labels) - n_made,
        dict(sorted(blended.items())),
        len(objects),
        sum(one["ignore"] for one in objects),
    )
