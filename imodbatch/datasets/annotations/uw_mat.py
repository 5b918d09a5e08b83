"""UW RGB-D Scenes v1: a MATLAB file per sequence; cell n of the variable `bboxes` is frame n.

A cell is empty or an array of structs with category, instance, top, bottom, left, right: inclusive
pixels counted from 1, so that the columns l to r are the continuous interval [l - 1, r].
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError, one_line
from imodbatch.datasets.annotations.entries import KEY, Entry, annotation_file
from imodbatch.datasets.base import Footage

VARIABLE = "bboxes"
SIDES = ("left", "top", "right", "bottom")
FIELDS = ("category", "instance", *SIDES)
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
HDF5_PLACES = (0, 512)  # MATLAB writes a text header of 512 bytes before it


def read_entries(footage: Footage) -> Iterator[Entry]:
    """The boxes of all cells, those of other frames without a frame.

    Raises:
        DataError: see `imodbatch.datasets.annotations.read_annotations`; fewer cells than frames.
    """
    path = annotation_file(footage.manifest, footage.sequence)
    cells = _cells(path)
    known = {frame.frame_index for frame in footage.frames}
    _refuse_frames_without_cell(path, len(cells), known)
    for number, cell in enumerate(cells, start=1):
        structs = np.asarray(cell)
        if structs.size == 0:
            continue
        _check_fields(structs, f"{path}: {VARIABLE}{{{number}}}")
        index = number if number in known else None
        for position, struct in enumerate(structs.ravel(), start=1):
            yield _entry(struct, index, f"{path}: {VARIABLE}{{{number}}}({position})")


def _cells(path: Path) -> list[Any]:
    """The cells of `bboxes`, in their order."""
    variables = _load(path)
    if VARIABLE not in variables:
        found = [name for name in variables if not name.startswith("__")]
        raise DataError(
            f"{path}: no variable {VARIABLE!r}, only {', '.join(found) or 'none at all'}. "
            f"Check {KEY} and annotations.format."
        )
    cells = np.asarray(variables[VARIABLE])
    if cells.dtype != object or cells.size != max(cells.shape, default=0):
        kind = "a cell" if cells.dtype == object else "an array, no cell,"
        shape = "×".join(map(str, cells.shape))
        raise DataError(
            f"{path}: {VARIABLE} is {kind} of size {shape}. Expected a 1×N cell, one per frame."
        )
    return list(cells.ravel())


def _load(path: Path) -> dict[str, Any]:
    """All variables of a MAT file of version 4 to 7.2."""
    from scipy.io import loadmat

    if _is_hdf5(path):
        raise DataError(
            f"{path}: is a MATLAB v7.3 file (HDF5), which is not read here. Save it again in "
            f"MATLAB with save(file, '{VARIABLE}', '-v7')."
        )
    try:
        loaded: dict[str, Any] = loadmat(path, appendmat=False)
    except Exception as error:  # scipy lets through whatever its parser meets in a damaged file
        reason = one_line(error) or type(error).__name__
        raise DataError(
            f"{path}: is no MAT file, or a damaged one ({reason}). Restore it, or check {KEY}."
        ) from None
    return loaded


def _is_hdf5(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(max(HDF5_PLACES) + len(HDF5_SIGNATURE))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}). Check {KEY}.") from None
    return any(head[place:].startswith(HDF5_SIGNATURE) for place in HDF5_PLACES)


def _refuse_frames_without_cell(path: Path, n_cells: int, known: set[int]) -> None:
    """A frame without a cell would pass for a frame without objects."""
    without = [number for number in known if not 1 <= number <= n_cells]
    if without:
        raise DataError(
            f"{path}: {n_cells} cells for frames numbered {min(known)} to {max(known)}; cells "
            f"count from 1, and {len(without)} frames have none. Check {KEY}, or leave those "
            f'frames out with sequences.frames = "1:{n_cells + 1}".'
        )


def _check_fields(structs: NDArray[Any], where: str) -> None:
    names = structs.dtype.names
    if names is None:
        raise DataError(
            f"{where}: holds {structs.dtype}, expected structs with {', '.join(FIELDS)}."
        )
    missing = [name for name in FIELDS if name not in names]
    if missing:
        raise DataError(
            f"{where}: no field {missing[0]!r}, only {', '.join(names)}. Add it to the file."
        )


def _entry(struct: Any, index: int | None, where: str) -> Entry:
    name = _text(struct["category"], where)
    left, top, right, bottom = (_number(struct[side], side, where) for side in SIDES)
    instance = _number(struct["instance"], "instance", where)
    if not instance.is_integer():
        raise DataError(f"{where}: instance is {instance:g}. Expected a whole number.")
    box = (left - 1, top - 1, right, bottom)
    return Entry(where, index, name, box, instance_id=f"{name}_{int(instance)}")


def _text(value: Any, where: str) -> str:
    """A char array."""
    bare = _bare(value)
    text = bare.strip() if isinstance(bare, str) else ""
    if not text:
        raise DataError(f"{where}: category is no name. Expected a char array such as 'cap'.")
    return text


def _number(value: Any, field: str, where: str) -> float:
    """A single real number of any type."""
    bare = _bare(value)
    if isinstance(bare, bool | int | float):
        return float(bare)
    shape = "×".join(map(str, np.shape(bare))) or type(bare).__name__
    raise DataError(f"{where}: {field} is not a single number ({shape}). Correct it.")


def _bare(value: Any) -> Any:
    """What is in an array, or a cell, of one."""
    while isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    return value
