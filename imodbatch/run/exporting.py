"""Finished poses as files that other tools read."""

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from imodbatch.core.trajectory import LOST
from imodbatch.run.plan import Plan
from imodbatch.run.stored import load
from imodbatch.tables.atomic import write_text
from imodbatch.tables.columns import column, tally

NS_PER_S = 1_000_000_000
POSE_COLUMNS = ("tx_m", "ty_m", "tz_m", "qx", "qy", "qz", "qw")


def export_tum(plan: Plan, folder: Path) -> Iterator[str]:
    """Write ``<sequence>.txt`` per sequence in the TUM format; yield a line on each that adds up.

    Args:
        plan: the run, and which of its sequences.
        folder: where the files go; made if it is not there.

    Raises:
        TableError: the poses are not there yet.
    """
    tables = [
        (alone.sequence.id, load(alone, "frames"), load(alone, "poses")) for alone in plan.each()
    ]
    folder.mkdir(parents=True, exist_ok=True)
    for sequence_id, frames, poses in tables:
        write_text(folder / f"{sequence_id}.txt", tum_text(frames, poses))
        n_lost = sum(status == LOST for status in poses["status"].to_pylist())
        counts = {"written": poses.num_rows - n_lost, "lost": n_lost}
        yield f"{sequence_id}: {tally(poses.num_rows, 'poses', counts)}"


def tum_text(frames: pa.Table, poses: pa.Table) -> str:
    """A comment, then ``stamp tx ty tz qx qy qz qw`` (world_from_cam) per frame that is not lost.

    Args:
        frames: the frames table of one sequence.
        poses: its poses.
    """
    keys, moments = (frames[name].to_pylist() for name in ("frame_index", "timestamp_ns"))
    moment = dict(zip(keys, moments, strict=True))
    has_moments = None not in moment.values()
    stamp = "stamp in seconds" if has_moments else "stamp = frame number (there are no timestamps)"
    lines = [f"# {stamp}, tx ty tz in metres, qx qy qz qw; camera in the world, +z up"]
    known = poses.filter(pc.not_equal(poses["status"], LOST)).sort_by("frame_index")
    values = zip(*(column(known, name) for name in POSE_COLUMNS), strict=True)
    for frame_index, pose in zip(known["frame_index"].to_pylist(), values, strict=True):
        at = _seconds(moment[frame_index]) if has_moments else str(frame_index)
        lines.append(" ".join([at, *(f"{value:.9f}" for value in pose)]))
    return "\n".join(lines) + "\n"


def _seconds(moment_ns: int) -> str:
    """Nanoseconds as seconds with all nine decimals; a float would lose today's."""
    whole, rest = divmod(abs(moment_ns), NS_PER_S)
    return f"{'-' if moment_ns < 0 else ''}{whole}.{rest:09d}"
