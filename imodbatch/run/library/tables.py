"""Tables that a caller of the library gives → tables of `schemas`, complete and checked.

A table is a pandas DataFrame or a pyarrow Table. What can be told is filled in: the sequence where
there is one only, the ordinal of a box in its frame, the id of a class by its name. Columns that
`schemas` does not know are of no matter.
"""

import logging
import warnings
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.detections import one_hot
from imodbatch.core.errors import DataError
from imodbatch.core.frames import is_rigid
from imodbatch.core.trajectory import LOST, TRACKED, FramePoses, Trajectory
from imodbatch.poses import association as poses
from imodbatch.settings.toml import did_you_mean
from imodbatch.tables.columns import StageResult
from imodbatch.tables.parquet import ARROW_ERRORS, conform, from_columns
from imodbatch.tables.schemas import ANNOTATIONS, BOX, DETECTIONS, FRAMES, POSES, TableSpec

Table: TypeAlias = pd.DataFrame | pa.Table
FRAME_KEY, DETECTION_KEY = list(FRAMES.key), list(DETECTIONS.key)
SEQUENCE = "sequence"
"""Name of the only sequence where no table says one."""
BOX_COLUMNS = [column.name for column in BOX]
POSE_COLUMNS = ["tx_m", "ty_m", "tz_m", "qw", "qx", "qy", "qz"]
UP = (0.0, 0.0, 1.0)
NO_CAMERA = PinholeCamera(0, 0, 1.0, 1.0, 0.0, 0.0)
"""Of images whose size is of no matter, or unknown."""


def frame_of(given: Table, name: str, columns: Sequence[str]) -> pd.DataFrame:
    """A copy as a DataFrame that has the columns asked.

    Raises:
        DataError: it is no table, or a column is missing.
    """
    if not isinstance(given, (pd.DataFrame, pa.Table)):
        raise DataError(
            f"{name}: got a {type(given).__name__}, expected a pandas DataFrame or pyarrow Table."
        )
    frame = given.copy(deep=False) if isinstance(given, pd.DataFrame) else given.to_pandas()
    for column in columns:
        if column not in frame.columns:
            known = [str(other) for other in frame.columns]
            raise DataError(f"{name}: has no column {column}.{did_you_mean(column, known)}")
    return frame


def table_of(frame: pd.DataFrame, spec: TableSpec) -> pa.Table:
    """A complete DataFrame as a table of its schema.

    Raises:
        TableError: it breaks the schema.
        DataError: a column is of mixed types.
    """
    known = [name for name in spec.schema.names if name in frame.columns]
    try:
        table = pa.Table.from_pandas(frame[known], preserve_index=False)
    except ARROW_ERRORS as error:
        raise DataError(f"{spec.name}: {str(error).splitlines()[0]}.") from None
    for field in spec.schema:
        if field.nullable and field.name not in known:
            table = table.append_column(field, pa.nulls(len(frame), field.type))
    return conform(table.replace_schema_metadata(None), spec)


def number_rows(frame: pd.DataFrame, index_name: str) -> None:
    """Fill in the ordinal of each row in its frame, in the order of rows."""
    if index_name not in frame.columns:
        frame[index_name] = frame.groupby(FRAME_KEY).cumcount()


def check_boxes(frame: pd.DataFrame, name: str) -> None:
    """Refuse boxes that are not finite or run backwards.

    Raises:
        DataError: there is one.
    """
    try:
        boxes = frame[BOX_COLUMNS].to_numpy(dtype=np.float64)
    except (TypeError, ValueError):
        raise DataError(f"{name}: box columns hold something other than numbers.") from None
    faulty = np.flatnonzero(~(boxes[:, 2:] > boxes[:, :2]).all(axis=1) | ~_is_finite(boxes))
    if faulty.size:
        raise DataError(
            f"{name}: row {faulty[0]}: the box {boxes[faulty[0]].tolist()} has no area or is not "
            f"finite ({faulty.size} such rows). Are these x, y, width, height? Give x0, y0, x1, y1."
        )


def check_classes(values: ArrayLike, classes: Sequence[str], name: str) -> None:
    """Refuse class ids that are no ordinals of `classes`.

    Raises:
        DataError: there is one.
    """
    ids = np.asarray(values)
    unknown = ids[~np.isin(ids, np.arange(len(classes)))]
    if unknown.size:
        raise DataError(
            f"{name}: unknown class_id {unknown[0]}; there are {len(classes)} classes, counted "
            f"from 0: {', '.join(classes)}."
        )


def _name_classes(frame: pd.DataFrame, classes: Sequence[str], name: str) -> None:
    """Fill in class_id from class_name, and check it."""
    if "class_id" not in frame.columns:
        if "class_name" not in frame.columns:
            raise DataError(f"{name}: has no column class_id or class_name.")
        for class_name in pd.unique(frame["class_name"]):
            if class_name not in classes:
                hint = did_you_mean(str(class_name), list(classes))
                raise DataError(f"{name}: unknown class {class_name!r}.{hint}")
        frame["class_id"] = [classes.index(class_name) for class_name in frame["class_name"]]
    check_classes(frame["class_id"], classes, name)


