"""Whether images agree with the poses given to them (opencv); no truth is needed.

Two questions. Do features move between neighbouring frames as depth and poses say? And where the
camera comes back to a place, do the images themselves tell the relative pose that the trajectory
claims? The first shows jitter and wrong conventions, the second drift.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.consistency import bilinear_depth
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply, invert, make_transform
from imodbatch.core.pairs import Pairs
from imodbatch.engines.rgbd import RgbdFrames

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]
HALF_PX = 0.5
"""OpenCV counts pixels from the middle of the first one, we from the image's corner."""
MOST_CORNERS = 300
CORNER_QUALITY, CORNER_DISTANCE_PX = 0.01, 8
TRACKING_WINDOW_PX = (21, 21)
LEVELS_IF_EXPECTED, LEVELS_IF_NOT = 1, 4
"""Of the image pyramid: coarse levels take wallpaper for its next repeat."""
MOST_THERE_AND_BACK_PX = 0.5
N_ORB_FEATURES = 1500
BEST_TO_SECOND = 0.8
PNP_ERROR_PX = 3.0
FEWEST_INLIERS, INLIER_SHARE = 20, 0.4


@dataclass(frozen=True, eq=False)
class _Features:
    """A grey image and its ORB features: pixels (n, 2) and descriptors (n, 32)."""

    gray: Gray
    pixels: Array
    descriptors: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class _Motion:
    """A relative pose (4, 4) from images and depth alone, and the rows (n,) that agree with it."""

    b_from_a: Array
    inliers: NDArray[np.int64]


def reprojection_errors_px(frames: RgbdFrames, world_from_cam: Array, pairs: Pairs) -> Array:
    """Per pair, how far features are found from where depth and poses put them (median).

    Corners (Shi & Tomasi 1994) are tracked from the first frame of a pair to the second (pyramidal
    Lucas–Kanade, Bouguet 2001) and back, from where matched ORB features lead to expect them: a
    robot may turn by a hundred pixels between frames. Left out are corners without depth or at an
    edge of it, those that do not come back, and those that fit no common motion of the camera.

    Args:
        frames: the images.
        world_from_cam: (F, 4, 4).
        pairs: (P, 2) positions of neighbouring frames; those with an unreadable image or without a
            clear motion in the images are passed over.

    Returns:
        (n,) pixels, of the n ≤ P pairs that were judged.
    """
    features = _feature_reader(frames)
    errors = []
    for a, b in pairs.tolist():
        first, second, depth_m = features(a), features(b), frames.read_depth(a)
        if first is None or second is None or depth_m is None:
            continue
        points_a, pixels_b = _tracks(first, second, depth_m, frames.camera)
        motion = _motion(points_a, pixels_b, frames.camera)
        if motion is None:
            continue
        b_from_a = invert(world_from_cam[b]) @ world_from_cam[a]
        predicted = frames.camera.project(apply(b_from_a, points_a[motion.inliers]))
        distances = np.linalg.norm(predicted - pixels_b[motion.inliers], axis=-1)
        in_front = np.isfinite(distances)
        if in_front.any():
            errors.append(float(np.median(distances[in_front])))
    return np.array(errors, dtype=np.float64)


def loop_errors(frames: RgbdFrames, world_from_cam: Array, pairs: Pairs) -> tuple[Array, Array]:
    """Relative poses estimated anew from images and depth, held against the trajectory's.

    ORB features (Rublee et al. 2011) of both frames are matched; those of the first get a place by
    its depth, and PnP with RANSAC puts the second camera before them. A pair counts with at least
    20 inliers that are 40 % of the matches.

    Args:
        frames: the images.
        world_from_cam: (F, 4, 4).
        pairs: (P, 2) positions of frames that see much the same.

    Returns:
        (n,) translation in metres and (n,) rotation in radians of the difference, of the n ≤ P
        pairs whose images tell a motion.
    """
    features = _feature_reader(frames)
    errors = []
    for a, b in pairs.tolist():
        first, second, depth_m = features(a), features(b), frames.read_depth(a)
        if first is None or second is None or depth_m is None:
            continue
        motion = _matched_motion(first, second, depth_m, frames.camera)
        if motion is not None:
            errors.append(invert(world_from_cam[b]) @ world_from_cam[a] @ invert(motion.b_from_a))
    stacked = np.array(errors).reshape(-1, 4, 4)
    rotation_rad = rotation_angle_rad(stacked[:, :3, :3])
    return np.linalg.norm(stacked[:, :3, 3], axis=-1), rotation_rad


def _feature_reader(frames: RgbdFrames) -> Callable[[int], _Features | None]:
    """ORB features by position, those of the last frames kept; None = no readable image."""

    @lru_cache(maxsize=8)
    def features(position: int) -> _Features | None:
        color = frames.read_color(position)
        if color is None:
            return None
        gray = np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY))
        keypoints, descriptors = cv2.ORB.create(N_ORB_FEATURES).detectAndCompute(gray, None)
        if descriptors is None:
            return _Features(gray, np.zeros((0, 2)), np.zeros((0, 32), dtype=np.uint8))
        return _Features(gray, np.array([k.pt for k in keypoints]) + HALF_PX, descriptors)

    return features


