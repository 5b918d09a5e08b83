"""TUM RGB-D: rgb.txt and depth.txt (a stamp and a path per line), groundtruth.txt (a trajectory).

A frame's number is the ordinal of its line in rgb.txt, so it does not hang on which depth images
there are. Colour and depth were taken at different moments: each colour image takes the depth image
nearest in time, one to one, within ``images.max_gap_ms``; one without keeps its frame.

Depth is registered to colour. The intrinsics are those that the benchmark publishes for its three
cameras, told apart by the folder's name. Images of freiburg1 and freiburg2 are distorted, and that
is not undone.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.trajectory import associate
from imodbatch.datasets.base import (
    NS_PER_MS,
    CameraModel,
    Extras,
    FrameFile,
    Odometry,
    nanoseconds,
)
from imodbatch.datasets.trajectories import read_odometry, trajectory_files
from imodbatch.errors import ConfigError, DataError
from imodbatch.manifest import ImagesSection, Manifest, OdometrySection, SequenceSection

COLOR_LIST, DEPTH_LIST = "rgb.txt", "depth.txt"
TRUE_POSES = OdometrySection(format="tum", path="{sequence}/groundtruth.txt")
DEPTH_SCALE_M = 1 / 5000
SERIES = re.compile(r"rgbd_dataset_freiburg([123])(?!\d)")
INTRINSICS_PX = {
    "1": (517.3, 516.5, 318.6, 255.3),
    "2": (520.9, 521.0, 325.1, 249.7),
    "3": (535.4, 539.2, 320.1, 247.6),
}
"""By series: fx, fy, cx, cy as published, where a pixel's middle has whole numbers."""
OTHER_PX = (525.0, 525.0, 319.5, 239.5)
"""Of a Kinect as the driver assumes it, for folders of another name."""

Listed = list[tuple[int, str]]


def frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """The lines of rgb.txt, each with the depth image nearest in time.

    Raises:
        ConfigError: `[images]` names patterns, which this layout does not have.
        DataError: a list is missing or damaged, rgb.txt is not in order of time, or no depth image
            lies near any colour image.
    """
    return [f for f in _all_frames(manifest, sequence) if sequence.keeps(f.frame_index)]


def _all_frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    max_gap_ms = _max_gap_ms(manifest)
    folder = manifest.root_path / sequence.path
    color = _read_list(folder / COLOR_LIST)
    _refuse_if_not_in_order(color, folder / COLOR_LIST)
    depth = _read_list(folder / DEPTH_LIST)
    partner = _partners(color, depth, max_gap_ms, folder)
    below = PurePosixPath(sequence.path)
    return [
        FrameFile(
            number,
            stamp_ns,
            (below / path).as_posix(),
            (below / depth[j][1]).as_posix() if j >= 0 else None,
        )
        for number, ((stamp_ns, path), j) in enumerate(zip(color, partner, strict=True))
    ]


def cameras(manifest: Manifest) -> CameraModel:
    """The camera where no sequence is named."""
    return _camera(manifest, OTHER_PX)


def sequence_cameras(manifest: Manifest, sequence: SequenceSection) -> CameraModel:
    """The camera of a sequence, by the last folder on its path that is called as TUM's are."""
    series = SERIES.findall((manifest.root_path / sequence.path).as_posix())
    return _camera(manifest, INTRINSICS_PX[series[-1]] if series else OTHER_PX)


def odometry(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],  # noqa: ARG001
) -> Odometry | None:
    """The true poses, or what `[odometry]` points at instead."""
    all_frames = _all_frames(manifest, sequence)
    return read_odometry(manifest.odometry or TRUE_POSES, manifest, sequence, all_frames)


def odometry_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The file behind `odometry`."""
    return trajectory_files(manifest.odometry or TRUE_POSES, manifest, sequence)


def reference(manifest: Manifest, sequence: SequenceSection) -> Odometry | None:
    """The true poses, if there are any, or what `[reference]` points at instead."""
    files = reference_files(manifest, sequence)
    if manifest.reference is None and not files[0].is_file():
        return None
    all_frames = _all_frames(manifest, sequence)
    return read_odometry(manifest.reference or TRUE_POSES, manifest, sequence, all_frames)


def reference_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The file behind `reference`."""
    return trajectory_files(manifest.reference or TRUE_POSES, manifest, sequence)


