"""estimate_poses: images in memory, or poses of the caller's own → poses in a world with +z up."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError
from imodbatch.core.trajectory import Trajectory
from imodbatch.poses import association as poses_stage
from imodbatch.poses.levelling.images import up_of_frames
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.run.library.images import Images, color_reader, depth_reader, frame_numbers
from imodbatch.run.library.settings import settings_of
from imodbatch.run.library.tables import SEQUENCE, frames_of, given_trajectory, told
from imodbatch.settings.config import PosesConfig, SfmConfig, SlamConfig
from imodbatch.settings.sections import WorldSection
from imodbatch.settings.toml import StrictModel, did_you_mean
from imodbatch.tables.columns import Progress

SOURCES = ("slam", "sfm")
CALL = "estimate_poses"


def estimate_poses(
    colors: Images | None,
    depths: Images | None,
    camera: PinholeCamera,
    source: str | ArrayLike = "slam",
    up: str | ArrayLike = "estimate",
    *,
    frame_index: ArrayLike | None = None,
    sequence_id: str = SEQUENCE,
    progress: Progress[Any] = iter,
    **settings: Any,
) -> pd.DataFrame:
    """Where the camera was in each frame, in a world with +z up.

    Args:
        colors: F images (H, W, 3) uint8 RGB in order, or a function from a frame's number to its
            image; None = the frame has none. Not needed where `source` is poses.
        depths: F images (H, W) of z-depth in metres, registered to colour; NaN, 0, negative or
            infinite = unknown. Likewise. Not needed where `source` is poses and `up` is given.
        camera: of the images, undistorted; cx, cy count from the image's corner.
        source: "slam" for video, "sfm" for frames in odd order, or poses of your own to be
            levelled, world_from_cam (F, 4, 4), NaN = lost.
        up: "estimate" from floors, tables and walls in depth, or which way is up: an axis ("-y")
            or direction (3,) in the camera of the first frame with a pose; of poses of your own,
            in their world.
        frame_index: (F,) rising numbers of the frames; None = 0, 1, 2, …
        sequence_id: names the sequence in tables and errors.
        progress: wraps loops, as tqdm does.
        settings: keys of ``[slam]`` or ``[sfm]`` of a pipeline file.

    Returns:
        The table `poses`: world_from_cam as centre and quaternion, and a status, per frame.

    Raises:
        ImodError: images do not fit the camera or each other, an unknown setting, nothing could be
            tracked, or depth does not tell up.
    """
    own = None if isinstance(source, str) else given_trajectory(source)
    if isinstance(source, str) and source not in SOURCES:
        raise ConfigError(f"source: no {source!r}.{did_you_mean(source, SOURCES)}")
    in_order = {"colors": colors, "depths": depths}
    if own is not None:
        in_order["source"] = list(own.poses.status)
    numbers = frame_numbers(frame_index, **in_order)
    images = RgbdFrames(
        sequence_id,
        numbers,
        None,
        camera,
        tuple(Path(f"{number:09d}") for number in numbers),  # names for sfm; nothing lies there
        color_reader(colors, numbers, camera) if own is None else _nothing,
        _nothing if depths is None else depth_reader(depths, numbers, camera),
    )
    given_up = settings_of(WorldSection, {"up": up}, CALL).direction()
    trajectory = _trajectory(source, own, images, settings, progress)
    direction: ArrayLike
    if given_up is None:
        found = up_of_frames(
            images,
            trajectory.poses.world_from_cam,
            np.full(len(numbers), depths is not None),
            PosesConfig().levelling_frames,
            "up=(x, y, z) to estimate_poses, or world.first_camera_up",
            progress,
        )
        direction, how = found.direction, str(found)
    else:
        direction, how = given_up, "up as given"
    frames = frames_of(camera, numbers, sequence_id)
    return told(poses_stage.run(frames, trajectory, direction, how), "poses")


def _trajectory(
    source: object,
    own: Trajectory | None,
    images: RgbdFrames,
    settings: dict[str, Any],
    progress: Progress[Any],
) -> Trajectory:
    if own is not None:
        settings_of(StrictModel, settings, CALL)
        return own
    if source == "slam":
        from imodbatch.poses import slam

        return slam.estimate(images, settings_of(SlamConfig, settings, CALL), progress)
    from imodbatch.poses import sfm

    config = settings_of(SfmConfig, settings, CALL)
    with tempfile.TemporaryDirectory() as workspace:
        return sfm.estimate(images, Path(workspace), config, progress)


def _nothing(position: int) -> None:
    """No image."""
    del position
