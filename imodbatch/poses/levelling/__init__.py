"""Which way is up: from floors, tables and walls in depth images.

Each frame gives its planes (`planes`), slanted or not; those that are the same are put together
(`surfaces`). Every surface, and every pair of them as walls, proposes a direction (`hypotheses`). A
direction explains the surfaces that are level or upright under it, and is likely if cameras are
held under it as cameras are: not rolled, looking ahead or down. The best ones are fitted to their
surfaces (`fitting`), whose agreement says how far off they may be. Where two directions do nearly
as well, or none does, it is an error: a world that stands askew would spoil every viewpoint without
a word.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.poses.levelling.fitting import Fit, fit_up
from imodbatch.poses.levelling.hypotheses import APART_DEG, Views, apart_deg, propose, score
from imodbatch.poses.levelling.planes import MAX_DEPTH_M
from imodbatch.poses.levelling.surfaces import Surfaces, find_surfaces
from imodbatch.poses.levelling.up import Up

Array = NDArray[np.float64]
MIN_SHARE = 0.05  # of the points, on level and upright surfaces
MAX_UNCERTAINTY_DEG = 8.0
MIN_MARGIN = 0.4  # below it another direction may as well be up
GROUNDLESS_COST = 0.5

__all__ = ["MAX_DEPTH_M", "Up", "estimate_up"]


@dataclass(frozen=True)
class _Rated:
    """A fitted direction and how well it explains the scene."""

    fit: Fit
    score: float


def estimate_up(
    points_cam: Iterable[Array],
    world_from_cam: Iterable[Array],
    where: str,
    setting: str = "world.up",
    seed: int = 0,
) -> Up:
    """Estimate up from depth.

    Args:
        points_cam: per frame (P, 3) points in the camera, metres, all finite.
        world_from_cam: per frame (4, 4).
        where: name of the sequence, for errors.
        setting: the manifest's key that gives up in place of this estimate, for errors.
        seed: of RANSAC.

    Raises:
        DataError: there is no depth, too few points lie on planes that bear a direction, they
            leave it open, or another direction does nearly as well.
    """
    cure = f"Give {setting} in the manifest."
    pairs = zip(points_cam, world_from_cam, strict=True)
    frames = [(np.asarray(p), np.asarray(pose)) for p, pose in pairs if len(p)]
    if not frames:
        raise DataError(f"{where}: no depth to find the floor in. {cure}")
    surfaces, views = find_surfaces(frames, seed), Views.of([pose for _, pose in frames])
    rated = _rated(surfaces, views)
    share = rated[0].fit.plane_share if rated else 0.0
    if share < MIN_SHARE:
        raise DataError(
            f"{where}: no floor or table plane found (level and upright planes hold "
            f"{100 * share:.0f} % of the points, {100 * MIN_SHARE:.0f} % needed). {cure}"
        )
    best = rated[0]
    if best.fit.uncertainty_deg > MAX_UNCERTAINTY_DEG:
        raise DataError(f"{where}: {_why_open(best.fit)}. {cure}")
    margin = 1 - rated[1].score / max(best.score, 1e-9) if len(rated) > 1 else 1.0
    if margin < MIN_MARGIN:
        between = apart_deg(best.fit.direction, rated[1].fit.direction)
        raise DataError(
            f"{where}: up is ambiguous: two directions {between:.0f}° apart explain the planes "
            f"about as well ({_text(best)}, {_text(rated[1])}). {cure}"
        )
    tilt_deg = apart_deg(best.fit.direction, views.mean_up)
    return Up(**vars(best.fit), margin=margin, tilt_deg=tilt_deg)


def _rated(surfaces: Surfaces, views: Views) -> list[_Rated]:
    """Fitted directions that differ, best first."""
    fits = [fit_up(surfaces, direction) for direction in propose(surfaces, views)]
    rated = []
    for fit in fits:
        explains = float(score(surfaces, views, fit.direction[None])[0])
        rated.append(_Rated(fit, explains * (1 - GROUNDLESS_COST * fit.groundless_share)))
    kept: list[_Rated] = []
    for candidate in sorted(rated, key=lambda r: -r.score):
        if all(apart_deg(candidate.fit.direction, k.fit.direction) > APART_DEG for k in kept):
            kept.append(candidate)
    return kept


def _why_open(fit: Fit) -> str:
    if fit.n_level == 0:
        return "no floor or table plane found, and walls that face one way do not tell up"
    return f"the floor and table planes found tell up to ± {fit.uncertainty_deg:.0f}° only"


def _text(rated: _Rated) -> str:
    x, y, z = rated.fit.direction
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
