"""A point in the world and the camera that saw it → its voxel, and its viewpoint in bins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.viewpoint import ViewGrid, view_angles
from imodbatch.core.voxels import voxel_indices

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
ROUNDING_RAD = 1e-12


@dataclass(frozen=True)
class Places:
    """What fusion asks of n points; voxel and bins of an unknown point have no meaning.

    Attributes:
        azimuth_rad: (n,) direction from the point to the camera about +z, NaN where unknown.
        elevation_rad: (n,) the same above the horizon.
        elevation_excess_rad: (n,) how far that lies outside the grid's elevations.
        voxel: (n, 3) indices.
        azimuth_bin: (n,).
        elevation_bin: (n,).
    """

    azimuth_rad: Array
    elevation_rad: Array
    elevation_excess_rad: Array
    voxel: Ints
    azimuth_bin: Ints
    elevation_bin: Ints

    def is_too_steep(self, margin_deg: float) -> NDArray[np.bool_]:
        """(n,) which points are seen from farther outside the grid's elevations than allowed."""
        return self.elevation_excess_rad > np.radians(margin_deg) + ROUNDING_RAD


def place(
    xyz_world: ArrayLike, camera_world: ArrayLike, grid: ViewGrid, voxel_size_m: float
) -> Places:
    """Place points in voxels and in the grid of viewpoints.

    Args:
        xyz_world: (n, 3) points in metres, +z up, NaN where unknown.
        camera_world: (n, 3) centre of the camera that saw each.
        grid: of azimuths and elevations.
        voxel_size_m: edge of a voxel.
    """
    azimuth, elevation = view_angles(xyz_world, camera_world)
    return Places(
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        elevation_excess_rad=grid.elevation_excess_rad(elevation),
        voxel=voxel_indices(_or_zero(xyz_world), voxel_size_m),
        azimuth_bin=grid.azimuth_bins(_or_zero(azimuth)),
        elevation_bin=grid.elevation_bins(_or_zero(elevation)),
    )


def _or_zero(values: ArrayLike) -> Array:
    return np.nan_to_num(np.asarray(values, dtype=np.float64), nan=0.0)
