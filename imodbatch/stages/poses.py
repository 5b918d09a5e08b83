"""poses: frames + a trajectory → a pose, and a status, for every frame, in a world with +z up."""

from collections.abc import Callable

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from imodbatch.config import PosesConfig
from imodbatch.core.frames import quaternion_from_matrix
from imodbatch.core.trajectory import (
    INTERPOLATED,
    LOST,
    TRACKED,
    FramePoses,
    associate,
    interpolate,
    level,
)
from imodbatch.datasets.base import Odometry
from imodbatch.errors import DataError
from imodbatch.schemas import POSES
from imodbatch.stages.base import StageResult, column, tally
from imodbatch.tables import from_columns

NS_PER_MS = 1_000_000
UpEstimator = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], str]]


def run(
    frames: pa.Table,
    odometry: Odometry | None,
    up: ArrayLike | None,
    estimate_up: UpEstimator,
    config: PosesConfig,
) -> StageResult:
    """Give every frame of a sequence a pose or the status ``lost``.

    Args:
        frames: the frames table of one sequence.
        odometry: poses as the dataset gives them; None = it has none.
        up: (3,) direction of the poses' world that points up; None = estimate it.
        estimate_up: poses (F, 4, 4) of the frames → up (3,) and how it was found.
        config: association and interpolation.

    Raises:
        DataError: there are no poses at all, or stamps are needed and missing.
    """
    sequence_id = frames["sequence_id"][0].as_py()
    if odometry is None:
        raise DataError(
            f"{sequence_id}: the dataset gives no camera poses. "
            "Add [odometry] with format and path to the manifest."
        )
    if odometry.frame_index is not None:
        poses = _by_number(column(frames, "frame_index"), odometry)
    else:
        poses = _by_stamp(frames, odometry, config, sequence_id)
    if (poses.status == LOST).all():
        raise DataError(
            f"{sequence_id}: none of {frames.num_rows} frames has a pose. Raise poses.max_gap_ms, "
            "or check odometry.clock_offset_ms and odometry.format."
        )
    how = "up as given"
    if up is None:
        up, how = estimate_up(poses.world_from_cam)
    levelled = level(poses.world_from_cam, up)
    counts = {s: int((poses.status == s).sum()) for s in (TRACKED, INTERPOLATED, LOST)}
    summary = f"{tally(frames.num_rows, 'frames', counts)}; {how}"
    table = _table(frames, levelled, poses.status)
    direction = [float(value) for value in np.asarray(up, dtype=np.float64)]
    return StageResult({"poses": table}, summary, attributes={"up": direction, "levelling": how})


def _by_number(frame_index: NDArray[np.int64], odometry: Odometry) -> FramePoses:
    """Poses that belong to frames by number."""
    if len(odometry.world_from_color) == 0:
        return FramePoses.from_matrices(np.full((len(frame_index), 4, 4), np.nan))
    row_of = {int(number): row for row, number in enumerate(odometry.frame_index)}  # type: ignore[arg-type]
    rows = np.array([row_of.get(int(number), -1) for number in frame_index])
    chosen = np.where((rows >= 0)[:, None, None], odometry.world_from_color[rows], np.nan)
    return FramePoses.from_matrices(chosen)


def _by_stamp(
    frames: pa.Table, odometry: Odometry, config: PosesConfig, sequence_id: str
) -> FramePoses:
    """Poses that belong to frames by moment: association one to one, then interpolation."""
    if frames["timestamp_ns"].null_count:
        raise DataError(
            f"{sequence_id}: frames have no timestamps, and the trajectory is by timestamp. Give "
            "images.timestamps, images.frames_per_second or {stamp} in images.color."
        )
    at = frames["timestamp_ns"].to_numpy()
    given = FramePoses.from_matrices(odometry.world_from_color)
    usable = np.flatnonzero(given.status == TRACKED)
    stamps, first = np.unique(odometry.timestamp_ns[usable], return_index=True)  # type: ignore[index]
    known = given.world_from_cam[usable[first]]

    poses = np.full((len(at), 4, 4), np.nan)
    status = np.full(len(at), LOST, dtype="<U12")
    if config.interpolate != "always":
        partner = associate(at, stamps, round(config.max_gap_ms * NS_PER_MS))
        poses[partner >= 0] = known[partner[partner >= 0]]
        status[partner >= 0] = TRACKED
    if config.interpolate != "never":
        open_rows = np.flatnonzero(status == LOST)
        max_gap = round(config.max_interpolation_gap_ms * NS_PER_MS)
        poses[open_rows] = interpolate(stamps, known, at[open_rows], max_gap)
        found = open_rows[np.isfinite(poses[open_rows, 0, 0])]
        status[found] = np.where(np.isin(at[found], stamps), TRACKED, INTERPOLATED)
    return FramePoses(poses, status)


def _table(
    frames: pa.Table, world_from_cam: NDArray[np.float64], status: NDArray[np.str_]
) -> pa.Table:
    known = status != LOST
    quaternion = np.full((len(status), 4), np.nan)
    quaternion[known] = quaternion_from_matrix(world_from_cam[known, :3, :3])
    values = np.concatenate([world_from_cam[:, :3, 3], quaternion], axis=1)
    names = ("tx_m", "ty_m", "tz_m", "qw", "qx", "qy", "qz")
    columns = {name: pa.array(values[:, i], mask=~known) for i, name in enumerate(names)}
    keys = {name: frames[name] for name in ("sequence_id", "frame_index")}
    return from_columns(POSES, {**keys, **columns, "status": status.tolist()})
