"""pose_quality: poses + images (+ true poses, if there are any) → how good the poses are.

Without truth: whether features and depth of nearby frames lie where the poses put them, and whether
the images agree with the poses where the camera comes back to a place. With truth: the absolute and
the relative error of the trajectory, and how far +z is from up. Nothing here changes a pose.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.alignment import (
    Similarity,
    absolute_errors_m,
    align_poses,
    known,
    relative_errors,
    summarise,
)
from imodbatch.core.consistency import DepthConsistency, depth_consistency
from imodbatch.core.frames import invert
from imodbatch.core.pairs import Pairs, neighbours, overlapping, revisits, steps_m
from imodbatch.core.trajectory import STATUSES, FramePoses
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.settings.config import PoseQualityConfig
from imodbatch.tables.columns import StageResult, column, pose_columns, world_from_cam_of
from imodbatch.tables.parquet import empty, from_columns, from_rows
from imodbatch.tables.schemas import POSE_QUALITY, REFERENCE_POSES

Array = NDArray[np.float64]
Figure = tuple[str, float | None, int]
"""Metric, value (None = cannot be told) and the cases behind it."""
NS_PER_S = 1_000_000_000
FEWEST_TO_ALIGN = 3
WORST_DEPTH_SHARE, WORST_REPROJECTION_SHARE = 0.5, 0.02
"""Less agreement in depth, or more pixels of the image's width, and the user is warned."""


@dataclass(frozen=True)
class Reference:
    """True poses of the frames, in a world of their own.

    Attributes:
        poses: of the frames.
        up: of their world; None = unknown.
        is_judged: whether they are the very poses that are judged.
    """

    poses: FramePoses
    up: tuple[float, float, float] | None = None
    is_judged: bool = False


@dataclass(frozen=True)
class ImageChecks:
    """What images say of poses: see `poses.rgbd.trajectory_checks`.

    Attributes:
        reprojection_px: frames, poses (F, 4, 4), pairs (P, 2) → a median distance per pair judged.
        loops: likewise → translation in metres and rotation in radians per pair judged.
    """

    reprojection_px: Callable[[RgbdFrames, Array, Pairs], Array]
    loops: Callable[[RgbdFrames, Array, Pairs], tuple[Array, Array]]


def run(
    frames: pa.Table,
    poses: pa.Table,
    source_figures: Mapping[str, float],
    reference: Reference | None,
    images: RgbdFrames,
    checks: ImageChecks,
    config: PoseQualityConfig,
) -> StageResult:
    """Judge the poses of one sequence.

    Args:
        frames: the frames table of the sequence.
        poses: its poses, in a world with +z up.
        source_figures: what their source says of itself, by name.
        reference: true poses of the same frames; None = there are none. Where they are the very
            poses that are judged, no error against them is given: it would be 0 and mislead.
        images: the same frames' images.
        checks: of images against poses.
        config: the span of the relative error.
    """
    world_from_cam = _matrices(frames, poses)
    figures = [*_counts(poses), *_walk(frames, world_from_cam)]
    figures += _by_images(images, world_from_cam, checks)
    aligned, remark = empty(REFERENCE_POSES), ""
    if reference is not None and reference.is_judged:
        remark = "no ATE: the poses are the reference itself"
    elif reference is not None:
        alignment = align_poses(world_from_cam, reference.poses.world_from_cam)
        figures += _against(reference, world_from_cam, config.rpe_delta_frames)
        aligned = _aligned(frames, alignment, reference)
        shared = known(world_from_cam) & known(reference.poses.world_from_cam)
        remark = "" if shared.sum() >= FEWEST_TO_ALIGN else "no ATE: too few poses are in both"
    n_known = int(known(world_from_cam).sum())
    figures += [(name, float(value), n_known) for name, value in source_figures.items()]
    return StageResult(
        {"pose_quality": _table(frames, figures), "reference_poses": aligned},
        "; ".join(part for part in (_in_short(figures), remark) if part),
        list(_warnings(frames, figures)),
    )


