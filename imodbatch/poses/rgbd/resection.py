"""One camera's pose from points of known place: RANSAC to start, then robust Gauss–Newton."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import apply, exp_twist, make_transform, orthonormal
from imodbatch.poses.rgbd import measurement

Array = NDArray[np.float64]
N_ROUNDS, N_ITERATIONS = 3, 5
SETTLED = 1e-5
RANSAC_ERROR_PX = 4.0
MIN_FITTING = 25
"""Sightings that a pose must explain to be believed near a guess."""


@dataclass(frozen=True)
class Sightings:
    """N points of the world and where one frame saw them.

    Attributes:
        points: (N, 3) metres in the world.
        measurements: (N, 3) u, v, z; z NaN = unknown.
        sigma: (N, 3).
    """

    points: Array
    measurements: Array
    sigma: Array

    def take(self, rows: NDArray[np.generic]) -> "Sightings":
        """Some of them."""
        return Sightings(self.points[rows], self.measurements[rows], self.sigma[rows])


def refine(
    camera: PinholeCamera, cam_from_world: Array, seen: Sightings
) -> tuple[Array, NDArray[np.bool_]]:
    """Best pose near a first guess, and which sightings (N,) fit it.

    After each round of Gauss–Newton steps sightings that do not fit are left out; they may come
    back. Columns of unknown depth do not count.
    """
    cam_from_world = orthonormal(cam_from_world)  # a guess by motion is a product of poses
    good = np.ones(len(seen.points), dtype=np.bool_)
    for _ in range(N_ROUNDS):
        if good.sum() < 6:
            break
        cam_from_world = _descend(camera, cam_from_world, seen.take(good))
        points = apply(cam_from_world, seen.points)
        good = measurement.fits_like_most(
            measurement.residuals(camera, points, seen.measurements, seen.sigma)
        )
    return cam_from_world, good


def _descend(camera: PinholeCamera, cam_from_world: Array, seen: Sightings) -> Array:
    for _ in range(N_ITERATIONS):
        normal, gradient = linearised(camera, cam_from_world, seen, measurement.majority_weights)
        step = -np.linalg.solve(normal + 1e-6 * np.diag(np.diag(normal) + 1e-9), gradient)
        cam_from_world = exp_twist(step) @ cam_from_world
        if np.abs(step).max() < SETTLED:
            break
    return cam_from_world


def linearised(
    camera: PinholeCamera, cam_from_world: Array, seen: Sightings, weigh: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """Normal matrix (6, 6) and gradient (6,) by a twist on the left, residuals weighed (N, 3)."""
    points = apply(cam_from_world, seen.points)
    error = measurement.residuals(camera, points, seen.measurements, seen.sigma)
    image = measurement.image_jacobian(camera, points, seen.measurements, seen.sigma)
    jacobian = measurement.pose_jacobian(image, points).reshape(-1, 6)
    weight = weigh(error).reshape(-1, 1)
    return jacobian.T @ (weight * jacobian), jacobian.T @ (weight[:, 0] * error.ravel())


def ransac(
    camera: PinholeCamera, points: Array, pixels: Array, n_iterations: int = 200
) -> tuple[Array, NDArray[np.bool_]] | None:
    """A pose without a first guess (EPnP in RANSAC), and which points (N,) agree; None = none."""
    if len(points) < 6:
        return None
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    cv2.setRNGSeed(0)
    try:
        found, rotation, translation, inliers = cv2.solvePnPRansac(
            *(points, pixels, matrix, None),
            iterationsCount=n_iterations,
            reprojectionError=RANSAC_ERROR_PX,
            confidence=0.999,
            flags=cv2.SOLVEPNP_EPNP,
        )
    except cv2.error:  # degenerate samples
        return None
    if not found or inliers is None or len(inliers) < 6:
        return None
    agrees = np.zeros(len(points), dtype=np.bool_)
    agrees[inliers.ravel()] = True
    return make_transform(cv2.Rodrigues(rotation)[0], translation.ravel()), agrees
