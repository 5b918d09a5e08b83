"""Is up where the manifest says? Floors, tables and walls in the depth images tell."""

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.finding import ERROR, WARNING, Finding, Outcome, failed, setting, skipped
from imodbatch.checkup.views import View, evenly
from imodbatch.core.errors import DataError
from imodbatch.poses.levelling import MAX_DEPTH_M, estimate_up
from imodbatch.poses.levelling.up import Up
from imodbatch.settings.sections import WorldSection

Array = NDArray[np.float64]
MOST_VIEWS = 12
STRIDE_PX = 4
TOLERANCE_DEG, SURELY_DEG = 6.0, 15.0
SIGMAS = 4.0
NEAR_AXIS_DEG = 5.0


def check_up(world: WorldSection, views: list[View], world_from_cam: Array, where: str) -> Outcome:
    """The check `up`."""
    try:
        found = _estimate(views, world_from_cam, where)
    except DataError as error:
        if world.up != "estimate":
            return skipped("up", f"the scene does not tell: {error}")
        return failed("up", str(error))
    given = world.direction()
    if given is None:
        return Outcome("up", str(found))
    direction = np.array(given) / np.linalg.norm(given)
    apart_deg = float(np.degrees(np.arccos(np.clip(direction @ found.direction, -1, 1))))
    summary = f"{apart_deg:.1f}° from what floors and tables say (± {found.uncertainty_deg:.1f}°)"
    if apart_deg <= max(TOLERANCE_DEG, SIGMAS * found.uncertainty_deg):
        return Outcome("up", summary)
    severity = ERROR if apart_deg > max(SURELY_DEG, SIGMAS * found.uncertainty_deg) else WARNING
    seen = f"world.up is {apart_deg:.0f}° off what the scene says: {found}."
    mend = (setting("world", "up", nearest_axis(found.direction)),)
    figures = {"apart_deg": apart_deg, "uncertainty_deg": found.uncertainty_deg}
    return Outcome("up", summary, (Finding(severity, seen, mend, figures),))


def nearest_axis(direction: Array) -> str | list[float]:
    """``-y`` for a direction (3,) near an axis, else the direction itself."""
    axis = int(np.abs(direction).argmax())
    off_deg = np.degrees(np.arccos(np.clip(abs(direction[axis]), 0, 1)))
    if off_deg <= NEAR_AXIS_DEG:
        return f"{'+' if direction[axis] > 0 else '-'}{'xyz'[axis]}"
    return [round(float(value), 3) for value in direction]


def _estimate(views: list[View], world_from_cam: Array, where: str) -> Up:
    posed = [view for view in views if np.isfinite(world_from_cam[view.position, 0, 0])]
    chosen = evenly(posed, MOST_VIEWS)
    points = [_points(view) for view in chosen]
    return estimate_up(points, [world_from_cam[view.position] for view in chosen], where)


def _points(view: View) -> Array:
    """Every fourth pixel of a frame as points (P, 3) in the colour camera."""
    depth_m = view.registered_m[::STRIDE_PX, ::STRIDE_PX]
    camera = view.camera.color
    pixels = camera.pixel_centers()[::STRIDE_PX, ::STRIDE_PX]
    near = depth_m < MAX_DEPTH_M
    return camera.unproject(pixels[near], depth_m[near])
