"""Where features are too few: open3d's RGB-D odometry from one frame to the next, checked.

Steinbrücker et al. 2011 and Park et al. 2017 (open3d's hybrid term) align brightness and depth as a
whole. Whether the depth images say enough is asked of our own surfaces: on a bare wall they slide,
and then there is no answer. Nor is there where the shape is the same but not what is printed on it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply, invert
from imodbatch.engines.open3d_library import open3d
from imodbatch.engines.slam.registration import settle
from imodbatch.engines.slam.surfaces import MAX_DEPTH_M, Surface

Array = NDArray[np.float64]
MAX_SIGMA_M = 0.01
MIN_MET, MIN_FITTING = 0.5, 0.7
MAX_DEPTH_JUMP_M = 0.07
BLUR_PX, PLAIN_GRAY, MIN_LIKENESS = 5, 4.0, 0.5


def dense_motion(
    camera: PinholeCamera,
    gray: tuple[NDArray[np.uint8], NDArray[np.uint8]],
    depth_m: tuple[DepthImage, DepthImage],
    surfaces: tuple[Surface, Surface],
) -> Array | None:
    """new_from_old (4, 4) of two frames (old, new), None where it is not certain."""
    o3d = open3d()
    odometry = o3d.pipelines.odometry
    old, new = (
        o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(g),
            o3d.geometry.Image(np.nan_to_num(d, nan=0.0).astype(np.float32)),
            depth_scale=1.0,
            depth_trunc=MAX_DEPTH_M,
            convert_rgb_to_intensity=True,
        )
        for g, d in zip((np.ascontiguousarray(g) for g in gray), depth_m, strict=True)
    )
    # open3d counts pixels from their middles
    intrinsics = o3d.camera.PinholeCameraIntrinsic(
        camera.width_px,
        camera.height_px,
        camera.fx_px,
        camera.fy_px,
        camera.cx_px - 0.5,
        camera.cy_px - 0.5,
    )
    found, new_from_old, _ = odometry.compute_rgbd_odometry(
        old,
        new,
        intrinsics,
        np.eye(4),
        odometry.RGBDOdometryJacobianFromHybridTerm(),
        odometry.OdometryOption(
            depth_diff_max=MAX_DEPTH_JUMP_M, depth_min=0.1, depth_max=MAX_DEPTH_M
        ),
    )
    if not found:
        return None
    settled = settle(camera, new_from_old, None, surfaces[1].samples, [(surfaces[0], np.eye(4))])
    is_certain = _largest_sigma_m(settled.information) < MAX_SIGMA_M
    if not is_certain or settled.met < MIN_MET or settled.fitting < MIN_FITTING:
        return None
    if not _brightness_agrees(camera, gray, surfaces[1].samples, settled.cam_from_world):
        return None
    return settled.cam_from_world


def _brightness_agrees(
    camera: PinholeCamera,
    gray: tuple[NDArray[np.uint8], NDArray[np.uint8]],
    samples: Array,
    new_from_old: Array,
) -> bool:
    """Whether the new frame's samples (S, 3) look in the old one as they do in their own.

    The same shape may be another place. Where both images are plain there is nothing to compare.
    """
    blurred = [cv2.blur(g, (BLUR_PX, BLUR_PX)) for g in gray]
    size = np.array([camera.width_px, camera.height_px])
    values = []
    for image, points in zip(blurred, (apply(invert(new_from_old), samples), samples), strict=True):
        with np.errstate(invalid="ignore"):
            pixel = np.nan_to_num(camera.project(points), nan=-1.0).astype(np.int64)
        inside: NDArray[np.bool_] = np.all((pixel >= 0) & (pixel < size), axis=1)
        column, row = np.where(inside[:, None], pixel, 0).T
        values.append(np.where(inside, image[row, column], np.nan))
    both = np.isfinite(values[0]) & np.isfinite(values[1])
    old, new = (v[both] for v in values)
    spread = np.array([old.std(), new.std()])
    if (spread < PLAIN_GRAY).all():
        return True
    covariance = ((old - old.mean()) * (new - new.mean())).mean()
    return bool(covariance > MIN_LIKENESS * spread.max() ** 2)


def _largest_sigma_m(information: Array) -> float:
    """Standard deviation in metres along the direction of which the surfaces say least."""
    covariance = np.linalg.inv(information + 1e-9 * np.eye(6))
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
