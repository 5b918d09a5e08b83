"""From where an object is seen: azimuth and elevation, continuous and in bins.

The line from the object to the camera has an azimuth about the world's up axis and an elevation
above the horizon. Both are cut into bins; the same grid serves the detector's classes and the
geometry (Konno et al. 2020, Sec. 3.1).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
FULL_TURN_RAD = 2 * np.pi


@dataclass(frozen=True)
class ViewGrid:
    """M elevations × N azimuths. Azimuth bin 0 is centred at azimuth 0 and wraps round."""

    n_azimuths: int
    elevations_rad: tuple[float, ...]

    @property
    def n_elevations(self) -> int:
        """M."""
        return len(self.elevations_rad)

    @property
    def azimuth_step_rad(self) -> float:
        """Width of an azimuth bin."""
        return FULL_TURN_RAD / self.n_azimuths

    def azimuth_bins(self, azimuth_rad: ArrayLike) -> NDArray[np.int64]:
        """Nearest azimuth bin (...,) of azimuths in radians; any number of turns is fine."""
        steps = np.asarray(azimuth_rad, dtype=np.float64) / self.azimuth_step_rad
        return np.floor(steps + 0.5).astype(np.int64) % self.n_azimuths

    def elevation_bins(self, elevation_rad: ArrayLike) -> NDArray[np.int64]:
        """Nearest elevation bin (...,) of elevations in radians; the lower one when tied."""
        elevation = np.asarray(elevation_rad, dtype=np.float64)
        distance = np.abs(elevation[..., None] - np.asarray(self.elevations_rad))
        return np.argmin(distance, axis=-1).astype(np.int64)

    def elevation_excess_rad(self, elevation_rad: ArrayLike) -> Array:
        """How far (...,) elevations lie outside the range of the grid's; 0 inside."""
        elevation = np.asarray(elevation_rad, dtype=np.float64)
        below = min(self.elevations_rad) - elevation
        above = elevation - max(self.elevations_rad)
        return np.maximum(np.maximum(below, above), 0.0)


def view_angles(xyz_world: ArrayLike, camera_world: ArrayLike) -> tuple[Array, Array]:
    """Azimuth and elevation from which objects are seen.

    Args:
        xyz_world: (..., 3) objects, metres, +z up.
        camera_world: (..., 3) camera centres.

    Returns:
        azimuth_rad (...,) in [0, 2π) and elevation_rad (...,) in [−π/2, π/2].
    """
    view = np.asarray(camera_world, dtype=np.float64) - np.asarray(xyz_world, dtype=np.float64)
    azimuth = np.arctan2(view[..., 1], view[..., 0]) % FULL_TURN_RAD
    azimuth = np.where(azimuth >= FULL_TURN_RAD, 0.0, azimuth)  # −1e−17 % 2π rounds up to 2π
    elevation = np.arctan2(view[..., 2], np.hypot(view[..., 0], view[..., 1]))
    return azimuth, elevation


def azimuth_bins_apart(
    predicted_bin: ArrayLike, azimuth_rad: ArrayLike, n_azimuths: int, n_fold: int = 1
) -> NDArray[np.int64]:
    """How many bins a predicted azimuth lies from the true one, the shorter way round.

    Args:
        predicted_bin: (...,) azimuth bins.
        azimuth_rad: (...,) true azimuths in radians.
        n_azimuths: N.
        n_fold: how often the object looks the same in a turn; the nearest equal view counts.

    Returns:
        (...,) integers from 0 to N // 2.
    """
    turns = np.arange(n_fold) * (FULL_TURN_RAD / n_fold)
    equal_views = np.asarray(azimuth_rad, dtype=np.float64)[..., None] + turns
    true_bins = ViewGrid(n_azimuths, (0.0,)).azimuth_bins(equal_views)
    forth = (np.asarray(predicted_bin)[..., None] - true_bins) % n_azimuths
    return np.minimum(forth, n_azimuths - forth).min(axis=-1)


def yaw_from_pose_bin(pose_bin: ArrayLike, n_azimuths: int) -> Array:
    """Object yaw in the world, [0, 2π) radians, of a pose hypothesis d.

    The detector names azimuth b in the object's own frame where geometry sees azimuth a in the
    world, and b = a + d; the object is therefore turned by −d bins (Eq. 1).
    """
    return (-np.asarray(pose_bin) % n_azimuths) * (FULL_TURN_RAD / n_azimuths)