def _matrices(frames: pa.Table, poses: pa.Table) -> Array:
    """Poses (F, 4, 4) in the order of the frames, NaN where lost."""
    known_poses = world_from_cam_of(poses)
    none = np.full((4, 4), np.nan)
    return np.array([known_poses.get(i, none) for i in column(frames, "frame_index").tolist()])


def _counts(poses: pa.Table) -> Iterator[Figure]:
    status = column(poses, "status")
    yield "frames", float(len(status)), len(status)
    for name in STATUSES:
        yield name, float((status == name).sum()), len(status)


def _walk(frames: pa.Table, world_from_cam: Array) -> Iterator[Figure]:
    """Length of the way between the frames that have a pose, and the time it took."""
    here = world_from_cam[known(world_from_cam)]
    yield "path_length_m", float(steps_m(here).sum()) if len(here) else None, len(here)
    stamps = frames["timestamp_ns"].drop_null().to_numpy()
    duration = float(np.ptp(stamps)) / NS_PER_S if len(stamps) else None
    yield "duration_s", duration, len(stamps)


def _by_images(images: RgbdFrames, world_from_cam: Array, checks: ImageChecks) -> Iterator[Figure]:
    """Figures that need no truth."""
    next_to = neighbours(known(world_from_cam))
    reprojection = checks.reprojection_px(images, world_from_cam, next_to)
    yield "reprojection_median_px", *_quantile(reprojection, 0.5)
    yield "reprojection_p90_px", *_quantile(reprojection, 0.9)
    found = list(_depth_pairs(images, world_from_cam, overlapping(world_from_cam)))
    residual = np.concatenate([np.zeros(0), *(np.abs(f.residual_m) for f in found)])
    tolerance = np.concatenate([np.zeros(0), *(f.tolerance_m for f in found)])
    yield "depth_consistency_median_m", *_quantile(residual, 0.5)
    yield "depth_consistency_share", *_mean(residual <= tolerance)
    yield "depth_overlap_share", *_mean(np.array([f.overlap for f in found]))
    seen_again = revisits(world_from_cam)
    translation_m, rotation_rad = checks.loops(images, world_from_cam, seen_again)
    yield "loop_pairs", float(len(translation_m)), len(seen_again)
    yield "loop_error_median_m", *_quantile(translation_m, 0.5)
    yield "loop_error_median_deg", *_quantile(np.degrees(rotation_rad), 0.5)


def _depth_pairs(
    images: RgbdFrames, world_from_cam: Array, pairs: Pairs
) -> Iterator[DepthConsistency]:
    for a, b in pairs.tolist():
        depth_a_m, depth_b_m = images.read_depth(a), images.read_depth(b)
        if depth_a_m is not None and depth_b_m is not None:
            b_from_a = invert(world_from_cam[b]) @ world_from_cam[a]
            yield depth_consistency(depth_a_m, depth_b_m, images.camera, b_from_a)


def _against(reference: Reference, world_from_cam: Array, delta: int) -> Iterator[Figure]:
    """Errors against true poses: all but the relative ones need three poses in both."""
    true = reference.poses.world_from_cam
    n_shared = int((known(true) & known(world_from_cam)).sum())
    if n_shared >= FEWEST_TO_ALIGN:
        rigid, similar = (align_poses(true, world_from_cam, s) for s in (False, True))
        ate = summarise(absolute_errors_m(true, world_from_cam, rigid))
        scaled = summarise(absolute_errors_m(true, world_from_cam, similar))
        yield "ate_se3_rmse_m", ate.rmse, ate.n
        yield "ate_se3_median_m", ate.median, ate.n
        yield "ate_se3_max_m", ate.largest, ate.n
        yield "ate_sim3_rmse_m", scaled.rmse, scaled.n
        yield "sim3_scale", similar.scale, scaled.n
    translation_m, rotation_rad = relative_errors(true, world_from_cam, delta)
    for name, errors in (
        ("rpe_translation_rmse_m", translation_m),
        ("rpe_rotation_rmse_deg", np.degrees(rotation_rad)),
    ):
        spans = summarise(errors)
        yield name, spans.rmse if spans.n else None, spans.n
    if reference.up is not None:
        yield "up_error_deg", _up_error_deg(reference, world_from_cam), n_shared


