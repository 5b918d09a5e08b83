"""Depth images: into the colour camera, and one depth for a box.

A depth sensor often sits beside the colour sensor and has another focal length. `register` moves
every depth pixel into the colour image and keeps the nearest where several meet (a z-buffer). Where
only focal lengths or centres differ, no two pixels meet, and each colour pixel looks up its own.
`box_depth` then answers "how far is the thing in this box", in one of three ways.
"""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import apply

DepthImage = NDArray[np.float32]
DepthMode = Literal["center", "window_median", "foreground"]


def register(
    depth_m: DepthImage,
    depth_camera: PinholeCamera,
    color_camera: PinholeCamera,
    color_from_depth: ArrayLike | None = None,
) -> DepthImage:
    """Render a depth image in the colour camera.

    Each depth pixel covers as many colour pixels as its footprint is wide there, so that a colour
    image of higher resolution gets no holes between samples.

    Args:
        depth_m: (H_d, W_d), NaN where unknown.
        depth_camera: intrinsics of the depth image.
        color_camera: intrinsics of the colour image.
        color_from_depth: (4, 4) transform between the two cameras; None = they coincide.

    Returns:
        (H_c, W_c) z-depth in the colour camera, NaN where no depth pixel lands.
    """
    if depth_camera == color_camera and color_from_depth is None:
        return depth_m
    if color_from_depth is None:
        return _look_up(depth_m, depth_camera, color_camera)
    return _splat(depth_m, depth_camera, color_camera, color_from_depth)


def _look_up(
    depth_m: DepthImage, depth_camera: PinholeCamera, color_camera: PinholeCamera
) -> DepthImage:
    """`register` without a baseline: rays coincide, so columns map to columns and rows to rows."""
    d, c = depth_camera, color_camera
    left, columns = _sources(d.width_px, d.fx_px, d.cx_px, c.width_px, c.fx_px, c.cx_px)
    top, rows = _sources(d.height_px, d.fy_px, d.cy_px, c.height_px, c.fy_px, c.cy_px)
    seen = depth_m.take(rows, axis=0).take(columns, axis=1)
    registered = np.full((c.height_px, c.width_px), np.nan, dtype=np.float32)
    inside = registered[top : top + len(rows), left : left + len(columns)]
    np.copyto(inside, seen, where=np.isfinite(seen) & (seen > 0), casting="same_kind")
    return registered


def _sources(
    n_depth: int, f_depth: float, c_depth: float, n_color: int, f_color: float, c_color: float
) -> tuple[int, NDArray[np.int64]]:
    """Along one axis, the depth pixel that holds each colour pixel's centre.

    Returns:
        The first colour pixel that looks into the depth image, and the depth pixels of it and of
        those that follow.
    """
    edges_px = f_color * ((np.arange(n_depth + 1, dtype=np.float64) - c_depth) / f_depth) + c_color
    first = np.clip(_first_center(edges_px), 0, n_color)
    return int(first[0]), np.repeat(np.arange(n_depth), np.diff(first))


def _splat(
    depth_m: DepthImage,
    depth_camera: PinholeCamera,
    color_camera: PinholeCamera,
    color_from_depth: ArrayLike,
) -> DepthImage:
    """`register` between cameras that stand apart, with a z-buffer."""
    valid = np.isfinite(depth_m)
    z = depth_m[valid].astype(np.float64)
    points = apply(color_from_depth, z[:, None] * _pixel_rays(depth_camera)[valid])
    in_front = points[:, 2] > 0
    points, z = points[in_front], z[in_front]
    pixels = color_camera.project(points)
    # a depth pixel is z/f_depth wide in metres, hence (z/f_depth)·(f_color/z_color) colour pixels
    shrink = z / points[:, 2]
    half_width = 0.5 * shrink * color_camera.fx_px / depth_camera.fx_px
    half_height = 0.5 * shrink * color_camera.fy_px / depth_camera.fy_px
    left = _first_center(pixels[:, 0] - half_width)
    top = _first_center(pixels[:, 1] - half_height)
    n_across = _first_center(pixels[:, 0] + half_width) - left
    n_down = _first_center(pixels[:, 1] + half_height) - top

    registered = np.full(color_camera.height_px * color_camera.width_px, np.inf)
    for down in range(int(n_down.max(initial=0))):
        for across in range(int(n_across.max(initial=0))):
            u, v = left + across, top + down
            inside = (across < n_across) & (down < n_down) & (u >= 0) & (v >= 0)
            inside &= (u < color_camera.width_px) & (v < color_camera.height_px)
            pixel = v[inside] * color_camera.width_px + u[inside]
            np.minimum.at(registered, pixel, points[inside, 2])
    registered[np.isinf(registered)] = np.nan
    shape = (color_camera.height_px, color_camera.width_px)
    return registered.reshape(shape).astype(np.float32)


