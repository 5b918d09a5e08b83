"""A run: which manifest, which settings, which sequences, and where its tables lie."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage, register
from imodbatch.core.errors import ConfigError
from imodbatch.datasets.images import read_color, read_depth
from imodbatch.datasets.registry import camera_model
from imodbatch.settings.config import Pipeline, load_pipeline
from imodbatch.settings.manifest import Manifest, SequenceSection


@dataclass(frozen=True)
class Plan:
    """A run, or the part of it that a step is done for: all that it may use besides its tables.

    Attributes:
        manifest: the dataset.
        pipeline: all settings.
        run_dir: where the tables lie.
        sequences: some of the manifest's, one at least.
        pipeline_name: for the report.
    """

    manifest: Manifest
    pipeline: Pipeline
    run_dir: Path
    sequences: tuple[SequenceSection, ...]
    pipeline_name: str = "default"

    @property
    def sequence(self) -> SequenceSection:
        """The only one; of a part that is the whole run, the first as a stand-in."""
        return self.sequences[0]

    @property
    def n_classes(self) -> int:
        """K."""
        return len(self.manifest.classes)

    def each(self) -> list["Plan"]:
        """The same for each sequence alone."""
        return [replace(self, sequences=(sequence,)) for sequence in self.sequences]

    def read_color(self, color_path: str) -> NDArray[np.uint8]:
        """Colour image of a path as the frames table gives it."""
        return read_color(self.manifest.root_path / color_path)

    def read_depth(self, row: Any) -> DepthImage:
        """Depth of a frame row, registered into the colour camera."""
        path = self.manifest.root_path / row["depth_path"]
        depth_m = read_depth(path, row["depth_scale_m"], camera_model(self.manifest).depth_invalid)
        baseline = row["color_from_depth"]
        return register(
            depth_m,
            camera_of(row, "depth_"),
            camera_of(row),
            None if baseline is None else np.reshape(baseline, (4, 4)),
        )


def make_plan(
    manifest: Manifest,
    pipeline: Path | None = None,
    out: Path | None = None,
    sequences: Collection[str] = (),
    settings: Sequence[str] = (),
) -> Plan:
    """The run that a command line means.

    Args:
        manifest: the dataset.
        pipeline: a name or path; None = the manifest's own, or all defaults.
        out: where the tables lie; None = where `run` puts them.
        sequences: ids; none = all.
        settings: ``section.key=value``, laid over the pipeline's.

    Raises:
        ConfigError: no such pipeline, setting or sequence, or `out` is a file.
    """
    file = manifest.pipeline_file(pipeline)
    run_dir = (out or default_run_dir(manifest.name, file)).absolute()
    if run_dir.exists() and not run_dir.is_dir():
        raise ConfigError(f"{run_dir}: is a file, expected a folder. Name another --out.")
    checked = load_pipeline(file, settings)
    return Plan(manifest, checked, run_dir, manifest.choose(sequences), _name(file))


def default_run_dir(manifest_name: str, pipeline: Path | None) -> Path:
    """Where a run's tables go if nobody says, relative to the working directory."""
    return Path("runs") / f"{manifest_name}--{_name(pipeline)}"


def _name(pipeline: Path | None) -> str:
    """What a pipeline is called: its file's name, or that of all defaults."""
    return "default" if pipeline is None else pipeline.stem


def camera_of(row: Any, prefix: str = "") -> PinholeCamera:
    """The colour camera of a frames row; prefix ``depth_``: its depth camera."""
    names = PinholeCamera.__dataclass_fields__
    return PinholeCamera(**{name: row[f"{prefix}{name}"] for name in names})
