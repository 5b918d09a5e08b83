"""COCO's JSON, and which file name or class name of a foreign file is which frame or class of ours.

A file may name an image by its path from the dataset's root, or by its path from the sequence's
folder, or by its mere file name. The last two are loose: frame-000000.jpg may lie in every
sequence. A loose name is taken only if no other sequence that reads the same file has that image.
"""

import json
import os.path
import posixpath
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from imodbatch.config import did_you_mean
from imodbatch.datasets.base import FrameFile
from imodbatch.errors import ConfigError, DataError
from imodbatch.manifest import Manifest, SequenceSection

OTHER_FRAMES = "other frames"
"""Reason: an image of another sequence, or outside the manifest's slice."""
OUTSIDE_IMAGE = "outside image"
"""Reason: no part of the box lies in the image."""
NO_AREA = "no area"
"""Reason: the box has no width or no height."""

JsonId = int | str
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class CocoImage:
    """An entry of "images": its file name, and its frame number if it is one of the slice."""

    file_name: str
    frame_index: int | None


class FrameNames:
    """The frames of a sequence by the names that a file may give to their images."""

    def __init__(
        self,
        manifest: Manifest,
        sequence: SequenceSection,
        frames: Sequence[FrameFile],
        key: str,
        pattern: str,
        *,
        without_suffix: bool = False,
        is_shared: bool = True,
    ) -> None:
        """Index the frames.

        Args:
            manifest: the split.
            sequence: the sequence that the frames belong to.
            frames: the frames of its slice.
            key: key of the manifest that names the file, such as ``annotations.path``.
            pattern: its value.
            without_suffix: names come without ``.jpg`` or ``.png``, as those of label files do.
            is_shared: other sequences that read the same file may mean their images by a name;
                False = the file says whose each name is.
        """
        self._root, self._key, self._pattern = manifest.root_path, key, pattern
        self._folder = posixpath.normpath(sequence.path)
        others = sharing(manifest, sequence, pattern) if is_shared else []
        self._sharing = [posixpath.normpath(other.path) for other in others]
        self._color_paths = {f.frame_index: posixpath.normpath(f.color_path) for f in frames}
        self._exact: dict[str, int] = {}
        self._loose: dict[str, list[int]] = defaultdict(list)
        for index, color_path in self._color_paths.items():
            path = str(PurePosixPath(color_path).with_suffix("")) if without_suffix else color_path
            self._exact[path] = index
            for name in {posixpath.relpath(path, self._folder), posixpath.basename(path)}:
                self._loose[name].append(index)
        beside = {posixpath.dirname(path) for path in self._color_paths.values()}
        tails = {posixpath.relpath(folder or ".", self._folder) for folder in beside} | {"."}
        self._places = {"."} | {
            posixpath.normpath(posixpath.join(s.path, tail))
            for s in manifest.sequences
            for tail in tails
        }

    def find(self, name: str, where: str) -> int | None:
        """The frame number of an image, None if no frame of the slice bears that name.

        Args:
            name: the name that a file gives to the image.
            where: file and entry, for the error.

        Raises:
            DataError: the name fits several images.
        """
        path = self._from_root(name)
        if path in self._exact:
            return self._exact[path]
        found = self._loose.get(path, [])
        candidates = [self._color_paths[index] for index in found]
        candidates += [twin for index in found for twin in self._twins(self._color_paths[index])]
        if len(candidates) > 1:
            raise DataError(
                f"{where}: {name!r} may be {candidates[0]} or {candidates[1]}. Name images by "
                f"their path from {self._root}, or put {{sequence}} into {self._key} "
                f"({self._pattern!r})."
            )
        return found[0] if found else None

    def is_elsewhere(self, name: str) -> bool:
        """Whether an image that is no frame of the slice exists in the dataset all the same."""
        path = self._from_root(name)
        return not posixpath.isabs(path) and any(
            os.path.isfile(self._root / place / path) for place in self._places
        )

    def _from_root(self, name: str) -> str:
        path = posixpath.normpath(name.replace("\\", "/"))
        root = self._root.as_posix()
        return posixpath.relpath(path, root) if path.startswith(f"{root}/") else path

    def _twins(self, color_path: str) -> list[str]:
        """The images at the same place in the other sequences that read the same file."""
        tail = posixpath.relpath(color_path, self._folder)
        twins = [posixpath.normpath(posixpath.join(folder, tail)) for folder in self._sharing]
        return [t for t in twins if t != color_path and os.path.isfile(self._root / t)]


class ClassNames:
    """Names of another data set or detector → ordinals of the manifest's classes."""

    def __init__(self, manifest: Manifest, rename: dict[str, str], key: str) -> None:
        """Check a renaming.

        Raises:
            ConfigError: it renames to what is no class of the manifest.
        """
        self._ids = {name: index for index, name in enumerate(manifest.classes)}
        self._rename, self._classes = rename, manifest.classes
        for source, target in rename.items():
            if target not in self._ids:
                raise ConfigError(
                    f"manifest {manifest.name}: {key}: {source!r} is renamed to {target!r}, which "
                    f"is not one of its classes.{did_you_mean(target, manifest.classes)}"
                )

    def find(self, name: str) -> int | None:
        """The class's ordinal, None if the manifest does not ask for that class."""
        return self._ids.get(self._rename.get(name, name))

    def hint(self, name: str) -> str:
        """The end of an error about an unknown name."""
        return did_you_mean(name, [*self._classes, *self._rename])


def sharing(manifest: Manifest, sequence: SequenceSection, pattern: str) -> list[SequenceSection]:
    """The sequences in other folders that would read the very same file or folder."""
    own = manifest.path_in(sequence, pattern)
    return [
        other
        for other in manifest.sequences
        if posixpath.normpath(other.path) != posixpath.normpath(sequence.path)
        and manifest.path_in(other, pattern) == own
    ]


