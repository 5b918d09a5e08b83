"""PASCAL VOC: an XML file per image; boxes are inclusive pixels counted from 1.

The pixels l to r, counted from 1 and both included, are the continuous interval [l - 1, r].
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from imodbatch.core.errors import DataError, one_line
from imodbatch.datasets.annotations.entries import Entry
from imodbatch.datasets.annotations.per_image import FrameOfFile, LabelFile, label_files
from imodbatch.datasets.base import Footage
from imodbatch.datasets.names import check_size

SUFFIX = ".xml"


def read_entries(footage: Footage) -> Iterator[Entry]:
    """The objects of all files, those of other images without a frame.

    Raises:
        ConfigError: the path cannot be meant.
        DataError: see `imodbatch.datasets.annotations.read_annotations`.
    """
    frame_of_file = FrameOfFile(footage)
    for file in label_files(footage.manifest, footage.sequence, SUFFIX):
        root = _root(file)
        image_name = root.findtext("filename", "").strip()
        index = frame_of_file.find(file, image_name)
        if index is not None:
            width, height = (_size(root, side, file) for side in ("width", "height"))
            check_size(width, height, footage.size_px, str(file.path))
        for number, element in enumerate(root.findall("object"), start=1):
            yield _entry(element, index, f"{file.path}: object {number}")


def _root(file: LabelFile) -> ET.Element:
    try:
        root = ET.parse(file.path).getroot()
    except (OSError, ET.ParseError, ValueError) as error:
        raise DataError(
            f"{file.path}: is not XML ({one_line(error)}). Write it again or take it out."
        ) from None
    if root.tag != "annotation":
        raise DataError(
            f"{file.path}: holds <{root.tag}>, expected <annotation> (PASCAL VOC). Take it out of "
            "the folder, or check annotations.format."
        )
    return root


def _entry(element: ET.Element, index: int | None, where: str) -> Entry:
    name = element.findtext("name", "").strip()
    if not name:
        raise DataError(f"{where} has no <name>. Add it to the file.")
    left, top, right, bottom = (
        _number(element, f"bndbox/{side}", where) for side in ("xmin", "ymin", "xmax", "ymax")
    )
    difficult = element.findtext("difficult", "").strip() or "0"
    if difficult not in ("0", "1"):
        raise DataError(f"{where}: <difficult> is {difficult!r}. Expected 0 or 1.")
    return Entry(
        where, index, name, (left - 1, top - 1, right, bottom), is_ignored=difficult == "1"
    )


def _number(element: ET.Element, tag: str, where: str) -> float:
    text = element.findtext(tag)
    if text is None:
        raise DataError(f"{where} has no <{tag}>. Add it to the file.")
    try:
        return float(text)
    except ValueError:
        raise DataError(f"{where}: <{tag}> is {text!r}. Expected a number of pixels.") from None


def _size(root: ET.Element, side: str, file: LabelFile) -> float:
    """Width or height of the image in pixels, 0 = not said."""
    if root.find(f"size/{side}") is None:
        return 0
    size = _number(root, f"size/{side}", str(file.path))
    return int(size) if size.is_integer() else size
