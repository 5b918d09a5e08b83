"""COCO results: image_id, category_id, bbox (left, top, width, height in px) and score per box.

Results rarely say what their ids mean. Images are looked up in the file itself, in the file that
`detections.images` names, in the COCO annotations; failing these, an id is a frame number, or a
file name if it is a string. Category names: the file itself, the COCO annotations, the images file.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from imodbatch.datasets.base import FrameFile
from imodbatch.datasets.coco import (
    ClassNames,
    CocoImage,
    FrameNames,
    JsonId,
    category_names,
    checked_entries,
    coco_images,
    id_of,
    missing_file,
    number_of,
    read_json,
    xywh_of,
)
from imodbatch.datasets.detections.found import (
    KEY,
    UNKNOWN_FRAMES,
    Found,
    Frames,
    Place,
    check_scores,
    one_hot,
    refuse_shared_numbers,
)
from imodbatch.errors import DataError
from imodbatch.manifest import DetectionsSection, Manifest, SequenceSection

BACKWARDS = "A bbox is x, y, width, height: make the last two positive."


@dataclass(frozen=True)
class Source:
    """A file that may say what ids mean, and the manifest's key and value that name it."""

    path: Path
    key: str
    pattern: str

    @cached_property
    def document(self) -> Any:
        """Its content."""
        return read_json(self.path, self.key)

    def has(self, table: str) -> bool:
        """Whether it holds "images" or "categories"."""
        return isinstance(self.document, dict) and bool(self.document.get(table))


def files_beside(
    manifest: Manifest, section: DetectionsSection, sequence: SequenceSection
) -> list[Path]:
    """The files besides the results that may say what ids mean.

    Raises:
        DataError: the one that `detections.images` names is missing.
    """
    sources = [_images_source(manifest, section, sequence), _annotations(manifest, sequence)]
    return [source.path for source in sources if source]


def read_found(
    manifest: Manifest,
    section: DetectionsSection,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],
    size_px: tuple[int, int],
) -> Found:
    """All entries of the file.

    Args:
        manifest: the split.
        section: its `[detections]`.
        sequence: one of its sequences.
        frames: the frames of the sequence's slice.
        size_px: width and height of the colour images.

    Raises:
        ConfigError: a rename to an unknown class.
        DataError: see `imodbatch.datasets.detections.read_detections`.
    """
    own = Source(manifest.path_in(sequence, section.path), KEY, section.path)
    key, results = _results(own)
    images_file = _images_source(manifest, section, sequence)
    annotations = _annotations(manifest, sequence)
    class_of = _class_of_category(
        manifest, section, own, [annotations, images_file], is_needed=bool(results)
    )
    locator = _Locator(
        manifest, sequence, frames, size_px, own=own, others=[images_file, annotations]
    )
    boxes, scores = np.empty((len(results), 4)), np.empty(len(results))
    class_ids = np.empty(len(results), dtype=np.int64)
    image_ids = []
    for number, result in enumerate(results):
        where = f"{own.path}: {key}[{number}]"
        image_ids.append(locator.add(id_of(result, "image_id", where), where))
        category_id = id_of(result, "category_id", where)
        if category_id not in class_of:
            raise DataError(
                f"{where}: category_id {category_id!r} has no name. Add it to the categories, in "
                "the results or in the file that detections.images names."
            )
        class_ids[number] = class_of[category_id]
        x, y, width, height = xywh_of(result, where)
        boxes[number] = x, y, x + width, y + height
        scores[number] = number_of(result, "score", where)

    def entry(number: int) -> str:
        return f"{key}[{number}]"

    check_scores(own.path, entry, scores)
    return Found(
        own.path,
        entry,
        [locator.places[image_id] for image_id in image_ids],
        image_ids,
        boxes,
        one_hot(class_ids, scores, len(manifest.classes)),
        1.0 - scores,
        class_ids >= 0,
        BACKWARDS,
    )


class _Locator:
    """The place of every image id, each looked up once."""

    def __init__(
        self,
        manifest: Manifest,
        sequence: SequenceSection,
        frames: Sequence[FrameFile],
        size_px: tuple[int, int],
        *,
        own: Source,
        others: Sequence[Source | None],
    ) -> None:
        source = next((s for s in (own, *others) if s and s.has("images")), own)
        names = FrameNames(manifest, sequence, frames, source.key, source.pattern)
        self.places: dict[JsonId, Place] = {}
        self._manifest, self._sequence, self._own = manifest, sequence, own
        self._frames = Frames(sequence, frames, names)
        self._images: dict[JsonId, CocoImage] | None = None
        if source.has("images"):
            self._images = coco_images(source.document, source.path, names, *size_px)

    def add(self, image_id: JsonId, where: str) -> JsonId:
        """Look an id up, unless it is known; return it."""
        if image_id not in self.places:
            self.places[image_id] = self._locate(image_id, where)
        return image_id

    def _locate(self, image_id: JsonId, where: str) -> Place:
        if self._images is not None:
            image = self._images.get(image_id)
            if image is None:
                return Place(None, UNKNOWN_FRAMES)
            return self._frames.by_name(image.file_name, where)
        if isinstance(image_id, str):
            return self._frames.by_name(image_id, where)
        refuse_shared_numbers(
            self._manifest,
            self._sequence,
            self._own.pattern,
            self._own.path,
            "Name a COCO file with the images (detections.images)",
        )
        return self._frames.by_number(image_id)


def _results(own: Source) -> tuple[str, list[dict[str, Any]]]:
    """The list of results and what to call it."""
    if isinstance(own.document, list):
        return "entry", checked_entries(own.document, "entry", own.path)
    for key in ("detections", "annotations"):
        if isinstance(own.document, dict) and key in own.document:
            return key, checked_entries(own.document[key], key, own.path)
    raise DataError(
        f"{own.path}: is no COCO results file. Expected a list of results, or an object that holds "
        'one as "detections" or "annotations".'
    )


def _images_source(
    manifest: Manifest, section: DetectionsSection, sequence: SequenceSection
) -> Source | None:
    if not section.images:
        return None
    path = manifest.path_in(sequence, section.images)
    if not path.is_file():
        raise missing_file(path, "detections.images")
    return Source(path, "detections.images", section.images)


def _annotations(manifest: Manifest, sequence: SequenceSection) -> Source | None:
    """The COCO annotations, if there are any."""
    section = manifest.annotations
    if section.format != "coco" or not section.path:
        return None
    path = manifest.path_in(sequence, section.path)
    return Source(path, "annotations.path", section.path) if path.is_file() else None


def _class_of_category(
    manifest: Manifest,
    section: DetectionsSection,
    own: Source,
    others: Sequence[Source | None],
    *,
    is_needed: bool,
) -> dict[JsonId, int]:
    """Category id → class ordinal, -1 = a class that the manifest does not ask for."""
    classes = ClassNames(manifest, section.rename, "detections.rename")
    source = next((s for s in (own, *others) if s and s.has("categories")), None)
    if source is not None:
        names = category_names(source.document, source.path)
        found = {category_id: classes.find(name) for category_id, name in names.items()}
        return {category_id: -1 if index is None else index for category_id, index in found.items()}
    if not is_needed:
        return {}
    raise DataError(
        f"{own.path}: nothing says what its category ids mean. Add "
        '"categories": [{"id": 1, "name": "…"}], or name a COCO file that has them '
        "(detections.images)."
    )
