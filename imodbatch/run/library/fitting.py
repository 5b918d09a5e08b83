"""Tables of one call that must fit each other: the same sequences, frames and boxes in each."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.run.library.images import Images, frame_numbers
from imodbatch.run.library.tables import (
    BOX_COLUMNS,
    DETECTION_KEY,
    FRAME_KEY,
    SEQUENCE,
    Table,
    annotated,
    check_boxes,
    check_classes,
    frame_of,
    frames_of,
    number_rows,
    posed,
    scored,
    table_of,
)
from imodbatch.tables.columns import column
from imodbatch.tables.schemas import BOX, DETECTIONS, FUSED, OBSERVATIONS, TableSpec

BOXES = TableSpec("detections", DETECTIONS.key_columns, BOX)
MOST = 0.5  # of the bins: azimuths were rounded, and one at a bin's border may fall beside it


@dataclass(frozen=True)
class ResultsAndTruth:
    """The tables that scoring takes, of all sequences."""

    frames: pa.Table
    fused: pa.Table
    detections: pa.Table
    annotations: pa.Table


def boxes_and_poses(
    detections: Table, poses: Table | ArrayLike, frame_index: ArrayLike | None, depths: Images
) -> tuple[NDArray[np.int64], pa.Table, pa.Table]:
    """What `lift` takes of one sequence: numbers (F,) of the frames, boxes, poses.

    Raises:
        DataError: several sequences, other numbers of images than of frames, or boxes in frames
            that are not among them.
    """
    boxes = frame_of(detections, "detections", ("frame_index", *BOX_COLUMNS))
    named = {"detections": boxes}
    if isinstance(poses, (pd.DataFrame, pa.Table)):
        poses = frame_of(poses, "poses", ("frame_index",)).sort_values("frame_index")
        named["poses"] = poses
    _name_sequences(**named)
    sequence_id = _only_sequence(named)
    if isinstance(poses, pd.DataFrame):
        frame_index = poses["frame_index"] if frame_index is None else frame_index
        numbers = frame_numbers(frame_index, depths=depths)
    else:
        numbers = frame_numbers(frame_index, depths=depths, poses=poses)
    check_boxes(boxes, "detections")
    number_rows(boxes, "detection_index")
    placed = posed(poses, numbers, sequence_id)
    _check_frames(boxes["frame_index"], numbers, "detections")
    return numbers, table_of(boxes, BOXES), placed


def boxes_and_sightings(
    detections: Table, observations: Table, classes: tuple[str, ...], grid: ViewGrid
) -> tuple[pa.Table, pa.Table]:
    """What `fuse` takes: detections, and the observation of each in the same order.

    Raises:
        DataError: a detection has no observation, or they are of another grid of viewpoints.
    """
    boxes = frame_of(detections, "detections", ("frame_index", *BOX_COLUMNS))
    seen = frame_of(observations, "observations", ("frame_index", "detection_index"))
    _name_sequences(detections=boxes, observations=seen)
    is_numbered = "detection_index" in boxes.columns
    number_rows(boxes, "detection_index")
    found, sightings = scored(boxes, classes), table_of(seen, OBSERVATIONS)
    fault = "observations: none for {} of {} detections"
    row = _rows_of(found, sightings, fault, "Lift these detections.")
    if not is_numbered and len(row) < sightings.num_rows:
        raise DataError(
            f"detections: {len(row)} without detection_index, and {sightings.num_rows} "
            "observations: which is whose? Keep detection_index, or lift these detections."
        )
    sightings = sightings.take(row)
    known = sightings.filter(sightings["azimuth_bin"].is_valid())
    bins = grid.azimuth_bins(column(known, "azimuth_rad"))
    if len(bins) and np.mean(bins != column(known, "azimuth_bin")) > MOST:
        raise DataError(
            f"observations: lifted with another grid of viewpoints than {grid.n_azimuths} "
            "azimuths. Give lift and fuse the same n_azimuths and elevations_deg."
        )
    return found, sightings


def results_and_truth(
    fused: Table,
    detections: Table,
    annotations: Table,
    frames: Table | None,
    camera: PinholeCamera,
    classes: tuple[str, ...],
) -> ResultsAndTruth:
    """What `score` takes.

    Args:
        fused: of `fuse`.
        detections: the boxes behind it.
        annotations: what is true.
        frames: the frames looked at; None = those with a box or an annotation.
        camera: of all frames.
        classes: names by class id.

    Raises:
        DataError: a fused row has no detection, a frame is not among `frames`, an unknown class.
    """
    rows = frame_of(fused, "fused", FUSED.schema.names)
    boxes = frame_of(detections, "detections", ("frame_index", *BOX_COLUMNS))
    true = frame_of(annotations, "annotations", ("frame_index", *BOX_COLUMNS))
    named = {"fused": rows, "detections": boxes, "annotations": true}
    looked = None
    if frames is not None:
        named["frames"] = looked = frame_of(frames, "frames", ("frame_index",))
    _name_sequences(**named)
    check_classes(rows["class_id"], classes, "fused")
    number_rows(boxes, "detection_index")
    results, found = table_of(rows, FUSED), scored(boxes, classes)
    fault = "detections: none behind {} of {} rows of fused"
    _rows_of(results, found, fault, "Give those that were fused.")
    if looked is None:
        looked = pd.concat([boxes[FRAME_KEY], true[FRAME_KEY]])
    looked = looked[FRAME_KEY].drop_duplicates().sort_values(FRAME_KEY)
    for name, frame in named.items():
        _check_frames(_frame_keys(frame), _frame_keys(looked), name)
    table = frames_of(camera, looked["frame_index"], looked["sequence_id"].tolist())
    return ResultsAndTruth(table, results, found, annotated(true, classes))


def _name_sequences(**frames: pd.DataFrame) -> None:
    """Fill in sequence_id where a table lacks it: that of the others, which must be one.

    Raises:
        DataError: the others speak of several.
    """
    lacking = [name for name, frame in frames.items() if "sequence_id" not in frame.columns]
    said = [frame["sequence_id"] for name, frame in frames.items() if name not in lacking]
    names = pd.unique(pd.concat(said)) if said else []
    if lacking and len(names) > 1:
        raise DataError(
            f"{lacking[0]}: has no column sequence_id, and other tables speak of {len(names)} "
            "sequences. Add it."
        )
    for name in lacking:
        frames[name]["sequence_id"] = names[0] if len(names) else SEQUENCE


def _only_sequence(named: dict[str, pd.DataFrame]) -> str:
    """The one sequence that all tables speak of.

    Raises:
        DataError: they speak of several.
    """
    names = {name: pd.unique(frame["sequence_id"]) for name, frame in named.items()}
    for name, found in names.items():
        if len(found) > 1:
            raise DataError(f"{name}: of {len(found)} sequences, expected one. Call lift for each.")
    said = {str(found[0]): name for name, found in names.items() if len(found)}
    if len(said) > 1:
        text = " and ".join(f"{name} of {sequence!r}" for sequence, name in said.items())
        raise DataError(f"{text}: expected one sequence. Give both the same sequence_id.")
    return next(iter(said), SEQUENCE)


def _frame_keys(frame: pd.DataFrame) -> list[tuple[str, int]]:
    return list(zip(frame["sequence_id"], frame["frame_index"], strict=True))


def _check_frames(used: Iterable[Any], known: Iterable[Any], name: str) -> None:
    unknown = sorted(set(used) - set(known))
    if unknown:
        raise DataError(
            f"{name}: {len(unknown)} frames are not among those given, the first of them "
            f"{unknown[0]}. Give all frames, or leave these rows out."
        )


def _rows_of(table: pa.Table, others: pa.Table, fault: str, cure: str) -> NDArray[np.int64]:
    """Position (n,) in `others` of the detection behind each row.

    Raises:
        DataError: it is not there; `fault` has places for the numbers of such rows and of all.
    """
    keys, known = (
        pd.MultiIndex.from_frame(t.select(DETECTION_KEY).to_pandas()) for t in (table, others)
    )
    rows = np.asarray(known.get_indexer(keys), dtype=np.int64)
    missing = np.flatnonzero(rows < 0)
    if missing.size:
        pairs = zip(DETECTION_KEY, keys[missing[0]], strict=True)
        first = ", ".join(f"{name} {value}" for name, value in pairs)
        count = fault.format(missing.size, len(rows))
        raise DataError(f"{count}, the first of them {first}. {cure}")
    return rows
