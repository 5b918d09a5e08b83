"""World voxels: the places in which boxes of different frames meet."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def voxel_indices(xyz_world: ArrayLike, voxel_size_m: float) -> NDArray[np.int64]:
    """Voxel (i, j, k) of points: ``floor(xyz / size)`` (Konno et al. 2020, Sec. 3.4).

    Args:
        xyz_world: (..., 3) metres.
        voxel_size_m: edge length.

    Returns:
        (..., 3) integers.
    """
    return np.floor(np.asarray(xyz_world, dtype=np.float64) / voxel_size_m).astype(np.int64)


def group_labels(voxels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the distinct voxels of (V, 3) indices 0, 1, …, in lexicographic order: (V,)."""
    if len(voxels) == 0:
        return np.zeros(0, dtype=np.int64)
    return np.unique(voxels, axis=0, return_inverse=True)[1].reshape(-1)
