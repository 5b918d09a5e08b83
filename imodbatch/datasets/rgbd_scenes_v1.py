"""UW RGB-D Scenes v1: <scene>/<scene>_<k>/<scene>_<k>_<n>.png and …_<n>_depth.png, n from 1.

The first release has no poses. A later one, `rgbd-scenes_aligned`, has a `.pose` file per sequence;
it is found in the sequence's folder, or in the folder `rgbd-scenes_aligned` beside the root.
"""

from collections.abc import Sequence
from pathlib import Path

from imodbatch.datasets.base import FrameFile, Odometry
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.trajectories import read_odometry, trajectory_files
from imodbatch.datasets.uw_kinect import cameras, paired_frames
from imodbatch.manifest import Manifest, OdometrySection, SequenceSection

__all__ = ["cameras", "frames", "odometry", "odometry_files", "reference", "reference_files"]

ALIGNED = "rgbd-scenes_aligned"
FIRST_FRAME = 1


def frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """Frames of a sequence's folder; its name stands in the files' names, too."""
    return [f for f in _all_frames(manifest, sequence) if sequence.keeps(f.frame_index)]


def _all_frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    folder = manifest.root_path / sequence.path
    color = PathPattern(f"{folder.name}_{{frame}}.png")
    depth = PathPattern(f"{folder.name}_{{frame}}_depth.png")
    return paired_frames(manifest.root_path, folder, color, depth)


def odometry(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],  # noqa: ARG001
) -> Odometry | None:
    """Poses of the aligned release, or what `[odometry]` points at instead."""
    return _read(manifest.odometry or _aligned(manifest, sequence), manifest, sequence)


def odometry_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The file behind `odometry`."""
    return _files(manifest.odometry or _aligned(manifest, sequence), manifest, sequence)


def reference(manifest: Manifest, sequence: SequenceSection) -> Odometry | None:
    """Poses of the aligned release, or what `[reference]` points at instead."""
    return _read(manifest.reference or _aligned(manifest, sequence), manifest, sequence)


def reference_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The file behind `reference`."""
    return _files(manifest.reference or _aligned(manifest, sequence), manifest, sequence)


def _aligned(manifest: Manifest, sequence: SequenceSection) -> OdometrySection | None:
    """The aligned release's poses of a sequence, None = they are not there."""
    folder = manifest.root_path / sequence.path
    beside_root = manifest.root_path.resolve().parent / ALIGNED / sequence.path
    for place in (folder, beside_root):
        path = place / f"{folder.name}.pose"
        if path.is_file():
            return OdometrySection(format="uw", path=str(path.resolve()))
    return None


def _read(
    section: OdometrySection | None, manifest: Manifest, sequence: SequenceSection
) -> Odometry | None:
    if section is None:
        return None
    all_frames = _all_frames(manifest, sequence)
    return read_odometry(section, manifest, sequence, all_frames, FIRST_FRAME)


def _files(
    section: OdometrySection | None, manifest: Manifest, sequence: SequenceSection
) -> list[Path]:
    return [] if section is None else trajectory_files(section, manifest, sequence)