def read_json(path: Path, key: str) -> Any:
    """The content of a JSON file; `key` of the manifest names it.

    Raises:
        DataError: missing, unreadable or not JSON.
    """
    try:
        return json.loads(path.read_bytes())
    except FileNotFoundError:
        raise missing_file(path, key) from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}). Check {key}.") from None
    except (ValueError, RecursionError) as error:
        raise DataError(
            f"{path}: is not JSON ({one_line(error)}). Write it again, or check {key}."
        ) from None


def missing_file(path: Path, key: str) -> DataError:
    """The error of a file or folder that the manifest names and that is not there."""
    return DataError(f"{path}: no such file or folder. Check {key} in the manifest.")


def one_line(error: BaseException) -> str:
    """The text of another library's error, in one line."""
    return " ".join(str(error).split())


def entries_of(document: Any, key: str, path: Path) -> list[dict[str, Any]]:
    """A list of objects below a key of a COCO document.

    Raises:
        DataError: the document is no object, the key is missing, an entry is no object.
    """
    if not isinstance(document, dict) or key not in document:
        raise DataError(f'{path}: has no list "{key}". Expected a COCO file that holds one.')
    return checked_entries(document[key], key, path)


def checked_entries(entries: Any, key: str, path: Path) -> list[dict[str, Any]]:
    """The same list, checked to hold objects only.

    Raises:
        DataError: it is no list, or an entry is no object.
    """
    if not isinstance(entries, list):
        raise DataError(f'{path}: "{key}" is no list. Expected a COCO file.')
    for number, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise DataError(f"{path}: {key}[{number}] is no object. Expected a COCO file.")
    return entries


def value_of(entry: dict[str, Any], key: str, where: str) -> Any:
    """A value that an entry must have.

    Raises:
        DataError: it has none.
    """
    if entry.get(key) is None:
        raise DataError(f'{where} has no "{key}". Add it to the file.')
    return entry[key]


def id_of(entry: dict[str, Any], key: str, where: str) -> JsonId:
    """An id: an integer or a string.

    Raises:
        DataError: it is missing or something else.
    """
    value = value_of(entry, key, where)
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise DataError(f'{where}: "{key}" is {value!r}. Expected a whole number or a string.')
    return value


def xywh_of(entry: dict[str, Any], where: str) -> Box:
    """The `bbox` of an entry: left, top, width, height in continuous pixels.

    Raises:
        DataError: it is missing, or not four finite numbers.
    """
    values = value_of(entry, "bbox", where)
    if isinstance(values, list) and len(values) == 4 and all(map(_is_finite, values)):
        x, y, width, height = map(float, values)
        return x, y, width, height
    raise DataError(f"{where}: bbox is {values!r}. Expected four finite numbers: x, y, w, h in px.")


def number_of(entry: dict[str, Any], key: str, where: str) -> float:
    """A number, perhaps NaN or infinite.

    Raises:
        DataError: it is missing or no number.
    """
    value = value_of(entry, key, where)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DataError(f'{where}: "{key}" is {value!r}. Expected a number.')
    return float(value)


def _is_finite(value: Any) -> bool:
    # A chain of comparisons is false for NaN, and does not overflow for an integer of 400 digits.
    return isinstance(value, int | float) and type(value) is not bool and -1e300 < value < 1e300


def category_names(document: Any, path: Path) -> dict[JsonId, str]:
    """Category id → name.

    Raises:
        DataError: no "categories", a key is missing, an id stands twice.
    """
    names: dict[JsonId, str] = {}
    for number, entry in enumerate(entries_of(document, "categories", path)):
        where = f"{path}: categories[{number}]"
        category_id = id_of(entry, "id", where)
        if category_id in names:
            raise DataError(
                f"{where}: id {category_id!r} stands twice. Give each category its own."
            )
        names[category_id] = str(value_of(entry, "name", where))
    return names


def coco_images(
    document: Any, path: Path, names: FrameNames, width_px: int, height_px: int
) -> dict[JsonId, CocoImage]:
    """Image id → file name and frame.

    Args:
        document: a COCO file's content.
        path: that file, for errors.
        names: the frames of the slice.
        width_px: width of the colour images.
        height_px: their height.

    Raises:
        DataError: a key is missing; an id stands twice; a name fits several frames, or two images
            the same frame; an image has another size than the frames.
    """
    images: dict[JsonId, CocoImage] = {}
    image_of_frame: dict[int, JsonId] = {}
    for number, entry in enumerate(entries_of(document, "images", path)):
        where = f"{path}: images[{number}]"
        image_id = id_of(entry, "id", where)
        if image_id in images:
            raise DataError(f"{where}: id {image_id!r} stands twice. Give each image its own.")
        file_name = str(value_of(entry, "file_name", where))
        index = names.find(file_name, where)
        images[image_id] = CocoImage(file_name, index)
        if index is None:
            continue
        first_id = image_of_frame.setdefault(index, image_id)
        if first_id != image_id:
            raise DataError(
                f"{where}: images {first_id!r} and {image_id!r} are both frame {index} "
                f"({images[first_id].file_name}, {file_name}). Leave one of them out."
            )
        check_size(entry.get("width"), entry.get("height"), (width_px, height_px), where)
    return images


def check_size(width: Any, height: Any, expected: tuple[int, int], where: str) -> None:
    """Refuse boxes that were drawn in images of another size; unknown sizes (None, 0) pass.

    Raises:
        DataError: the sizes differ.
    """
    if width and height and (width, height) != expected:
        raise DataError(
            f"{where}: says its image has {width}x{height} px, but the frames have "
            f"{expected[0]}x{expected[1]}. Scale the boxes, or check [camera] in the manifest."
        )
