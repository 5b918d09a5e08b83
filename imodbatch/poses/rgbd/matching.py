"""Which feature is which: by descriptor alone, or near where a point should appear."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from imodbatch.poses.rgbd.features import SCALE_FACTOR, Features

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Descriptors = NDArray[np.uint64]
N_BITS = 256
MAX_DISTANCE = 64
MAX_RATIO = 0.8
MAX_WIDENING_OCTAVE = 4


def hamming(a: Descriptors, b: Descriptors) -> NDArray[np.int64]:
    """Differing bits of descriptors (..., 4) and (..., 4)."""
    return np.bitwise_count(a ^ b).sum(axis=-1, dtype=np.int64)


def mutual_matches(a: Descriptors, b: Descriptors) -> tuple[Indices, Indices]:
    """Pairs that are each other's nearest, near enough, and clearly nearer than the next.

    Args:
        a: (A, 4).
        b: (B, 4).

    Returns:
        Positions in a and in b of the pairs.
    """
    if len(a) < 2 or len(b) < 2:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    distance = (0.5 * (N_BITS - _signs(a) @ _signs(b).T)).astype(np.uint16)
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(a))
    best = distance[rows, nearest]
    mutual = distance.argmin(axis=0)[nearest] == rows
    masked = distance
    masked[rows, nearest] = 1000
    clear = best < MAX_RATIO * masked.min(axis=1)
    good = mutual & clear & (best <= MAX_DISTANCE)
    return rows[good], nearest[good]


def _signs(descriptors: Descriptors) -> NDArray[np.float32]:
    """Bits (n, 256) as 1 and −1: their products, which are exact, tell how many are the same."""
    bits = np.unpackbits(descriptors.view(np.uint8), axis=1)
    return 2 * bits.astype(np.float32) - 1


def near(features: Features, pixels: Array, radius_px: Array) -> tuple[Indices, Indices]:
    """Pairs (query, feature) closer than the query's radius.

    Args:
        features: of a frame.
        pixels: (Q, 2) queries, all finite.
        radius_px: (Q,).
    """
    widest = float(radius_px.max(initial=0.0))
    pairs = KDTree(pixels).sparse_distance_matrix(features.tree, widest, output_type="ndarray")
    pairs = pairs[pairs["v"] < radius_px[pairs["i"]]]
    return pairs["i"].astype(np.int64), pairs["j"].astype(np.int64)


@dataclass(frozen=True)
class Expected:
    """P map points as they should appear in a frame: pixels (P, 2), octave (P,), descriptors."""

    pixels: Array
    octave: Array
    descriptors: Descriptors


def projection_matches(
    expected: Expected, features: Features, radius_px: float
) -> tuple[Indices, Indices]:
    """Pairs (point, feature), one to one: the nearest descriptor near the expected pixel.

    The radius grows with the point's octave; the feature's octave may differ by one and a half.
    """
    scale = SCALE_FACTOR ** np.clip(expected.octave, 0, MAX_WIDENING_OCTAVE)
    point, feature = near(features, expected.pixels, radius_px * scale)
    fits = np.abs(features.octave[feature] - expected.octave[point]) <= 1.5
    point, feature = point[fits], feature[fits]
    distance = hamming(expected.descriptors[point], features.descriptors[feature])
    order = np.lexsort((distance, point))
    point, feature, distance = point[order], feature[order], distance[order]
    # the nearest of each point and, if there is one, the next after it
    is_next = np.r_[False, point[1:] == point[:-1]][: len(point)]
    nearest = np.flatnonzero(~is_next)
    rival = np.where(np.r_[is_next, False], np.r_[distance, 0], 1000)[nearest + 1]
    good = (distance[nearest] <= MAX_DISTANCE) & (distance[nearest] < 0.9 * rival)
    nearest = nearest[good]
    # one to one: of several points that want a feature the nearest gets it
    nearest = nearest[np.argsort(distance[nearest], kind="stable")]
    _, owner = np.unique(feature[nearest], return_index=True)
    chosen = nearest[np.sort(owner)]
    return point[chosen], feature[chosen]
