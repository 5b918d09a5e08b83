"""What may be meant by a file of poses: every reading of it, held against the images.

A trajectory can be written as world_from_cam or its inverse, with the quaternion's w first or last,
in metres or millimetres, and its clock may be ahead of the images'. Each combination is a claim
about how the camera moved between two views, and the images say which claim is right. Only
comparisons count: a claim takes the place of the manifest's if it explains the images clearly
better, whatever the noise of the poses.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.motions import Motions, relative
from imodbatch.core.frames import invert, matrix_from_quaternion, quaternion_from_matrix

Array = NDArray[np.float64]
Order = Literal["xyzw", "wxyz"]
MOST_LAG = 30
CLEARLY_BETTER = 0.6
"""Share of the manifest's error that a better claim may leave at most."""
LEAST_GAIN_PX = 1.0
MOST_PAIRS_BETTER = 0.7
AS_GOOD = 1.25
"""A claim with fewer changes is preferred if its error is no more than this times the least."""
LEAST_SCALE = 1.3
FEWEST_PAIRS = 5
LEAST_PARALLAX = 0.02
"""Baselines shorter than this share of the depth say little of scale."""


@dataclass(frozen=True)
class Claim:
    """One reading of the poses.

    Attributes:
        is_inverse: the matrices are the inverse of what the manifest says.
        has_other_order: the quaternion's w stands at the other end.
        lag: image i has the pose that the manifest gives to image i + lag.
        scale: what the poses' translations must be multiplied with to fit the depth.
    """

    is_inverse: bool = False
    has_other_order: bool = False
    lag: int = 0
    scale: float = 1.0

    @property
    def n_changes(self) -> int:
        """In how many ways it departs from the manifest."""
        return sum([self.is_inverse, self.has_other_order, self.lag != 0, self.scale != 1.0])


AS_GIVEN = Claim()


@dataclass(frozen=True)
class Judged:
    """A claim and how well images bear it out.

    Attributes:
        claim: which.
        b_from_a: (P, 4, 4) the motions it claims, metres of the depth; NaN = no pose.
        errors_px: (P,) median pixel error per pair.
        error_px: their typical size.
    """

    claim: Claim
    b_from_a: Array
    errors_px: Array
    error_px: float


@dataclass(frozen=True)
class Verdict:
    """The manifest's claim, the best one, and what can be had at all.

    Attributes:
        given: the manifest's.
        best: the preferred one; `given` itself unless another is clearly better.
        floor_px: error of the motions that features alone tell.
        rivals: claims of convention or order that images do not tell from the best.
        scale: by how much translations are too small for the depth; NaN = too little parallax.
        n_pairs: pairs of views that could be judged.
    """

    given: Judged
    best: Judged
    floor_px: float
    rivals: tuple[Claim, ...]
    scale: float
    n_pairs: int


