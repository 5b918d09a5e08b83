"""Where features are too few: open3d's RGB-D odometry from one frame to the next, checked.

Steinbrücker et al. 2011 and Park et al. 2017 (open3d's hybrid term) align brightness and depth as a
whole. Whether the depth images say enough is asked of our own surfaces: on a bare wall they slide,
and then there is no answer. Nor is there where the shape is the same but not what is printed on it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import apply, invert
from imodbatch.libraries.open3d_library import intrinsics, open3d, rgbd_image
from imodbatch.poses.rgbd.registration import settle
from imodbatch.poses.rgbd.surfaces import MAX_DEPTH_M
from imodbatch.poses.slam.frame import Seen

Array = NDArray[np.float64]
MAX_SIGMA_M = 0.01
MIN_MET, MIN_FITTING = 0.5, 0.7
MAX_DEPTH_JUMP_M = 0.07
BLUR_PX, PLAIN_GRAY, MIN_LIKENESS = 5, 4.0, 0.5


def dense_motion(old: Seen, new: Seen) -> Array | None:
    """new_from_old (4, 4) of two frames, None where it is not certain."""
    o3d, camera = open3d(), new.frame.camera
    odometry = o3d.pipelines.odometry
    found, new_from_old, _ = odometry.compute_rgbd_odometry(
        *(rgbd_image(seen.gray, seen.depth_m, MAX_DEPTH_M) for seen in (old, new)),
        intrinsics(camera),
        np.eye(4),
        odometry.RGBDOdometryJacobianFromHybridTerm(),
        odometry.OdometryOption(
            depth_diff_max=MAX_DEPTH_JUMP_M, depth_min=0.1, depth_max=MAX_DEPTH_M
        ),
    )
    if not found:
        return None
    samples = new.frame.surface.samples
    settled = settle(camera, new_from_old, None, samples, [(old.frame.surface, np.eye(4))])
    is_certain = _largest_sigma_m(settled.information) < MAX_SIGMA_M
    if not is_certain or settled.met < MIN_MET or settled.fitting < MIN_FITTING:
        return None
    return settled.cam_from_world if _looks_alike(old, new, settled.cam_from_world) else None


def _looks_alike(old: Seen, new: Seen, new_from_old: Array) -> bool:
    """Whether the new frame's samples look in the old one as they do in their own.

    The same shape may be another place. Where both images are plain there is nothing to compare.
    """
    camera, samples = new.frame.camera, new.frame.surface.samples
    size = np.array([camera.width_px, camera.height_px])
    values = []
    for gray, points in (old.gray, apply(invert(new_from_old), samples)), (new.gray, samples):
        image = cv2.blur(gray, (BLUR_PX, BLUR_PX))
        with np.errstate(invalid="ignore"):
            pixel = np.nan_to_num(camera.project(points), nan=-1.0).astype(np.int64)
        inside: NDArray[np.bool_] = np.all((pixel >= 0) & (pixel < size), axis=1)
        column, row = np.where(inside[:, None], pixel, 0).T
        values.append(np.where(inside, image[row, column], np.nan))
    both = np.isfinite(values[0]) & np.isfinite(values[1])
    before, after = (v[both] for v in values)
    spread = np.array([before.std(), after.std()])
    if (spread < PLAIN_GRAY).all():
        return True
    covariance = ((before - before.mean()) * (after - after.mean())).mean()
    return bool(covariance > MIN_LIKENESS * spread.max() ** 2)


def _largest_sigma_m(information: Array) -> float:
    """Standard deviation in metres along the direction of which the surfaces say least."""
    covariance = np.linalg.inv(information + 1e-9 * np.eye(6))
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
