"""Shading normals that make scans and round shapes smooth and keep the creases of boxes."""

import numpy as np
from numpy.typing import NDArray

CREASE_DEG = 35.0
"""A corner whose smooth normal leans further than this off its face stays flat."""
WELD = 1e-5
"""Vertices nearer than this share of the model's size are one."""


def weld(points: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.int32]]:
    """Points (N, 3) without repetition (V, 3), and the number of each one's place there (N,).

    Files keep a vertex several times where its texture coordinates differ.
    """
    low = points.min(axis=0)
    size = max(float((points - low).max()), 1e-12)
    cells = np.rint((points - low) / (WELD * size)).astype(np.int64)
    # A cell's number along an axis has at most 17 bits, so three make one number.
    key = (cells[:, 0] << 40) | (cells[:, 1] << 20) | cells[:, 2]
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return points[first], number.reshape(-1).astype(np.int32)


def corner_normals(
    vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> NDArray[np.float32]:
    """Unit normals (F, 3, 3) of the corners of faces (F, 3) on welded vertices (V, 3)."""
    corners = np.asarray(vertices, np.float64)[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-30)
    smooth = np.zeros((len(vertices), 3))
    for axis in range(3):
        weights = np.repeat(cross[:, axis], 3)
        smooth[:, axis] = np.bincount(faces.ravel(), weights, minlength=len(smooth))
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-30)
    normals = smooth[faces]
    creased = np.einsum("fcd,fd->fc", normals, flat) < np.cos(np.deg2rad(CREASE_DEG))
    return np.where(creased[..., None], flat[:, None], normals).astype(np.float32)
