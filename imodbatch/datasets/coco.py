"""COCO's JSON, read and written: images, categories, and boxes in continuous pixels.

Beyond COCO there may be: `ignore`, `instance` (or `instance_id`), `azimuth_deg` and `elevation_deg`
of a box (where from the camera sees the object, in the object's own frame), and `symmetry` of a
category.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictInt,
    StrictStr,
    ValidationError,
)

from imodbatch.core.errors import DataError, one_line
from imodbatch.core.symmetry import Symmetry, parse_symmetry

JsonId = int | str


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


Id = Annotated[StrictInt | StrictStr, Field(description="a whole number or a string")]
Number = Annotated[float, Field(strict=True, description="a number")]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Box = Annotated[
    tuple[Finite, Finite, Finite, Finite],
    Field(description="four finite numbers: x, y, w, h in px"),
]
Flag = Annotated[Literal[0, 1] | None, Field(description="0 or 1")]
Degrees = Annotated[Finite | None, Field(description="degrees, or take it out")]
Text = Annotated[str, BeforeValidator(_text)]
Turns = Annotated[
    Symmetry | None,
    BeforeValidator(lambda value: None if value is None else parse_symmetry(value)),
    Field(description='"none", "full", or how often it looks the same in a turn'),
]


class Entry(BaseModel):
    """An object in a list of a COCO file; `where` is file and entry, for errors.

    The description of a field says what was expected where something else stands.
    """

    model_config = ConfigDict(frozen=True)

    where: str


class CocoImage(Entry):
    """An entry of "images"; its size is None or 0 where the file does not say it."""

    id: Id
    file_name: Text
    width: Any = None
    height: Any = None


class CocoCategory(Entry):
    """An entry of "categories"; a symmetry of None = not said."""

    id: Id
    name: Text
    symmetry: Turns = None


class CocoResult(Entry):
    """What a detector found: `bbox` is left, top, width, height in continuous pixels."""

    image_id: Id
    category_id: Id
    bbox: Box
    score: Number


class CocoBox(Entry):
    """An entry of "annotations".

    Attributes:
        image_id: key of `CocoFile.images`.
        category_id: key of `CocoFile.categories`.
        bbox: left, top, width, height in continuous pixels.
        ignore: 1 = counts neither as found nor as missed.
        iscrowd: 1 = one box around several objects.
        instance_id: the physical object, None = unknown.
        azimuth_deg: of the camera in the object's own frame, None = unknown.
        elevation_deg: the same above the horizon.
    """

    image_id: Id
    category_id: Id
    bbox: Box
    ignore: Flag = None
    iscrowd: Flag = None
    instance_id: Annotated[str | None, BeforeValidator(_text)] = Field(
        None, validation_alias=AliasChoices("instance_id", "instance")
    )
    azimuth_deg: Degrees = None
    elevation_deg: Degrees = None


E = TypeVar("E", bound=Entry)


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

    def entries(self, key: str, kind: type[E]) -> list[E]:
        """The objects in the list below a key; of a file that is a bare list "entry" names that.

        Raises:
            DataError: there is no such list, or an entry is not of that kind.
        """
        content = {"entry": self.content} if isinstance(self.content, list) else self.content
        if not isinstance(content, dict) or key not in content:
            raise DataError(
                f'{self.path}: has no list "{key}". Expected a COCO file that holds one.'
            )
        if not isinstance(content[key], list):
            raise DataError(f'{self.path}: "{key}" is no list. Expected a COCO file.')
        return [
            _checked(values, kind, f"{self.path}: {key}[{number}]")
            for number, values in enumerate(content[key])
        ]

    @cached_property
    def images(self) -> dict[JsonId, CocoImage]:
        """Image id → image.

        Raises:
            DataError: no "images", a key is missing, an id stands twice.
        """
        return _by_id(self.entries("images", CocoImage), "image")

    @cached_property
    def categories(self) -> dict[JsonId, CocoCategory]:
        """Category id → category.

        Raises:
            DataError: no "categories", a key is missing, an id stands twice, or a symmetry cannot
                be meant.
        """
        return _by_id(self.entries("categories", CocoCategory), "category")

    def boxes(self) -> Iterator[CocoBox]:
        """The annotations.

        Raises:
            DataError: no "annotations", a key is missing or cannot be meant, an id is not in
                "images" or "categories".
        """
        images, categories = self.images, self.categories
        for box in self.entries("annotations", CocoBox):
            if box.image_id not in images:
                raise _unlisted(box.where, "image_id", box.image_id, "images")
            if box.category_id not in categories:
                raise _unlisted(box.where, "category_id", box.category_id, "categories")
            yield box


def _checked(values: Any, kind: type[E], where: str) -> E:
    if not isinstance(values, dict):
        raise DataError(f"{where} is no object. Expected a COCO file.")
    try:
        return kind.model_validate({**values, "where": where})
    except ValidationError as error:
        key = str(error.errors(include_url=False)[0]["loc"][0])
    if values.get(key) is None:
        raise DataError(f'{where} has no "{key}". Add it to the file.')
    expected = kind.model_fields[key].description
    raise DataError(f'{where}: "{key}" is {values[key]!r}. Expected {expected}.')


def _by_id(entries: Iterable[Any], what: str) -> dict[JsonId, Any]:
    found: dict[JsonId, Any] = {}
    for entry in entries:
        if found.setdefault(entry.id, entry) is not entry:
            raise DataError(
                f"{entry.where}: id {entry.id!r} stands twice. Give each {what} its own."
            )
    return found


def _unlisted(where: str, key: str, identifier: JsonId, table: str) -> DataError:
    return DataError(f'{where}: {key} {identifier!r} is not in "{table}". Add it there.')


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