@lru_cache(maxsize=4)
def _pixel_rays(camera: PinholeCamera) -> NDArray[np.float64]:
    """Points at z = 1 m behind every pixel centre, (H, W, 3)."""
    rays = camera.unproject(camera.pixel_centers(), 1.0)
    rays.setflags(write=False)
    return rays


def _first_center(edge_px: NDArray[np.float64]) -> NDArray[np.int64]:
    """Column of the first pixel whose centre lies at or right of an edge.

    Rounded first: where two footprints meet on a pixel's centre, their common edge comes out with
    two rounding errors, and the pixel could fall between them.
    """
    return np.ceil(np.round(edge_px - 0.5, 6)).astype(np.int64)


def box_depth(
    depth_m: DepthImage, box: ArrayLike, mode: DepthMode, window: float, bin_m: float = 0.02
) -> float:
    """One z-depth in metres for a box, NaN when the pixels asked hold none.

    Args:
        depth_m: (H, W) in the camera the box was seen with.
        box: x0, y0, x1, y1 in continuous pixels; parts outside the image are ignored.
        mode: ``center`` takes the pixel under the box's centre (the paper); ``window_median`` the
            median of the inner window; ``foreground`` the nearest mode of the inner window's
            depth histogram that holds at least a fifth of its pixels.
        window: width and height of the inner window as a fraction of the box's.
        bin_m: histogram bin of ``foreground``.
    """
    height, width = depth_m.shape
    x0, y0, x1, y1 = (float(v) for v in np.asarray(box, dtype=np.float64))
    x_mid, y_mid = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    if mode == "center":
        column, row = int(np.floor(x_mid)), int(np.floor(y_mid))
        if not (0 <= column < width and 0 <= row < height):
            return float("nan")
        return float(depth_m[row, column])
    half_width, half_height = 0.5 * window * (x1 - x0), 0.5 * window * (y1 - y0)
    values = depth_m[_pixels(y_mid, half_height), _pixels(x_mid, half_width)]
    values = values[np.isfinite(values)]
    if values.size == 0:
        return float("nan")
    if mode == "window_median":
        return float(np.median(values))
    return _nearest_mode(values.astype(np.float64), bin_m)


def _pixels(mid_px: float, half_px: float) -> slice:
    """Pixels that a window touches along one axis, the one under its centre at least."""
    first = int(np.floor(mid_px - half_px))
    last = max(int(np.ceil(mid_px + half_px)), int(np.floor(mid_px)) + 1)
    return slice(max(first, 0), max(last, 0))


def _nearest_mode(values_m: NDArray[np.float64], bin_m: float, min_share: float = 0.2) -> float:
    """Median of the nearest peak of a depth histogram that holds `min_share` of the pixels.

    A peak is a bin with its two neighbours, so that a surface on a bin's border is not halved.
    """
    bins = np.floor((values_m - values_m.min()) / bin_m).astype(np.int64)
    counts = np.bincount(bins, minlength=3)
    smoothed = np.convolve(counts, np.ones(3), mode="same")
    peaks = smoothed >= np.maximum(np.r_[0, smoothed[:-1]], np.r_[smoothed[1:], 0])
    enough = peaks & (smoothed >= min_share * values_m.size)
    peak = int(np.argmax(enough)) if enough.any() else int(np.argmax(smoothed))
    return float(np.median(values_m[np.abs(bins - peak) <= 1]))
