"""Text files with a row per line, columns between blanks or commas, and # for comments."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError, one_line

Row = tuple[str, list[str]]
"""File and line, for errors; and the columns."""


def read_lines(path: Path, cure: str) -> list[str]:
    """The lines of a text file.

    Raises:
        DataError: it is missing or no text; ends with the cure.
    """
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise DataError(f"{path}: no such file. {cure}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as text ({one_line(error)}). {cure}") from None


def read_rows(path: Path, cure: str) -> list[Row]:
    """The lines that hold more than a comment, as columns.

    Raises:
        DataError: it is missing or no text; ends with the cure.
    """
    lines = enumerate(read_lines(path, cure), start=1)
    rows = ((n, line.split("#", 1)[0].replace(",", " ").split()) for n, line in lines)
    return [(f"{path}, line {n}", columns) for n, columns in rows if columns]


def check_width(rows: list[Row], widths: tuple[int, ...], cure: str) -> None:
    """Check the number of columns; the first line says which of several the file has.

    Raises:
        DataError: a line has another number; ends with the cure.
    """
    for where, columns in rows:
        if len(columns) not in widths:
            raise DataError(
                f"{where}: expected {' or '.join(map(str, widths))} numbers, found "
                f"{len(columns)}. {cure}"
            )
        widths = (len(columns),)


def read_numbers(path: Path, widths: tuple[int, ...], cure: str) -> NDArray[np.float64]:
    """Numbers, perhaps NaN or infinite, (lines, one of `widths`).

    Raises:
        DataError: it is missing, or a line has another number of columns or something that is no
            number; ends with the cure.
    """
    rows = read_rows(path, cure)
    check_width(rows, widths, cure)
    numbers = [[number(text, where, cure) for text in columns] for where, columns in rows]
    return np.array(numbers, dtype=np.float64).reshape(-1, len(rows[0][1]) if rows else widths[0])


def number(text: str, where: str, cure: str) -> float:
    """A number, perhaps NaN or infinite.

    Raises:
        DataError: it is none; ends with the cure.
    """
    try:
        return float(text)
    except ValueError:
        raise DataError(f"{where}: {text[:30]!r} is no number. {cure}") from None
