"""Trajectory files: TUM, KITTI, UW, one 4×4 per file, CSV with named columns.

All become `Odometry` of the colour camera, world_from_cam, metres, in the order of the file.
Numbers that are not finite are kept: the frame they belong to is lost, not the file. A pose
without a stamp belongs to no moment, so it becomes NaN.
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.frames import is_rigid, make_transform, matrix_from_quaternion
from imodbatch.datasets.base import NS_PER_MS, NS_PER_S, FrameFile, Odometry, nanoseconds
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.text import number, read_lines, read_numbers, read_rows
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import OdometrySection
from imodbatch.settings.toml import did_you_mean

Array = NDArray[np.float64]
NO_STAMP = np.iinfo(np.int64).min // 2  # stands where a stamp is missing; its pose is NaN
UW_COLUMNS = (7, 9)  # quaternion, place; the aligned scenes of v1 have two stamps before them
CSV_COLUMNS = ("tx", "ty", "tz", "qw", "qx", "qy", "qz")
CSV_KEYS = ("frame_index", "timestamp_ns", "timestamp_s")
CHECK_FORMAT = "Check odometry.path and odometry.format."


def trajectory_files(
    section: OdometrySection, manifest: Manifest, sequence: SequenceSection
) -> list[Path]:
    """The file, or the files, that hold a sequence's poses."""
    if section.format == "matrix":
        return [path for _, path in _numbered_files(section, manifest, sequence)]
    return [manifest.path_in(sequence, section.path)]


def _numbered_files(
    section: OdometrySection, manifest: Manifest, sequence: SequenceSection
) -> list[tuple[int, Path]]:
    """Files of one matrix each, by frame number."""
    names_sequence = "{sequence}" in section.path
    base = manifest.root_path if names_sequence else manifest.root_path / sequence.path
    return PathPattern(sequence.fill(section.path)).find(base)


def read_odometry(
    section: OdometrySection,
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],
    first_number: int = 0,
) -> Odometry:
    """Read the poses that an `[odometry]` section points at.

    Args:
        section: which file, and what its numbers mean.
        manifest: the split.
        sequence: one of its sequences.
        frames: all frames of the sequence, also those outside its slice: a file with one line per
            frame starts at the first of them.
        first_number: number that the layout gives to its first frame; a file with more lines than
            there are images starts at it.

    Raises:
        DataError: a file is missing, a line has the wrong number of columns, a number is none, or
            most of the matrices are not rigid transforms.
    """
    files = trajectory_files(section, manifest, sequence)
    stamps: NDArray[np.int64] | None = None
    numbers: NDArray[np.int64] | None = None
    if section.format == "matrix":
        numbered = [
            (number, path)
            for number, path in _numbered_files(section, manifest, sequence)
            if sequence.keeps(number)
        ]
        if not numbered:
            raise DataError(
                f"{manifest.root_path / sequence.path}: no pose file fits {section.path!r}. "
                "Check odometry.path, such as 'pose/{frame}.txt'."
            )
        poses = np.stack([_read_matrix(path) for _, path in numbered])
        numbers = np.array([number for number, _ in numbered], dtype=np.int64)
    elif section.format in ("kitti", "uw"):
        read_lines = _read_kitti if section.format == "kitti" else _read_uw
        poses = read_lines(files[0], section)
        kept = [frame for frame in frames if sequence.keeps(frame.frame_index)]
        numbers = _numbers_by_line(files[0], len(poses), frames, kept, first_number)
    elif section.format == "tum":
        poses, stamps = _read_tum(files[0], section)
    else:
        poses, stamps, numbers = _read_csv(files[0], section)
    _refuse_if_not_rigid(poses, files[0])
    poses = _to_color_world(poses, section, manifest)
    if stamps is not None:
        poses[stamps == NO_STAMP] = np.nan
        offset_ns = round(section.clock_offset_ms * NS_PER_MS)
        stamps = np.where(stamps == NO_STAMP, NO_STAMP, stamps + offset_ns)
    return Odometry(poses, stamps, numbers)


def _read_kitti(path: Path, _section: OdometrySection) -> Array:
    """The first three rows of a matrix per line."""
    rows = read_numbers(path, (12,), CHECK_FORMAT)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :] = rows.reshape(-1, 3, 4)
    return poses


def _read_uw(path: Path, section: OdometrySection) -> Array:
    """Quaternion, then place, per line; two stamps may stand before them and are not needed."""
    rows = read_numbers(path, UW_COLUMNS, CHECK_FORMAT)[:, -7:]
    return _from_quaternions(_scalar_first(rows[:, :4], section), rows[:, 4:])


def _read_tum(path: Path, section: OdometrySection) -> tuple[Array, NDArray[np.int64]]:
    """Stamp, place, quaternion per line."""
    numbers = read_numbers(path, (8,), CHECK_FORMAT)
    poses = _from_quaternions(_scalar_first(numbers[:, 4:], section), numbers[:, 1:4])
    stamps = [(where, columns[0]) for where, columns in read_rows(path, CHECK_FORMAT)]
    return poses, _stamps(stamps, NS_PER_S)


def _read_matrix(path: Path) -> Array:
    rows = read_numbers(path, (4,), CHECK_FORMAT)
    if rows.shape not in ((4, 4), (3, 4)):
        raise DataError(f"{path}: expected a 4×4 or 3×4 matrix, found {rows.shape[0]} lines.")
    return np.vstack([rows, [0.0, 0.0, 0.0, 1.0]]) if len(rows) == 3 else rows


