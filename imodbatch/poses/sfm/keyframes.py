"""Which frames are worth reconstructing: a new one whenever the image has moved on.

Corners of the last keyframe are tracked through the frames that follow (pyramidal Lucas–Kanade at
half size). The first frame in which a quarter of them have moved by more than a share of the
image's width, or in which half of them are lost, is the next keyframe. A quarter, because a camera
that circles an object keeps most of it in place. A camera that waits adds none.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.rgbd.flow import corners, track
from imodbatch.poses.rgbd.gray import Gray, read_gray
from imodbatch.poses.sfm.colmap import Progress

CORNER_DISTANCE_PX = 7
MIN_CORNERS = 20
MIN_SHARE_KEPT = 0.5
FEW_KEYFRAMES = 12
MOVED_QUANTILE = 0.75
WINDOW_PX = 15
PYRAMID_LEVELS = 3


@dataclass(frozen=True)
class Keyframes:
    """Positions (K,) of keyframes and of the frames (n,) whose image cannot be read."""

    positions: list[int] = field(default_factory=list)
    unreadable: list[int] = field(default_factory=list)


def select_keyframes(frames: RgbdFrames, motion_percent: float, progress: Progress) -> Keyframes:
    """Choose keyframes; where they are few, again with half the motion, and with a quarter.

    Args:
        frames: the sequence.
        motion_percent: shift that a quarter of the corners exceed, in percent of the image's width.
        progress: wraps the loop.
    """
    chosen = Keyframes()
    for part in (1.0, 0.5, 0.25):
        chosen = _select(frames, part * motion_percent / 100, progress)
        if len(chosen.positions) >= FEW_KEYFRAMES:
            break
    return chosen


def _select(frames: RgbdFrames, share_of_width: float, progress: Progress) -> Keyframes:
    motion, chosen = _Motion(share_of_width), Keyframes()
    for position in progress(range(len(frames))):
        gray = read_gray(frames, position)
        if gray is None:
            chosen.unreadable.append(position)
            continue
        half = cv2.resize(gray, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        if motion.is_enough(half):  # type: ignore[arg-type]
            chosen.positions.append(position)
    return chosen


class _Motion:
    """Tracks the corners of the last keyframe."""

    def __init__(self, share_of_width: float) -> None:
        self._share = share_of_width
        self._key: Gray | None = None
        self._corners = self._tracks = np.zeros((0, 2))

    def is_enough(self, gray: Gray) -> bool:
        """Whether an image (H, W) is a new keyframe; if so, the next is compared with it."""
        key, n_corners = self._key, len(self._corners)
        if key is not None and n_corners >= MIN_CORNERS and not self._moved(key, gray):
            return False
        self._key = gray
        self._corners = self._tracks = corners(gray, CORNER_DISTANCE_PX)
        return True

    def _moved(self, key: Gray, gray: Gray) -> bool:
        pixels, kept = track(key, gray, self._corners, self._tracks, WINDOW_PX, PYRAMID_LEVELS)
        if kept.mean() < MIN_SHARE_KEPT:
            return True
        self._tracks = np.where(kept[:, None], pixels, self._tracks)
        shift = np.linalg.norm((pixels - self._corners)[kept], axis=-1)
        return bool(np.quantile(shift, MOVED_QUANTILE) > self._share * gray.shape[1])
