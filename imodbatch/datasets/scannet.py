"""ScanNet as its exporter writes it: color/%d.jpg, depth/%d.png (mm), pose/%d.txt, intrinsic/.

Poses are 4×4 world_from_cam; frames whose tracking was lost hold −inf. Each scene was scanned by a
device of its own, so each sequence has its own intrinsics: ``intrinsic/intrinsic_color.txt`` and
``intrinsic_depth.txt``, 4×4 matrices. Colour and depth have different resolutions and, by the
authors' word, one place: the extrinsics that are exported with them are identities.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets.base import CameraModel, Extras, FrameFile, Odometry
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.trajectories import read_odometry, trajectory_files
from imodbatch.errors import DataError
from imodbatch.images import UnreadableImageError, probe
from imodbatch.manifest import Manifest, OdometrySection, SequenceSection

POSES = OdometrySection(format="matrix", path="pose/{frame}.txt")
DEPTH = PathPattern("depth/{frame}.png")
COLOR = [PathPattern(f"color/{{frame}}.{ending}") for ending in ("png", "jpeg", "jpg")]
TYPICAL_COLOR = PinholeCamera(1296, 968, 1170.19, 1170.19, 648.25, 484.25)
TYPICAL_DEPTH = PinholeCamera(640, 480, 577.87, 577.87, 320.0, 240.0)
NAMES = ("intrinsic_color", "intrinsic_depth", "extrinsic_color", "extrinsic_depth")
FARTHEST_CENTER = 0.1
"""Of the principal point from the image's middle, over the image's side; scenes stay below 0.03."""


def frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """The colour images by number, each with the depth image of that number."""
    return [f for f in _all_frames(manifest, sequence) if sequence.keeps(f.frame_index)]


def _all_frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    base, root = manifest.root_path / sequence.path, manifest.root_path
    depth = dict(DEPTH.find(base))
    return [
        FrameFile(
            number,
            None,
            path.relative_to(root).as_posix(),
            depth[number].relative_to(root).as_posix() if number in depth else None,
        )
        for number, path in _color_files(base)
    ]


def cameras(manifest: Manifest) -> CameraModel:  # noqa: ARG001
    """Cameras such as those of most scenes, where no sequence is named; no file is read."""
    return CameraModel(TYPICAL_COLOR, TYPICAL_DEPTH, depth_scale_m=0.001, depth_invalid=(0,))


def sequence_cameras(manifest: Manifest, sequence: SequenceSection) -> CameraModel:
    """A scene's own cameras; what the manifest gives is not looked for in files.

    Raises:
        DataError: an intrinsics file is missing or damaged, does not fit the images, or the two
            cameras stand apart.
    """
    given, base = manifest.camera, manifest.root_path / sequence.path
    color, depth = TYPICAL_COLOR, TYPICAL_DEPTH
    if given.color is None:
        files = (path for _, path in _color_files(base))
        color = _camera(_file(base, "intrinsic_color"), files, color, "camera.color")
    if given.depth is None or given.depth.intrinsics() is None:
        files = (path for _, path in DEPTH.find(base))
        depth = _camera(_file(base, "intrinsic_depth"), files, depth, "camera.depth")
    if given.color_from_depth is None:
        _refuse_if_apart(base)
    return CameraModel(color, depth, depth_scale_m=0.001, depth_invalid=(0,))


def odometry(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],  # noqa: ARG001
) -> Odometry | None:
    """The scan's poses, or what `[odometry]` points at instead."""
    all_frames = _all_frames(manifest, sequence)
    return read_odometry(manifest.odometry or POSES, manifest, sequence, all_frames)


def odometry_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The files behind `odometry`."""
    return trajectory_files(manifest.odometry or POSES, manifest, sequence)


def reference(manifest: Manifest, sequence: SequenceSection) -> Odometry | None:
    """The scan's poses, if there are any, or what `[reference]` points at instead."""
    if not reference_files(manifest, sequence):
        return None
    all_frames = _all_frames(manifest, sequence)
    return read_odometry(manifest.reference or POSES, manifest, sequence, all_frames)


def reference_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The files behind `reference`."""
    return trajectory_files(manifest.reference or POSES, manifest, sequence)


def camera_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The files that `sequence_cameras` reads besides images."""
    return [_file(manifest.root_path / sequence.path, name) for name in NAMES]


def _file(base: Path, name: str) -> Path:
    return base / "intrinsic" / f"{name}.txt"


def _color_files(base: Path) -> list[tuple[int, Path]]:
    return sorted({number: path for p in COLOR for number, path in p.find(base)}.items())


def _camera(
    path: Path, images: Iterator[Path], typical: PinholeCamera, section: str
) -> PinholeCamera:
    """Intrinsics of a file, image size of the first image that can be read."""
    matrix = _read_matrix(path, f"Export it again, or give {section} in the manifest.")
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if not (fx > 0 and fy > 0 and np.isfinite([fx, fy, cx, cy]).all()):
        raise DataError(
            f"{path}: expected focal lengths above 0 and a principal point, found fx {fx:g}, "
            f"fy {fy:g}, cx {cx:g}, cy {cy:g}. Export it again, or give {section} in the manifest."
        )
    width, height = _first_size(images) or (typical.width_px, typical.height_px)
    # The exporter's numbers count from a pixel's middle: 319.5 for an image 640 wide.
    camera = PinholeCamera(width, height, fx, fy, cx + 0.5, cy + 0.5)
    off = max(abs(camera.cx_px / width - 0.5), abs(camera.cy_px / height - 0.5))
    if off > FARTHEST_CENTER:
        raise DataError(
            f"{path}: the principal point ({cx:g}, {cy:g}) is far from the middle of images of "
            f"{width}×{height}. If they were resized, give {section} in the manifest."
        )
    return camera


def _first_size(images: Iterator[Path]) -> tuple[int, int] | None:
    for path in images:
        try:
            return probe(path)[:2]
        except UnreadableImageError:  # index warns of it
            continue
    return None


def _refuse_if_apart(base: Path) -> None:
    """Which way a matrix other than the identity points is not documented."""
    for name in ("extrinsic_color", "extrinsic_depth"):
        path = _file(base, name)
        if not path.exists():
            continue
        cure = (
            "Give camera.color_from_depth in the manifest; the identity, if colour and depth are "
            "taken from one place."
        )
        if not np.allclose(_read_matrix(path, cure), np.eye(4), atol=1e-5):
            raise DataError(f"{path}: expected the identity, found another matrix. {cure}")


def _read_matrix(path: Path, cure: str) -> NDArray[np.float64]:
    """A 4×4 matrix; its numbers may be infinite or none."""
    try:
        rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
        matrix = np.array([row for row in rows if row], dtype=np.float64)
    except FileNotFoundError:
        raise DataError(f"{path}: no such file. {cure}") from None
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0][:80]
        raise DataError(f"{path}: expected a 4×4 matrix ({reason}). {cure}") from None
    if matrix.shape != (4, 4):
        shape = "×".join(map(str, matrix.shape))
        raise DataError(f"{path}: expected a 4×4 matrix, found {shape} numbers. {cure}")
    return matrix


EXTRAS = Extras(cameras=sequence_cameras, files=camera_files)