def _numbers_by_line(
    path: Path,
    n_lines: int,
    frames: Sequence[FrameFile],
    kept: Sequence[FrameFile],
    first_number: int,
) -> NDArray[np.int64]:
    """Frame numbers of a file with one line per frame, or one per frame of the slice."""
    first = frames[0].frame_index if frames else 0
    last = frames[-1].frame_index if frames else -1
    for those in (frames, kept):
        if n_lines == len(those):
            return np.array([frame.frame_index for frame in those], dtype=np.int64)
    if first >= first_number and n_lines > last - first_number:
        return np.arange(first_number, first_number + n_lines, dtype=np.int64)
    raise DataError(
        f"{path}: {n_lines} lines for {len(frames)} frames numbered {first} to {last}. "
        "This format has one line per frame; use TUM or CSV where frames are missing."
    )


def _read_csv(
    path: Path, section: OdometrySection
) -> tuple[Array, NDArray[np.int64] | None, NDArray[np.int64] | None]:
    """CSV with a header; `odometry.columns` maps our names to the file's."""
    reader = csv.DictReader(read_lines(path, "Check odometry.path."))
    header = reader.fieldnames = [name.strip() for name in reader.fieldnames or []]
    names = {n: section.columns.get(n, n) for n in (*CSV_COLUMNS, *CSV_KEYS)}
    for name in CSV_COLUMNS:
        if names[name] not in header:
            raise DataError(
                f"{path}: no column {names[name]!r}.{did_you_mean(names[name], header)} "
                f'Name it in the manifest: odometry.columns = {{ {name} = "…" }}.'
            )
    cells: dict[str, list[tuple[str, str]]] = {
        n: [] for n, of_file in names.items() if of_file in header
    }
    for row in reader:
        where = f"{path}, line {reader.line_num}"
        if None in row or None in row.values():  # what csv puts for cells too many or too few
            raise DataError(f"{where}: expected the header's {len(header)} columns.")
        for name, texts in cells.items():
            texts.append((where, row[names[name]].strip() or "nan"))
    values = {
        name: np.array([number(text, where, CHECK_FORMAT) for where, text in texts])
        for name, texts in cells.items()
    }
    place, quaternion = (
        np.stack([values[n] for n in part], axis=-1) for part in (CSV_COLUMNS[:3], CSV_COLUMNS[3:])
    )
    poses = _from_quaternions(quaternion, place)
    if "frame_index" in values:
        return poses, None, _whole(values["frame_index"], cells["frame_index"])
    for name, unit_ns in (("timestamp_ns", 1), ("timestamp_s", NS_PER_S)):
        if name in cells:
            return poses, _stamps(cells[name], unit_ns), None
    raise DataError(
        f"{path}: no column frame_index, timestamp_ns or timestamp_s. "
        'Name one in the manifest: odometry.columns = { timestamp_s = "…" }.'
    )


def _scalar_first(quaternions: Array, section: OdometrySection) -> Array:
    """Quaternions as w, x, y, z."""
    return quaternions[:, [3, 0, 1, 2]] if section.scalar_is_last else quaternions


def _from_quaternions(quaternion_wxyz: Array, translation: Array) -> Array:
    """Transforms; NaN where a quaternion is not finite or has no length near 1."""
    length = np.linalg.norm(quaternion_wxyz, axis=-1)
    good = np.isfinite(length) & (np.abs(length - 1) < 0.1)
    poses = np.full((len(length), 4, 4), np.nan)
    poses[good] = make_transform(matrix_from_quaternion(quaternion_wxyz[good]), translation[good])
    return poses


def _stamps(cells: Sequence[tuple[str, str]], unit_ns: int) -> NDArray[np.int64]:
    """Nanoseconds of (where, text); a stamp that is not finite becomes `NO_STAMP`."""
    stamps = np.full(len(cells), NO_STAMP, dtype=np.int64)
    for row, (where, text) in enumerate(cells):
        if not math.isfinite(number(text, where, CHECK_FORMAT)):
            continue
        try:
            stamps[row] = nanoseconds(text, unit_ns)
        except ValueError as error:
            raise DataError(f"{where}: {error}. Check the file's unit.") from None
    return stamps


def _whole(values: Array, cells: Sequence[tuple[str, str]]) -> NDArray[np.int64]:
    """Frame numbers as integers."""
    for value, (where, _) in zip(values.tolist(), cells, strict=True):
        if not value.is_integer():
            raise DataError(f"{where}: {value:g} is no frame number.")
    return values.astype(np.int64)


def _to_color_world(poses: Array, section: OdometrySection, manifest: Manifest) -> Array:
    """Poses as read → world_from_color in metres."""
    poses = poses.copy()
    poses[~np.isfinite(poses).all(axis=(-2, -1))] = np.nan  # -inf would warn in products
    poses[:, :3, 3] *= section.unit_m
    if section.convention == "cam_from_world":
        good = is_rigid(poses)
        poses[~good] = np.nan
        rotation = np.swapaxes(poses[:, :3, :3], -1, -2)
        translation = -np.einsum("pij,pj->pi", rotation, poses[:, :3, 3])
        poses[:, :3, :3], poses[:, :3, 3] = rotation, translation
    if section.camera == "depth" and manifest.camera.color_from_depth is not None:
        color_from_depth = np.array(manifest.camera.color_from_depth)
        poses = poses @ np.linalg.inv(color_from_depth)
    return poses


def _refuse_if_not_rigid(poses: Array, path: Path) -> None:
    finite = np.isfinite(poses).all(axis=(-2, -1))
    distorted = finite & ~is_rigid(poses)
    if distorted.sum() > 0.5 * max(finite.sum(), 1):
        raise DataError(
            f"{path}: {distorted.sum()} of {len(poses)} poses are not rigid transforms. "
            "Check odometry.format and that matrices stand row by row."
        )