def judge(
    motions: Motions,
    world_from_cam: Array,
    read_as: Literal["world_from_cam", "cam_from_world"] = "world_from_cam",
    order: Order | None = None,
) -> Verdict | None:
    """Hold every claim against the images.

    Args:
        motions: what the images tell.
        world_from_cam: (F, 4, 4) poses as the manifest reads them, NaN = lost.
        read_as: the convention they were read with.
        order: the order that quaternions were read with; None = the file has none.

    Returns:
        None where fewer than five pairs have poses and a clear motion in the images.
    """
    variants = {
        (inverse, other): _reread(world_from_cam, read_as, order, inverse, other)
        for inverse in (False, True)
        for other in ((False, True) if order is not None else (False,))
    }
    given = _judged(motions, variants[False, False], AS_GIVEN)
    usable = np.isfinite(given.errors_px)
    if usable.sum() < FEWEST_PAIRS:
        return None
    most_lag = min(MOST_LAG, len(world_from_cam) // 4)
    others = [
        judged
        for (inverse, other), poses in variants.items()
        for lag in range(-most_lag, most_lag + 1)
        for judged in _with_scales(motions, poses, Claim(inverse, other, lag))
        if judged.claim != AS_GIVEN and _covers(judged, usable)
    ]
    best = _preferred(given, others)
    rivals = tuple(
        o.claim
        for o in others
        if o.claim.lag == best.claim.lag
        and o.claim.scale == 1.0
        and (o.claim.is_inverse, o.claim.has_other_order)
        != (best.claim.is_inverse, best.claim.has_other_order)
        and o.error_px < AS_GOOD * best.error_px + 0.3
    )
    floor = typical(motions.errors_px(motions.b_from_a)[usable])
    scale = _scale(motions, best.b_from_a) * best.claim.scale
    return Verdict(given, best, floor, rivals, scale, int(usable.sum()))


def typical(errors: Array) -> float:
    """A mean of errors (P,) in which neither the largest nor the smallest rule."""
    known = errors[np.isfinite(errors)]
    return float(np.expm1(np.log1p(known).mean())) if len(known) else float("nan")


def is_clearly_better(errors_px: Array, than_px: Array) -> bool:
    """Whether errors (P,) are clearly and mostly smaller than others of the same pairs."""
    both = np.isfinite(errors_px) & np.isfinite(than_px)
    if both.sum() < FEWEST_PAIRS:
        return False
    ours, theirs = typical(errors_px[both]), typical(than_px[both])
    better = float((errors_px[both] < than_px[both]).mean())
    gained = theirs - ours >= LEAST_GAIN_PX
    return gained and ours <= CLEARLY_BETTER * theirs and better >= MOST_PAIRS_BETTER


def _preferred(given: Judged, others: list[Judged]) -> Judged:
    """The claim with the fewest changes that does about as well as the best one."""
    better = [o for o in others if is_clearly_better(o.errors_px, given.errors_px)]
    if not better:
        return given
    least = min(o.error_px for o in better)
    good = [o for o in better if o.error_px <= AS_GOOD * least + 0.3]
    fewest = min(o.claim.n_changes for o in good)
    return min((o for o in good if o.claim.n_changes == fewest), key=lambda o: o.error_px)


def _covers(judged: Judged, usable: NDArray[np.bool_]) -> bool:
    """Whether a claim says something of most pairs: a lag leaves some without a pose."""
    return bool((np.isfinite(judged.errors_px) & usable).sum() >= 0.7 * usable.sum())


def _with_scales(motions: Motions, poses: Array, claim: Claim) -> list[Judged]:
    plain = _judged(motions, poses, claim)
    scale = _scale(motions, plain.b_from_a)
    if not np.isfinite(scale) or abs(np.log(scale)) < np.log(LEAST_SCALE):
        return [plain]
    scaled = Claim(claim.is_inverse, claim.has_other_order, claim.lag, scale)
    return [plain, _judged(motions, poses, scaled)]


def _judged(motions: Motions, poses: Array, claim: Claim) -> Judged:
    b_from_a = relative(poses, motions.first + claim.lag, motions.second + claim.lag)
    b_from_a[:, :3, 3] *= claim.scale
    errors = motions.errors_px(b_from_a)
    return Judged(claim, b_from_a, errors, typical(errors))


def _scale(motions: Motions, b_from_a: Array) -> float:
    """Baselines by images over those of a claim; NaN where parallax is too small to say."""
    claimed_m = np.linalg.norm(b_from_a[:, :3, 3], axis=-1)
    with np.errstate(invalid="ignore"):
        told = (motions.baseline_m > LEAST_PARALLAX * motions.depth_a_m) & (claimed_m > 0)
    if told.sum() < FEWEST_PAIRS:
        return float("nan")
    return float(np.exp(np.median(np.log(motions.baseline_m[told] / claimed_m[told]))))


def _reread(
    world_from_cam: Array,
    read_as: Literal["world_from_cam", "cam_from_world"],
    order: Order | None,
    is_inverse: bool,
    has_other_order: bool,
) -> Array:
    """The poses, had the file been read with another convention or quaternion order."""
    known = np.isfinite(world_from_cam[:, 0, 0])
    in_file = world_from_cam[known]
    if read_as == "cam_from_world":
        in_file = invert(in_file)
    if has_other_order:
        columns = [1, 2, 3, 0] if order == "xyzw" else [3, 0, 1, 2]
        quaternion = quaternion_from_matrix(in_file[:, :3, :3])[:, columns]
        in_file = in_file.copy()
        in_file[:, :3, :3] = matrix_from_quaternion(quaternion)
    result = np.full_like(world_from_cam, np.nan)
    result[known] = invert(in_file) if (read_as == "cam_from_world") != is_inverse else in_file
    return result
