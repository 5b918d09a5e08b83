"""Which unit is wrong, that of the depth or that of the poses.

Images tell only by how much baselines and depth disagree. Either number may be at fault; the pair
of units that people use, and that puts a room at a room's distance, is the likelier.
"""

from dataclasses import dataclass

import numpy as np

DEPTH_UNITS_M = (0.001, 0.0002, 0.0001, 0.00025, 0.01, 1.0)
"""Millimetres; TUM's 1/5000; tenths; the L515's; centimetres; metres."""
POSE_UNITS_M = (1.0, 0.001, 0.01, 0.0254, 0.3048)
USUAL_DEPTH_M = 1.8
DEPTH_SPREAD = 0.9
"""Of the logarithm of a frame's median depth, over rooms and tables."""
NEAR_A_UNIT = 0.15
UNCOMMON_COST = 2.0
NEAREST_M, FARTHEST_M = 0.3, 8.0
"""Median depths of indoor sequences."""


@dataclass(frozen=True)
class Units:
    """A reading of the numbers: metres per unit of depth and of the poses."""

    depth_scale_m: float
    pose_unit_m: float


def snapped(value: float, units: tuple[float, ...]) -> float:
    """The unit near a value, or the value itself."""
    near = min(units, key=lambda unit: abs(np.log(value / unit)))
    return near if abs(np.log(value / near)) <= NEAR_A_UNIT else value


def explain_scale(scale: float, given: Units, median_depth_m: float) -> Units:
    """The likelier of two cures where poses must be multiplied with `scale` to fit the depth.

    Args:
        scale: not 1.
        given: the manifest's units.
        median_depth_m: with these units.
    """
    depth = snapped(given.depth_scale_m / scale, DEPTH_UNITS_M)
    pose = snapped(given.pose_unit_m * scale, POSE_UNITS_M)
    cures = (Units(depth, given.pose_unit_m), Units(given.depth_scale_m, pose))
    return min(cures, key=lambda units: _cost(units, given, median_depth_m))


def likely_depth_scale(scale_m: float, median_depth_m: float) -> float:
    """The common unit that puts the scene at a room's distance; the given one if it does."""
    if NEAREST_M <= median_depth_m <= FARTHEST_M:
        return scale_m
    raw = median_depth_m / scale_m
    return min(DEPTH_UNITS_M, key=lambda unit: _distance_cost(raw * unit) + 0.1 * (unit != 0.001))


def _cost(units: Units, given: Units, median_depth_m: float) -> float:
    depth_m = median_depth_m * units.depth_scale_m / given.depth_scale_m
    uncommon = (units.depth_scale_m not in DEPTH_UNITS_M) + (units.pose_unit_m not in POSE_UNITS_M)
    return _distance_cost(depth_m) + UNCOMMON_COST * uncommon


def _distance_cost(depth_m: float) -> float:
    """Minus the log-likelihood of a median depth."""
    return 0.5 * float(np.log(depth_m / USUAL_DEPTH_M) / DEPTH_SPREAD) ** 2
