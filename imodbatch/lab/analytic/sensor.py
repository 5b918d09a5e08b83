"""A depth camera's faults: noise that grows with the square of depth, holes, ragged silhouettes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DepthNoise:
    """How depth is disturbed.

    Attributes:
        sigma_at_2m_m: standard deviation of depth at 2 m; it grows as depth squared.
        hole_fraction: share of pixels without depth, anywhere.
        silhouette_hole_fraction: the same for pixels next to a jump in depth.
        jump_fraction: difference of neighbours, relative to depth, that is a jump.
    """

    sigma_at_2m_m: float = 0.005
    hole_fraction: float = 0.01
    silhouette_hole_fraction: float = 0.5
    jump_fraction: float = 0.03


def disturb(depth_m: Array, rng: np.random.Generator, noise: DepthNoise) -> Array:
    """Exact depth (H, W) in metres as the camera would give it; NaN in holes."""
    measured = depth_m + rng.normal(size=depth_m.shape) * noise.sigma_at_2m_m * (depth_m / 2) ** 2
    hole_chance = np.where(
        _is_at_a_jump(depth_m, noise.jump_fraction),
        noise.silhouette_hole_fraction,
        noise.hole_fraction,
    )
    return np.where(rng.random(depth_m.shape) < hole_chance, np.nan, measured)


def _is_at_a_jump(depth_m: Array, jump_fraction: float) -> NDArray[np.bool_]:
    """Pixels (H, W) that differ from a neighbour above, below, left or right by a jump."""
    jump = np.zeros(depth_m.shape, dtype=np.bool_)
    for axis in (0, 1):
        jumps = np.abs(np.diff(depth_m, axis=axis))
        least = np.minimum(
            depth_m.take(range(depth_m.shape[axis] - 1), axis),
            depth_m.take(range(1, depth_m.shape[axis]), axis),
        )
        between = jumps > jump_fraction * least
        pad = [(0, 0), (0, 0)]
        pad[axis] = (0, 1)
        jump |= np.pad(between, pad)
        pad[axis] = (1, 0)
        jump |= np.pad(between, pad)
    return jump
