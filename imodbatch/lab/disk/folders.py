"""Whether a folder may be written to: nothing of a user's is mixed up or replaced."""

import re
from collections.abc import Collection
from pathlib import Path

from imodbatch.core.errors import DataError


def refuse_file(folder: Path) -> None:
    """Refuse a path that is a file.

    Raises:
        DataError: it is one.
    """
    if folder.exists() and not folder.is_dir():
        raise DataError(f"{folder}: is a file, expected a folder. Name another.")


def refuse_foreign(folder: Path, files: Collection[str], sequence: str, dataset: str) -> None:
    """Refuse a folder that holds anything which is not ours.

    Args:
        folder: need not be there.
        files: names that are ours.
        sequence: a regular expression for further ones.
        dataset: what ours is, such as ``a house dataset``.

    Raises:
        DataError: something foreign lies there, or `folder` is a file.
    """
    refuse_file(folder)
    names = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    foreign = [name for name in names if name not in files and not re.fullmatch(sequence, name)]
    if foreign:
        raise DataError(
            f"{folder}: holds {foreign[0]!r}, which is no part of {dataset}. "
            "Name an empty or new folder."
        )
