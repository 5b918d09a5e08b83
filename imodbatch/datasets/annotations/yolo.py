"""YOLO text: a file per image, a line per box: class, centre, width and height.

The four numbers are shares of the image's width and height. An image without a file has no objects.
The class is a number from 0; its name stands in `annotations.names` or in a classes.txt.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.datasets.annotations.entries import Entry
from imodbatch.datasets.annotations.per_image import (
    CLASSES_FILE,
    FrameOfFile,
    label_files,
    label_folder,
)
from imodbatch.datasets.base import Footage
from imodbatch.datasets.text import read_lines
from imodbatch.settings.manifest import Manifest, SequenceSection

SUFFIX = ".txt"
LARGEST_SHARE = 2.0
"""A share beyond it cannot be meant: the numbers are pixels."""


def files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The text files, and the file of the classes' names if they come from there.

    Raises:
        ConfigError: the path cannot be meant.
        DataError: the folder is missing.
    """
    labels = [file.path for file in label_files(manifest, sequence, SUFFIX)]
    names = None if manifest.annotations.names else _classes_file(manifest, sequence)
    return [*labels, names] if names else labels


def read_entries(footage: Footage) -> Iterator[Entry]:
    """The boxes of all files, those of other images without a frame.

    Raises:
        ConfigError: nothing says the classes' names; the path cannot be meant.
        DataError: see `imodbatch.datasets.annotations.read_annotations`.
    """
    labels = label_files(footage.manifest, footage.sequence, SUFFIX)
    names = _names(footage.manifest, footage.sequence)
    frame_of_file = FrameOfFile(footage)
    for file in labels:
        index = frame_of_file.find(file)
        try:
            yield from list(_entries(file.path, index, names, *footage.size_px))
        except DataError:
            # A text file that bears no frame's name may be anything: a README, a list of images.
            if index is not None:
                raise


def _entries(
    path: Path, index: int | None, names: Sequence[str], width_px: int, height_px: int
) -> Iterator[Entry]:
    for number, line in enumerate(read_lines(path, "Write it again."), start=1):
        where = f"{path}: line {number}"
        fields = line.split()
        if not fields:
            continue
        try:
            class_number, (cx, cy, width, height) = int(fields[0]), map(float, fields[1:])
        except ValueError:
            raise DataError(
                f"{where}: {line.strip()!r}. Expected a class number and four shares of the image: "
                "centre x, centre y, width, height."
            ) from None
        if not 0 <= class_number < len(names):
            raise DataError(
                f"{where}: class {class_number}, but there are {len(names)} class names, counted "
                f"from 0. Complete annotations.names or {CLASSES_FILE}."
            )
        if max(map(abs, (cx, cy, width, height))) > LARGEST_SHARE:
            raise DataError(
                f"{where}: {line.strip()!r} are no shares of the image; are they pixels? Divide x "
                f"by {width_px} and y by {height_px}."
            )
        box = (
            (cx - width / 2) * width_px,
            (cy - height / 2) * height_px,
            (cx + width / 2) * width_px,
            (cy + height / 2) * height_px,
        )
        yield Entry(where, index, names[class_number], box)


def _names(manifest: Manifest, sequence: SequenceSection) -> Sequence[str]:
    if manifest.annotations.names:
        return manifest.annotations.names
    path = _classes_file(manifest, sequence)
    if path is None:
        raise ConfigError(
            f"manifest {manifest.name}: nothing says what the class numbers in "
            f"{label_folder(manifest, sequence)} mean. Set annotations.names = [...], or put a "
            f"{CLASSES_FILE} there with a name per line."
        )
    return [line.strip() for line in read_lines(path, "Write it again.") if line.strip()]


def _classes_file(manifest: Manifest, sequence: SequenceSection) -> Path | None:
    """The classes.txt beside the labels, in the folder above, or in the root."""
    folder = label_folder(manifest, sequence)
    places = [folder / CLASSES_FILE, manifest.root_path / CLASSES_FILE]
    if folder != manifest.root_path:
        places.insert(1, folder.parent / CLASSES_FILE)
    return next((path for path in places if path.is_file()), None)
