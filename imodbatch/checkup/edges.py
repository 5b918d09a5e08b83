"""Do the edges of depth fall on edges of colour, and at which size would they do so best?

Where depth jumps, colour mostly changes, too. The points of such jumps are projected into the
colour image by the manifest's cameras and then drawn larger or smaller about the image centre; the
size at which most of them lie on colour edges is the ratio of the true focal lengths to that of the
manifest's. Each size may be shifted by some pixels: cameras a few centimetres apart see edges side
by side, which is no fault of a focal length.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.peaks import peak
from imodbatch.checkup.views import View
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply

Array = NDArray[np.float64]
SIZES = np.exp(np.linspace(np.log(0.72), np.log(1.38), 41))
SHIFTS = np.arange(-15, 16, 3)
"""Columns; rows are shifted half as far. Of an image 640 pixels wide."""
JUMP_SHARE = 0.06
FEWEST_POINTS, MOST_POINTS = 150, 1000
FEWEST_VIEWS = 4
REFERENCE_WIDTH_PX = 640
SMOOTHING_PX = 3
STRONG_PERCENTILE = 90
RESAMPLES = 200


@dataclass(frozen=True)
class EdgeFit:
    """Where colour edges are met best.

    Attributes:
        size: of the depth's edges relative to where the manifest's cameras put them.
        sigma: standard deviation of its logarithm, over the choice of views.
        gain: by how much more colour edge is met at that size than at the manifest's: 1.2 = a
            fifth more.
        shift_px: columns and rows by which edges must move at that size.
        n_views: views with enough depth edges.
    """

    size: float
    sigma: float
    gain: float
    shift_px: tuple[float, float]
    n_views: int


def fit_edges(views: list[View]) -> EdgeFit | None:
    """The size that fits best over all views; None = too few depth edges."""
    scores = np.array([s for view in views if (s := _scores(view)) is not None])
    if len(scores) < FEWEST_VIEWS:
        return None
    mean = scores.mean(axis=0)
    _, across, down = np.unravel_index(mean.argmax(), mean.shape)
    as_given = int(np.abs(np.log(SIZES)).argmin())
    gain = float(mean.max() / mean[as_given].max())
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(scores), size=(RESAMPLES, len(scores)))
    at_shift = scores[:, :, across, down]
    spread = np.log(SIZES)[at_shift[drawn].mean(axis=1).argmax(axis=1)].std()
    step = float(np.log(SIZES[1] / SIZES[0]))
    unit = views[0].gray.shape[1] / REFERENCE_WIDTH_PX
    shift = (float(SHIFTS[across] * unit), float(SHIFTS[down] / 2 * unit))
    best = peak(np.log(SIZES), mean.max(axis=(1, 2)))
    return EdgeFit(float(np.exp(best)), float(max(spread, step / 2)), gain, shift, len(scores))


def _scores(view: View) -> Array | None:
    """Colour edge met by a view's depth edges, (sizes, columns, rows) over the image's mean."""
    points = depth_jumps(view.depth_m)
    if len(points) < FEWEST_POINTS:
        return None
    points = points[np.random.default_rng(0).permutation(len(points))[:MOST_POINTS]]
    cameras = view.camera
    in_depth = cameras.depth.unproject(points[:, :2], points[:, 2])
    if cameras.color_from_depth is not None:
        in_depth = apply(cameras.color_from_depth, in_depth)
    color = cameras.color
    center = np.array([color.cx_px, color.cy_px])
    offset = color.project(in_depth) - center
    offset = offset[np.isfinite(offset).all(axis=1)]
    return _met(edge_strength(view.gray), center + SIZES[:, None, None] * offset)


def _met(strength: NDArray[np.float32], pixels: Array) -> Array:
    """Mean strength (sizes, columns, rows) at pixels (sizes, n, 2) that are shifted by `SHIFTS`.

    Relative to the image's mean. Pixels outside the image meet nothing, and count only if they
    are inside when unshifted.
    """
    height, width = strength.shape
    shifts = np.rint(SHIFTS * width / REFERENCE_WIDTH_PX).astype(np.int64)
    shifts_down = np.rint(SHIFTS * width / (2 * REFERENCE_WIDTH_PX)).astype(np.int64)
    reach = int(np.abs(shifts).max()) + 1
    margin = 2 * reach  # whatever is clipped to `reach` outside stays outside when shifted
    padded = np.pad(strength, margin)
    column = np.clip(np.floor(pixels[..., 0]), -reach, width - 1 + reach).astype(np.int64)
    row = np.clip(np.floor(pixels[..., 1]), -reach, height - 1 + reach).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    at = (row + margin) * padded.shape[1] + column + margin
    steps = shifts[:, None] + shifts_down * padded.shape[1]
    flat = padded.ravel()
    met = np.array([[flat[at + step].sum(axis=-1) for step in across] for across in steps])
    mean = np.moveaxis(met, -1, 0) / np.maximum(inside.sum(axis=-1), 1)[:, None, None]
    return mean / max(float(strength.mean()), 1e-6)


def depth_jumps(depth_m: DepthImage) -> Array:
    """Points (n, 3) between pixels where depth jumps: x, y in continuous pixels, the nearer depth.

    A gap between near and far is the far surface seen by one eye of the sensor only, so gaps are
    filled with the farther side.
    """
    across = _jumps(_filled(depth_m))
    down = _jumps(_filled(depth_m.T))
    return np.concatenate([across, down[:, [1, 0, 2]]])


def _jumps(depth_m: Array) -> Array:
    left, right = depth_m[:, :-1], depth_m[:, 1:]
    with np.errstate(invalid="ignore"):
        near = np.minimum(left, right)
        row, column = np.nonzero(np.abs(left - right) > JUMP_SHARE * near)
    return np.stack([column + 1.0, row + 0.5, near[row, column]], axis=-1)


def _filled(depth_m: DepthImage) -> Array:
    """Gaps of each row filled with the farther of the depths beside them."""
    before, after = _last_known(depth_m), _last_known(depth_m[:, ::-1])[:, ::-1]
    return np.where(np.isfinite(depth_m), depth_m, np.fmax(before, after)).astype(np.float64)


def _last_known(depth_m: DepthImage) -> DepthImage:
    columns = np.where(np.isfinite(depth_m), np.arange(depth_m.shape[1]), 0)
    return np.take_along_axis(depth_m, np.maximum.accumulate(columns, axis=1), axis=1)


def edge_strength(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(H, W) in 0 … 1: the smoothed gradient, cut at its 90th percentile."""
    down, across = np.gradient(_smooth(gray.astype(np.float32)))
    strength = np.hypot(down, across)
    strong = max(float(np.percentile(strength, STRONG_PERCENTILE)), 1e-3)
    return _smooth(np.minimum(strength / strong, 1.0).astype(np.float32))


def _smooth(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean over a small square; the border repeats."""
    square = (SMOOTHING_PX, SMOOTHING_PX)
    return np.asarray(cv2.blur(image, square, borderType=cv2.BORDER_REPLICATE))