def scored(frame: pd.DataFrame, classes: Sequence[str]) -> pa.Table:
    """The detections table, of whole score vectors or of a class and a score per box.

    Args:
        frame: detections with key and boxes; then class_ids, view_scores and background_score, or
            class_id or class_name and a score in [0, 1].
        classes: K names by class id.

    Raises:
        DataError: a class, score or box cannot be meant, or vectors do not fit the classes.
    """
    check_boxes(frame, "detections")
    if "view_scores" in frame.columns:
        frame_of(frame, "detections", ("class_ids", "background_score"))
        lengths = frame["view_scores"].map(len).unique()
        if len(lengths) > 1 or (len(lengths) and lengths[0] % len(classes)):
            raise DataError(
                f"detections: view_scores of {', '.join(map(str, lengths))} values, expected one "
                f"length, a multiple of the {len(classes)} classes."
            )
        check_classes(np.concatenate([*frame["class_ids"], []]), classes, "detections")
        return table_of(frame, DETECTIONS)
    frame_of(frame, "detections", ("score",))
    _name_classes(frame, classes, "detections")
    scores = pd.to_numeric(frame["score"], errors="coerce").to_numpy(dtype=np.float64)
    faulty = np.flatnonzero(~((scores >= 0) & (scores <= 1)))
    if faulty.size:
        raise DataError(
            f"detections: row {faulty[0]}: the score {frame['score'].iloc[faulty[0]]} is not "
            f"within 0 to 1 ({faulty.size} such rows). Give scores after softmax or sigmoid."
        )
    class_ids = frame["class_id"].to_numpy(dtype=np.int64)
    columns: dict[str, Any] = {name: frame[name].to_numpy() for name in DETECTION_KEY}
    columns |= {name: frame[name].to_numpy(dtype=np.float64) for name in BOX_COLUMNS}
    columns |= {
        "background_score": 1.0 - scores,
        "class_ids": [[k] for k in class_ids.tolist()],
        "view_scores": list(one_hot(class_ids, scores, len(classes))),
    }
    return from_columns(DETECTIONS, columns)


def annotated(frame: pd.DataFrame, classes: Sequence[str]) -> pa.Table:
    """The annotations table; what is not said counts, is no crowd, and has no instance.

    Raises:
        DataError: a class or box cannot be meant.
    """
    check_boxes(frame, "annotations")
    _name_classes(frame, classes, "annotations")
    number_rows(frame, "annotation_index")
    for name in ("is_ignored", "is_crowd"):
        if name not in frame.columns:
            frame[name] = False
    return table_of(frame, ANNOTATIONS)


def frames_of(
    camera: PinholeCamera, numbers: ArrayLike, sequence_ids: str | Sequence[str]
) -> pa.Table:
    """The frames table of images in memory, depth registered; a path is a frame's position.

    Args:
        camera: of colour and depth.
        numbers: (F,) of the frames.
        sequence_ids: the sequence, or (F,) that of each frame.
    """
    numbers = np.asarray(numbers)
    n = len(numbers)
    positions = [str(position) for position in range(n)]
    columns: dict[str, Any] = {
        "sequence_id": [sequence_ids] * n if isinstance(sequence_ids, str) else sequence_ids,
        "frame_index": numbers,
        "timestamp_ns": pa.nulls(n, pa.int64()),
        "color_path": positions,
        "depth_path": positions,
        "depth_scale_m": [1.0] * n,
        "color_from_depth": pa.nulls(n),
    }
    for prefix in ("", "depth_"):
        columns |= {f"{prefix}{name}": [value] * n for name, value in vars(camera).items()}
    return from_columns(FRAMES, columns)


def given_trajectory(world_from_cam: ArrayLike) -> Trajectory:
    """Poses (F, 4, 4) of the caller's own; NaN = lost.

    Raises:
        DataError: they have another shape, or one is no rigid transform.
    """
    try:
        matrices = np.asarray(world_from_cam, dtype=np.float64)
    except (TypeError, ValueError):
        matrices = np.zeros(0)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4):
        raise DataError(
            f"poses: expected world_from_cam of shape (F, 4, 4), got "
            f"{type(world_from_cam).__name__} of shape {matrices.shape}."
        )
    faulty = np.flatnonzero(_is_finite(matrices.reshape(-1, 16)) & ~is_rigid(matrices))
    if faulty.size:
        raise DataError(
            f"poses: the matrix at {faulty[0]} is no rotation with a translation ({faulty.size} "
            "such matrices). Is it transposed, or scaled?"
        )
    return Trajectory(FramePoses.from_matrices(matrices))


def posed(given: Table | ArrayLike, numbers: NDArray[np.int64], sequence_id: str) -> pa.Table:
    """The poses table of one sequence, of a table or of matrices (F, 4, 4) in a world with +z up.

    Raises:
        DataError: a column is missing, or matrices are not poses.
        TableError: the table breaks its schema.
    """
    if not isinstance(given, (pd.DataFrame, pa.Table)):
        frames = frames_of(NO_CAMERA, numbers, sequence_id)
        return poses.run(frames, given_trajectory(given), UP, "as given").tables["poses"]
    frame = frame_of(given, "poses", ("frame_index", *POSE_COLUMNS))
    if "sequence_id" not in frame.columns:
        frame["sequence_id"] = sequence_id
    known = frame[POSE_COLUMNS].notna().all(axis=1)
    frame["status"] = np.where(known, frame.get("status", TRACKED), LOST)
    return table_of(frame, POSES)


def _is_finite(rows: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(rows).all(axis=1))


def told(result: StageResult, name: str, **brought: Any) -> pd.DataFrame:
    """A stage's table as a DataFrame; its summary goes to the log, its warnings to `warnings`.

    Args:
        result: of the stage.
        name: of the table.
        brought: what the table brings along for the next call, in `attrs`.
    """
    if result.summary:
        logging.getLogger("imodbatch").info("%s: %s", name, result.summary)
    for warning in result.warnings:
        warnings.warn(warning, stacklevel=3)
    frame: pd.DataFrame = result.tables[name].to_pandas()
    # lists, for pandas writes attrs into files as JSON
    frame.attrs = {key: list(v) if isinstance(v, tuple) else v for key, v in brought.items()}
    return frame
