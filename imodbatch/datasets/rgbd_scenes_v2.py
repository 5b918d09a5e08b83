"""UW RGB-D Scenes v2: imgs/scene_01/00000-color.png and …-depth.png, poses in pc/01.pose.

A sequence's `path` is its folder below ``imgs``. The number at its end names the files in ``pc``;
``{number}`` stands for it in the manifest's paths.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from imodbatch.datasets.base import FrameFile, Odometry
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.trajectories import read_odometry, trajectory_files
from imodbatch.datasets.uw_kinect import cameras, paired_frames
from imodbatch.errors import ConfigError, DataError
from imodbatch.manifest import Manifest, OdometrySection, SequenceSection

__all__ = [
    "cameras",
    "frames",
    "numbered_path",
    "odometry",
    "odometry_files",
    "reference",
    "reference_files",
]

IMAGES = "imgs"
POSES = OdometrySection(format="uw", path="pc/{number}.pose")
COLOR, DEPTH = PathPattern("{frame}-color.png"), PathPattern("{frame}-depth.png")


def frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """Frames of a ``scene_XX`` folder.

    Raises:
        DataError: there is no such folder below ``imgs``.
    """
    return [f for f in _all_frames(manifest, sequence) if sequence.keeps(f.frame_index)]


def _all_frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    folder = manifest.root_path / IMAGES / sequence.path
    if not folder.is_dir():
        raise DataError(
            f"{folder}: no such folder (sequence {sequence.id!r}). Correct root or sequences.path, "
            "such as 'scene_01'."
        )
    return paired_frames(manifest.root_path, folder, COLOR, DEPTH)


def numbered_path(pattern: str, sequence: SequenceSection) -> str:
    """A path of the manifest with the scene's number in the place of ``{number}``.

    Raises:
        ConfigError: the sequence's path does not end in a number.
    """
    if "{number}" not in pattern:
        return pattern
    number = re.search(r"\d+$", Path(sequence.path).name)
    if number is None:
        raise ConfigError(
            f"sequence {sequence.id!r}: path {sequence.path!r} has no number at its end to stand "
            f"for {{number}} in {pattern!r}. Expected a path such as 'scene_01'."
        )
    return pattern.replace("{number}", number[0])


def odometry(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],  # noqa: ARG001
) -> Odometry | None:
    """Poses beside the labelled cloud, or what `[odometry]` points at instead."""
    section = _section(manifest.odometry, sequence)
    return read_odometry(section, manifest, sequence, _all_frames(manifest, sequence))


def odometry_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The files behind `odometry`."""
    return trajectory_files(_section(manifest.odometry, sequence), manifest, sequence)


def reference(manifest: Manifest, sequence: SequenceSection) -> Odometry | None:
    """Poses beside the labelled cloud, if there are any, or what `[reference]` points at."""
    if not reference_files(manifest, sequence):
        return None
    section = _section(manifest.reference, sequence)
    return read_odometry(section, manifest, sequence, _all_frames(manifest, sequence))


def reference_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The files behind `reference`."""
    files = trajectory_files(_section(manifest.reference, sequence), manifest, sequence)
    return files if manifest.reference else [path for path in files if path.is_file()]


def _section(section: OdometrySection | None, sequence: SequenceSection) -> OdometrySection:
    chosen = section or POSES
    return chosen.model_copy(update={"path": numbered_path(chosen.path, sequence)})
