"""ScanNet as its exporter writes it: color/%d.jpg, depth/%d.png (mm), pose/%d.txt, intrinsic/.

Poses are 4×4 world_from_cam; frames whose tracking was lost hold −inf. Each scene was scanned by a
device of its own, so each sequence has its own intrinsics: ``intrinsic/intrinsic_color.txt`` and
``intrinsic_depth.txt``, 4×4 matrices. Colour and depth have different resolutions and, by the
authors' word, one place: the extrinsics that are exported with them are identities.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.datasets.base import CameraModel, FrameFile
from imodbatch.datasets.images import UnreadableImageError, probe
from imodbatch.datasets.layout import Layout, always, paired_frames
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.text import read_numbers
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import OdometrySection

POSES = OdometrySection(format="matrix", path="pose/{frame}.txt")
DEPTH = PathPattern("depth/{frame}.png")
COLOR = [PathPattern(f"color/{{frame}}.{ending}") for ending in ("png", "jpeg", "jpg")]
TYPICAL_COLOR = PinholeCamera(1296, 968, 1170.19, 1170.19, 648.25, 484.25)
TYPICAL_DEPTH = PinholeCamera(640, 480, 577.87, 577.87, 320.0, 240.0)
NAMES = ("intrinsic_color", "intrinsic_depth", "extrinsic_color", "extrinsic_depth")
FARTHEST_CENTER = 0.1
"""Of the principal point from the image's middle, over the image's side; scenes stay below 0.03."""


def _frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """The colour images by number, each with the depth image of that number."""
    root = manifest.root_path
    return paired_frames(root, root / sequence.path, COLOR, DEPTH)


def _cameras(manifest: Manifest, sequence: SequenceSection | None) -> CameraModel:
    """A scene's own cameras; what the manifest gives is not looked for in files.

    Raises:
        DataError: an intrinsics file is missing or damaged, does not fit the images, or the two
            cameras stand apart.
    """
    color, depth = TYPICAL_COLOR, TYPICAL_DEPTH
    if sequence is not None:
        given, base = manifest.camera, manifest.root_path / sequence.path
        if given.color is None:
            color = _camera(_file(base, "intrinsic_color"), COLOR, color, "camera.color")
        if given.depth is None or given.depth.intrinsics() is None:
            depth = _camera(_file(base, "intrinsic_depth"), [DEPTH], depth, "camera.depth")
        if given.color_from_depth is None:
            _refuse_if_apart(base)
    return CameraModel(color, depth, depth_scale_m=0.001, depth_invalid=(0,))


def _camera_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    return [_file(manifest.root_path / sequence.path, name) for name in NAMES]


def _file(base: Path, name: str) -> Path:
    return base / "intrinsic" / f"{name}.txt"


def _camera(
    path: Path, images: list[PathPattern], typical: PinholeCamera, section: str
) -> PinholeCamera:
    """Intrinsics of a file, image size of the first image that can be read."""
    matrix = _read_matrix(path, f"Export it again, or give {section} in the manifest.")
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if not (fx > 0 and fy > 0 and np.isfinite([fx, fy, cx, cy]).all()):
        raise DataError(
            f"{path}: expected focal lengths above 0 and a principal point, found fx {fx:g}, "
            f"fy {fy:g}, cx {cx:g}, cy {cy:g}. Export it again, or give {section} in the manifest."
        )
    width, height = _first_size(path.parents[1], images) or (typical.width_px, typical.height_px)
    # The exporter's numbers count from a pixel's middle: 319.5 for an image 640 wide.
    camera = PinholeCamera(width, height, fx, fy, cx + 0.5, cy + 0.5)
    off = max(abs(camera.cx_px / width - 0.5), abs(camera.cy_px / height - 0.5))
    if off > FARTHEST_CENTER:
        raise DataError(
            f"{path}: the principal point ({cx:g}, {cy:g}) is far from the middle of images of "
            f"{width}×{height}. If they were resized, give {section} in the manifest."
        )
    return camera


def _first_size(base: Path, images: list[PathPattern]) -> tuple[int, int] | None:
    for _, path in sorted(found for pattern in images for found in pattern.find(base)):
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
    matrix = read_numbers(path, (4,), cure)
    if matrix.shape != (4, 4):
        raise DataError(f"{path}: expected a 4×4 matrix, found {len(matrix)}×4 numbers. {cure}")
    return matrix


LAYOUT = Layout(
    _frames,
    _cameras,
    images="color/{frame}.jpg and depth/{frame}.png",
    own_poses=always(POSES),
    true_poses=always(POSES),
    other_files=_camera_files,
)
