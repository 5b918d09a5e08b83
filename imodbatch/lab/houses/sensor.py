"""The robot's RGB-D camera: what Kinect and Xtion do to depth, and a cheap lens to colour.

Depth comes from disparity: noise of sigma 0.06 px and steps of 1/8 px at focal length times base =
43 px m (570 px by 7.5 cm) give sigma = 5.6 mm and steps of 12 mm at 2 m, growing with the square of
distance.
No depth: nearer than 0.4 m, farther than 6 m, where the projector's pattern is hidden by something
nearer, at jumps (half the pixels), on surfaces seen at a grazing angle, in patches on shiny
objects, and in 1 % of all pixels. Colour: exposure and white balance drift from frame to frame,
defocus and motion blur, noise like √brightness.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.lab.render.raycast import Frame

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class DepthFaults:
    """How depth is disturbed; see the module's text."""

    focal_base_px_m: float = 42.75
    disparity_sigma_px: float = 0.06
    disparity_step_px: float = 0.125
    nearest_m: float = 0.4
    farthest_m: float = 6.0
    hole_fraction: float = 0.01
    jump_fraction: float = 0.03
    jump_hole_fraction: float = 0.5
    grazing_cosine: float = 0.2

    def sigma_m(self, depth_m: Array) -> Array:
        """Standard deviation (…) of depth: noise and rounding together."""
        rounding = self.disparity_step_px / np.sqrt(12)
        return np.asarray(
            depth_m**2 / self.focal_base_px_m * np.hypot(self.disparity_sigma_px, rounding)
        )


