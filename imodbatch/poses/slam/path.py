"""A sequence through the mapper, and from its records to a trajectory."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from imodbatch.core.alignment import known
from imodbatch.core.depth import DepthImage
from imodbatch.core.errors import DataError
from imodbatch.core.frames import invert
from imodbatch.core.trajectory import LOST, FramePoses, Trajectory
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.rgbd.gray import Gray, read_gray
from imodbatch.poses.slam.mapping import Mapper
from imodbatch.settings.config import SlamConfig

N_AHEAD = 4
Images = tuple[Gray | None, DepthImage | None]


def estimate(
    frames: RgbdFrames,
    config: SlamConfig,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,  # type: ignore[assignment]
) -> Trajectory:
    """Track the camera of a sequence.

    Args:
        frames: of one sequence, with depth.
        config: what can be turned.
        progress: wraps the frame numbers to show how far it is.

    Returns:
        poses in the world of the first frame that is not lost: its camera. Where the sequence
        falls into parts that share no view, the one with most frames counts, the rest is lost.

    Raises:
        DataError: no frame has depth, or none could be located.
    """
    mapper = Mapper(frames.camera, config.n_features)
    n_with_depth = 0
    for _, (gray, depth_m) in zip(progress(range(len(frames))), _read_ahead(frames), strict=True):
        n_with_depth += depth_m is not None and bool(np.isfinite(depth_m).any())
        mapper.add(gray, depth_m)
    if n_with_depth == 0:
        raise DataError(
            f"{frames.sequence_id}: no depth in any of {len(frames)} frames, and slam needs it. "
            "Check images.depth and camera.depth in the manifest."
        )
    mapper.finish()
    return _trajectory(frames, mapper)


def _read_ahead(frames: RgbdFrames) -> Iterator[Images]:
    """Images in order; the next ones are read while one is worked on."""

    def read(position: int) -> Images:
        return read_gray(frames, position), frames.read_depth(position)

    with ThreadPoolExecutor(1) as pool:
        coming: list[Future[Images]] = []
        for position in range(len(frames)):
            coming.append(pool.submit(read, position))
            if len(coming) > N_AHEAD:
                yield coming.pop(0).result()
        for future in coming:
            yield future.result()


def _trajectory(frames: RgbdFrames, mapper: Mapper) -> Trajectory:
    keyframes = mapper.landmarks.keyframes
    part_of = [None if r is None else keyframes[r.keyframe].part for r in mapper.records]
    size = Counter(part for part in part_of if part is not None)
    n = len(frames)
    largest = max(size, key=lambda part: size[part], default=None)
    if largest is None or (size[largest] == 1 and n > 1):
        raise DataError(
            f"{frames.sequence_id}: none of {n} frames could be followed to the next: too little "
            "texture and shape in view, or frames too far apart. Use poses.source = 'sfm', or "
            "[odometry] in the manifest."
        )
    poses, status = np.full((n, 4, 4), np.nan), np.full(n, LOST, dtype="<U12")
    for position, record in enumerate(mapper.records):
        if record is not None and part_of[position] == largest:
            reference = keyframes[record.keyframe].cam_from_world
            poses[position] = invert(record.cam_from_keyframe @ reference)
            status[position] = record.status
    poses = invert(poses[np.flatnonzero(status != LOST)[0]]) @ poses
    status[~known(poses)] = LOST
    others = sum(size.values()) - size[largest]
    warnings: tuple[str, ...] = ()
    if others:
        warnings = (
            f"{frames.sequence_id}: {others} frames belong to {len(size) - 1} other places that "
            "share no view with the rest; they count as lost.",
        )
    n_keyframes = sum(k.part == largest for k in keyframes)
    figures = {
        "slam_keyframes": float(n_keyframes),
        "slam_loops": float(mapper.n_loops),
        "slam_relocalised": float(mapper.n_relocalised),
        "slam_largest_correction_m": mapper.largest_correction_m,
        "slam_parts": float(len(size)),
    }
    summary = f"slam: {n_keyframes} keyframes, {mapper.n_loops} loops"
    return Trajectory(FramePoses(poses, status), summary, warnings, figures)
