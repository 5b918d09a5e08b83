"""Annotations with a file per image: which files there are, and which frame each belongs to.

The manifest names a folder, whose files bear the names of the images, or a pattern such as
``labels/{sequence}/{frame}.txt``, whose files bear frame numbers, zero-padded or not.
"""

from dataclasses import dataclass
from pathlib import Path

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.datasets.annotations.entries import KEY
from imodbatch.datasets.base import Footage
from imodbatch.datasets.names import FrameNames, missing_file
from imodbatch.datasets.patterns import PathPattern
from imodbatch.settings.manifest import Manifest, SequenceSection

CLASSES_FILE = "classes.txt"


@dataclass(frozen=True)
class LabelFile:
    """One file; `number` is its frame's where a pattern says so, None = go by its name."""

    path: Path
    number: int | None


def label_folder(manifest: Manifest, sequence: SequenceSection) -> Path:
    """The folder of the sequence's files.

    Raises:
        ConfigError: ``{frame}`` stands in a folder's name or twice.
        DataError: there is no such folder.
    """
    folder, name = _split(manifest, sequence)
    if not folder.exists():
        raise missing_file(folder, KEY)
    if not folder.is_dir():
        raise DataError(
            f"{folder}: is a file, expected a folder. Let {KEY} name the folder, or a pattern with "
            f"{{frame}} such as {name or 'labels/{frame}' + folder.suffix!r}."
        )
    return folder


def label_files(manifest: Manifest, sequence: SequenceSection, suffix: str) -> list[LabelFile]:
    """The files of a sequence, sorted by name.

    Args:
        manifest: the split.
        sequence: one of its sequences.
        suffix: ending of the files, such as ``.xml``.

    Raises:
        ConfigError: the pattern gives the same files to sequences of different folders.
        DataError: no such folder; none of its files fits the pattern.
    """
    folder = label_folder(manifest, sequence)
    _, name = _split(manifest, sequence)
    endings = sorted(
        p for p in folder.iterdir() if p.suffix.lower() == suffix and p.name != CLASSES_FILE
    )
    if name is None:
        return [LabelFile(path, None) for path in endings]
    _refuse_sharing(manifest, sequence)
    numbered = [LabelFile(path, number) for number, path in PathPattern(name).find(folder)]
    if endings and not numbered:
        raise DataError(
            f"{folder}: none of its {len(endings)} {suffix} files, such as {endings[0].name}, fits "
            f"the pattern {name!r}. Check {KEY}."
        )
    return numbered


class FrameOfFile:
    """The frame of a label file, and a check that no two files claim the same one."""

    def __init__(self, footage: Footage) -> None:
        pattern = footage.manifest.annotations.path or ""
        self._stems = FrameNames(footage, KEY, pattern, without_suffix=True)
        self._names = FrameNames(footage, KEY, pattern)
        self._known = {frame.frame_index for frame in footage.frames}
        self._file_of: dict[int, Path] = {}

    def find(self, file: LabelFile, image_name: str = "") -> int | None:
        """The frame of a file, None = an image outside the slice.

        Args:
            file: the label file.
            image_name: the name of the image that the file itself gives, "" = none.

        Raises:
            DataError: several frames fit the file, or several files the frame.
        """
        index = (
            self._by_number(file) if file.number is not None else self._by_name(file, image_name)
        )
        if index is not None:
            first = self._file_of.setdefault(index, file.path)
            if first != file.path:
                raise DataError(
                    f"{file.path}: is of frame {index}, and so is {first.name}. "
                    "Leave one of them out."
                )
        return index

    def _by_number(self, file: LabelFile) -> int | None:
        return file.number if file.number in self._known else None

    def _by_name(self, file: LabelFile, image_name: str) -> int | None:
        by_stem = self._stems.find(file.path.stem, str(file.path))
        if not image_name:
            return by_stem
        by_content = self._names.find(image_name, str(file.path))
        if by_stem is not None and by_content is not None and by_stem != by_content:
            raise DataError(
                f"{file.path}: its name says frame {by_stem}, its <filename> {image_name!r} says "
                f"frame {by_content}. Correct the one that is wrong."
            )
        return by_content if by_stem is None else by_stem


def _split(manifest: Manifest, sequence: SequenceSection) -> tuple[Path, str | None]:
    """The folder, and the pattern of its files' names (None = all of them)."""
    pattern = manifest.annotations.path or ""
    if "{frame}" not in pattern:
        return manifest.path_in(sequence, pattern), None
    folder, _, name = sequence.fill(pattern).rpartition("/")
    if name.count("{frame}") != 1 or "{frame}" in folder:
        raise ConfigError(
            f"manifest {manifest.name}: {KEY} = {pattern!r}: {{frame}} must stand once, in the "
            "file's name, as in 'labels/{sequence}/{frame}.txt'."
        )
    if "{sequence}" in pattern:
        return manifest.root_path / folder, name
    return manifest.path_in(sequence, folder or "."), name


def _refuse_sharing(manifest: Manifest, sequence: SequenceSection) -> None:
    """Frame numbers alone cannot tell sequences apart."""
    own = _split(manifest, sequence)
    for other in manifest.sequences:
        if Path(other.path) != Path(sequence.path) and _split(manifest, other) == own:
            raise ConfigError(
                f"manifest {manifest.name}: {KEY} = {manifest.annotations.path!r} gives the same "
                f"files to {sequence.id} and {other.id}. Put {{sequence}} into it."
            )
