"""The order of events: database, model, scale, frames in between, gaps."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.frames import invert
from imodbatch.core.trajectory import INTERPOLATED, LOST, TRACKED, FramePoses, Trajectory
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.sfm.colmap import SEED, Progress, pycolmap
from imodbatch.poses.sfm.depth_adjustment import adjust_to_depth
from imodbatch.poses.sfm.features import image_root
from imodbatch.poses.sfm.gaps import fill_gaps, n_covered
from imodbatch.poses.sfm.localization import localize
from imodbatch.poses.sfm.mapping import Model, reconstruct
from imodbatch.poses.sfm.scale import MetricScale, check_depth, metric_scale
from imodbatch.poses.sfm.workspace import Database, keep_model, provide_database
from imodbatch.settings.config import SfmConfig

Array = NDArray[np.float64]
MIN_FRAMES = 2
SURE_SCALE_PERCENT = 1.0


def estimate(
    frames: RgbdFrames, workspace: Path, config: SfmConfig, progress: Progress
) -> Trajectory:
    """Estimate the camera's path by structure from motion.

    The world is the camera of the first frame with a pose, in metres. Random numbers are seeded,
    so runs are alike; but sums of bundle adjustment come in another order with another number of
    threads, which moves poses slightly and may decide on a frame that can barely be registered.

    Args:
        frames: the sequence.
        workspace: folder of the database, which is used again if it fits, and of the model.
        config: settings.
        progress: wraps loops, as tqdm does.

    Raises:
        DataError: too few frames, no depth, nothing to reconstruct, or no common scale.
        ImodError: COLMAP cannot do what is asked of it.
    """
    if len(frames) < MIN_FRAMES:
        raise DataError(
            f"{frames.sequence_id}: {len(frames)} frame, structure from motion needs several "
            "views. Give more frames, or use poses.source = 'odometry'."
        )
    check_depth(frames)
    pycolmap().set_random_seed(SEED)
    database = provide_database(frames, workspace, config, progress)
    models = reconstruct(database, image_root(frames), config.mapper, frames.sequence_id, progress)
    model, n_elsewhere = _largest(models, database, len(frames))
    scale = metric_scale(frames, model, progress)
    model.reconstruction.transform(_similarity(scale.metres * np.eye(4)[:3]))
    if config.adjust_to_depth:
        adjust_to_depth(frames, model, progress)
    known = {k: invert(model.cam_from_world(k)) for k in model.keyframes()}
    known |= localize(frames, model, config.adjust_to_depth, progress)
    first_from_model = invert(known[min(known)])
    known = {position: first_from_model @ pose for position, pose in known.items()}
    poses = fill_gaps(known, len(frames), config.max_gap_frames)
    model.reconstruction.transform(_similarity(first_from_model[:3]))
    keep_model(model.reconstruction, workspace)
    figures = _figures(model, database, scale, poses)
    warnings = _warnings(frames, database, n_elsewhere, scale)
    return Trajectory(poses, _summary(figures, len(frames)), warnings, figures)


def _largest(models: list[Model], database: Database, n_frames: int) -> tuple[Model, int]:
    """The model that stands for most frames, and the number of frames that lie in others only."""
    keyframes = database.keyframes
    largest = max(models, key=lambda m: n_covered(m.keyframes(), keyframes, n_frames))
    mapped = {k for model in models for k in model.keyframes()}
    elsewhere = sorted(mapped - set(largest.keyframes()))
    return largest, n_covered(elsewhere, keyframes, n_frames)


def _similarity(rows: Array) -> Any:
    """COLMAP's similarity of a matrix (3, 4)."""
    return pycolmap().Sim3d(rows)


def _figures(
    model: Model, database: Database, scale: MetricScale, poses: FramePoses
) -> dict[str, float]:
    reconstruction = model.reconstruction
    return {
        "sfm_registered": float((poses.status == TRACKED).sum()),
        "sfm_interpolated": float((poses.status == INTERPOLATED).sum()),
        "sfm_lost": float((poses.status == LOST).sum()),
        "sfm_keyframes": float(len(database.keyframes)),
        "sfm_keyframes_reconstructed": float(len(model.keyframes())),
        "sfm_points": float(reconstruction.num_points3D()),
        "sfm_track_length": float(reconstruction.compute_mean_track_length()),
        "sfm_reprojection_error_px": float(reconstruction.compute_mean_reprojection_error()),
        "metric_scale": scale.metres,
        "metric_scale_spread_percent": scale.spread_percent,
        "metric_scale_standard_error_percent": scale.standard_error_percent,
        "metric_scale_ratios": float(scale.n_ratios),
    }


def _warnings(
    frames: RgbdFrames, database: Database, n_elsewhere: int, scale: MetricScale
) -> tuple[str, ...]:
    found = []
    if database.unreadable:
        found.append(
            f"{len(database.unreadable)} of {len(frames)} colour images are missing or damaged; "
            "their frames are interpolated or lost."
        )
    if n_elsewhere:
        found.append(
            f"{n_elsewhere} of {len(frames)} frames lie in models that could not be joined with "
            "the largest; they are lost."
        )
    if scale.standard_error_percent > SURE_SCALE_PERCENT:
        found.append(
            f"the metric scale is known to {scale.standard_error_percent:.1f} % only, from "
            f"{scale.n_ratios:,} points with depth."
        )
    return tuple(found)


def _summary(figures: dict[str, float], n_frames: int) -> str:
    return (
        f"sfm: {figures['sfm_registered']:.0f} of {n_frames:,} registered "
        f"({figures['sfm_keyframes_reconstructed']:.0f} keyframes), "
        f"{figures['sfm_points']:,.0f} points, scale {figures['metric_scale']:.4g} "
        f"± {figures['metric_scale_standard_error_percent']:.1f} %"
    )
