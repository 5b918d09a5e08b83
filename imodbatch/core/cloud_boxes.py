"""The box of a cloud of points in an image, and how much of the cloud the camera saw.

A cloud knows where a thing is, a depth image what stands in front. The box is that of all points,
hidden ones too. Whether the thing is seen is asked of its front alone, for its far side is hidden
by itself: the front is what remains of the cloud in a z-buffer of its own, and it is seen where the
depth image has that very distance.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply

Array = NDArray[np.float64]
NEAR_M = 0.1
"""Nothing is seen nearer than this, and points behind the camera have no projection."""
FRONT_M = 0.02
"""How far behind the nearest point of its cell a point still belongs to the front."""


@dataclass(frozen=True)
class Sight:
    """What a depth image says of the front of a cloud.

    Attributes:
        n_front: points of the front, also those beside the image.
        n_confirmed: those at which the depth image has their own distance.
        depth_ratios: depth over distance of each front point that lies on a known depth.
    """

    n_front: int
    n_confirmed: int
    depth_ratios: Array

    @property
    def share(self) -> float:
        """Confirmed share of the front, 0 where nothing is known."""
        return self.n_confirmed / self.n_front if self.n_front else 0.0


def box_of_points(
    points_world: ArrayLike, cam_from_world: ArrayLike, camera: PinholeCamera
) -> tuple[float, float, float, float] | None:
    """Box x0, y0, x1, y1 in continuous pixels around the projection of points, not cut at borders.

    Args:
        points_world: (n, 3) metres; corners of the convex hull do as well as all points, as long as
            all of them lie in front of the camera.
        cam_from_world: (4, 4).
        camera: of the image.

    Returns:
        None where all points lie behind the camera; else the box of those in front of it.
    """
    points = apply(cam_from_world, points_world)
    points = points[points[:, 2] > NEAR_M]
    if len(points) == 0:
        return None
    pixels = camera.project(points)
    (x0, y0), (x1, y1) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
    return x0, y0, x1, y1


def is_in_front(points_world: ArrayLike, cam_from_world: ArrayLike) -> bool:
    """Whether all points (n, 3) lie in front of the camera, so that their box is whole."""
    return bool((apply(cam_from_world, points_world)[:, 2] > NEAR_M).all())


def sight_of_points(
    points_world: ArrayLike,
    spacing_m: float,
    cam_from_world: ArrayLike,
    camera: PinholeCamera,
    depth_m: DepthImage,
    tolerance_m: float,
    tolerance_share: float,
) -> Sight:
    """Hold the front of a cloud against a depth image.

    Args:
        points_world: (n, 3) metres, about evenly spread over the surface.
        spacing_m: distance of neighbouring points.
        cam_from_world: (4, 4).
        camera: of the depth image.
        depth_m: (H, W), NaN where unknown.
        tolerance_m: a point is seen if its distance z and the depth differ by no more than
            ``tolerance_m + tolerance_share * z``.
        tolerance_share: see there; noise and pose errors grow with the distance.
    """
    points = apply(cam_from_world, points_world)
    points = points[points[:, 2] > NEAR_M]
    pixels, z = camera.project(points), points[:, 2]
    front = _front(pixels, z, camera.fx_px * spacing_m)
    pixels, z = pixels[front], z[front]
    depth = _look_up(depth_m, pixels)
    known = np.isfinite(depth)
    agrees = np.abs(depth[known] - z[known]) <= tolerance_m + tolerance_share * z[known]
    return Sight(len(z), int(agrees.sum()), depth[known] / z[known])


def _front(pixels: Array, z: Array, spacing_px_m: float) -> NDArray[np.bool_]:
    """Which points (n,) are nearest, or nearly so, in their cell of the image.

    Cells are as wide as two spacings of the nearest points, so that none of the front lacks one.
    """
    if len(z) == 0:
        return np.zeros(0, dtype=np.bool_)
    side_px = max(2.0 * spacing_px_m / float(z.min()), 1.0)
    columns, rows = np.floor((pixels - pixels.min(axis=0)) / side_px).astype(np.int64).T
    cell = rows * (int(columns.max()) + 1) + columns
    cells, owner = np.unique(cell, return_inverse=True)
    nearest = np.full(len(cells), np.inf)
    np.minimum.at(nearest, owner, z)
    return np.asarray(z <= nearest[owner] + FRONT_M)


def _look_up(depth_m: DepthImage, pixels: Array) -> Array:
    """Depth (n,) under pixels (n, 2), NaN beside the image."""
    height, width = depth_m.shape
    columns, rows = np.floor(pixels).astype(np.int64).T
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    depth = np.full(len(pixels), np.nan)
    depth[inside] = depth_m[rows[inside], columns[inside]]
    return depth
