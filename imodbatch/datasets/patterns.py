"""Path patterns such as ``depth/{frame}.png``: which files fit, and which number each has."""

import re
from functools import cached_property
from pathlib import Path

from imodbatch.core.errors import ConfigError

FIELDS = {"frame": r"(?P<frame>\d+)", "stamp": r"(?P<stamp>\d+(?:\.\d+)?)", "name": r"(?P<name>.+)"}


class PathPattern:
    """A relative path with exactly one of {frame}, {stamp}, {name} in its last part.

    Attributes:
        field: which one.
    """

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern
        found = re.findall(r"\{(\w+)\}", pattern)
        name = pattern.rsplit("/", 1)[-1]
        if len(found) != 1 or found[0] not in FIELDS or f"{{{found[0]}}}" not in name:
            raise ConfigError(
                f"pattern {pattern!r}: expected exactly one of {{frame}}, {{stamp}}, {{name}}, "
                "in the file's name, such as 'color/{frame}.png'."
            )
        self.field: str = found[0]

    @cached_property
    def _folder_and_regex(self) -> tuple[str, re.Pattern[str]]:
        folder, _, name = self.pattern.rpartition("/")
        before, after = name.split(f"{{{self.field}}}")
        return folder, re.compile(re.escape(before) + FIELDS[self.field] + re.escape(after))

    def values(self, base: Path) -> dict[str, Path]:
        """Field text → file, for every file below `base` that fits."""
        folder, regex = self._folder_and_regex
        place = base / folder
        if not place.is_dir():
            return {}
        matches = ((regex.fullmatch(path.name), path) for path in place.iterdir())
        return {match[self.field]: path for match, path in matches if match}

    def find(self, base: Path) -> list[tuple[int, Path]]:
        """Numbered files in rising order.

        A ``{frame}`` is its own number; ``{stamp}`` and ``{name}`` are numbered from 0 in order.
        """
        values = self.values(base)
        if self.field == "frame":
            return sorted((int(text), path) for text, path in values.items())
        ordered = sorted(values, key=float if self.field == "stamp" else natural_key)
        return [(number, values[text]) for number, text in enumerate(ordered)]


def natural_key(text: str) -> list[tuple[int, int | str]]:
    """Sort key in which frame_10 follows frame_9."""
    return [(0, int(p)) if p.isdecimal() else (1, p) for p in re.split(r"(\d+)", text) if p]
