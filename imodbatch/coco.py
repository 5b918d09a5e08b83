"""COCO's JSON, read and written: images, categories, and boxes in continuous pixels.

Beyond COCO there may be: `ignore`, `instance` (or `instance_id`), `azimuth_deg` and `elevation_deg`
of a box (where from the camera sees the object, in the object's own frame), and `symmetry` of a
category.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from imodbatch.core.symmetry import Symmetry, parse_symmetry
from imodbatch.errors import DataError, one_line

JsonId = int | str


@dataclass(frozen=True)
class CocoImage:
    """An entry of "images"; its size is None or 0 where the file does not say it."""

    where: str
    file_name: str
    width_px: Any
    height_px: Any


@dataclass(frozen=True)
class CocoCategory:
    """An entry of "categories"; a symmetry of None = not said."""

    name: str
    symmetry: Symmetry | None


@dataclass(frozen=True)
class CocoBox:
    """An entry of "annotations".

    Attributes:
        where: file and entry, for errors.
        image_id: key of `CocoFile.images`.
        category_id: key of `CocoFile.categories`.
        xywh: left, top, width, height in continuous pixels.
        is_ignored: counts neither as found nor as missed.
        is_crowd: one box around several objects.
        instance_id: the physical object, None = unknown.
        azimuth_deg: of the camera in the object's own frame, None = unknown.
        elevation_deg: the same above the horizon.
    """

    where: str
    image_id: JsonId
    category_id: JsonId
    xywh: tuple[float, float, float, float]
    is_ignored: bool
    is_crowd: bool
    instance_id: str | None
    azimuth_deg: float | None
    elevation_deg: float | None


@dataclass(frozen=True)
class Entry:
    """An object in a list of a file, and what to call it in errors; all access is checked."""

    where: str
    values: dict[str, Any]

    def value(self, key: str) -> Any:
        """A value that the entry must have.

        Raises:
            DataError: it has none.
        """
        if self.values.get(key) is None:
            raise DataError(f'{self.where} has no "{key}". Add it to the file.')
        return self.values[key]

    def id(self, key: str) -> JsonId:
        """An id: an integer or a string.

        Raises:
            DataError: it is missing or something else.
        """
        return self._typed(key, (int, str), "a whole number or a string")

    def number(self, key: str) -> float:
        """A number, perhaps NaN or infinite.

        Raises:
            DataError: it is missing or no number.
        """
        return float(self._typed(key, (int, float), "a number"))

    def _typed(self, key: str, types: tuple[type, ...], what: str) -> Any:
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, types):
            raise DataError(f'{self.where}: "{key}" is {value!r}. Expected {what}.')
        return value

    def xywh(self) -> tuple[float, float, float, float]:
        """The `bbox`: left, top, width, height in continuous pixels.

        Raises:
            DataError: it is missing, or not four finite numbers.
        """
        values = self.value("bbox")
        if isinstance(values, list) and len(values) == 4 and all(map(_is_finite, values)):
            x, y, width, height = map(float, values)
            return x, y, width, height
        raise DataError(
            f"{self.where}: bbox is {values!r}. Expected four finite numbers: x, y, w, h in px."
        )

    def flag(self, key: str) -> bool:
        """A 0 or 1, False where it is missing.

        Raises:
            DataError: it is something else.
        """
        value = self.values.get(key, 0)
        if value not in (0, 1, None):
            raise DataError(f'{self.where}: "{key}" is {value!r}. Expected 0 or 1.')
        return bool(value)

    def angle_deg(self, key: str) -> float | None:
        """Degrees, None where they are not given.

        Raises:
            DataError: they are no finite number.
        """
        if self.values.get(key) is None:
            return None
        angle_deg = self.number(key)
        if not math.isfinite(angle_deg):
            raise DataError(
                f'{self.where}: "{key}" is {angle_deg}. Expected degrees, or take it out.'
            )
        return angle_deg


def _is_finite(value: Any) -> bool:
    # A chain of comparisons is false for NaN, and does not overflow for an integer of 400 digits.
    return isinstance(value, int | float) and type(value) is not bool and -1e300 < value < 1e300


@dataclass(frozen=True)
class CocoFile:
    """A COCO file, read when it is asked for something; each of its lists is checked then.

    Attributes:
        path: the file.
        key: what names it: a key of the manifest or an option.
    """

    path: Path
    key: str

    @cached_property
    def content(self) -> Any:
        """Its JSON.

        Raises:
            DataError: it cannot be read or is not JSON.
        """
        try:
            return json.loads(self.path.read_bytes())
        except OSError as error:
            fault = f"cannot be read ({error.strerror})"
        except (ValueError, RecursionError) as error:
            fault = f"is not JSON ({one_line(error)})"
        raise DataError(f"{self.path}: {fault}. Write it again, or check {self.key}.")

    def has(self, key: str) -> bool:
        """Whether it is an object that holds something below a key."""
        return isinstance(self.content, dict) and bool(self.content.get(key))

    def entries(self, key: str) -> list[Entry]:
        """The objects in the list below a key; of a file that is a bare list "entry" names that.

        Raises:
            DataError: there is no such list, or an entry is no object.
        """
        content = {"entry": self.content} if isinstance(self.content, list) else self.content
        if not isinstance(content, dict) or key not in content:
            raise DataError(
                f'{self.path}: has no list "{key}". Expected a COCO file that holds one.'
            )
        if not isinstance(content[key], list):
            raise DataError(f'{self.path}: "{key}" is no list. Expected a COCO file.')
        for number, values in enumerate(content[key]):
            if not isinstance(values, dict):
                raise DataError(f"{self.path}: {key}[{number}] is no object. Expected a COCO file.")
        return [Entry(f"{self.path}: {key}[{i}]", values) for i, values in enumerate(content[key])]

    @cached_property
    def images(self) -> dict[JsonId, CocoImage]:
        """Image id → image.

        Raises:
            DataError: no "images", a key is missing, an id stands twice.
        """
        return {
            image_id: CocoImage(
                entry.where,
                str(entry.value("file_name")),
                entry.values.get("width"),
                entry.values.get("height"),
            )
            for image_id, entry in self._by_id("images", "image").items()
        }

    @cached_property
    def categories(self) -> dict[JsonId, CocoCategory]:
        """Category id → category.

        Raises:
            DataError: no "categories", a key is missing, an id stands twice, or a symmetry cannot
                be meant.
        """
        return {
            category_id: CocoCategory(str(entry.value("name")), _symmetry(entry))
            for category_id, entry in self._by_id("categories", "category").items()
        }

    def _by_id(self, key: str, what: str) -> dict[JsonId, Entry]:
        found: dict[JsonId, Entry] = {}
        for entry in self.entries(key):
            identifier = entry.id("id")
            if identifier in found:
                raise DataError(
                    f"{entry.where}: id {identifier!r} stands twice. Give each {what} its own."
                )
            found[identifier] = entry
        return found

    def boxes(self) -> Iterator[CocoBox]:
        """The annotations.

        Raises:
            DataError: no "annotations", a key is missing or cannot be meant, an id is not in
                "images" or "categories".
        """
        tables: dict[str, tuple[str, Mapping[JsonId, Any]]] = {
            "image_id": ("images", self.images),
            "category_id": ("categories", self.categories),
        }
        for entry in self.entries("annotations"):
            xywh = entry.xywh()
            for key, (table, known) in tables.items():
                if entry.id(key) not in known:
                    raise DataError(
                        f'{entry.where}: {key} {entry.id(key)!r} is not in "{table}". Add it there.'
                    )
            instance = entry.values.get("instance_id", entry.values.get("instance"))
            yield CocoBox(
                entry.where,
                entry.id("image_id"),
                entry.id("category_id"),
                xywh,
                entry.flag("ignore"),
                entry.flag("iscrowd"),
                None if instance is None else str(instance),
                entry.angle_deg("azimuth_deg"),
                entry.angle_deg("elevation_deg"),
            )


def _symmetry(entry: Entry) -> Symmetry | None:
    value = entry.values.get("symmetry")
    try:
        return None if value is None else parse_symmetry(value)
    except ValueError as error:
        raise DataError(f"{entry.where}: {error}.") from None


def image_entry(image_id: int, file_name: str, size_px: tuple[int, int]) -> dict[str, Any]:
    """An entry of "images" for `coco_text`; size is width, height."""
    width, height = size_px
    return {"id": image_id, "file_name": file_name, "width": width, "height": height}


def box_entry(
    class_id: int, box: Sequence[float], area: float, *, is_ignored: bool, **more: Any
) -> dict[str, Any]:
    """An entry of "annotations" for `coco_text`.

    Args:
        class_id: ordinal of its class, from 0.
        box: x0 y0 x1 y1 in continuous pixels.
        area: of the object in square pixels.
        is_ignored: counts neither as found nor as missed.
        more: further keys.
    """
    x0, y0, x1, y1 = box
    return {
        "category_id": class_id + 1,
        "bbox": [x0, y0, x1 - x0, y1 - y0],
        "area": area,
        "iscrowd": 0,
        "ignore": int(is_ignored),
        **more,
    }


def coco_text(
    info: Mapping[str, Any],
    classes: Mapping[str, Symmetry | None],
    images: Sequence[Mapping[str, Any]],
    boxes: Iterable[Iterable[Mapping[str, Any]]],
    indent: int | None = 1,
) -> str:
    """A COCO file's text; categories and annotations are numbered from 1.

    Args:
        info: what to say of the whole.
        classes: name → symmetry, None = not said.
        images: entries as of `image_entry`.
        boxes: of each image, entries as of `box_entry`.
        indent: of the text; None = one line.
    """
    listed = [
        {"image_id": image["id"], **box}
        for image, own in zip(images, boxes, strict=True)
        for box in own
    ]
    categories = [
        {"id": k, "name": name} | ({} if symmetry is None else {"symmetry": symmetry})
        for k, (name, symmetry) in enumerate(classes.items(), start=1)
    ]
    content = {
        "info": info,
        "images": images,
        "categories": categories,
        "annotations": [{"id": k, **box} for k, box in enumerate(listed, start=1)],
    }
    return json.dumps(content, indent=indent) + "\n"
