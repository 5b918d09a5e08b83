"""COCO results: image_id, category_id, bbox (left, top, width, height in px) and score per box.

Results rarely say what their ids mean. Images are looked up in the file itself, in the file that
`detections.images` names, in the COCO annotations; failing these, an id is a frame number, or a
file name if it is a string. Category names: the file itself, the COCO annotations, the images file.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imodbatch.core.errors import DataError
from imodbatch.datasets.base import Footage
from imodbatch.datasets.coco import CocoFile, CocoResult, JsonId
from imodbatch.datasets.detections.found import (
    KEY,
    Entries,
    Found,
    asked_for,
    of_classes,
    refuse_shared_numbers,
)
from imodbatch.datasets.names import UNKNOWN_FRAMES, ClassNames, FrameNames, Place, existing_file
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import DetectionsSection

BACKWARDS = "A bbox is x, y, width, height: make the last two positive."


@dataclass(frozen=True)
class Source(CocoFile):
    """A file that may say what ids mean; `pattern` is the value of the manifest that names it."""

    pattern: str


def files_beside(
    manifest: Manifest, section: DetectionsSection, sequence: SequenceSection
) -> list[Path]:
    """The files besides the results that may say what ids mean.

    Raises:
        DataError: the one that `detections.images` names is missing.
    """
    return [source.path for source in _beside(manifest, section, sequence)]


def _beside(
    manifest: Manifest, section: DetectionsSection, sequence: SequenceSection
) -> list[Source]:
    """The file that `detections.images` names, and the COCO annotations, if there are any."""
    sources = []
    if section.images:
        key, path = "detections.images", manifest.path_in(sequence, section.images)
        sources.append(Source(existing_file(path, key), key, section.images))
    annotations = manifest.annotations
    if annotations.format == "coco" and annotations.path:
        path = manifest.path_in(sequence, annotations.path)
        if path.is_file():
            sources.append(Source(path, "annotations.path", annotations.path))
    return sources


def read_found(footage: Footage, section: DetectionsSection) -> Found:
    """All entries of the file.

    Raises:
        ConfigError: a rename to an unknown class.
        DataError: see `imodbatch.datasets.detections.read_detections`.
    """
    manifest, sequence = footage.manifest, footage.sequence
    own = Source(manifest.path_in(sequence, section.path), KEY, section.path)
    beside = _beside(manifest, section, sequence)
    key, results = _results(own)
    classes = ClassNames(manifest, section.rename, "detections.rename")
    named = next((s for s in (own, *reversed(beside)) if s.has("categories")), None)
    if named is None and results:
        raise DataError(
            f"{own.path}: nothing says what its category ids mean. Add "
            '"categories": [{"id": 1, "name": "…"}], or name a COCO file that has them '
            "(detections.images)."
        )
    categories = {} if named is None else named.categories
    class_of = {identifier: classes.find(one.name) for identifier, one in categories.items()}
    place_of = _places(footage, own, beside)
    boxes, scores = np.empty((len(results), 4)), np.empty(len(results))
    known: dict[JsonId, Place] = {}
    image_ids, class_ids = [], []
    for number, result in enumerate(results):
        image_id, category_id = result.image_id, result.category_id
        if image_id not in known:
            known[image_id] = place_of(image_id, result.where)
        if category_id not in class_of:
            raise DataError(
                f"{result.where}: category_id {category_id!r} has no name. Add it to the "
                "categories, in the results or in the file that detections.images names."
            )
        image_ids.append(image_id)
        class_ids.append(class_of[category_id])
        x, y, width, height = result.bbox
        boxes[number] = x, y, x + width, y + height
        scores[number] = result.score

    entries = Entries(own.path, lambda number: f"{key}[{number}]")
    found = of_classes(entries, boxes, class_ids, scores, len(manifest.classes))
    places = asked_for([known[image_id] for image_id in image_ids], class_ids)
    return Found(entries, found, places, image_ids, BACKWARDS)


def _places(footage: Footage, own: Source, beside: list[Source]) -> Callable[[JsonId, str], Place]:
    """A function from an image's id, and the entry that names it, to its place."""
    source = next((s for s in (own, *beside) if s.has("images")), own)
    names = FrameNames(footage, source.key, source.pattern)
    has_images = source.has("images")
    if has_images:
        names.frames_of_images(source)

    def place(image_id: JsonId, where: str) -> Place:
        if has_images:
            image = source.images.get(image_id)
            return (
                Place(None, UNKNOWN_FRAMES)
                if image is None
                else names.place_of_name(image.file_name, where)
            )
        if isinstance(image_id, str):
            return names.place_of_name(image_id, where)
        cure = "Name a COCO file with the images (detections.images)"
        refuse_shared_numbers(footage, own.pattern, cure)
        return names.place_of_number(image_id)

    return place


def _results(own: Source) -> tuple[str, list[CocoResult]]:
    """The list of results and what to call it."""
    if isinstance(own.content, list):
        return "entry", own.entries("entry", CocoResult)
    for key in ("detections", "annotations"):
        if isinstance(own.content, dict) and key in own.content:
            return key, own.entries(key, CocoResult)
    raise DataError(
        f"{own.path}: is no COCO results file. Expected a list of results, or an object that holds "
        'one as "detections" or "annotations".'
    )
