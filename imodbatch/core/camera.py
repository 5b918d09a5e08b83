"""A pinhole camera: metres to continuous pixels and back."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PinholeCamera:
    """Size and intrinsics of an undistorted image, all in continuous pixels (`core.frames`)."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    def project(self, points_cam: ArrayLike) -> Array:
        """Project camera-frame points (..., 3) in metres to pixels (..., 2).

        Points with z ≤ 0 lie behind the camera and give NaN.
        """
        points = np.asarray(points_cam, dtype=np.float64)
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        u = self.fx_px * points[..., 0] / z + self.cx_px
        v = self.fy_px * points[..., 1] / z + self.cy_px
        return np.stack([u, v], axis=-1)

    def unproject(self, pixels: ArrayLike, depth_m: ArrayLike) -> Array:
        """Back-project pixels (..., 2) at z-depths (...,) to camera-frame points (..., 3)."""
        pixels = np.asarray(pixels, dtype=np.float64)
        z = np.asarray(depth_m, dtype=np.float64)
        x = (pixels[..., 0] - self.cx_px) / self.fx_px * z
        y = (pixels[..., 1] - self.cy_px) / self.fy_px * z
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)

    def pixel_centers(self) -> Array:
        """Centres of all pixels, (H, W, 2), read-only."""
        return _pixel_centers(self.width_px, self.height_px)


@lru_cache(maxsize=8)
def _pixel_centers(width_px: int, height_px: int) -> Array:
    u, v = np.meshgrid(np.arange(width_px) + 0.5, np.arange(height_px) + 0.5)
    centers = np.stack([u, v], axis=-1)
    centers.setflags(write=False)
    return centers
