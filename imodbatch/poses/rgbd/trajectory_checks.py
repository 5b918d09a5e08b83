"""Whether images agree with the poses given to them; no truth is needed.

Two questions. Do features move between neighbouring frames as depth and poses say? And where the
camera comes back to a place, do the images themselves tell the relative pose that the trajectory
claims? The first shows jitter and wrong conventions, the second drift.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.consistency import bilinear_depth
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply, invert
from imodbatch.core.pairs import Pairs
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.rgbd.features import FeatureExtractor, Features
from imodbatch.poses.rgbd.flow import corners, track
from imodbatch.poses.rgbd.gray import Gray, read_gray
from imodbatch.poses.rgbd.motion import Motion, motion_between, motion_of

Array = NDArray[np.float64]
N_FEATURES = 1500
CORNER_DISTANCE_PX, WINDOW_PX = 8, 21
LEVELS_IF_EXPECTED, LEVELS_IF_NOT = 1, 4
"""Of the image pyramid: coarse levels take wallpaper for its next repeat."""
MOST_THERE_AND_BACK_PX = 0.5


@dataclass(frozen=True, eq=False)
class _Seen:
    """Grey image (H, W), depth (H, W) and features of a frame."""

    gray: Gray
    depth_m: DepthImage
    features: Features


def reprojection_errors_px(frames: RgbdFrames, world_from_cam: Array, pairs: Pairs) -> Array:
    """Per pair, how far features are found from where depth and poses put them (median).

    Corners are tracked from the first frame of a pair to the second and back, from where matched
    ORB features lead to expect them: a robot may turn by a hundred pixels between frames. Left out
    are corners without depth or at an edge of it, those that do not come back, and those that fit
    no common motion of the camera.

    Args:
        frames: the images.
        world_from_cam: (F, 4, 4).
        pairs: (P, 2) positions of neighbouring frames; those with an unreadable image or without a
            clear motion in the images are passed over.

    Returns:
        (n,) pixels, of the n ≤ P pairs that were judged.
    """
    errors = []
    for first, second, b_from_a in _readable(frames, world_from_cam, pairs):
        motion = motion_of(*_tracks(first, second, frames.camera), frames.camera)
        if motion is None:
            continue
        predicted = frames.camera.project(apply(b_from_a, motion.points_a))
        distances = np.linalg.norm(predicted - motion.pixels_b, axis=-1)
        in_front = np.isfinite(distances)
        if in_front.any():
            errors.append(float(np.median(distances[in_front])))
    return np.array(errors, dtype=np.float64)


def loop_errors(frames: RgbdFrames, world_from_cam: Array, pairs: Pairs) -> tuple[Array, Array]:
    """Relative poses estimated anew from images and depth, held against the trajectory's.

    Args:
        frames: the images.
        world_from_cam: (F, 4, 4).
        pairs: (P, 2) positions of frames that see much the same.

    Returns:
        (n,) translation in metres and (n,) rotation in radians of the difference, of the n ≤ P
        pairs whose images tell a motion.
    """
    errors = []
    for first, second, b_from_a in _readable(frames, world_from_cam, pairs):
        motion = motion_between(first.features, second.features, frames.camera)
        if motion is not None:
            errors.append(b_from_a @ invert(motion.b_from_a))
    stacked = np.array(errors).reshape(-1, 4, 4)
    return np.linalg.norm(stacked[:, :3, 3], axis=-1), rotation_angle_rad(stacked[:, :3, :3])


def _readable(
    frames: RgbdFrames, world_from_cam: Array, pairs: Pairs
) -> Iterator[tuple[_Seen, _Seen, Array]]:
    """The pairs whose images can be read, and b_from_a (4, 4) by the trajectory."""
    extractor = FeatureExtractor(frames.camera, N_FEATURES)

    @lru_cache(maxsize=8)
    def seen(position: int) -> _Seen | None:
        gray, depth_m = read_gray(frames, position), frames.read_depth(position)
        if gray is None or depth_m is None:
            return None
        return _Seen(gray, depth_m, extractor.extract(gray, depth_m))

    for a, b in pairs.tolist():
        first, second = seen(a), seen(b)
        if first is not None and second is not None:
            yield first, second, invert(world_from_cam[b]) @ world_from_cam[a]


def _tracks(first: _Seen, second: _Seen, camera: PinholeCamera) -> tuple[Array, Array]:
    """Corners of a as points (n, 3) by its depth, and the pixels (n, 2) where b shows them."""
    pixels_a = corners(first.gray, CORNER_DISTANCE_PX)
    points_a = camera.unproject(pixels_a, bilinear_depth(first.depth_m, pixels_a))
    has_depth = np.isfinite(points_a[:, 2])
    pixels_a, points_a = pixels_a[has_depth], points_a[has_depth]
    motion = motion_between(first.features, second.features, camera)
    levels = LEVELS_IF_NOT if motion is None else LEVELS_IF_EXPECTED
    expected = _expected(points_a, pixels_a, motion, camera)
    pixels_b, found = track(first.gray, second.gray, pixels_a, expected, WINDOW_PX, levels)
    start = pixels_b - (expected - pixels_a)
    back, found_back = track(second.gray, first.gray, pixels_b, start, WINDOW_PX, levels)
    returned = np.linalg.norm(back - pixels_a, axis=-1) <= MOST_THERE_AND_BACK_PX
    good = found & found_back & returned
    return points_a[good], pixels_b[good]


def _expected(
    points_a: Array, pixels_a: Array, motion: Motion | None, camera: PinholeCamera
) -> Array:
    """Where to look for points (n, 3) in b: where they were in a, unless a motion is known."""
    if motion is None:
        return pixels_a
    pixels = camera.project(apply(motion.b_from_a, points_a))
    return np.where(np.isfinite(pixels), pixels, pixels_a)
