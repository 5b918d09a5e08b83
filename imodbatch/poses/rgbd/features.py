"""ORB features of a frame, spread over the image, each with the depth behind it (Rublee 2011)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage

Array = NDArray[np.float64]
SCALE_FACTOR, N_LEVELS = 1.2, 8
CELL_PX = 32
FAST_THRESHOLD = 7
MAX_EDGE_SHARE = 0.03


@dataclass(frozen=True)
class Features:
    """N features of one frame.

    Attributes:
        pixels: (N, 2) continuous pixels.
        octave: (N,) level of the image pyramid, `SCALE_FACTOR` apart.
        descriptors: (N, 4) uint64, 256 bits each.
        points_cam: (N, 3) metres in the camera, NaN where no depth is known.
    """

    pixels: Array
    octave: NDArray[np.int64]
    descriptors: NDArray[np.uint64]
    points_cam: Array

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def has_depth(self) -> NDArray[np.bool_]:
        """(N,) whether the place is known."""
        return np.isfinite(self.points_cam[:, 2])

    @cached_property
    def tree(self) -> KDTree:
        """Their pixels, to be asked for those nearby."""
        return KDTree(self.pixels)


class FeatureExtractor:
    """Finds about `n_features` features in grey images of one camera."""

    def __init__(self, camera: PinholeCamera, n_features: int) -> None:
        self._camera = camera
        self._n_features = n_features
        self._orb: Any = cv2.ORB.create(
            nfeatures=3 * n_features,
            scaleFactor=SCALE_FACTOR,
            nlevels=N_LEVELS,
            fastThreshold=FAST_THRESHOLD,
        )

    def extract(self, gray: NDArray[np.uint8], depth_m: DepthImage) -> Features:
        """Features of an image (H, W) with its registered depth (H, W), NaN = unknown."""
        keypoints = self._orb.detect(gray, None)
        kept = self._spread(keypoints)
        keypoints, descriptors = self._orb.compute(gray, [keypoints[i] for i in kept])
        if not keypoints:
            return Features(
                np.zeros((0, 2)),
                np.zeros(0, dtype=np.int64),
                np.zeros((0, 4), dtype=np.uint64),
                np.zeros((0, 3)),
            )
        octave = np.array([k.octave for k in keypoints], dtype=np.int64)
        pixels = self._continuous(_pixels(keypoints), octave)
        depth = smooth_depth(depth_m, pixels)
        points = self._camera.unproject(pixels, depth)
        return Features(pixels, octave, descriptors.view(np.uint64), points)

    def _continuous(self, pixels: Array, octave: NDArray[np.int64]) -> Array:
        """Continuous pixels of the places (N, 2) that OpenCV gives.

        It counts from the middle of the corner pixel of the octave, and takes no notice that an
        octave's size is rounded to whole pixels.
        """
        size = np.array([self._camera.width_px, self._camera.height_px])
        scale = SCALE_FACTOR ** octave[:, None]
        return (pixels / scale + 0.5) * size / np.rint(size / scale)

    def _spread(self, keypoints: Any) -> NDArray[np.int64]:
        """Positions of the strongest features, at most four equal shares from each cell."""
        if not keypoints:
            return np.zeros(0, dtype=np.int64)
        pixels = _pixels(keypoints)
        response = np.array([k.response for k in keypoints])
        n_across = -(-self._camera.width_px // CELL_PX)
        n_cells = n_across * -(-self._camera.height_px // CELL_PX)
        cell = (pixels[:, 1] // CELL_PX).astype(np.int64) * n_across
        cell += (pixels[:, 0] // CELL_PX).astype(np.int64)
        order = np.lexsort((-response, cell))
        first = np.searchsorted(cell[order], cell[order], side="left")
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order)) - first
        # round by round: the best of each cell first, then the second best
        chosen = np.lexsort((-response, rank))[: self._n_features]
        most = max(int(np.ceil(4.0 * self._n_features / n_cells)), 1)
        return chosen[rank[chosen] < most]


def _pixels(keypoints: Any) -> Array:
    """Places (N, 2) as OpenCV counts them."""
    return np.asarray(cv2.KeyPoint.convert(keypoints), dtype=np.float64)


def smooth_depth(depth_m: DepthImage, pixels: Array) -> Array:
    """Median depth of the 3×3 pixels round each feature, NaN across an edge or a hole.

    A corner on an object's border has the depth of the object or of what is behind it by chance.
    """
    height, width = depth_m.shape
    column = np.clip(pixels[:, 0].astype(np.int64), 1, width - 2)
    row = np.clip(pixels[:, 1].astype(np.int64), 1, height - 2)
    shift = np.arange(-1, 2)
    window = depth_m[row[:, None, None] + shift[:, None], column[:, None, None] + shift]
    values = np.sort(window.reshape(len(pixels), 9).astype(np.float64), axis=1)  # NaN goes last
    middle = values[:, 4]
    with np.errstate(invalid="ignore"):
        flat = values[:, -1] - values[:, 0] <= MAX_EDGE_SHARE * middle
    return np.where(flat, middle, np.nan)
