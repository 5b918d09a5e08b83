"""7-Scenes: frame-%06d.color.png|jpg, .depth.png (mm), .pose.txt (4×4 world_from_depth_camera).

The colour image is not registered to the depth image: depth has a focal length of 585 pixels,
colour about 525. The baseline between the cameras is not published and taken as 0 unless the
manifest gives `camera.color_from_depth`.
"""

from collections.abc import Sequence
from pathlib import Path

from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets.base import CameraModel, FrameFile, Odometry
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.trajectories import read_odometry, trajectory_files
from imodbatch.manifest import Manifest, OdometrySection, SequenceSection

POSES = OdometrySection(format="matrix", path="frame-{frame}.pose.txt", camera="depth")
DEPTH = PathPattern("frame-{frame}.depth.png")
COLOR = [PathPattern(f"frame-{{frame}}.color.{ending}") for ending in ("png", "jpg", "jpeg")]


def frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """Frames of a ``seq-XX`` folder."""
    return [f for f in _all_frames(manifest, sequence) if sequence.keeps(f.frame_index)]


def _all_frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    base, root = manifest.root_path / sequence.path, manifest.root_path
    color = {number: path for pattern in COLOR for number, path in pattern.find(base)}
    depth = dict(DEPTH.find(base))
    return [
        FrameFile(
            number,
            None,
            color[number].relative_to(root).as_posix(),
            depth[number].relative_to(root).as_posix() if number in depth else None,
        )
        for number in sorted(color)
    ]


def cameras(manifest: Manifest) -> CameraModel:  # noqa: ARG001
    """The intrinsics that the dataset's page and its users give."""
    return CameraModel(
        color=PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0),
        depth=PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0),
        depth_scale_m=0.001,
        depth_invalid=(0, 65535),
    )


def odometry(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],  # noqa: ARG001
) -> Odometry | None:
    """Poses beside the images, or what `[odometry]` points at instead."""
    all_frames = _all_frames(manifest, sequence)
    return read_odometry(manifest.odometry or POSES, manifest, sequence, all_frames)


def odometry_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The files behind `odometry`."""
    return trajectory_files(manifest.odometry or POSES, manifest, sequence)


def reference(manifest: Manifest, sequence: SequenceSection) -> Odometry | None:
    """The poses beside the images, if there are any, or what `[reference]` points at instead."""
    if not reference_files(manifest, sequence):
        return None
    all_frames = _all_frames(manifest, sequence)
    return read_odometry(manifest.reference or POSES, manifest, sequence, all_frames)


def reference_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The files behind `reference`."""
    return trajectory_files(manifest.reference or POSES, manifest, sequence)
