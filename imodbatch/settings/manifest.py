"""A dataset split as data: where it lies, how it is laid out, which cameras, classes, sequences.

Paths are relative to `root`, and `root` to the manifest; ``${NAME}`` is an environment variable.
``{sequence}`` in a path stands for the sequence's own `path`, ``{number}`` for the number that it
ends in, ``{frame}`` for a frame number.
A shipped manifest goes by name, and is read as if it lay in ``manifests`` of the working directory.
"""

import os
import re
from collections import Counter
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from imodbatch.core.errors import ConfigError
from imodbatch.settings.sections import (
    AnnotationsSection,
    CameraSection,
    DetectionsSection,
    ImagesSection,
    OdometrySection,
    ReferenceSection,
    SimulateSection,
    WorldSection,
    below_root,
)
from imodbatch.settings.shipped import find_shipped, is_name, shipped_folder
from imodbatch.settings.toml import StrictModel, read_toml, validate


class SequenceSection(StrictModel):
    """`[[sequences]]`: one walk through a scene; `n_frames` is what its folder should hold."""

    id: str
    path: str = "."
    frames: str | None = None
    n_frames: Annotated[int, Field(ge=1)] | None = None

    @field_validator("id")
    @classmethod
    def _is_a_file_name(cls, name: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
            raise ValueError("must be made of letters, digits, '.', '_', '-' (it names a file)")
        return name

    @field_validator("path")
    @classmethod
    def _is_below_the_root(cls, path: str) -> str:
        return below_root(path)

    @field_validator("frames")
    @classmethod
    def _is_a_slice(cls, text: str | None) -> str | None:
        if text is not None and not re.fullmatch(r"\d*:\d*(:[1-9]\d*)?", text):
            raise ValueError("must be start:stop or start:stop:step, such as '0:450'")
        return text

    def keeps(self, frame_index: int) -> bool:
        """Whether the slice holds a frame number of the dataset."""
        if self.frames is None:
            return True
        start, stop, step = [int(p) if p else None for p in (self.frames + "::").split(":")[:3]]
        if frame_index < (start or 0) or (stop is not None and frame_index >= stop):
            return False
        return (frame_index - (start or 0)) % (step or 1) == 0

    def fill(self, pattern: str) -> str:
        """A path of the manifest, with the sequence's path and number put in.

        Raises:
            ConfigError: a number is asked for, and the sequence's path does not end in one.
        """
        if "{number}" in pattern:
            number = re.search(r"\d+$", self.path.rstrip("/"))
            if number is None:
                raise ConfigError(
                    f"sequence {self.id!r}: path {self.path!r} has no number at its end to stand "
                    f"for {{number}} in {pattern!r}. Expected a path such as 'scene_01'."
                )
            pattern = pattern.replace("{number}", number[0])
        return pattern.replace("{sequence}", self.path)


class Manifest(StrictModel):
    """A dataset split, checked. `folder` is where the manifest lies."""

    name: str
    description: str = ""
    adapter: str
    root: str = "."
    classes: Annotated[tuple[str, ...], Field(min_length=1)]
    pipeline: str | None = None
    simulate: SimulateSection | None = None
    camera: CameraSection = CameraSection()
    world: WorldSection = WorldSection()
    images: ImagesSection | None = None
    odometry: OdometrySection | None = None
    reference: ReferenceSection | None = None
    annotations: AnnotationsSection = AnnotationsSection()
    detections: DetectionsSection | None = None
    sequences: Annotated[tuple[SequenceSection, ...], Field(min_length=1)]
    folder: Path = Field(default=Path(), exclude=True)

    @field_validator("name")
    @classmethod
    def _is_a_file_name(cls, name: str) -> str:
        return SequenceSection._is_a_file_name(name)

    @model_validator(mode="after")
    def _names_are_unique(self) -> "Manifest":
        for what, names in (
            ("classes", self.classes),
            ("sequences", [sequence.id for sequence in self.sequences]),
        ):
            name, count = Counter(names).most_common(1)[0]
            if count > 1:
                raise ValueError(f"{what}: {name!r} stands {count} times")
        return self

    @property
    def root_path(self) -> Path:
        """The dataset's root folder; the manifest's own need not be there."""
        return Path(os.path.normpath(self.folder / self.root))

    def pipeline_file(self, given: Path | None) -> Path | None:
        """The pipeline of a run: `given`, a name or path, else the manifest's; None = defaults.

        Raises:
            ConfigError: a name that no shipped pipeline bears.
        """
        if given is None and self.pipeline is not None:
            own = Path(self.pipeline)
            given = own if is_name(own) else self.folder / own
        return given and find_shipped(given, "pipeline", shipped_folder("pipelines"))

    def choose(self, ids: Collection[str]) -> tuple[SequenceSection, ...]:
        """Some of the sequences, in the manifest's order; all of them where none is named.

        Raises:
            ConfigError: an id that the manifest does not have.
        """
        known = [sequence.id for sequence in self.sequences]
        for name in ids:
            if name not in known:
                raise ConfigError(
                    f"--sequence {name}: not in manifest {self.name}. Known: {', '.join(known)}."
                )
        return tuple(s for s in self.sequences if not ids or s.id in ids)

    def path_in(self, sequence: SequenceSection, pattern: str) -> Path:
        """A file named in the manifest, for one sequence.

        With ``{sequence}`` in it the path is relative to the root, else it is looked for in the
        sequence's folder first and in the root second.
        """
        path = sequence.fill(pattern)
        beside = self.root_path / sequence.path / path
        is_beside = "{sequence}" not in pattern and beside.exists()
        return beside if is_beside else self.root_path / path


def load_manifest(name_or_path: Path) -> Manifest:
    """Read and check a manifest, a shipped one by its name.

    Raises:
        ConfigError: missing, not TOML, an unknown key, an unset environment variable.
    """
    path = find_shipped(name_or_path, "manifest", shipped_folder("manifests"))
    data = _expand(read_toml(path), str(path))
    if "folder" in data:
        raise ConfigError(f"{path}: folder: unknown key. Did you mean 'root'?")
    named = is_name(name_or_path)
    data["folder"] = Path.cwd() / "manifests" if named else path.resolve().parent
    return validate(Manifest, data, str(path))


def _expand(value: Any, where: str) -> Any:
    """Replace ${NAME} in every string."""
    if isinstance(value, dict):
        return {key: _expand(item, where) for key, item in value.items()}
    if isinstance(value, list):
        return [_expand(item, where) for item in value]
    if isinstance(value, str):
        return re.sub(r"\$\{(\w+)\}", lambda match: _variable(match[1], where), value)
    return value


def _variable(name: str, where: str) -> str:
    if name not in os.environ:
        raise ConfigError(
            f"{where}: the environment variable {name} is not set. "
            f"Set it to the folder that holds the data: export {name}=/path/to/data"
        )
    return os.environ[name]
