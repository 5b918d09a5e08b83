"""Wrong poses on purpose: how far each frame's camera is shifted and turned from where it was.

Two kinds of noise, each a vector n of three numbers per frame, used once as a shift in metres and
once, drawn anew, as a rotation vector (its direction the axis, its length the angle in radians):

- ``jitter``: every frame on its own, n ~ N(0, s²/3 · I). The RMS length of n is the level s, all
  directions are equally likely.
- ``drift``: a random walk over the sequence's F frames, n_0 = 0 and n_i = n_{i−1} + w_i with
  w_i ~ N(0, s²/(3 (F−1)) · I). The RMS length grows with √i and is the level s in the last frame.
  Rotation vectors are added up as if they commuted, which small ones do.

The camera's centre c becomes c + shift; the camera is turned about its own centre, about axes of
the world. A point p that it saw stays where it was in the camera and so moves along in the world:
p + (R − I)(p − c) + shift. A shift moves voxels only; a turn moves viewpoints as well.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import exp_twist

Array = NDArray[np.float64]
Kind = Literal["jitter", "drift"]
KINDS: tuple[Kind, ...] = get_args(Kind)


def unit_noise(n_frames: int, kind: Kind, rng: np.random.Generator) -> Array:
    """Noise (F, 3) of level 1; any other level is a multiple of it."""
    draws = rng.standard_normal((n_frames, 3)) / np.sqrt(3)
    if kind == "jitter":
        return draws
    draws[:1] = 0.0
    return np.cumsum(draws, axis=0) / np.sqrt(max(n_frames - 1, 1))


def carried_along(xyz_world: Array, camera_world: Array, shift_m: Array, turn_rad: Array) -> Array:
    """Where points (n, 3) go when the cameras that saw them are shifted and turned.

    Args:
        xyz_world: (n, 3) metres.
        camera_world: (n, 3) undisturbed centre of each point's camera.
        shift_m: (n, 3) of the camera.
        turn_rad: (n, 3) rotation vectors, about axes of the world.
    """
    turn = exp_twist(np.concatenate([np.zeros_like(turn_rad), turn_rad], axis=-1))
    change = turn[..., :3, :3] - np.eye(3)  # exactly 0 where nothing is turned
    return xyz_world + np.einsum("nij,nj->ni", change, xyz_world - camera_world) + shift_m
