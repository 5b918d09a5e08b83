"""TUM RGB-D: rgb.txt and depth.txt (a stamp and a path per line), groundtruth.txt (a trajectory).

A frame's number is the ordinal of its line in rgb.txt, so it does not hang on which depth images
there are. Colour and depth were taken at different moments: each colour image takes the depth image
nearest in time, one to one, within ``images.max_gap_ms``; one without keeps its frame.

Depth is registered to colour. The intrinsics are those that the benchmark publishes for its three
cameras, told apart by the folder's name. Images of freiburg1 and freiburg2 are distorted, and that
is not undone.
"""

import re
from itertools import pairwise
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.core.trajectory import associate
from imodbatch.datasets.base import NS_PER_MS, CameraModel, FrameFile, nanoseconds
from imodbatch.datasets.layout import Layout, always, registered
from imodbatch.datasets.text import read_rows
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import ImagesSection, OdometrySection

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


def _frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """The lines of rgb.txt, each with the depth image nearest in time.

    Raises:
        DataError: a list is missing or damaged, rgb.txt is not in order of time, or no depth image
            lies near any colour image.
    """
    max_gap_ms = (manifest.images or ImagesSection()).max_gap_ms
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


def _cameras(manifest: Manifest, sequence: SequenceSection | None) -> CameraModel:
    """The camera of a sequence, by the last folder on its path that is called as TUM's are."""
    path = "" if sequence is None else (manifest.root_path / sequence.path).as_posix()
    series = SERIES.findall(path)
    fx, fy, cx, cy = INTRINSICS_PX[series[-1]] if series else OTHER_PX
    return registered(manifest, PinholeCamera(640, 480, fx, fy, cx + 0.5, cy + 0.5), DEPTH_SCALE_M)


def _lists(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The two lists of images."""
    folder = manifest.root_path / sequence.path
    return [folder / COLOR_LIST, folder / DEPTH_LIST]


def _read_list(path: Path) -> Listed:
    """Moments in nanoseconds and paths below the sequence's folder, in the order of the file."""
    cure = (
        f"A sequence of TUM RGB-D has {COLOR_LIST} and {DEPTH_LIST}, empty where there are no such "
        "images. Check root and sequences.path."
    )
    rows: Listed = []
    for where, columns in read_rows(path, cure):
        if len(columns) != 2:
            raise DataError(
                f"{where}: expected a stamp in seconds and a path, found {len(columns)} columns. "
                "Correct the line."
            )
        if columns[1].startswith("/"):
            raise DataError(
                f"{where}: {columns[1]!r} is no path from the sequence's folder. Correct the line."
            )
        try:
            rows.append((nanoseconds(columns[0]), columns[1]))
        except ValueError as error:
            raise DataError(
                f"{where}: {error}. Expected a stamp in seconds, then a path."
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


LAYOUT = Layout(
    _frames,
    _cameras,
    images=f"{COLOR_LIST} and {DEPTH_LIST}",
    images_keys=frozenset({"max_gap_ms"}),
    own_poses=always(TRUE_POSES),
    true_poses=always(TRUE_POSES),
    other_files=_lists,
)
