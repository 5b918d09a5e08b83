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

from imodbatch.config import did_you_mean
from imodbatch.core.frames import is_rigid, make_transform, matrix_from_quaternion
from imodbatch.datasets.base import NS_PER_MS, NS_PER_S, FrameFile, Odometry, nanoseconds
from imodbatch.datasets.patterns import PathPattern
from imodbatch.errors import DataError
from imodbatch.manifest import Manifest, OdometrySection, SequenceSection

Array = NDArray[np.float64]
NO_STAMP = np.iinfo(np.int64).min // 2  # stands where a stamp is missing; its pose is NaN
UW_COLUMNS = (7, 9)  # quaternion, place; the aligned scenes of v1 have two stamps before them
CSV_COLUMNS = ("tx", "ty", "tz", "qw", "qx", "qy", "qz")


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


def _read_kitti(path: Path, section: OdometrySection) -> Array:
    """The first three rows of a matrix per line."""
    del section
    rows = _read_numbers(path, (12,))
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :] = rows.reshape(-1, 3, 4)
    return poses


def _read_uw(path: Path, section: OdometrySection) -> Array:
    """Quaternion, then place, per line; two stamps may stand before them and are not needed."""
    rows = _read_numbers(path, UW_COLUMNS)[:, -7:]
    return _from_quaternions(_scalar_first(rows[:, :4], section), rows[:, 4:])


def _read_tum(path: Path, section: OdometrySection) -> tuple[Array, NDArray[np.int64]]:
    """Stamp, place, quaternion per line."""
    rows = _read_numbers(path, (8,))
    poses = _from_quaternions(_scalar_first(rows[:, 4:], section), rows[:, 1:4])
    first_column = [(line, parts[0]) for line, parts in _read_fields(path, (8,))]
    return poses, _stamps(first_column, NS_PER_S, path)


def _read_matrix(path: Path) -> Array:
    rows = _read_numbers(path, (4,))
    if rows.shape not in ((4, 4), (3, 4)):
        raise DataError(f"{path}: expected a 4×4 or 3×4 matrix, found {rows.shape[0]} lines.")
    return np.vstack([rows, [0.0, 0.0, 0.0, 1.0]]) if len(rows) == 3 else rows


def _read_numbers(path: Path, n_columns: tuple[int, ...]) -> Array:
    """Lines of numbers: (lines, one of n_columns)."""
    rows = [
        [_number(part, path, line) for part in parts]
        for line, parts in _read_fields(path, n_columns)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, len(rows[0]) if rows else n_columns[0])


def _read_fields(path: Path, n_columns: tuple[int, ...]) -> list[tuple[int, list[str]]]:
    """Line numbers and columns of a text file, comments (#) and blank lines left out.

    Of several numbers of columns that are allowed, the first line says which the file has.
    """
    rows: list[tuple[int, list[str]]] = []
    for number, line in enumerate(_lines(path), start=1):
        text = line.split("#", 1)[0].replace(",", " ").strip()
        if not text:
            continue
        parts = text.split()
        allowed = (len(rows[0][1]),) if rows else n_columns
        if len(parts) not in allowed:
            raise DataError(
                f"{path}, line {number}: expected {' or '.join(map(str, allowed))} numbers, "
                f"found {len(parts)}. Check odometry.format."
            )
        rows.append((number, parts))
    return rows


def _number(text: str, path: Path, line: int) -> float:
    try:
        return float(text)
    except ValueError:
        raise DataError(
            f"{path}, line {line}: {text[:30]!r} is no number. Check odometry.format."
        ) from None


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise DataError(f"{path}: no such trajectory file. Check odometry.path.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as text ({error}).") from None


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
    reader = csv.DictReader(_lines(path))
    header = [name.strip() for name in reader.fieldnames or []]
    reader.fieldnames = header

    def column(name: str) -> str | None:
        wanted = section.columns.get(name, name)
        return wanted if wanted in header else None

    for name in CSV_COLUMNS:
        if column(name) is None:
            wanted = section.columns.get(name, name)
            raise DataError(
                f"{path}: no column {wanted!r}.{did_you_mean(wanted, header)} "
                f'Name it in the manifest: odometry.columns = {{ {name} = "…" }}.'
            )
    rows, lines = [], []
    for row in reader:
        if None in row or None in row.values():  # what csv puts for cells too many or too few
            raise DataError(
                f"{path}, line {reader.line_num}: expected the header's {len(header)} columns."
            )
        rows.append(row)
        lines.append(reader.line_num)
    texts = {
        name: [row[of_file].strip() or "nan" for row in rows]
        for name in (*CSV_COLUMNS, "frame_index", "timestamp_ns", "timestamp_s")
        if (of_file := column(name)) is not None
    }
    values = {
        name: np.array(
            [_number(t, path, line) for t, line in zip(column_texts, lines, strict=True)]
        )
        for name, column_texts in texts.items()
    }
    quaternion = np.stack([values[n] for n in ("qw", "qx", "qy", "qz")], axis=-1)
    poses = _from_quaternions(
        quaternion, np.stack([values[n] for n in ("tx", "ty", "tz")], axis=-1)
    )
    if "frame_index" in values:
        return poses, None, _whole(values["frame_index"], path, lines)
    for name, unit_ns in (("timestamp_ns", 1), ("timestamp_s", NS_PER_S)):
        if name in texts:
            cells = list(zip(lines, texts[name], strict=True))
            return poses, _stamps(cells, unit_ns, path), None
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


def _stamps(cells: Sequence[tuple[int, str]], unit_ns: int, path: Path) -> NDArray[np.int64]:
    """Nanoseconds of (line, text); a stamp that is not finite becomes `NO_STAMP`."""
    stamps = np.full(len(cells), NO_STAMP, dtype=np.int64)
    for row, (line, text) in enumerate(cells):
        if not math.isfinite(_number(text, path, line)):
            continue
        try:
            stamps[row] = nanoseconds(text, unit_ns)
        except ValueError as error:
            raise DataError(f"{path}, line {line}: {error}. Check the file's unit.") from None
    return stamps


def _whole(values: Array, path: Path, lines: Sequence[int]) -> NDArray[np.int64]:
    """Frame numbers as integers."""
    for value, line in zip(values.tolist(), lines, strict=True):
        if not value.is_integer():
            raise DataError(f"{path}, line {line}: {value:g} is no frame number.")
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
