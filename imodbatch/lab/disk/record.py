"""The record that data are whole: what they were made with, and every file's length.

It is written last. So a run that broke off, a lost or shortened file and other settings are all
noticed, and the data are made again.
"""

import json
from pathlib import Path
from typing import Any

from imodbatch.tables.atomic import write_text

Settings = dict[str, Any]
Sizes = dict[str, int]


def sizes_beside(record: Path) -> Sizes:
    """Every file's length in bytes, by path within the record's folder; its own is left out."""
    files = sorted(path for path in record.parent.rglob("*") if path.is_file())
    return {
        path.relative_to(record.parent).as_posix(): path.stat().st_size
        for path in files
        if path != record
    }


def write_record(record: Path, settings: Settings, sizes: Sizes | None = None) -> None:
    """Say that the data are whole; `sizes`: of the files that count, None = all beside it."""
    found = sizes_beside(record) if sizes is None else sizes
    write_text(record, json.dumps({"settings": settings, "bytes": found}, indent=1) + "\n")


def is_whole(record: Path, settings: Settings, sizes: Sizes | None = None) -> bool:
    """Whether what was made with these settings lies there with every file in its full length.

    Args:
        record: as `write_record` wrote it.
        settings: that are wanted.
        sizes: of the files that count as they lie there; None = all beside it.
    """
    try:
        done = json.loads(record.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    found = sizes_beside(record) if sizes is None else sizes
    return bool(done == {"settings": settings, "bytes": found})
