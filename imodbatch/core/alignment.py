"""How far an estimated trajectory is from a true one: alignment, and errors after it.

Two trajectories of one walk live in worlds of their own. The rigid transform (or similarity) that
brings their positions together best is found in closed form (Umeyama 1991); what then remains is
the absolute trajectory error (ATE). The relative pose error (RPE) compares motions over a span of
frames and needs no alignment (Sturm et al. 2012; Zhang & Scaramuzza 2018).

A frame counts only where both trajectories have a pose; NaN marks those that have none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.frames import exp_twist, invert, make_transform, rotation_between

Array = NDArray[np.float64]
NO_SPREAD = 1e-12
"""Correlation of positions, relative to their spread, below which they say nothing."""
LINE_SHARE = 1e-6
"""Second singular value of the correlation, relative to the first, below which it is a line."""


@dataclass(frozen=True)
class Similarity:
    """``target = scale · rotation · source + translation``; scale 1 makes it rigid."""

    rotation: Array
    translation: Array
    scale: float = 1.0

    def points(self, points: ArrayLike) -> Array:
        """Take points (..., 3) of the source's world to the target's."""
        points = np.asarray(points, dtype=np.float64)
        return self.scale * points @ self.rotation.T + self.translation

    def poses(self, world_from_cam: ArrayLike) -> Array:
        """Take poses (..., 4, 4) of the source's world to the target's; NaN stays NaN."""
        poses = np.asarray(world_from_cam, dtype=np.float64)
        moved = make_transform(self.rotation @ poses[..., :3, :3], self.points(poses[..., :3, 3]))
        moved[~np.isfinite(poses).all(axis=(-2, -1))] = np.nan
        return moved


@dataclass(frozen=True)
class ErrorSummary:
    """Root mean square, median and largest of n errors; NaN where there is none."""

    rmse: float
    median: float
    largest: float
    n: int


def known(world_from_cam: Array) -> NDArray[np.bool_]:
    """Which of the poses (F, 4, 4) are there."""
    return np.asarray(np.isfinite(world_from_cam).all(axis=(-2, -1)))


def align_points(
    target: ArrayLike, source: ArrayLike, with_scale: bool = False, turn: Array | None = None
) -> Similarity:
    """Least-squares similarity between corresponding points (Umeyama 1991, Eq. 39 to 42).

    The rotation is never a reflection. Where positions leave it open, `turn` closes it:

    - fewer than 3 points, or all on a line: the angle about the line is the one that fits `turn`
      best, else the smallest rotation that brings the lines together;
    - no point, one, or all equal: the rotation nearest to `turn`, else the identity.

    Without spread in both sets the scale is 1; without points the translation is 0.

    Args:
        target: (N, 3); rows with NaN in either set are left out.
        source: (N, 3).
        with_scale: find the scale, too: Sim(3) in place of SE(3).
        turn: (3, 3) sum of ``R_target R_sourceᵀ`` over the frames' orientations.
    """
    target = np.asarray(target, dtype=np.float64).reshape(-1, 3)
    source = np.asarray(source, dtype=np.float64).reshape(-1, 3)
    both = np.isfinite(target).all(axis=1) & np.isfinite(source).all(axis=1)
    target, source = target[both], source[both]
    if len(target) == 0:
        return Similarity(np.eye(3) if turn is None else nearest_rotation(turn), np.zeros(3))
    middle_t, middle_s = target.mean(axis=0), source.mean(axis=0)
    around_t, around_s = target - middle_t, source - middle_s
    rotation = _rotation(around_t, around_s, turn)
    scale = _scale(around_t, around_s, rotation) if with_scale else 1.0
    return Similarity(rotation, middle_t - scale * rotation @ middle_s, scale)


def align_poses(target: ArrayLike, source: ArrayLike, with_scale: bool = False) -> Similarity:
    """`align_points` of the camera centres, with their orientations where centres do not do.

    Args:
        target: (F, 4, 4), NaN where there is no pose.
        source: (F, 4, 4) of the same frames.
        with_scale: Sim(3) in place of SE(3).
    """
    target = np.asarray(target, dtype=np.float64).reshape(-1, 4, 4)
    source = np.asarray(source, dtype=np.float64).reshape(-1, 4, 4)
    both = known(target) & known(source)
    target, source = target[both], source[both]
    turn = np.einsum("fij,fkj->ik", target[:, :3, :3], source[:, :3, :3])
    has_turn = turn if both.any() else None
    return align_points(target[:, :3, 3], source[:, :3, 3], with_scale, has_turn)


def nearest_rotation(matrix: ArrayLike) -> Array:
    """The rotation (3, 3) with the largest ``trace(Rᵀ M)``: the chordal mean of a sum of them."""
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=np.float64))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return np.asarray(u @ flip @ vt)


def rotation_angle_rad(rotation: ArrayLike) -> Array:
    """Angles (...,) of rotations (..., 3, 3), exact for tiny ones, too."""
    r = np.asarray(rotation, dtype=np.float64)
    axis = np.stack(
        [r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]],
        axis=-1,
    )
    return np.arctan2(np.linalg.norm(axis, axis=-1), np.trace(r, axis1=-2, axis2=-1) - 1)


def absolute_errors_m(target: ArrayLike, source: ArrayLike, alignment: Similarity) -> Array:
    """Distances (F,) of camera centres after alignment; NaN where a pose is missing.

    Args:
        target: (F, 4, 4) true poses.
        source: (F, 4, 4) poses to be judged.
        alignment: from the source's world to the target's.
    """
    target = np.asarray(target, dtype=np.float64)
    aligned = alignment.poses(source)
    return np.linalg.norm(target[..., :3, 3] - aligned[..., :3, 3], axis=-1)


def relative_errors(target: ArrayLike, source: ArrayLike, delta: int) -> tuple[Array, Array]:
    """Errors of the motions over `delta` frames: ``(Q_i⁻¹ Q_{i+Δ})⁻¹ (P_i⁻¹ P_{i+Δ})``.

    Args:
        target: (F, 4, 4) true poses Q.
        source: (F, 4, 4) poses P to be judged.
        delta: how many frames a motion spans.

    Returns:
        (n,) translation in metres and (n,) rotation in radians, for the spans whose four poses are
        known.
    """
    target, source = (np.asarray(poses, dtype=np.float64) for poses in (target, source))
    both = known(target) & known(source)
    first = np.flatnonzero(both[:-delta] & both[delta:])
    motion_t, motion_s = (invert(p[first]) @ p[first + delta] for p in (target, source))
    error = invert(motion_t) @ motion_s
    return np.linalg.norm(error[:, :3, 3], axis=-1), rotation_angle_rad(error[:, :3, :3])


def summarise(errors: ArrayLike) -> ErrorSummary:
    """Of the errors (n,) that are not NaN."""
    values = np.asarray(errors, dtype=np.float64)
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return ErrorSummary(np.nan, np.nan, np.nan, 0)
    rmse = float(np.sqrt(np.mean(values**2)))
    return ErrorSummary(rmse, float(np.median(values)), float(values.max()), len(values))


def _rotation(around_t: Array, around_s: Array, turn: Array | None) -> Array:
    """Rotation that brings centred points together; see `align_points` for what is degenerate."""
    correlation = around_t.T @ around_s
    u, sizes, vt = np.linalg.svd(correlation)
    if sizes[0] <= NO_SPREAD * np.linalg.norm(around_t) * np.linalg.norm(around_s):
        return np.eye(3) if turn is None else nearest_rotation(turn)
    if sizes[1] > LINE_SHARE * sizes[0]:
        return nearest_rotation(correlation)
    line_t, line_s = u[:, 0], vt[0]
    shortest = rotation_between(line_s, line_t)
    return shortest if turn is None else _turn_about(line_t, turn @ shortest.T) @ shortest


def _turn_about(axis: Array, wanted: Array) -> Array:
    """Of the rotations R about an axis (3,), the one with the largest ``trace(Rᵀ wanted)``."""
    skew = wanted - wanted.T
    sine = axis @ np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    cosine = np.trace(wanted) - axis @ wanted @ axis
    return exp_twist(np.r_[np.zeros(3), np.arctan2(sine, cosine) * axis])[:3, :3]


def _scale(around_t: Array, around_s: Array, rotation: Array) -> float:
    spread, size = float(np.sum(around_s**2)), float(np.sum(around_t**2))
    if spread == 0 or size == 0:
        return 1.0
    return float(np.sum(around_t * (around_s @ rotation.T))) / spread
