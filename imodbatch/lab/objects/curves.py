"""Curves that shapes are made of: arcs and smooth paths through points, and closed outlines."""

from collections.abc import Callable, Sequence

import numpy as np

from imodbatch.lab.objects.part import Array

Outline = Callable[[float], Array]
"""From a radius to the (n, 2) points of a closed curve round the origin, counter-clockwise.

The first point is the one at azimuth −π; the last one is not the first one again.
"""


def arc(
    centre: tuple[float, float], radius: float, from_deg: float, to_deg: float, n: int = 8
) -> list[tuple[float, float]]:
    """Points on a circle."""
    angles = np.deg2rad(np.linspace(from_deg, to_deg, n))
    return [(centre[0] + radius * np.cos(a), centre[1] + radius * np.sin(a)) for a in angles]


def smooth(points: Sequence[Sequence[float]], n: int) -> Array:
    """A smooth curve (n, D) through points (P, D) (uniform Catmull–Rom)."""
    given = np.asarray(points, dtype=np.float64)
    padded = np.concatenate([2 * given[:1] - given[1:2], given, 2 * given[-1:] - given[-2:-1]])
    position = np.linspace(0, len(given) - 1, n)
    index = np.minimum(position.astype(np.int64), len(given) - 2)
    t = (position - index)[:, None]
    a, b, c, d = (padded[index + k] for k in range(4))
    curve = b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
    return np.asarray(curve)


def profile(points: Sequence[Sequence[float]], n: int) -> list[tuple[float, float]]:
    """`smooth` in the plane, as pairs."""
    return [(float(r), float(z)) for r, z in smooth(points, n)]


def circle(n: int = 64) -> Outline:
    """Circles of n points."""
    angles = np.linspace(-np.pi, np.pi, n, endpoint=False)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return lambda radius: radius * unit


def rounded_rectangle(
    corner: Callable[[float], float], longer_by: float = 0.0, n_arc: int = 8, n_side: int = 4
) -> Outline:
    """Rectangles with rounded corners.

    The outline of radius r is 2 r wide in y and 2 (r + longer_by) long in x.

    Args:
        corner: from a radius to the radius of the corners; cut to 0..radius, which is what fits.
        longer_by: half of what it is longer in x than in y.
        n_arc: points round a corner.
        n_side: stretches that a side is divided into; even.
    """

    def outline(radius: float) -> Array:
        rounding = min(max(corner(radius), 0.0), radius)
        x, y = radius + longer_by - rounding, radius - rounding
        corners = []
        for k, (sx, sy) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
            angles = np.pi + np.pi / 2 * (k + np.linspace(0, 1, n_arc))
            offset = rounding * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            corners.append(np.array([sx * x, sy * y]) + offset)
        points = []
        for k in range(4):
            start, end = corners[k][-1], corners[(k + 1) % 4][0]
            t = np.arange(1, n_side)[:, None] / n_side
            points += [corners[k], start + t * (end - start)]
        # Start at the middle of the side at azimuth −π.
        return np.roll(np.concatenate(points), n_side // 2, axis=0)

    return outline


def rounded_polygon(corners: Sequence[tuple[float, float]], rounding: float) -> Outline:
    """Scaled copies of a convex polygon whose corners are cut round.

    Args:
        corners: counter-clockwise, round the origin.
        rounding: how far from a corner its side begins to bend.
    """
    given = np.asarray(corners, dtype=np.float64)
    points = []
    for k, corner in enumerate(given):
        before, after = given[k - 1] - corner, given[(k + 1) % len(given)] - corner
        start = corner + rounding * before / np.linalg.norm(before)
        end = corner + rounding * after / np.linalg.norm(after)
        t = np.linspace(0, 1, 7)[:, None]
        points.append((1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end)
    unit = np.concatenate(points)
    return lambda radius: radius * unit
