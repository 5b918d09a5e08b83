"""A direction fitted to the surfaces that bear it, and how far off it may be.

Surfaces, not points, are what errs: a million points on a table that stands askew all say so. A
level surface is a witness of both angles of up, an upright one of the angle across it. Where they
disagree by more than they should, the stated uncertainty grows with it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.poses.levelling.surfaces import Surfaces

Array = NDArray[np.float64]
WITHIN_DEG = (10.0, 6.0, 6.0, 6.0)
OUTLIER_SIGMAS = 2.0
BELOW_M, MIN_FLOOR_SHARE = 0.15, 0.02


@dataclass(frozen=True)
class Fit:
    """A direction and what bears it.

    Attributes:
        direction: (3,) of length 1.
        uncertainty_deg: one standard deviation, in the direction that is known worst.
        plane_share: share of the points on the level and upright surfaces it rests on.
        n_level: level surfaces.
        n_upright: upright surfaces.
        groundless_share: of all points, below the lowest level surface: a room has a floor.
    """

    direction: Array
    uncertainty_deg: float
    plane_share: float
    n_level: int
    n_upright: int
    groundless_share: float


def fit_up(surfaces: Surfaces, direction: Array) -> Fit:
    """Fit a direction (3,) to the surfaces that are level or upright under it."""
    for within_deg in WITHIN_DEG:
        is_level, is_upright = _bearing(surfaces, direction, within_deg)
        direction, uncertainty_deg = _step(surfaces, is_level, is_upright, direction)
    return Fit(
        direction,
        uncertainty_deg,
        float(surfaces.share[is_level | is_upright].sum()),
        int(is_level.sum()),
        int(is_upright.sum()),
        _groundless_share(surfaces, is_level, direction),
    )


def _bearing(
    surfaces: Surfaces, direction: Array, within_deg: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which surfaces (S,) are level and which upright."""
    cosine = np.abs(surfaces.normals @ direction)
    return cosine > np.cos(np.radians(within_deg)), cosine < np.sin(np.radians(within_deg))


def _step(
    surfaces: Surfaces,
    is_level: NDArray[np.bool_],
    is_upright: NDArray[np.bool_],
    direction: Array,
) -> tuple[Array, float]:
    """One step of robust least squares: the new direction (3,) and its uncertainty in degrees.

    Unknown are the two angles by which the direction turns. Each row says how far a surface wants
    it to turn along one axis.
    """
    across = np.linalg.svd(direction[None])[2][1:]  # (2, 3), spans the plane across it
    tilt = surfaces.normals @ across.T
    height = surfaces.normals @ direction
    level_deg = np.degrees(np.arctan(tilt[is_level] / height[is_level, None]))
    upright_deg = -np.degrees(np.arcsin(np.clip(height[is_upright], -1, 1)))
    axes = np.concatenate([np.tile(np.eye(2), (is_level.sum(), 1)), tilt[is_upright]])
    wanted_deg = np.concatenate([level_deg.ravel(), upright_deg])
    variance = np.concatenate(
        [np.repeat(surfaces.variance_deg2[is_level], 2), surfaces.variance_deg2[is_upright]]
    )
    weights = 1 / (variance + (wanted_deg / OUTLIER_SIGMAS) ** 2)  # Cauchy
    information = (axes * weights[:, None]).T @ axes
    weakest = float(np.linalg.eigvalsh(information)[0])
    turn_deg = np.linalg.pinv(information, rcond=1e-3) @ (axes.T @ (weights * wanted_deg))
    misfit = float((1 / variance) @ (wanted_deg - axes @ turn_deg) ** 2)
    disagreement = max(1.0, misfit / max(len(wanted_deg) - 2, 1))
    turned = direction + np.radians(turn_deg) @ across
    uncertainty_deg = np.sqrt(disagreement / weakest) if weakest > 1e-6 else np.inf
    return turned / np.linalg.norm(turned), float(uncertainty_deg)


def _groundless_share(surfaces: Surfaces, is_level: NDArray[np.bool_], direction: Array) -> float:
    """Share of all points that no level surface of some size lies under."""
    floors = is_level & (surfaces.normals @ direction > 0) & (surfaces.share >= MIN_FLOOR_SHARE)
    if not floors.any():
        return 1.0
    lowest = float((surfaces.centroids[floors] @ direction).min())
    return float((surfaces.points @ direction < lowest - BELOW_M).mean())