def measure_depth(
    frame: Frame,
    camera: PinholeCamera,
    shininess: Mapping[int, float],
    rng: np.random.Generator,
    faults: DepthFaults | None = None,
) -> Floats:
    """Depth (H, W) as the sensor gives it, NaN = none.

    Args:
        frame: as rendered.
        camera: of it.
        shininess: of instances, 0..1: chance that a patch of it gives no depth.
        rng: random numbers.
        faults: how bad.
    """
    faults = faults or DepthFaults()
    exact = np.asarray(frame.depth_m, np.float32)
    shape = exact.shape
    known = np.where(np.isfinite(exact) & (exact > 0), exact, np.float32(100.0))
    disparity = np.asarray(faults.focal_base_px_m / known, np.float32)
    noisy = disparity + rng.standard_normal(shape, np.float32) * faults.disparity_sigma_px
    steps = np.maximum(np.round(noisy / faults.disparity_step_px), 1.0)
    measured = faults.focal_base_px_m / (steps * faults.disparity_step_px)

    hole_chance = np.full(shape, faults.hole_fraction, np.float32)
    hole_chance[_cosine(known, camera) < faults.grazing_cosine] = 0.8
    hole_chance[_jumps(known, faults.jump_fraction)] = faults.jump_hole_fraction
    patches = cv2.resize(
        rng.random((shape[0] // 6 + 1, shape[1] // 6 + 1), np.float32), shape[::-1]
    )
    for instance, chance in shininess.items():
        dull = (frame.instance_ids == instance) & (patches < chance)
        hole_chance[dull] = 0.9
    is_hole = rng.random(shape, np.float32) < hole_chance
    is_hole |= _in_shadow(disparity) | (known > 99)
    is_hole |= (measured < faults.nearest_m) | (measured > faults.farthest_m)
    return np.where(is_hole, np.nan, measured).astype(np.float32)


def _jumps(depth_m: Floats, fraction: float) -> NDArray[np.bool_]:
    """Pixels whose neighbourhood of 3 × 3 spans more than a share of the depth."""
    kernel = np.ones((3, 3), np.uint8)
    near, far = cv2.erode(depth_m, kernel), cv2.dilate(depth_m, kernel)
    # A slope is no jump: the neighbourhood's middle then lies in the middle.
    bend = np.abs(near + far - 2 * depth_m)
    return np.asarray((far - near > fraction * near) & (bend > 0.5 * fraction * near))


def _cosine(depth_m: Floats, camera: PinholeCamera) -> Floats:
    """Cosine (H, W) of the angle under which surfaces are seen, from differences of depth."""
    x = np.arange(camera.width_px, dtype=np.float32) + np.float32(0.5 - camera.cx_px)
    y = np.arange(camera.height_px, dtype=np.float32)[:, None] + np.float32(0.5 - camera.cy_px)
    ray_x, ray_y = x / np.float32(camera.fx_px), y / np.float32(camera.fy_px)
    dz_dx = cv2.Sobel(depth_m, cv2.CV_32F, 1, 0, ksize=3) / 8
    dz_dy = cv2.Sobel(depth_m, cv2.CV_32F, 0, 1, ksize=3) / 8
    # z(u, v) of a plane: its normal is (−f_x z_u, −f_y z_v, z + (u − c_x) z_u + (v − c_y) z_v).
    normal = np.stack(
        [
            camera.fx_px * dz_dx,
            camera.fy_px * dz_dy,
            -(depth_m + ray_x * camera.fx_px * dz_dx + ray_y * camera.fy_px * dz_dy),
        ]
    )
    towards = np.abs(normal[0] * ray_x + normal[1] * ray_y + normal[2])
    length = np.sqrt((normal**2).sum(axis=0) * (ray_x**2 + ray_y**2 + 1))
    return np.asarray(towards / np.maximum(length, 1e-12))


def _in_shadow(disparity: Floats) -> NDArray[np.bool_]:
    """Pixels that the projector, beside the camera, does not reach: something nearer hides them."""
    column = np.arange(disparity.shape[1], dtype=np.float32) - disparity
    farthest = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(column > farthest + 1.0)


class ColorCamera:
    """Colour with a drifting exposure and white balance: frames of a sequence, in order."""

    def __init__(self, rng: np.random.Generator, noise: float = 1.0) -> None:
        self.rng = rng
        self._drift = rng.normal(0, 0.03, 3)
        self.noise = noise * float(rng.uniform(1.0, 2.2))
        self.defocus_px = float(rng.uniform(0.3, 0.6))

    def photograph(
        self, color: NDArray[np.uint8], motion_px: tuple[float, float]
    ) -> NDArray[np.uint8]:
        """One frame.

        Args:
            color: (H, W, 3) as rendered.
            motion_px: how far the picture moves while the shutter is open.
        """
        rng = self.rng
        self._drift = 0.95 * self._drift + rng.normal(0, 0.01, 3)
        gain = np.exp(self._drift[0] + np.array([self._drift[1], 0.0, self._drift[2]]))
        image = color.astype(np.float32) * gain.astype(np.float32)
        sigma = self.defocus_px * float(rng.uniform(0.7, 1.4))
        image = cv2.GaussianBlur(image, (0, 0), sigma)
        kernel = _streak(*motion_px)
        if kernel is not None:
            image = cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REPLICATE)
        strength = self.noise * np.sqrt(0.35 + image / 160)
        image = image + strength * rng.standard_normal(image.shape, np.float32)
        return np.asarray(np.rint(np.clip(image, 0, 255)), np.uint8)


def _streak(x_px: float, y_px: float) -> Floats | None:
    """A kernel that smears along a line; None if it is shorter than a pixel."""
    length = min(float(np.hypot(x_px, y_px)), 9.0)
    if length < 1:
        return None
    half = int(np.ceil(length / 2)) + 1
    along = np.linspace(-0.5, 0.5, 40) * length / np.hypot(x_px, y_px)
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    rows, columns = np.rint(half + along * y_px), np.rint(half + along * x_px)
    np.add.at(kernel, (rows.astype(int), columns.astype(int)), 1.0)
    return np.asarray(kernel / kernel.sum(), np.float32)
