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
from imodbatch.run.plan import Plan, camera_of
from imodbatch.run.step import Tables, sections
from imodbatch.tables.columns import Progress, StageResult, column
from imodbatch.tables.parquet import attributes_of


def pose_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Poses of a sequence from where the pipeline says, upright."""
    manifest, frames = part.manifest, tables["frames"]
    source = part.pipeline.poses.source
    trajectory = TRAJECTORY_SOURCES[source](part, frames, progress)
    world, how = manifest.world, "up as given"
    up: ArrayLike | None = world.direction() if source == "odometry" else world.first_camera_up
    if up is None:
        found = estimate_up(part, frames, trajectory.poses.world_from_cam, progress)
        up, how = found.direction, str(found)
        trajectory = replace(trajectory, figures={**trajectory.figures, **found.figures()})
    return poses.run(frames, trajectory, up, how)


def quality_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
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
        _reference(part, frames),
        rgbd_frames(part, frames),
        checks,
        part.pipeline.pose_quality,
    )


def _reference(part: Plan, frames: pa.Table) -> pose_quality.Reference | None:
    """True poses; their up is known where `[reference]`, or else `[world]`, says so."""
    manifest = part.manifest
    try:
        true = layout_of(manifest).reference(manifest, part.sequence)
        if true is None:
            return None
        of_frames = poses.from_odometry(frames, true, part.pipeline.poses).poses
    except DataError as error:
        raise DataError(f"[reference] {error}") from None
    section = manifest.reference
    up = manifest.world.direction() if section is None else section.up_direction()
    is_judged = part.pipeline.poses.source == "odometry" and _is_same(
        _from_odometry(part, frames, iter).poses, of_frames
    )
    return pose_quality.Reference(of_frames, up, is_judged)


def _is_same(judged: FramePoses, true: FramePoses) -> bool:
    both = known(judged.world_from_cam) & known(true.world_from_cam)
    same = np.array_equal(judged.world_from_cam[both], true.world_from_cam[both])
    return bool(both.any() and same)


def estimate_up(
    part: Plan,
    frames: pa.Table,
    world_from_cam: NDArray[np.float64],
    progress: Progress[Any],
) -> Up:
    """Up in the world of the poses (F, 4, 4), from the depth of some frames that have a pose."""
    from imodbatch.poses.levelling.images import up_of_frames

    config = part.pipeline.poses
    has_depth = np.asarray(frames["depth_path"].is_valid())
    setting = "world.up" if config.source == "odometry" else "world.first_camera_up"
    images = rgbd_frames(part, frames)
    return up_of_frames(
        images, world_from_cam, has_depth, config.levelling_frames, setting, progress
    )


def _from_odometry(part: Plan, frames: pa.Table, progress: Progress[Any]) -> Trajectory:
    del progress
    odometry = layout_of(part.manifest).odometry(part.manifest, part.sequence)
    return poses.from_odometry(frames, odometry, part.pipeline.poses)


def _from_slam(part: Plan, frames: pa.Table, progress: Progress[Any]) -> Trajectory:
    from imodbatch.poses import slam

    return slam.estimate(rgbd_frames(part, frames), part.pipeline.slam, progress)


def _from_sfm(part: Plan, frames: pa.Table, progress: Progress[Any]) -> Trajectory:
    from imodbatch.poses import sfm

    workspace = part.run_dir / "sfm" / part.sequence.id
    return sfm.estimate(rgbd_frames(part, frames), workspace, part.pipeline.sfm, progress)


TRAJECTORY_SOURCES = {"odometry": _from_odometry, "slam": _from_slam, "sfm": _from_sfm}


def rgbd_frames(part: Plan, frames: pa.Table) -> RgbdFrames:
    """The images of a sequence, as the engines take them."""
    rows = frames.to_pylist()

    def color(position: int) -> NDArray[np.uint8] | None:
        try:
            return part.read_color(rows[position]["color_path"])
        except UnreadableImageError:
            return None

    def depth(position: int) -> DepthImage | None:
        if rows[position]["depth_path"] is None:
            return None
        try:
            return part.read_depth(rows[position])
        except UnreadableImageError:
            return None

    return RgbdFrames(
        rows[0]["sequence_id"],
        column(frames, "frame_index").astype(np.int64),
        None if frames["timestamp_ns"].null_count else frames["timestamp_ns"].to_numpy(),
        camera_of(rows[0]),
        tuple(part.manifest.root_path / row["color_path"] for row in rows),
        color,
        depth,
    )


def pose_files(part: Plan) -> Iterable[Path]:
    """Files that the poses depend on."""
    manifest, layout = part.manifest, layout_of(part.manifest)
    is_estimated = part.pipeline.poses.source != "odometry"
    return (index.image_files if is_estimated else layout.odometry_files)(manifest, part.sequence)


def pose_settings(part: Plan) -> dict[str, Any]:
    """Of the source in use; how frames find poses in a file matters to that source alone."""
    config = part.pipeline.poses
    if config.source == "odometry":
        return sections("poses", "@odometry", "@world", "@camera")(part)
    own = config.model_dump(include={"source", "levelling_frames"})
    return {"poses": own, **sections(config.source, "@world", "@camera")(part)}


quality_settings = sections("pose_quality", "poses", "@world", "@camera", "@reference")
"""The reference is a file, whatever the source of the poses."""


def reference_files(part: Plan) -> Iterable[Path]:
    """Files of true poses."""
    return layout_of(part.manifest).reference_files(part.manifest, part.sequence)
