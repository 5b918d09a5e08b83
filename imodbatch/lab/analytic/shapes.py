"""Where a ray meets a simple solid, in closed form.

A ray is ``origin + t * direction``. Directions are not normalised: a camera ray is scaled to
advance one metre along the optical axis per unit of t, so that t *is* the z-depth. Every solid is
centred on its own origin, upright along z. A convex solid is an intersection of simpler ones, so
its stretch of the ray is the intersection of their stretches.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PARALLEL = 1e-12
"""A ray exactly parallel to a face is tilted by this much, instead of dividing by zero."""


class Shape(Protocol):
    """A solid in its own frame, metres."""

    @property
    def half_extents_m(self) -> tuple[float, float, float]:
        """Half the sides of the bounding box."""
        ...

    def hit(self, origin: Array, directions: Array) -> Array:
        """Ray parameter (...,) of the first surface met by rays (..., 3) from one origin (3,).

        Infinite where the ray misses. The origin lies outside a solid, and inside a `Room`.
        """
        ...

    def normal(self, points: Array) -> Array:
        """Unit normals (P, 3) that face the camera's side, at surface points (P, 3)."""
        ...


@dataclass(frozen=True)
class Sphere:
    """A ball."""

    radius_m: float

    @property
    def half_extents_m(self) -> tuple[float, float, float]:
        """See `Shape`."""
        return (self.radius_m, self.radius_m, self.radius_m)

    def hit(self, origin: Array, directions: Array) -> Array:
        """See `Shape`."""
        return _entry(*_round_stretch(origin, directions, self.radius_m))

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        return _unit(points)


@dataclass(frozen=True)
class Box:
    """A cuboid."""

    half_extents_m: tuple[float, float, float]

    def hit(self, origin: Array, directions: Array) -> Array:
        """See `Shape`."""
        return _entry(*_slab_stretch(origin, directions, np.array(self.half_extents_m)))

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        scaled = points / np.array(self.half_extents_m)
        axis = np.argmax(np.abs(scaled), axis=-1)
        return np.asarray(np.sign(np.take_along_axis(scaled, axis[:, None], -1)) * np.eye(3)[axis])


@dataclass(frozen=True)
class Room:
    """The inside of a cuboid: floor, walls and ceiling around the camera."""

    half_extents_m: tuple[float, float, float]

    def hit(self, origin: Array, directions: Array) -> Array:
        """See `Shape`."""
        return _slab_stretch(origin, directions, np.array(self.half_extents_m))[1]

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        return -Box(self.half_extents_m).normal(points)


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder with flat ends."""

    radius_m: float
    half_height_m: float

    @property
    def half_extents_m(self) -> tuple[float, float, float]:
        """See `Shape`."""
        return (self.radius_m, self.radius_m, self.half_height_m)

    def hit(self, origin: Array, directions: Array) -> Array:
        """See `Shape`."""
        enter, leave = _round_stretch(origin[:2], directions[..., :2], self.radius_m)
        low, high = _slab_stretch(origin[2:], directions[..., 2:], np.array([self.half_height_m]))
        return _entry(np.maximum(enter, low), np.minimum(leave, high))

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        level = points[:, 2] / self.half_height_m
        on_side = np.hypot(points[:, 0], points[:, 1]) / self.radius_m >= np.abs(level)
        side = _unit(points * [1, 1, 0])
        return np.where(on_side[:, None], side, np.sign(level)[:, None] * [0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Capsule:
    """An upright cylinder whose ends are half balls.

    Attributes:
        radius_m: of the cylinder and the balls.
        half_height_m: half the straight part, without the balls.
    """

    radius_m: float
    half_height_m: float

    @property
    def half_extents_m(self) -> tuple[float, float, float]:
        """See `Shape`."""
        return (self.radius_m, self.radius_m, self.half_height_m + self.radius_m)

    def hit(self, origin: Array, directions: Array) -> Array:
        """See `Shape`."""
        ball, end = Sphere(self.radius_m), np.array([0.0, 0.0, self.half_height_m])
        straight = Cylinder(self.radius_m, self.half_height_m).hit(origin, directions)
        ends = np.minimum(ball.hit(origin - end, directions), ball.hit(origin + end, directions))
        return np.minimum(straight, ends)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        on_axis = np.zeros_like(points)
        on_axis[:, 2] = np.clip(points[:, 2], -self.half_height_m, self.half_height_m)
        return _unit(points - on_axis)


def _entry(enter: Array, leave: Array) -> Array:
    """Where rays enter a solid from outside; infinite for an empty stretch or one behind."""
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def _slab_stretch(origin: Array, directions: Array, half: Array) -> tuple[Array, Array]:
    """Where rays (..., D) enter and leave the cuboid |x| ≤ half, (D,)."""
    directions = np.where(directions == 0, PARALLEL, directions)
    one, other = (-half - origin) / directions, (half - origin) / directions
    return np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)


def _round_stretch(origin: Array, directions: Array, radius: float) -> tuple[Array, Array]:
    """Where rays (..., D) enter and leave the ball |x| ≤ radius of D dimensions; empty = never.

    Roots of ``a t² + 2 b t + c = 0`` with a = d·d, b = o·d, c = o·o - r².
    """
    a = np.maximum(np.einsum("...i,...i->...", directions, directions), PARALLEL**2)
    b = directions @ origin
    discriminant = b * b - a * (origin @ origin - radius * radius)
    root = np.sqrt(np.maximum(discriminant, 0.0))
    meets = discriminant >= 0
    return np.where(meets, (-b - root) / a, np.inf), np.where(meets, (-b + root) / a, -np.inf)


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, PARALLEL))
