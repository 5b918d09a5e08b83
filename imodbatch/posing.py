"""How the poses step comes by its poses: sources, levelling and judging put together."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from imodbatch.context import Context, camera_of
from imodbatch.core.depth import DepthImage
from imodbatch.core.trajectory import Trajectory
from imodbatch.datasets.registry import adapter_of
from imodbatch.engines.levelling.up import Up
from imodbatch.engines.rgbd import RgbdFrames
from imodbatch.errors import DataError
from imodbatch.images import UnreadableImageError
from imodbatch.manifest import SequenceSection
from imodbatch.stages import index, pose_quality, poses
from imodbatch.stages.base import Progress, StageResult, column

Tables = dict[str, pa.Table]


def pose_step(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    """Poses of a sequence from where the pipeline says, upright, and how good they are."""
    manifest, frames = context.manifest, tables["frames"]
    source = context.pipeline.poses.source
    trajectory = TRAJECTORY_SOURCES[source](context, sequence, frames, progress)
    world, how = manifest.world, "up as given"
    up: ArrayLike | None = world.direction() if source == "odometry" else world.first_camera_up
    if up is None:
        found = estimate_up(context, sequence, frames, trajectory.poses.world_from_cam, progress)
        up, how = found.direction, str(found)
        trajectory = replace(trajectory, figures={**trajectory.figures, **found.figures()})
    placed = poses.run(frames, trajectory, up, how)
    judged = _judge(context, sequence, frames, trajectory, placed.tables["poses"])
    return StageResult(
        {**placed.tables, **judged.tables},
        "; ".join(part for part in (placed.summary, judged.summary) if part),
        [*placed.warnings, *judged.warnings],
        placed.attributes,
    )


def _judge(
    context: Context,
    sequence: SequenceSection,
    frames: pa.Table,
    trajectory: Trajectory,
    placed: pa.Table,
) -> StageResult:
    """How good finished poses are; here only are true poses read."""
    from imodbatch.engines import trajectory_checks

    checks = pose_quality.ImageChecks(
        trajectory_checks.reprojection_errors_px, trajectory_checks.loop_errors
    )
    images, config = rgbd_frames(context, frames), context.pipeline.poses
    reference = _reference(context, sequence, frames)
    return pose_quality.run(frames, placed, trajectory, reference, images, checks, config)


def _reference(
    context: Context, sequence: SequenceSection, frames: pa.Table
) -> pose_quality.Reference | None:
    """True poses; their up is known where `[reference]`, or else `[world]`, says so."""
    manifest = context.manifest
    try:
        true = adapter_of(manifest).reference(manifest, sequence)
        if true is None:
            return None
        of_frames = poses.from_odometry(frames, true, context.pipeline.poses).poses
    except DataError as error:
        raise DataError(f"[reference] {error}") from None
    section = manifest.reference
    up = manifest.world.direction() if section is None else section.up_direction()
    return pose_quality.Reference(of_frames, up)


def estimate_up(
    context: Context,
    sequence: SequenceSection,
    frames: pa.Table,
    world_from_cam: NDArray[np.float64],
    progress: Progress[Any],
) -> Up:
    """Up in the world of the poses (F, 4, 4), from the depth of some frames that have a pose."""
    from imodbatch.engines.levelling import MAX_DEPTH_M, estimate_up

    config = context.pipeline.poses
    rows = frames.to_pylist()
    usable = [
        i
        for i in np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]))
        if rows[i]["depth_path"] is not None
    ]
    picked = np.unique(np.linspace(0, len(usable) - 1, config.levelling_frames).astype(int))
    chosen = [usable[i] for i in picked] if usable else []
    points = [_points_cam(context, rows[i], MAX_DEPTH_M) for i in progress(chosen)]
    setting = "world.up" if config.source == "odometry" else "world.first_camera_up"
    return estimate_up(points, world_from_cam[chosen], sequence.id, setting)


def _from_odometry(
    context: Context, sequence: SequenceSection, frames: pa.Table, progress: Progress[Any]
) -> Trajectory:
    del progress
    manifest, adapter = context.manifest, adapter_of(context.manifest)
    odometry = adapter.odometry(manifest, sequence, adapter.frames(manifest, sequence))
    return poses.from_odometry(frames, odometry, context.pipeline.poses)


def _from_slam(
    context: Context, sequence: SequenceSection, frames: pa.Table, progress: Progress[Any]
) -> Trajectory:
    from imodbatch.engines import slam

    del sequence
    return slam.estimate(rgbd_frames(context, frames), context.pipeline.slam, progress)


def _from_sfm(
    context: Context, sequence: SequenceSection, frames: pa.Table, progress: Progress[Any]
) -> Trajectory:
    from imodbatch.engines import sfm

    workspace = context.run_dir / "sfm" / sequence.id
    pipeline = context.pipeline
    return sfm.estimate(rgbd_frames(context, frames), workspace, pipeline.sfm, progress)


TRAJECTORY_SOURCES = {"odometry": _from_odometry, "slam": _from_slam, "sfm": _from_sfm}


def rgbd_frames(context: Context, frames: pa.Table) -> RgbdFrames:
    """The images of a sequence, as the engines take them."""
    rows = frames.to_pylist()

    def color(position: int) -> NDArray[np.uint8] | None:
        try:
            return context.read_color(rows[position]["color_path"])
        except UnreadableImageError:
            return None

    def depth(position: int) -> DepthImage | None:
        if rows[position]["depth_path"] is None:
            return None
        try:
            return context.read_depth(rows[position])
        except UnreadableImageError:
            return None

    return RgbdFrames(
        rows[0]["sequence_id"],
        column(frames, "frame_index").astype(np.int64),
        None if frames["timestamp_ns"].null_count else frames["timestamp_ns"].to_numpy(),
        camera_of(rows[0]),
        tuple(context.manifest.root_path / row["color_path"] for row in rows),
        color,
        depth,
    )


def _points_cam(context: Context, row: Any, max_depth_m: float) -> NDArray[np.float64]:
    """Every fourth pixel of a frame as points (P, 3) in the colour camera; none if unreadable."""
    try:
        depth_m = context.read_depth(row)[::4, ::4]
    except UnreadableImageError:  # lift says so for every box of the frame
        return np.zeros((0, 3))
    pixels = camera_of(row).pixel_centers()[::4, ::4]
    near = depth_m < max_depth_m
    return camera_of(row).unproject(pixels[near], depth_m[near])


def pose_files(context: Context, sequence: SequenceSection) -> Iterable[Path]:
    """Files that the poses and their quality depend on."""
    manifest, adapter = context.manifest, adapter_of(context.manifest)
    is_estimated = context.pipeline.poses.source != "odometry"
    return [
        *(index.image_files if is_estimated else adapter.odometry_files)(manifest, sequence),
        *adapter.reference_files(manifest, sequence),
    ]