def _tracks(
    first: _Features, second: _Features, depth_m: DepthImage, camera: PinholeCamera
) -> tuple[Array, Array]:
    """Corners of a as points (n, 3) by its depth, and the pixels (n, 2) where b shows them."""
    corners = cv2.goodFeaturesToTrack(first.gray, MOST_CORNERS, CORNER_QUALITY, CORNER_DISTANCE_PX)
    if corners is None:
        return np.zeros((0, 3)), np.zeros((0, 2))
    pixels_a = corners.reshape(-1, 2).astype(np.float64) + HALF_PX
    points_a, pixels_a = _with_depth(pixels_a, pixels_a, depth_m, camera)
    motion = _matched_motion(first, second, depth_m, camera)
    levels = LEVELS_IF_NOT if motion is None else LEVELS_IF_EXPECTED
    expected = _expected(points_a, pixels_a, motion, camera)
    pixels_b, found = _flow(first.gray, second.gray, pixels_a, expected, levels)
    start = pixels_b - (expected - pixels_a)
    back, found_back = _flow(second.gray, first.gray, pixels_b, start, levels)
    returned = np.linalg.norm(back - pixels_a, axis=-1) <= MOST_THERE_AND_BACK_PX
    good = found & found_back & returned
    return points_a[good], pixels_b[good]


def _expected(
    points_a: Array, pixels_a: Array, motion: _Motion | None, camera: PinholeCamera
) -> Array:
    """Where to look for points (n, 3) in b: where they were in a, unless a motion is known."""
    if motion is None:
        return pixels_a
    pixels = camera.project(apply(motion.b_from_a, points_a))
    return np.where(np.isfinite(pixels), pixels, pixels_a)


def _flow(
    gray_from: Gray, gray_to: Gray, pixels: Array, expected: Array, levels: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Lucas–Kanade: pixels (n, 2) in the second image, and which of them were found."""
    if len(pixels) == 0:
        return pixels, np.zeros(0, dtype=np.bool_)
    start, guess = (
        np.ascontiguousarray(x - HALF_PX, dtype=np.float32).reshape(-1, 1, 2)
        for x in (pixels, expected)
    )
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        *(gray_from, gray_to, start, guess),
        winSize=TRACKING_WINDOW_PX,
        maxLevel=levels,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return end[:, 0].astype(np.float64) + HALF_PX, found.ravel() > 0


def _matched_motion(
    first: _Features, second: _Features, depth_m: DepthImage, camera: PinholeCamera
) -> _Motion | None:
    """The motion that matched ORB features and the depth of a tell."""
    rows = _matches(first.descriptors, second.descriptors)
    pixels = first.pixels[rows[:, 0]], second.pixels[rows[:, 1]]
    return _motion(*_with_depth(*pixels, depth_m, camera), camera)


def _with_depth(
    pixels_a: Array, pixels_b: Array, depth_m: DepthImage, camera: PinholeCamera
) -> tuple[Array, Array]:
    """Points (n, 3) in camera a and pixels (n, 2) in b, of the correspondences with a depth."""
    depth = bilinear_depth(depth_m, pixels_a)
    has_one = np.isfinite(depth)
    return camera.unproject(pixels_a[has_one], depth[has_one]), pixels_b[has_one]


def _matches(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Rows (n, 2) of descriptors whose best match is clearly better than the second best."""
    if len(second) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    both = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(first, second, k=2)
    rows = [
        (best.queryIdx, best.trainIdx)
        for best, other in both
        if best.distance < BEST_TO_SECOND * other.distance
    ]
    return np.array(rows, dtype=np.int64).reshape(-1, 2)


def _motion(points_a: Array, pixels_b: Array, camera: PinholeCamera) -> _Motion | None:
    """The motion that projects most points (n, 3) to their pixels (n, 2); None = no clear one."""
    if len(points_a) < FEWEST_INLIERS:
        return None
    center = camera.cx_px - HALF_PX, camera.cy_px - HALF_PX
    matrix = np.array([[camera.fx_px, 0, center[0]], [0, camera.fy_px, center[1]], [0, 0, 1]])
    pixels = pixels_b - HALF_PX
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        *(points_a, pixels, matrix, None),
        iterationsCount=500,
        reprojectionError=PNP_ERROR_PX,
        confidence=0.999,
    )
    if not found or inliers is None:
        return None
    rows = inliers.ravel()
    if len(rows) < max(FEWEST_INLIERS, INLIER_SHARE * len(points_a)):
        return None
    rotation, translation = cv2.solvePnPRefineLM(
        points_a[rows], pixels[rows], matrix, None, rotation, translation
    )
    return _Motion(make_transform(cv2.Rodrigues(rotation)[0], translation.ravel()), rows)
