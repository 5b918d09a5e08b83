"""A camera's path as a trajectory file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import quaternion_from_matrix
from imodbatch.tables.atomic import write_text


def write_tum(
    path: Path,
    world_from_cam: NDArray[np.float64],
    frames_per_second: float,
    comment: str,
    digits: int = 9,
) -> None:
    """Write poses (F, 4, 4) as TUM lines ``stamp tx ty tz qx qy qz qw``, world_from_cam.

    Args:
        path: of the file.
        world_from_cam: metres.
        frames_per_second: from which the stamps follow; the first is 0.
        comment: its first line.
        digits: after the point.
    """
    lines = [f"# {comment}"]
    for frame_index, pose in enumerate(world_from_cam):
        w, x, y, z = quaternion_from_matrix(pose[:3, :3])
        numbers = " ".join(f"{value:.{digits}f}" for value in (*pose[:3, 3], x, y, z, w))
        lines.append(f"{frame_index / frames_per_second:.6f} {numbers}")
    write_text(path, "\n".join(lines) + "\n")
