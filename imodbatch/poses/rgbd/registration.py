"""A frame's pose from features and surfaces together.

Features alone follow whatever the colour camera's calibration says; surfaces alone slide along
walls. Their squared errors add up, each in its own standard deviations, and each holds the pose in
the directions that it knows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import adjoint, exp_twist, invert, orthonormal
from imodbatch.poses.rgbd import measurement
from imodbatch.poses.rgbd.adjustment import Tie
from imodbatch.poses.rgbd.resection import Sightings, linearised
from imodbatch.poses.rgbd.surfaces import Surface, contact

Array = NDArray[np.float64]
N_ITERATIONS = 8
SETTLED = 3e-5
MIN_TIE_MET = 0.3
TIE_SIGMA_M, TIE_SIGMA_RAD = 0.002, 0.001


@dataclass(frozen=True)
class Settled:
    """A pose and how well it is known.

    Attributes:
        cam_from_world: (4, 4).
        information: (6, 6) inverse covariance of a twist on its left.
        met: share of the samples that meet one of the surfaces.
        fitting: share of those that lie within three standard deviations of it.
    """

    cam_from_world: Array
    information: Array
    met: float
    fitting: float


def settle(
    camera: PinholeCamera,
    cam_from_world: Array,
    seen: Sightings | None,
    samples: Array,
    targets: Sequence[tuple[Surface, Array]],
) -> Settled:
    """Best pose near a first guess.

    Args:
        camera: of the features.
        cam_from_world: (4, 4) first guess.
        seen: sightings that fit it; None = surfaces alone.
        samples: (S, 3) points of the frame's own surface.
        targets: surfaces of other frames and their target_from_world (4, 4).
    """
    cam_from_world = orthonormal(cam_from_world)
    for _ in range(N_ITERATIONS):
        normal, gradient = np.zeros((6, 6)), np.zeros(6)
        if seen is not None:
            normal, gradient = linearised(camera, cam_from_world, seen, measurement.huber_weights)
        met, fitting = _add_surfaces(normal, gradient, cam_from_world, samples, targets)
        step = -np.linalg.solve(normal + 1e-6 * np.eye(6), gradient)
        cam_from_world = exp_twist(step) @ cam_from_world
        if np.abs(step).max() < SETTLED:
            break
    return Settled(cam_from_world, normal, met, fitting)


def _add_surfaces(
    normal: Array,
    gradient: Array,
    cam_from_world: Array,
    samples: Array,
    targets: Sequence[tuple[Surface, Array]],
) -> tuple[float, float]:
    n_met = n_fitting = 0
    for target, target_from_world in targets:
        target_from_cam = target_from_world @ invert(cam_from_world)
        lies = contact(target, samples, target_from_cam)
        # moving the camera by a twist moves the samples the other way, seen from the target
        jacobian = -lies.jacobian @ adjoint(target_from_cam)
        normal += jacobian.T @ (lies.weight[:, None] * jacobian)
        gradient += jacobian.T @ (lies.weight * lies.error)
        n_met += int(lies.met.sum())
        n_fitting += int((np.abs(lies.error[lies.met]) < 3).sum())
    n_asked = len(samples) * len(targets)
    return n_met / max(n_asked, 1), n_fitting / max(n_met, 1)


def bind(
    surfaces: Sequence[Surface], cam_from_world: Sequence[Array] | Array, first: int, second: int
) -> Tie | None:
    """Tie two frames by their surfaces alone; None where these overlap too little.

    Directions along which the surfaces slide stay as they are and get no information.

    Args:
        surfaces: of K frames.
        cam_from_world: K poses (4, 4).
        first: frame whose surface the other's samples are laid on.
        second: that other one.
    """
    target, samples = surfaces[first], surfaces[second].samples
    start = invert(cam_from_world[first] @ invert(cam_from_world[second]))
    found = settle(target.camera, start, None, samples, [(target, np.eye(4))])
    if found.met < MIN_TIE_MET:
        return None
    systematic = np.diag(np.repeat(np.square([TIE_SIGMA_M, TIE_SIGMA_RAD]), 3))
    covariance = np.linalg.inv(found.information + 1e-6 * np.eye(6)) + systematic
    return Tie(second, first, found.cam_from_world, np.linalg.inv(covariance))
