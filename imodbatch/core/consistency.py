"""Whether two depth images agree under the relative pose that a trajectory gives them.

Points of frame a are moved into frame b and held against what b measures there. Right poses leave
the sensor's noise; wrong ones leave more. What lies well behind b's surface is hidden from b and
says nothing. No truth is needed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply

Array = NDArray[np.float64]
STRIDE_PX = 8
HIDDEN_BEHIND_M = 0.25
"""Farther behind b's surface, a point of a counts as hidden, not as wrong."""
EDGE_SHARE = 0.03
"""Four depths that differ by more than this share of the depth straddle an edge."""
TOLERANCE_M = 0.03


@dataclass(frozen=True)
class DepthConsistency:
    """What b says of the points of a.

    Attributes:
        residual_m: (n,) depth of a's point in b less the depth that b measures there, of the points
            that both see.
        tolerance_m: (n,) the larger of 3 cm and three standard deviations of the sensor's noise.
        n_points: points of a with a depth.
    """

    residual_m: Array
    tolerance_m: Array
    n_points: int

    @property
    def overlap(self) -> float:
        """Share of a's points that b sees, too."""
        return len(self.residual_m) / self.n_points if self.n_points else 0.0


def depth_consistency(
    depth_a_m: DepthImage,
    depth_b_m: DepthImage,
    camera: PinholeCamera,
    b_from_a: ArrayLike,
    stride_px: int = STRIDE_PX,
) -> DepthConsistency:
    """Hold the depth of frame a against that of frame b.

    Args:
        depth_a_m: (H, W), NaN where unknown.
        depth_b_m: (H, W) likewise.
        camera: of both.
        b_from_a: (4, 4) relative pose.
        stride_px: every so many-th pixel of a is asked, along both axes.
    """
    offset = stride_px // 2
    pixels = camera.pixel_centers()[offset::stride_px, offset::stride_px].reshape(-1, 2)
    depth = np.asarray(depth_a_m, dtype=np.float64)[offset::stride_px, offset::stride_px].ravel()
    seen = np.isfinite(depth) & (depth > 0)
    points_b = apply(b_from_a, camera.unproject(pixels[seen], depth[seen]))
    measured = bilinear_depth(depth_b_m, camera.project(points_b))
    residual = points_b[:, 2] - measured
    both = np.isfinite(residual) & (residual <= HIDDEN_BEHIND_M)
    return DepthConsistency(residual[both], tolerance_m(measured[both]), int(seen.sum()))


def tolerance_m(depth_m: Array) -> Array:
    """3 cm, or three times a structured-light sensor's axial noise (Nguyen et al. 2012, Eq. 1)."""
    noise = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2
    return np.maximum(TOLERANCE_M, 3 * noise)


def bilinear_depth(depth_m: DepthImage, pixels: ArrayLike) -> Array:
    """Depth (n,) at continuous pixels (n, 2), between the four pixel centres around each.

    NaN outside the image, beside unknown depth, and across edges, where a mean of near and far
    would be the depth of nothing.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    height, width = depth_m.shape
    result = np.full(len(pixels), np.nan)
    at = pixels - 0.5
    with np.errstate(invalid="ignore"):
        inside = ((at >= 0) & (at < [width - 1, height - 1])).all(axis=1)
    at = at[inside]
    left, top = np.floor(at).astype(np.int64).T
    x, y = (at - np.floor(at)).T
    corners = np.stack(
        [depth_m[top + down, left + across] for down in (0, 1) for across in (0, 1)]
    ).astype(np.float64)
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
    mean = (weights * corners).sum(axis=0)
    is_smooth = np.ptp(corners, axis=0) <= EDGE_SHARE * mean
    result[inside] = np.where(is_smooth, mean, np.nan)
    return result