def list_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The two lists of images."""
    folder = manifest.root_path / sequence.path
    return [folder / COLOR_LIST, folder / DEPTH_LIST]


def _camera(manifest: Manifest, intrinsics_px: tuple[float, float, float, float]) -> CameraModel:
    """One camera for both images: depth follows a colour camera that the manifest gives."""
    section = manifest.camera
    fx, fy, cx, cy = intrinsics_px
    color = PinholeCamera(640, 480, fx, fy, cx + 0.5, cy + 0.5)
    if section.color is not None:
        color = section.color.camera(section.pixel_origin)
    return CameraModel(color, color, DEPTH_SCALE_M, (0,))


def _max_gap_ms(manifest: Manifest) -> float:
    images = manifest.images or ImagesSection()
    if others := images.model_fields_set - {"max_gap_ms"}:
        raise ConfigError(
            f"manifest {manifest.name}: images.{min(others)} means nothing to the adapter 'tum', "
            f"which takes images from {COLOR_LIST} and {DEPTH_LIST}. Take it out, or use the "
            "adapter 'folder'."
        )
    return images.max_gap_ms


def _read_list(path: Path) -> Listed:
    """Moments in nanoseconds and paths below the sequence's folder, in the order of the file."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise DataError(
            f"{path}: no such file. A sequence of TUM RGB-D has {COLOR_LIST} and {DEPTH_LIST}, "
            "empty where there are no such images. Check root and sequences.path."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as text ({error}).") from None
    rows: Listed = []
    for number, line in enumerate(lines, start=1):
        parts = line.split("#", 1)[0].replace(",", " ").split()
        if not parts:
            continue
        if len(parts) != 2:
            raise DataError(
                f"{path}, line {number}: expected a stamp in seconds and a path, found "
                f"{len(parts)} columns. Correct the line."
            )
        if parts[1].startswith("/"):
            raise DataError(
                f"{path}, line {number}: {parts[1]!r} is no path from the sequence's folder. "
                "Correct the line."
            )
        try:
            rows.append((nanoseconds(parts[0]), parts[1]))
        except ValueError as error:
            raise DataError(
                f"{path}, line {number}: {error}. Expected a stamp in seconds, then a path."
            ) from None
    return rows


def _refuse_if_not_in_order(color: Listed, path: Path) -> None:
    """Frames are fused in the order of their numbers, so that must be the order of time."""
    if not color:
        raise DataError(f"{path}: lists no image. Expected a stamp and a path per line.")
    for (before_ns, _), (stamp_ns, name) in pairwise(color):
        if stamp_ns <= before_ns:
            what = "has the same stamp as" if stamp_ns == before_ns else "is earlier than"
            raise DataError(
                f"{path}: {name} {what} the image listed before it. Sort the lines by stamp, each "
                "moment once."
            )


def _partners(color: Listed, depth: Listed, max_gap_ms: float, folder: Path) -> NDArray[np.int64]:
    """For each colour image the row of its depth image, −1 = none."""
    color_ns, depth_ns = (np.array([ns for ns, _ in rows], np.int64) for rows in (color, depth))
    partner = associate(color_ns, depth_ns, round(max_gap_ms * NS_PER_MS))
    if len(depth) and (partner < 0).all():
        ordered = np.sort(depth_ns)
        after = np.searchsorted(ordered, color_ns)
        around = np.stack([after - 1, after]).clip(0, len(ordered) - 1)
        nearest_ms = int(np.abs(ordered[around] - color_ns).min()) / NS_PER_MS
        raise DataError(
            f"{folder}: no image of {DEPTH_LIST} lies within {max_gap_ms:g} ms of one of "
            f"{COLOR_LIST}; the nearest two are {nearest_ms:.3f} ms apart. Raise "
            "images.max_gap_ms above that, or check that both lists are of one recording."
        )
    return partner


EXTRAS = Extras(cameras=sequence_cameras, files=list_files)
