"""Points of a PLY file: the scalar properties of its vertices, in text or binary of either order.

Faces and all else that follows the vertices are not looked at.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_LINE = 1000


@dataclass(frozen=True)
class Header:
    """What stands before the vertices: their form, number and properties (name, numpy type)."""

    form: str
    n_vertices: int
    properties: list[tuple[str, str]]


def read_points(path: Path) -> NDArray[np.float64]:
    """Vertices x, y, z of a PLY file, (N, 3), in the file's order and unit.

    Raises:
        DataError: missing, no PLY file, cut short, or without x, y, z.
    """
    try:
        with path.open("rb") as file:
            header = _read_header(file, path)
            names = [name for name, _ in header.properties]
            missing = [axis for axis in "xyz" if axis not in names]
            if missing:
                raise DataError(
                    f"{path}: its vertices have no {missing[0]!r}, only {', '.join(names)}. "
                    "Export the cloud again with x, y, z."
                )
            vertices = _read_vertices(file, header, path)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}). Check its path.") from None
    return np.stack([vertices[axis] for axis in "xyz"], axis=-1).astype(np.float64)


def _read_header(file: BinaryIO, path: Path) -> Header:
    if file.readline(LONGEST_LINE).strip() != b"ply":
        raise DataError(f"{path}: is no PLY file: its first line is not 'ply'. Check its path.")
    form, elements = "", list[tuple[str, int]]()
    properties: dict[str, str] = {}
    while (line := file.readline(LONGEST_LINE)).strip() != b"end_header":
        words = line.decode("ascii", errors="replace").split()
        match words:
            case ["comment" | "obj_info", *_]:
                pass
            case ["format", name, _] if name in BYTE_ORDERS:
                form = name
            case ["element", name, count] if form and count.isdecimal():
                elements.append((name, int(count)))
            case ["property", *_] if len(elements) > 1:
                pass
            case ["property", kind, name] if elements and kind in TYPES and name not in properties:
                properties[name] = BYTE_ORDERS[form] + TYPES[kind]
            case _:
                shown = " ".join(words) or "the end of the file"
                raise DataError(
                    f"{path}: its PLY header cannot be read at {shown!r}. Export the cloud again."
                )
    if not elements or elements[0][0] != "vertex":
        raise DataError(
            f"{path}: its PLY header does not begin with the vertices. Export the cloud again."
        )
    return Header(form, elements[0][1], list(properties.items()))


def _read_vertices(file: BinaryIO, header: Header, path: Path) -> NDArray[np.void]:
    """All properties of all vertices as a structured array (N,)."""
    n_vertices, dtype = header.n_vertices, np.dtype(header.properties)
    if header.form == "ascii":
        lines = itertools.islice(file, n_vertices)
        try:
            vertices = np.loadtxt(lines, [(name, "f8") for name in dtype.names or ()], ndmin=1)
        except ValueError:
            raise DataError(
                f"{path}: its vertices are not {n_vertices} lines of {len(header.properties)} "
                "numbers. Restore it or export the cloud again."
            ) from None
    else:
        # No more than there is: a damaged header may name any number.
        n_left = path.stat().st_size - file.tell()
        content = file.read(min(n_vertices * dtype.itemsize, n_left))
        vertices = np.frombuffer(content[: len(content) // dtype.itemsize * dtype.itemsize], dtype)
    if len(vertices) < n_vertices:
        raise DataError(
            f"{path}: cut short: {len(vertices):,} of {n_vertices:,} vertices. Restore it."
        )
    return vertices
