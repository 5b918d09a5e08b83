"""What a step of a run may use besides its tables: manifest, settings, images, the run's folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage, register
from imodbatch.datasets.images import read_color, read_depth
from imodbatch.datasets.registry import camera_model
from imodbatch.settings.config import Pipeline
from imodbatch.settings.manifest import Manifest


@dataclass(frozen=True)
class Context:
    """All that a step may use besides its tables; `run_dir` is where the run's files lie."""

    manifest: Manifest
    pipeline: Pipeline
    run_dir: Path

    @property
    def n_classes(self) -> int:
        """K."""
        return len(self.manifest.classes)

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


def camera_of(row: Any, prefix: str = "") -> PinholeCamera:
    """The colour camera of a frames row; prefix ``depth_``: its depth camera."""
    names = PinholeCamera.__dataclass_fields__
    return PinholeCamera(**{name: row[f"{prefix}{name}"] for name in names})
