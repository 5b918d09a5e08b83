"""What every stage returns, and how it says in one line what became of its rows."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from imodbatch.core.errors import TableError
from imodbatch.core.frames import make_transform, matrix_from_quaternion, quaternion_from_matrix
from imodbatch.core.scoring import Candidates, Truth
from imodbatch.core.trajectory import LOST
from imodbatch.tables.schemas import BOX, DETECTIONS, FRAMES

T = TypeVar("T")
Progress = Callable[[Iterable[T]], Iterable[T]]


@dataclass(frozen=True)
class StageResult:
    """Tables by name, a summary that adds up, warnings, and figures that are not rows."""

    tables: dict[str, pa.Table]
    summary: str
    warnings: list[str] = field(default_factory=list)
    attributes: dict[str, Any] = field(default_factory=dict)


def tally(total: int, noun: str, parts: Mapping[str, int]) -> str:
    """``450 frames = 448 tracked + 2 lost``; a part that is 0 is left out unless all are."""
    if sum(parts.values()) != total:
        raise AssertionError(f"{total} {noun} do not equal {dict(parts)}")
    shown = {name: count for name, count in parts.items() if count} or dict(list(parts.items())[:1])
    terms = " + ".join(f"{count:,} {name}" for name, count in shown.items())
    return f"{total:,} {noun} = {terms}"


def column(table: pa.Table, name: str) -> NDArray[Any]:
    """A column as a numpy array; null numbers become NaN."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False))


def codes(strings: pa.ChunkedArray, names: Sequence[str] | pa.Array) -> NDArray[np.int64]:
    """Position (n,) of each string in `names`."""
    found = pc.index_in(strings, value_set=pa.array(names, pa.string()))
    return np.asarray(found.to_numpy(zero_copy_only=False), dtype=np.int64)


def stacked(table: pa.Table, *names: str) -> NDArray[Any]:
    """Columns side by side: (n, as many as named)."""
    return np.stack([column(table, name) for name in names], axis=-1)


def boxes_of(table: pa.Table) -> NDArray[np.float64]:
    """Boxes (n, 4) of a table with box columns."""
    return stacked(table, *(box.name for box in BOX)).astype(np.float64)


def view_scores_of(detections: pa.Table, n_classes: int) -> NDArray[np.float32]:
    """Score vectors (n, n_classes, values per class), not yet cut into elevations and azimuths."""
    flat = detections["view_scores"].combine_chunks().flatten().to_numpy(zero_copy_only=False)
    if detections.num_rows == 0:
        return np.zeros((0, n_classes, 1), dtype=np.float32)
    return flat.reshape(detections.num_rows, n_classes, -1)


def rows_by_frame(table: pa.Table) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Frame numbers in rising order, each with the positions of its rows."""
    frame = column(table, "frame_index")
    order = np.argsort(frame, kind="stable")
    if len(order) == 0:
        return
    values, starts = np.unique(frame[order], return_index=True)
    for value, rows in zip(values, np.split(order, starts[1:]), strict=True):
        yield int(value), rows


def world_from_cam_of(poses: pa.Table) -> dict[int, NDArray[np.float64]]:
    """Frame number → world_from_cam (4, 4), for the frames that are not lost."""
    known = poses.filter(pc.not_equal(poses["status"], LOST))
    if known.num_rows == 0:
        return {}
    rotation = matrix_from_quaternion(stacked(known, "qw", "qx", "qy", "qz"))
    transforms = make_transform(rotation, stacked(known, "tx_m", "ty_m", "tz_m"))
    return dict(zip(column(known, "frame_index").tolist(), transforms, strict=True))


def pose_columns(world_from_cam: NDArray[np.float64]) -> dict[str, pa.Array]:
    """Poses (F, 4, 4) as columns of a table; null where they are NaN."""
    known = np.asarray(np.isfinite(world_from_cam).all(axis=(-2, -1)))
    quaternion = np.full((len(known), 4), np.nan)
    quaternion[known] = quaternion_from_matrix(world_from_cam[known, :3, :3])
    values = np.concatenate([world_from_cam[:, :3, 3], quaternion], axis=1)
    names = ("tx_m", "ty_m", "tz_m", "qw", "qx", "qy", "qz")
    return {name: pa.array(values[:, i], mask=~known) for i, name in enumerate(names)}


def truth_of(annotations: pa.Table, image: NDArray[np.int64]) -> Truth:
    """Annotations as the core takes them; `image` (A,) numbers their images."""
    return Truth(
        image=image.astype(np.int64),
        class_id=column(annotations, "class_id").astype(np.int64),
        boxes=boxes_of(annotations),
        is_ignored=column(annotations, "is_ignored").astype(np.bool_),
        is_crowd=column(annotations, "is_crowd").astype(np.bool_),
    )


def candidates_of(rows: pa.Table, detections: pa.Table, image: NDArray[np.int64]) -> Candidates:
    """Fused rows or matches with the boxes of their detections; `image` (D,) as in `truth_of`."""
    return Candidates(
        image=image.astype(np.int64),
        class_id=column(rows, "class_id").astype(np.int64),
        boxes=boxes_of(detections)[positions(rows, detections, DETECTIONS.key)],
    )


def positions(table: pa.Table, among: pa.Table, key: Sequence[str]) -> NDArray[np.int64]:
    """Where (n,) the key of each row of a table stands in another one, which holds it once.

    Raises:
        TableError: a row's key is not there.
    """
    keys = list(key)
    asked = table.select(keys).append_column("row", pa.array(np.arange(table.num_rows)))
    there = among.select(keys).append_column("position", pa.array(np.arange(among.num_rows)))
    found = asked.join(there, keys=keys, join_type="inner").sort_by("row")
    if found.num_rows != table.num_rows:
        n_lost = table.num_rows - found.num_rows
        raise TableError(f"{n_lost} rows have a {', '.join(keys)} that the other table lacks.")
    return column(found, "position").astype(np.int64)


def image_numbers(frames: pa.Table, table: pa.Table) -> NDArray[np.int64]:
    """Number (n,) of each row's image: its position among the run's frames."""
    return positions(table, frames, FRAMES.key)
