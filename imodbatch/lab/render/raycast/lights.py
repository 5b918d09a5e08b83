"""How light falls on points: from where, how much, and where shadow rays go."""

import numpy as np
from numpy.typing import ArrayLike

from imodbatch.lab.render.raycast.interface import BulbLight, Floats, Light, SunLight
from imodbatch.lab.render.raycast.surfaces import dot, length

SUN_DISTANCE_M = 200.0
"""How far a shadow ray towards the sun goes."""
FAINT = 0.002
"""Light weaker than this on a white surface is left out."""


def arriving(light: Light, position: Floats) -> tuple[Floats, Floats, Floats]:
    """Light at points (3, N) if nothing were in its way.

    Returns:
        Unit directions (3, N) towards the middle of the light; its strength (N,) on a surface
        that faces it, as a factor of `intensity`; the tangent of half the angle under which it
        appears (N,).
    """
    if isinstance(light, SunLight):
        n = position.shape[1]
        spread = np.full(n, np.tan(light.half_angle_rad), np.float32)
        direction = np.broadcast_to(_unit(light.to_sun), (3, n))
        return direction, np.ones(n, np.float32), spread
    middle = light.position if isinstance(light, BulbLight) else light.center
    to_light = _column(middle) - position
    square = np.maximum(dot(to_light, to_light), np.float32(1e-4))
    distance = np.sqrt(square)
    direction = to_light / distance
    if isinstance(light, BulbLight):
        return direction, 1 / square, np.float32(light.radius_m) / distance
    cross = np.cross(light.half_u, light.half_v)
    area = float(np.linalg.norm(cross))
    cosine = np.maximum(dot(direction, _column(-cross / area)), np.float32(0))
    # The light of a disc of the same area, exact on its axis: finite even right in front of it.
    radius_square = np.float32(4 * area / np.pi)
    return direction, cosine / (square + radius_square), np.sqrt(radius_square) / distance


def shadow_rays(light: Light, position: Floats, samples: Floats) -> Floats:
    """Ways (3, N) from points to places on the light chosen by samples (2, N) in [0, 1)."""
    if isinstance(light, SunLight):
        to_sun = _unit(light.to_sun)
        disc = _disc(samples) * np.float32(np.tan(light.half_angle_rad))
        first, second = _across(to_sun)
        return (to_sun + disc[0] * first + disc[1] * second) * np.float32(SUN_DISTANCE_M)
    if isinstance(light, BulbLight):
        way = _column(light.position) - position
        disc = _disc(samples) * np.float32(light.radius_m)
        first, second = _across(way / np.maximum(length(way), np.float32(1e-4)))
        return way + disc[0] * first + disc[1] * second
    u, v = 2 * samples - 1
    target = _column(light.center) + u * _column(light.half_u) + v * _column(light.half_v)
    return target - position


def hemisphere(normal: Floats, face_normal: Floats, samples: Floats) -> Floats:
    """Unit directions (3, N) about normals, dense as the cosine, above the flat face too."""
    disc = _disc(samples)
    up = np.sqrt(np.maximum(1 - samples[0], np.float32(0)))
    first, second = _across(normal)
    direction = disc[0] * first + disc[1] * second + up * normal
    below = np.minimum(dot(direction, face_normal), np.float32(0))
    return direction - (2 * below) * face_normal


def _disc(samples: Floats) -> Floats:
    """Points of the unit square to points of the unit disc, (2, N), evenly."""
    radius = np.sqrt(samples[0])
    angle = np.float32(2 * np.pi) * samples[1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


def _across(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (3, N) square to unit directions and to each other (Duff et al. 2017)."""
    x, y, z = direction
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x])
    second = np.stack([b, sign + y * y * a, -y])
    return first, second


def _column(vector: ArrayLike) -> Floats:
    """A vector (3, 1)."""
    return np.asarray(vector, np.float32)[:, None]


def _unit(vector: ArrayLike) -> Floats:
    """A vector of length 1, (3, 1)."""
    column = _column(vector)
    return column / np.linalg.norm(column)
