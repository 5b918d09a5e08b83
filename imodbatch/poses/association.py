"""poses: frames + a trajectory → a pose, and a status, for every frame, in a world with +z up."""

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.trajectory import (
    INTERPOLATED,
    LOST,
    STATUSES,
    TRACKED,
    FramePoses,
    Trajectory,
    associate,
    interpolate,
    level,
)
from imodbatch.datasets.base import Odometry
from imodbatch.datasets.odometry_checks import contradictions, left_out, why_none_fits
from imodbatch.settings.config import PosesConfig
from imodbatch.tables.columns import StageResult, column, pose_columns, tally
from imodbatch.tables.parquet import from_columns
from imodbatch.tables.schemas import POSES

NS_PER_MS = 1_000_000


def run(frames: pa.Table, trajectory: Trajectory, up: ArrayLike, how: str) -> StageResult:
    """Give every frame of a sequence a pose or the status ``lost``, in a world with +z up.

    Args:
        frames: the frames table of one sequence.
        trajectory: poses of these frames in a world of their own.
        up: (3,) direction of that world that points up.
        how: how that is known, for the summary.
    """
    poses = trajectory.poses
    levelled = level(poses.world_from_cam, up)
    counts = {s: int((poses.status == s).sum()) for s in STATUSES}
    parts = (tally(frames.num_rows, "frames", counts), trajectory.summary, how)
    table = _table(frames, levelled, poses.status)
    direction = [float(value) for value in np.asarray(up, dtype=np.float64)]
    return StageResult(
        {"poses": table},
        "; ".join(part for part in parts if part),
        list(trajectory.warnings),
        {"up": direction, "levelling": how, "figures": dict(trajectory.figures)},
    )


def from_odometry(frames: pa.Table, odometry: Odometry | None, config: PosesConfig) -> Trajectory:
    """The poses that a dataset gives, for its frames.

    Args:
        frames: the frames table of one sequence.
        odometry: poses as the dataset gives them; None = it has none.
        config: association and interpolation.

    Raises:
        DataError: there are no poses at all, or stamps are needed and missing.
    """
    sequence_id = frames["sequence_id"][0].as_py()
    if odometry is None:
        raise DataError(
            f"{sequence_id}: the dataset gives no camera poses. Add [odometry] with format and "
            "path to the manifest, or estimate them: poses.source = 'slam' or 'sfm'."
        )
    if odometry.frame_index is not None:
        poses = _by_number(column(frames, "frame_index"), odometry)
    else:
        poses = _by_stamp(frames, odometry, config, sequence_id)
    if (poses.status == LOST).all():
        raise DataError(
            f"{sequence_id}: none of {frames.num_rows} frames has a pose. "
            + why_none_fits(column(frames, "frame_index"), _stamps(frames), odometry)
        )
    return Trajectory(poses, left_out(odometry), contradictions(odometry))


def _stamps(frames: pa.Table) -> NDArray[np.int64] | None:
    """Moments of the frames, None where one is unknown."""
    return None if frames["timestamp_ns"].null_count else frames["timestamp_ns"].to_numpy()


def _by_number(frame_index: NDArray[np.int64], odometry: Odometry) -> FramePoses:
    """Poses that belong to frames by number."""
    if len(odometry.world_from_color) == 0:
        return FramePoses.from_matrices(np.full((len(frame_index), 4, 4), np.nan))
    given = FramePoses.from_matrices(odometry.world_from_color)
    row_of: dict[int, int] = {}
    for row in np.flatnonzero(given.status == TRACKED):
        row_of.setdefault(int(odometry.frame_index[row]), int(row))  # type: ignore[index]
    rows = np.array([row_of.get(int(number), -1) for number in frame_index])
    chosen = np.where((rows >= 0)[:, None, None], odometry.world_from_color[rows], np.nan)
    return FramePoses.from_matrices(chosen)


def _by_stamp(
    frames: pa.Table, odometry: Odometry, config: PosesConfig, sequence_id: str
) -> FramePoses:
    """Poses that belong to frames by moment: association one to one, then interpolation."""
    at = _stamps(frames)
    if at is None:
        raise DataError(
            f"{sequence_id}: frames have no timestamps, and the trajectory is by timestamp. Give "
            "images.timestamps, images.frames_per_second or {stamp} in images.color."
        )
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
    keys = {name: frames[name] for name in ("sequence_id", "frame_index")}
    columns = {**keys, **pose_columns(world_from_cam), "status": status.tolist()}
    return from_columns(POSES, columns)
