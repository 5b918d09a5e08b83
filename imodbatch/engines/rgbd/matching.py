"""Which feature is which: by descriptor alone, or near where a point should appear."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.engines.rgbd.features import SCALE_FACTOR, Features

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Descriptors = NDArray[np.uint64]
MAX_DISTANCE = 64
MAX_RATIO = 0.8
BUCKET_PX = 16
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
    distance = np.zeros((len(a), len(b)), dtype=np.uint16)
    for word in range(a.shape[1]):
        distance += np.bitwise_count(a[:, None, word] ^ b[None, :, word])
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(a))
    best = distance[rows, nearest]
    mutual = distance.argmin(axis=0)[nearest] == rows
    masked = distance
    masked[rows, nearest] = 1000
    clear = best < MAX_RATIO * masked.min(axis=1)
    good = mutual & clear & (best <= MAX_DISTANCE)
    return rows[good], nearest[good]


class FeatureGrid:
    """The features of a frame in buckets, to be asked for those near a pixel."""

    def __init__(self, features: Features, width_px: int, height_px: int) -> None:
        self._features = features
        self._n_across = -(-width_px // BUCKET_PX)
        self._n_down = -(-height_px // BUCKET_PX)
        column = np.clip(features.pixels[:, 0] // BUCKET_PX, 0, self._n_across - 1)
        row = np.clip(features.pixels[:, 1] // BUCKET_PX, 0, self._n_down - 1)
        bucket = (row * self._n_across + column).astype(np.int64)
        self._order = np.argsort(bucket, kind="stable")
        edges = np.arange(self._n_across * self._n_down + 1)
        self._start = np.searchsorted(bucket[self._order], edges)

    def near(self, pixels: Array, radius_px: Array) -> tuple[Indices, Indices]:
        """Pairs (query, feature) closer than the query's radius.

        Args:
            pixels: (Q, 2), all finite.
            radius_px: (Q,).
        """
        reach = int(np.ceil(radius_px.max(initial=1.0) / BUCKET_PX))
        row = (pixels[:, 1] // BUCKET_PX).astype(np.int64)
        left = np.clip((pixels[:, 0] - radius_px) // BUCKET_PX, 0, self._n_across - 1)
        right = np.clip((pixels[:, 0] + radius_px) // BUCKET_PX, 0, self._n_across - 1)
        queries, features = [], []
        for shift in range(-reach, reach + 1):
            inside = np.flatnonzero((row + shift >= 0) & (row + shift < self._n_down))
            base = (row[inside] + shift) * self._n_across
            start = self._start[base + left[inside].astype(np.int64)]
            count = self._start[base + right[inside].astype(np.int64) + 1] - start
            queries.append(np.repeat(inside, count))
            within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            features.append(self._order[np.repeat(start, count) + within])
        query, feature = np.concatenate(queries), np.concatenate(features)
        offset = self._features.pixels[feature] - pixels[query]
        close = (offset * offset).sum(axis=1) < radius_px[query] ** 2
        return query[close], feature[close]


@dataclass(frozen=True)
class Expected:
    """P map points as they should appear in a frame: pixels (P, 2), octave (P,), descriptors."""

    pixels: Array
    octave: Array
    descriptors: Descriptors


def projection_matches(
    expected: Expected, grid: FeatureGrid, features: Features, radius_px: float
) -> tuple[Indices, Indices]:
    """Pairs (point, feature), one to one: the nearest descriptor near the expected pixel.

    The radius grows with the point's octave; the feature's octave may differ by one and a half.
    """
    scale = SCALE_FACTOR ** np.clip(expected.octave, 0, MAX_WIDENING_OCTAVE)
    point, feature = grid.near(expected.pixels, radius_px * scale)
    fits = np.abs(features.octave[feature] - expected.octave[point]) <= 1.5
    point, feature = point[fits], feature[fits]
    distance = hamming(expected.descriptors[point], features.descriptors[feature])
    order = np.lexsort((distance, point))
    point, feature, distance = point[order], feature[order], distance[order]
    first = np.r_[True, point[1:] != point[:-1]] if len(point) else np.zeros(0, dtype=np.bool_)
    position = np.flatnonzero(first)
    has_second = position + 1 < len(point)
    next_one = np.minimum(position + 1, max(len(point) - 1, 0))
    rival = np.where(
        has_second & (point[next_one] == point[position]) if len(point) else has_second,
        distance[next_one] if len(point) else 0,
        1000,
    )
    good = (distance[position] <= MAX_DISTANCE) & (distance[position] < 0.9 * rival)
    position = position[good]
    # one to one: of several points that want a feature the nearest gets it
    position = position[np.argsort(distance[position], kind="stable")]
    _, owner = np.unique(feature[position], return_index=True)
    chosen = position[np.sort(owner)]
    return point[chosen], feature[chosen]
