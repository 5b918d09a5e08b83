"""How poses come about: sources, levelling, and, a step of its own, judging."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.alignment import known
from imodbatch.core.depth import DepthImage
from imodbatch.core.errors import DataError
from imodbatch.core.trajectory import FramePoses, Trajectory
from imodbatch.datasets import index
from imodbatch.datasets.images import UnreadableImageError
from imodbatch.datasets.registry import layout_of
from imodbatch.poses import association as poses
from imodbatch.poses import quality as pose_quality
from imodbatch.poses.levelling.up import Up
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.run.context import Context, camera_of
from imodbatch.settings.manifest import SequenceSection
from imodbatch.tables.columns import Progress, StageResult, column
from imodbatch.tables.parquet import attributes_of

Tables = dict[str, pa.Table]


def pose_step(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    """Poses of a sequence from where the pipeline says, upright."""
    manifest, frames = context.manifest, tables["frames"]
    source = context.pipeline.poses.source
    trajectory = TRAJECTORY_SOURCES[source](context, sequence, frames, progress)
    world, how = manifest.world, "up as given"
    up: ArrayLike | None = world.direction() if source == "odometry" else world.first_camera_up
    if up is None:
        found = estimate_up(context, frames, trajectory.poses.world_from_cam, progress)
        up, how = found.direction, str(found)
        trajectory = replace(trajectory, figures={**trajectory.figures, **found.figures()})
    return poses.run(frames, trajectory, up, how)


def quality_step(
    context: Context, sequence: SequenceSection, tables: Tables, progress: Progress[Any]
) -> StageResult:
    """How good the poses of a sequence are; here only are true poses read."""
    del progress
    frames = tables["frames"]
    from imodbatch.poses.rgbd import trajectory_checks

    checks = pose_quality.ImageChecks(
        trajectory_checks.reprojection_errors_px, trajectory_checks.loop_errors
    )
    return pose_quality.run(
        frames,
        tables["poses"],
        attributes_of(tables["poses"])["figures"],
        _reference(context, sequence, frames),
        rgbd_frames(context, frames),
        checks,
        context.pipeline.pose_quality,
    )


def _reference(
    context: Context, sequence: SequenceSection, frames: pa.Table
) -> pose_quality.Reference | None:
    """True poses; their up is known where `[reference]`, or else `[world]`, says so."""
    manifest = context.manifest
    try:
        true = layout_of(manifest).reference(manifest, sequence)
        if true is None:
            return None
        of_frames = poses.from_odometry(frames, true, context.pipeline.poses).poses
    except DataError as error:
        raise DataError(f"[reference] {error}") from None
    section = manifest.reference
    up = manifest.world.direction() if section is None else section.up_direction()
    is_judged = context.pipeline.poses.source == "odometry" and _is_same(
        _from_odometry(context, sequence, frames, iter).poses, of_frames
    )
    return pose_quality.Reference(of_frames, up, is_judged)


def _is_same(judged: FramePoses, true: FramePoses) -> bool:
    both = known(judged.world_from_cam) & known(true.world_from_cam)
    same = np.array_equal(judged.world_from_cam[both], true.world_from_cam[both])
    return bool(both.any() and same)


def estimate_up(
    context: Context,
    frames: pa.Table,
    world_from_cam: NDArray[np.float64],
    progress: Progress[Any],
) -> Up:
    """Up in the world of the poses (F, 4, 4), from the depth of some frames that have a pose."""
    from imodbatch.poses.levelling.images import up_of_frames

    config = context.pipeline.poses
    has_depth = np.asarray(frames["depth_path"].is_valid())
    setting = "world.up" if config.source == "odometry" else "world.first_camera_up"
    images = rgbd_frames(context, frames)
    return up_of_frames(
        images, world_from_cam, has_depth, config.levelling_frames, setting, progress
    )


def _from_odometry(
    context: Context, sequence: SequenceSection, frames: pa.Table, progress: Progress[Any]
) -> Trajectory:
    del progress
    odometry = layout_of(context.manifest).odometry(context.manifest, sequence)
    return poses.from_odometry(frames, odometry, context.pipeline.poses)


def _from_slam(
    context: Context, sequence: SequenceSection, frames: pa.Table, progress: Progress[Any]
) -> Trajectory:
    from imodbatch.poses import slam

    del sequence
    return slam.estimate(rgbd_frames(context, frames), context.pipeline.slam, progress)


def _from_sfm(
    context: Context, sequence: SequenceSection, frames: pa.Table, progress: Progress[Any]
) -> Trajectory:
    from imodbatch.poses import sfm

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


def pose_files(context: Context, sequence: SequenceSection) -> Iterable[Path]:
    """Files that the poses depend on."""
    manifest, layout = context.manifest, layout_of(context.manifest)
    is_estimated = context.pipeline.poses.source != "odometry"
    return (index.image_files if is_estimated else layout.odometry_files)(manifest, sequence)


def reference_files(context: Context, sequence: SequenceSection) -> Iterable[Path]:
    """Files of true poses."""
    return layout_of(context.manifest).reference_files(context.manifest, sequence)
