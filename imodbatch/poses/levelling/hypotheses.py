"""Directions that may be up, and how well each explains the planes and the way cameras are held."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.poses.levelling.surfaces import Surfaces

Array = NDArray[np.float64]
ALONG_SIGMA_DEG = 4.0
LEVEL, UPRIGHT = 1.0, 0.4
ROLL_SIGMA_DEG = 25.0
USUAL_PITCH_DEG, PITCH_SIGMA_DEG = (-15.0, 45.0), 15.0  # downwards
MAX_SURFACES = 60  # the largest
MIN_CORNER_DEG = 30.0
APART_DEG = 10.0
MAX_HYPOTHESES = 6


@dataclass(frozen=True)
class Views:
    """How F cameras were held: unit vectors (F, 3) in the poses' world."""

    right: Array
    up: Array
    forward: Array

    @classmethod
    def of(cls, world_from_cam: Sequence[Array]) -> "Views":
        """Axes of poses (4, 4)."""
        rotations = np.stack([pose[:3, :3] for pose in world_from_cam])
        return cls(rotations[:, :, 0], -rotations[:, :, 1], rotations[:, :, 2])

    @property
    def mean_up(self) -> Array:
        """Mean of the cameras' own up directions (3,)."""
        mean = self.up.mean(axis=0)
        return mean / max(float(np.linalg.norm(mean)), 1e-9)

    def likelihood(self, directions: Array) -> Array:
        """How usual the cameras' roll and pitch would be if a direction (C, 3) were up: (C,).

        1 for cameras that are not rolled and look ahead or down to the floor; 0 for cameras that
        are upside down. Their pitch alone tells little, so it counts only beyond what is usual.
        """
        roll_deg = np.degrees(np.arcsin(np.clip(directions @ self.right.T, -1, 1)))
        pitch_deg = np.degrees(np.arcsin(np.clip(-directions @ self.forward.T, -1, 1)))
        mean_deg = pitch_deg.mean(axis=1)
        low, high = USUAL_PITCH_DEG
        unusual = np.maximum(low - mean_deg, 0) + np.maximum(mean_deg - high, 0)
        cost = (roll_deg**2).mean(axis=1) / ROLL_SIGMA_DEG**2 + (unusual / PITCH_SIGMA_DEG) ** 2
        is_upside_down = (directions @ self.up.T).mean(axis=1) < -0.1
        return np.where(is_upside_down, 0.0, np.exp(-0.5 * cost))


def propose(surfaces: Surfaces, views: Views) -> Array:
    """The best directions (H, 3), best first, each more than 10° from those before."""
    candidates = _candidates(surfaces, views)
    scores = score(surfaces, views, candidates)
    chosen: list[Array] = []
    for row in np.argsort(-scores, kind="stable"):
        if len(chosen) == MAX_HYPOTHESES or scores[row] <= 0:
            break
        if all(apart_deg(candidates[row], other) > APART_DEG for other in chosen):
            chosen.append(candidates[row])
    return np.reshape(chosen, (-1, 3))


def score(surfaces: Surfaces, views: Views, directions: Array) -> Array:
    """What directions (C, 3) explain, times the cameras' likelihood: (C,)."""
    likelihood = views.likelihood(directions)
    scores = np.zeros(len(directions))
    likely = likelihood > 0.01
    scores[likely] = explained(surfaces, directions[likely]) * likelihood[likely]
    return scores


def explained(surfaces: Surfaces, directions: Array) -> Array:
    """What directions (C, 3) explain: (C,).

    That a surface is level by chance is much less likely (1 in 200 within 4°) than that it is
    upright by chance (1 in 11), so it says more: the logarithms are as 1 to 0.4. Of a surface's
    share of the points the root counts: several surfaces in agreement say more than a large one.
    """
    above_deg = np.degrees(np.arcsin(np.clip(np.abs(directions @ surfaces.normals.T), 0, 1)))

    def count(off_deg: Array) -> Array:
        return np.exp(-0.5 * (off_deg / ALONG_SIGMA_DEG) ** 2) @ np.sqrt(surfaces.share)

    return LEVEL * count(90 - above_deg) + UPRIGHT * count(above_deg)


def _candidates(surfaces: Surfaces, views: Views) -> Array:
    """Directions (C, 3): normals, lines along which two planes meet, and walls of unknown up.

    That a lone plane may be a wall, with the cameras' up along it, is a rival to its being a floor.
    """
    largest = np.argsort(-surfaces.share, kind="stable")[:MAX_SURFACES]
    normals = surfaces.normals[largest]
    i, j = np.triu_indices(len(normals), 1)
    corners = np.cross(normals[i], normals[j])
    corners = corners[np.linalg.norm(corners, axis=1) > np.sin(np.radians(MIN_CORNER_DEG))]
    walls = views.mean_up - (normals @ views.mean_up)[:, None] * normals
    walls = walls[np.linalg.norm(walls, axis=1) > np.sin(np.radians(MIN_CORNER_DEG))]
    every = np.concatenate([normals, -normals, corners, -corners, walls])
    return every / np.linalg.norm(every, axis=1, keepdims=True)


def apart_deg(a: Array, b: Array) -> float:
    """Angle between two unit vectors."""
    return float(np.degrees(2 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b), 0, 1))))
