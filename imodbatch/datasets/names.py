"""Which file name or class name of a foreign file is which frame or class of ours.

A file may name an image by its path from the dataset's root, or by its path from the sequence's
folder, or by its mere file name. The last two are loose: frame-000000.jpg may lie in every
sequence. A loose name is taken only if no other sequence that reads the same file has that image.
"""

import os.path
import posixpath
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.datasets.base import Footage
from imodbatch.datasets.coco import CocoFile, JsonId
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.toml import did_you_mean

OTHER_FRAMES = "other frames"
"""Reason: an image of another sequence, or outside the manifest's slice."""
OUTSIDE_IMAGE = "outside image"
"""Reason: no part of the box lies in the image."""
NO_AREA = "no area"
"""Reason: the box has no width or no height."""

UNKNOWN_FRAMES = "unknown frames"
"""Reason: an image that the dataset does not have."""


@dataclass(frozen=True)
class Place:
    """Where an image belongs: a frame of the slice, or the reason why it is none."""

    frame_index: int | None
    reason: str = ""


class FrameNames:
    """The frames of a sequence by the names that a file may give to their images."""

    def __init__(
        self,
        footage: Footage,
        key: str,
        pattern: str,
        *,
        without_suffix: bool = False,
        is_shared: bool = True,
    ) -> None:
        """Index the frames.

        Args:
            footage: the frames.
            key: key of the manifest that names the file, such as ``annotations.path``.
            pattern: its value.
            without_suffix: names come without ``.jpg`` or ``.png``, as those of label files do.
            is_shared: other sequences that read the same file may mean their images by a name;
                False = the file says whose each name is.
        """
        manifest, sequence = footage.manifest, footage.sequence
        self._root, self._key, self._pattern = manifest.root_path, key, pattern
        self._size_px, self._sequence = footage.size_px, sequence
        self._folder = posixpath.normpath(sequence.path)
        others = sharing(manifest, sequence, pattern) if is_shared else []
        self._sharing = [posixpath.normpath(other.path) for other in others]
        self._color_paths = {
            f.frame_index: posixpath.normpath(f.color_path) for f in footage.frames
        }
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

    def place_of_number(self, number: int) -> Place:
        """The place of a frame number; one that the slice leaves out may well exist."""
        if number in self._color_paths:
            return Place(number)
        kept = self._sequence.keeps(number)
        return Place(None, UNKNOWN_FRAMES if kept else OTHER_FRAMES)

    def place_of_name(self, name: str, where: str) -> Place:
        """The place of an image file.

        Raises:
            DataError: the name fits several images.
        """
        index = self.find(name, where)
        if index is not None:
            return Place(index)
        return Place(None, OTHER_FRAMES if self._is_elsewhere(name) else UNKNOWN_FRAMES)

    def frames_of_images(self, file: CocoFile) -> dict[JsonId, int | None]:
        """Image id of a COCO file → frame number, None = an image outside the slice.

        Raises:
            DataError: a name fits several frames, or two images the same frame; an image has
                another size than the frames.
        """
        found: dict[JsonId, int | None] = {}
        image_of_frame: dict[int, JsonId] = {}
        for image_id, image in file.images.items():
            index = found[image_id] = self.find(image.file_name, image.where)
            if index is None:
                continue
            first_id = image_of_frame.setdefault(index, image_id)
            if first_id != image_id:
                raise DataError(
                    f"{image.where}: images {first_id!r} and {image_id!r} are both frame {index} "
                    f"({file.images[first_id].file_name}, {image.file_name}). Leave one of them "
                    "out."
                )
            check_size(image.width, image.height, self._size_px, image.where)
        return found

    def _is_elsewhere(self, name: str) -> bool:
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
        """The class's ordinal, None = a class that the manifest does not ask for."""
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


def existing_file(path: Path, key: str) -> Path:
    """The path of a file that `key` of the manifest names.

    Raises:
        DataError: there is no such file.
    """
    if not path.is_file():
        raise missing_file(path, key)
    return path


def missing_file(path: Path, key: str) -> DataError:
    """The error of a file or folder that the manifest names and that is not there."""
    return DataError(f"{path}: no such file or folder. Check {key} in the manifest.")


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
