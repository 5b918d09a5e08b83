"""What a feature measures: a pixel and a z-depth; residuals, Jacobians and how far to trust them.

A point X of the world appears in the camera at p = R X + t, in the image at (u, v) and at depth z.
Residuals are divided by their standard deviations: pixels by that of a corner at its octave, depth
by the sensor's, which grows with the square of the distance (Khoshelham & Elberink 2012).
"""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.poses.rgbd.features import SCALE_FACTOR

Array = NDArray[np.float64]
PIXEL_SIGMA = 1.0
DEPTH_SIGMA_PER_M = 0.0025
DEPTH_SIGMA_FLOOR_M = 0.004
CHI2_PIXEL, CHI2_DEPTH = 5.991, 3.841  # 95 % of two and of one normal variable
CHI2_PIXEL_MEDIAN = 1.386
LEAST_VARIANCE = 0.05
MIN_Z_M = 0.05


def measured(pixels: Array, points_cam: Array) -> Array:
    """Measurements (N, 3): u, v, z; z is NaN where no depth is known."""
    return np.concatenate([pixels, points_cam[:, 2:]], axis=1)


def sigmas(measurements: Array, octave: NDArray[np.int64] | Array) -> Array:
    """Standard deviations (N, 3) of measurements; an octave (N,) need not be a whole number."""
    pixel = PIXEL_SIGMA * SCALE_FACTOR ** octave.astype(np.float64)
    depth = DEPTH_SIGMA_FLOOR_M + DEPTH_SIGMA_PER_M * measurements[:, 2] ** 2
    return np.stack([pixel, pixel, depth], axis=1)


def residuals(camera: PinholeCamera, points_cam: Array, measurements: Array, sigma: Array) -> Array:
    """Whitened residuals (N, 3), predicted − measured; 0 for an unknown depth.

    Points behind the camera get residuals so large that no test lets them pass.
    """
    z = np.maximum(points_cam[:, 2], MIN_Z_M)
    u = camera.fx_px * points_cam[:, 0] / z + camera.cx_px
    v = camera.fy_px * points_cam[:, 1] / z + camera.cy_px
    predicted = np.stack([u, v, points_cam[:, 2]], axis=1)
    found = (predicted - measurements) / sigma
    found[points_cam[:, 2] < MIN_Z_M] = 1e6
    found[:, 2] = np.where(np.isfinite(measurements[:, 2]), found[:, 2], 0.0)
    return found


def image_jacobian(
    camera: PinholeCamera, points_cam: Array, measurements: Array, sigma: Array
) -> Array:
    """Derivatives (N, 3, 3) of the whitened residuals by the point in the camera."""
    x, y = points_cam[:, 0], points_cam[:, 1]
    inverse_z = 1.0 / np.maximum(points_cam[:, 2], MIN_Z_M)
    jacobian = np.zeros((len(points_cam), 3, 3))
    jacobian[:, 0, 0] = camera.fx_px * inverse_z
    jacobian[:, 0, 2] = -camera.fx_px * x * inverse_z**2
    jacobian[:, 1, 1] = camera.fy_px * inverse_z
    jacobian[:, 1, 2] = -camera.fy_px * y * inverse_z**2
    jacobian[:, 2, 2] = np.isfinite(measurements[:, 2])
    return jacobian / np.where(np.isfinite(sigma), sigma, 1.0)[:, :, None]


def pose_jacobian(image: Array, points_cam: Array) -> Array:
    """Derivatives (N, 3, 6) by a twist that acts on the left of cam_from_world."""
    x, y, z = points_cam.T
    jacobian = np.empty((len(points_cam), 3, 6))
    jacobian[:, :, :3] = image
    jacobian[:, :, 3] = image[:, :, 2] * y[:, None] - image[:, :, 1] * z[:, None]
    jacobian[:, :, 4] = image[:, :, 0] * z[:, None] - image[:, :, 2] * x[:, None]
    jacobian[:, :, 5] = image[:, :, 1] * x[:, None] - image[:, :, 0] * y[:, None]
    return jacobian


def chi2(whitened: Array) -> tuple[Array, Array]:
    """Squared residuals (N,) of the pixel and (N,) of the depth."""
    return (whitened[:, :2] ** 2).sum(axis=1), whitened[:, 2] ** 2


def huber_weights(whitened: Array) -> Array:
    """Weights (N, 3) that make squares grow linearly beyond the 95 % bound (Huber 1964)."""
    pixel, depth = chi2(whitened)
    of_pixel = np.sqrt(CHI2_PIXEL / np.maximum(pixel, CHI2_PIXEL))
    of_depth = np.sqrt(CHI2_DEPTH / np.maximum(depth, CHI2_DEPTH))
    return np.stack([of_pixel, of_pixel, of_depth], axis=1)


def fits(whitened: Array) -> NDArray[np.bool_]:
    """(N,) whether a pixel residual is within the 95 % bound and a depth's is not absurd.

    Depth at corners has heavy tails; the weight tames what lies between the two bounds.
    """
    pixel, depth = chi2(whitened)
    return (pixel < CHI2_PIXEL) & (depth < 16.0)


def majority_weights(whitened: Array) -> Array:
    """Weights (N, 3) that follow the majority (Geman & McClure 1985, scale by the median).

    Something that moves by itself would pull the pose to a compromise; what is far worse than most
    sightings hardly counts, whatever the size of most errors is.
    """
    pixel, _ = chi2(whitened)
    of_pixel = np.square(1 / (1 + pixel / (CHI2_PIXEL * _variance(pixel))))
    return np.stack([of_pixel, of_pixel, huber_weights(whitened)[:, 2]], axis=1)


def fits_like_most(whitened: Array) -> NDArray[np.bool_]:
    """(N,) whether residuals fit, by the spread that most of them show if that is smaller."""
    pixel, _ = chi2(whitened)
    return fits(whitened) & (pixel < CHI2_PIXEL * min(_variance(pixel), 1.0))


def _variance(chi2_pixel: Array) -> float:
    """Variance that the median of squared residuals (N,) tells, 1 = as expected."""
    median = float(np.median(chi2_pixel)) if len(chi2_pixel) else CHI2_PIXEL_MEDIAN
    return max(median / CHI2_PIXEL_MEDIAN, LEAST_VARIANCE)
