"""A scene as one cloud of points with a class each → its single objects.

Points of a class that lie close together are one object: as in DBSCAN (Ester et al. 1996), a point
with few others about it is noise and links nothing. The cloud is thinned first, so that density
tells surfaces from strays and not near from far. A group too small to be an object is none.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.voxels import group_labels, voxel_indices
from imodbatch.datasets.ply import read_points

Array = NDArray[np.float64]
THINNED_PER_GAP = 5
"""Thinning leaves one point in each cube with this fraction of the gap as its edge."""
MIN_NEIGHBORS = 3
"""Thinned points within two spacings that make a point no noise; a flat surface has about 12."""
MIN_POINTS = 50
"""Thinned points of the smallest object: 18 cm² of surface at a gap of 3 cm."""


@dataclass(frozen=True)
class CloudObject:
    """One object of a scene.

    Attributes:
        hull: (h, 3) corners of the convex hull of all its points, in metres.
        surface: (m, 3) its thinned points.
        spacing_m: distance of neighbouring thinned points.
    """

    hull: Array
    surface: Array
    spacing_m: float


@dataclass(frozen=True)
class Clustering:
    """Objects of one class, the one with the largest surface first, and how many were too small."""

    objects: list[CloudObject]
    n_too_small: int


def read_labelled_cloud(cloud: Path, labels: Path) -> tuple[Array, NDArray[np.int64]]:
    """Points (N, 3) in metres and the class number of each, (N,).

    Args:
        cloud: PLY file.
        labels: text file: the number of points, then a class number for each.

    Raises:
        DataError: a file is missing or damaged, or they do not belong together.
    """
    points, numbers = read_points(cloud), _read_labels(labels)
    if len(numbers) != len(points):
        raise DataError(
            f"{labels}: {len(numbers):,} labels for {len(points):,} points of {cloud.name}. "
            "Restore the one that is wrong; both must be of one scene."
        )
    finite = np.isfinite(points).all(axis=1)
    return points[finite], numbers[finite]


def _read_labels(path: Path) -> NDArray[np.int64]:
    try:
        values = np.array(path.read_bytes().split(), dtype=np.float64)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}). Check its path.") from None
    except ValueError:
        raise DataError(f"{path}: holds more than numbers. Expected N, then N labels.") from None
    if len(values) == 0 or not (np.isfinite(values) & (values == np.floor(values))).all():
        raise DataError(f"{path}: holds no whole numbers. Expected N, then N labels.")
    if values[0] != len(values) - 1:
        raise DataError(
            f"{path}: its first number says {values[0]:,.0f} labels, {len(values) - 1:,} follow. "
            "Restore it."
        )
    return values[1:].astype(np.int64)


def cluster(points: Array, gap_m: float) -> Clustering:
    """Single objects among the points (n, 3) of one class.

    Args:
        points: metres.
        gap_m: points nearer than this belong together. It is kept to within the edge of a thinning
            cube, a fifth of it.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    spacing_m = gap_m / THINNED_PER_GAP
    cube = group_labels(voxel_indices(points, spacing_m))
    n_cubes = int(cube.max(initial=-1)) + 1
    counts = np.bincount(cube, minlength=n_cubes)
    sums = [np.bincount(cube, points[:, axis], n_cubes) for axis in range(3)]
    thinned = np.stack(sums, axis=-1) / counts[:, None]

    tree = KDTree(thinned)
    near = tree.query_pairs(2 * spacing_m, output_type="ndarray")
    is_dense = np.bincount(near.ravel(), minlength=n_cubes) >= MIN_NEIGHBORS
    if is_dense.mean() < 0.5:  # a cloud so sparse that strays look like all others
        is_dense[:] = True
    pairs = tree.query_pairs(gap_m, output_type="ndarray")
    pairs = pairs[is_dense[pairs].all(axis=1)]
    links = coo_array((np.ones(len(pairs), np.bool_), tuple(pairs.T)), (n_cubes, n_cubes))
    _, group = connected_components(links, directed=False)
    group = np.where(is_dense, group, -1)

    names, sizes = np.unique(group[is_dense], return_counts=True)
    order = np.argsort(-sizes, kind="stable")
    large = [int(name) for name in names[order][sizes[order] >= MIN_POINTS]]
    objects = [
        CloudObject(_hull(points[group[cube] == name]), thinned[group == name], spacing_m)
        for name in large
    ]
    return Clustering(objects, len(names) - len(large))


def _hull(points: Array) -> Array:
    """Corners of the convex hull; all points where they are flat and so have none."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points
