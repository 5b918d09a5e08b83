"""Files and folders that a reader finds as they were or as they are to be, never in part.

What is written first gets a name of its own in the same folder, ``.NAME.<8 hex digits>.partial``,
and then takes its place by renaming. A leading dot: dataset readers skip it. No two writers share
one.
"""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import BinaryIO

SUFFIX = ".partial"


@contextmanager
def replacing(path: Path, sync: bool = True) -> Iterator[BinaryIO]:
    """An open binary file that takes the place of `path` when the block ends without an error.

    Args:
        path: of the file.
        sync: wait until the disk holds it. Without, a power cut can leave it short: only for files
            whose lengths are kept in a record that is held against them.

    Raises:
        OSError: the folder is not there or cannot be written.
    """
    partial = _partial(path)
    file = partial.open("xb")  # x: made here, and never through a symbolic link
    try:
        with file:
            yield file
            if sync:
                file.flush()
                os.fsync(file.fileno())
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def write_bytes(path: Path, content: bytes, sync: bool = True) -> None:
    """Write a whole file; `sync` as in `replacing`."""
    with replacing(path, sync) as file:
        file.write(content)


def write_text(path: Path, text: str) -> None:
    """Write a whole file as UTF-8, its line ends as they are."""
    write_bytes(path, text.encode())


@contextmanager
def scratch_folder(path: Path) -> Iterator[Path]:
    """An empty folder beside `path` that is removed when the block ends.

    What killed runs left of the same name is removed first.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    for left in path.parent.glob(f".{escape(path.name)}.????????{SUFFIX}"):
        shutil.rmtree(left, ignore_errors=True)
    folder = _partial(path)
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """An empty folder that takes the place of `path` when the block ends without an error."""
    with scratch_folder(path) as folder:
        yield folder
        shutil.rmtree(path, ignore_errors=True)
        folder.replace(path)


def sweep(folder: Path) -> None:
    """Remove what killed runs left anywhere in a folder; only for who has it for himself."""
    for left in sorted(folder.rglob(f".*{SUFFIX}"), reverse=True):
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left)
        else:
            left.unlink(missing_ok=True)


def _partial(path: Path) -> Path:
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}{SUFFIX}")