def _up_error_deg(reference: Reference, world_from_cam: Array) -> float | None:
    """Angle between +z and the reference's up, as the cameras of both trajectories carry it over.

    Up in the camera is the reference's rotation backwards; the judged rotation takes it on into the
    levelled world. The mean over frames is compared, so that no alignment of paths is needed.
    """
    true = reference.poses.world_from_cam
    both = known(true) & known(world_from_cam)
    if not both.any():
        return None
    up_cam = np.swapaxes(true[both, :3, :3], -1, -2) @ np.array(reference.up)
    up = np.einsum("fij,fj->fi", world_from_cam[both, :3, :3], up_cam).mean(axis=0)
    return float(np.degrees(np.arctan2(np.linalg.norm(up[:2]), up[2])))


def _aligned(frames: pa.Table, alignment: Similarity, reference: Reference) -> pa.Table:
    keys = {name: frames[name] for name in ("sequence_id", "frame_index")}
    moved = alignment.poses(reference.poses.world_from_cam)
    return from_columns(REFERENCE_POSES, {**keys, **pose_columns(moved)})


def _table(frames: pa.Table, figures: list[Figure]) -> pa.Table:
    sequence_id = frames["sequence_id"][0].as_py()
    rows = [
        {
            "sequence_id": sequence_id,
            "metric": metric,
            "value": None if value is None or math.isnan(value) else value,
            "n": n,
        }
        for metric, value, n in figures
    ]
    return from_rows(POSE_QUALITY, rows)


def _in_short(figures: list[Figure]) -> str:
    """The essentials: ``reprojection 0.7 px, depth 1.0 cm, ATE 1.6 cm``."""
    value_of = {name: value for name, value, _ in figures}
    parts = []
    for name, metric, unit, factor in (
        ("reprojection", "reprojection_median_px", "px", 1),
        ("depth", "depth_consistency_median_m", "cm", 100),
        ("loops", "loop_error_median_m", "cm", 100),
        ("ATE", "ate_se3_rmse_m", "cm", 100),
    ):
        value = value_of.get(metric)
        if value is not None:
            parts.append(f"{name} {factor * value:.1f} {unit}")
    return ", ".join(parts)


def _warnings(frames: pa.Table, figures: list[Figure]) -> Iterator[str]:
    """Poses that contradict the images: rather a wrong convention than a bad sensor."""
    row = frames.slice(0, 1).to_pylist()[0]
    value_of = {name: value for name, value, _ in figures}
    off_px, share = (
        value_of[name] for name in ("reprojection_median_px", "depth_consistency_share")
    )
    faults = []
    if off_px is not None and off_px > WORST_REPROJECTION_SHARE * row["width_px"]:
        faults.append(f"features lie {off_px:.0f} px from where depth and poses put them")
    if share is not None and share < WORST_DEPTH_SHARE:
        faults.append(f"the depth of nearby frames agrees in {100 * share:.0f} % of the pixels")
    if faults:
        yield (
            f"{row['sequence_id']}: {' and '.join(faults)}. Check the poses' convention, unit and "
            "clock, and the camera's intrinsics and depth scale."
        )


def _quantile(values: Array, at: float) -> tuple[float | None, int]:
    return (float(np.quantile(values, at)) if len(values) else None), len(values)


def _mean(values: NDArray[np.generic]) -> tuple[float | None, int]:
    return (float(np.mean(values)) if len(values) else None), len(values)  # type: ignore[arg-type]
