"""Closed shapes: turned on a lathe, drawn along a path, pressed between two sheets, or boxes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from imodbatch.lab.mesh import Surface
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.curves import Outline, arc, circle, smooth
from imodbatch.lab.objects.part import Array, Indices, Part, Picture, closed_part, quad_grid


@dataclass(frozen=True, eq=False)
class Strip:
    """A stretch of a lathe's profile that carries one picture.

    Attributes:
        points: (radius, height) pairs; the next strip begins where this one ends.
        picture: what is painted on it.
        chart: ``wrap``: the picture is wrapped round, its top edge at the strip's upper end and
            its middle at azimuth 0; ``top``: it is laid on from above, its lower edge at +x.
    """

    points: Sequence[tuple[float, float]]
    picture: Picture
    chart: Literal["wrap", "top"] = "wrap"


def lathe(
    strips: Sequence[Strip],
    surface: Surface,
    outline: Outline | None = None,
    crease_deg: float = 40.0,
) -> Part:
    """A profile turned about the z axis; it begins and ends on the axis, or where it began.

    Args:
        strips: the profile.
        surface: how it shines.
        outline: what a radius stands for, if not a circle.
        crease_deg: as in `Part`.
    """
    outline = outline or circle()
    vertices, faces, uvs, face_picture = [], [], [], []
    n_vertices = 0
    for index, strip in enumerate(strips):
        grid, strip_uvs = _turned(strip, outline)
        strip_faces, _ = quad_grid(*grid.shape[:2])
        vertices.append(grid.reshape(-1, 3))
        faces.append(strip_faces + n_vertices)
        uvs.append(strip_uvs.reshape(-1, 2)[strip_faces])
        face_picture.append(np.full(len(strip_faces), index))
        n_vertices += grid.shape[0] * grid.shape[1]
    return closed_part(
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(uvs),
        np.concatenate(face_picture),
        tuple(strip.picture for strip in strips),
        surface,
        crease_deg,
    )


def _turned(strip: Strip, outline: Outline) -> tuple[Array, Array]:
    """Vertices (P, n + 1, 3) of a strip, the last column on the first one, and their uv."""
    rings = []
    for radius, height in strip.points:
        ring = outline(radius)
        rings.append(np.column_stack([ring, np.full(len(ring), height)]))
    grid = np.stack(rings)
    grid = np.concatenate([grid, grid[:, :1]], axis=1)
    if strip.chart == "top":
        reach = np.abs(grid[..., :2]).max(axis=(0, 1))
        return grid, 0.5 + 0.5 * (grid[..., :2] / reach)[..., ::-1]
    points = np.asarray(strip.points, dtype=np.float64)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    v = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    if points[-1, 1] > points[0, 1]:
        v = 1 - v
    u = np.linspace(0, 1, grid.shape[1])
    return grid, np.stack(np.broadcast_arrays(u[None], v[:, None]), axis=-1)


def ellipsoid(
    radii: tuple[float, float, float], picture: Picture, surface: Surface, n: int = 32
) -> Part:
    """An ellipsoid about the origin; the picture is wrapped round like a map of the world.

    Args:
        radii: half axes along x, y, z.
        picture: what is painted on it.
        surface: how it shines.
        n: points round; half as many from pole to pole.
    """
    half_circle = arc((0, 0), 1, -90, 90, n // 2 + 1)
    ball = lathe([Strip(half_circle, picture)], surface, circle(n), crease_deg=180)
    return ball.scaled(*radii)


def tube(
    path: Sequence[Sequence[float]],
    radii: Sequence[float],
    picture: Picture,
    surface: Surface,
    n_around: int = 20,
    n_along: int = 20,
) -> Part:
    """A round limb with round ends along a smooth path: an arm, a tail, a handle.

    Args:
        path: points (P, 3) that the limb's middle passes through; its ends reach beyond the path
            by their radius.
        radii: at those points.
        picture: wrapped round; its top edge lies at the path's end.
        surface: how it shines.
        n_around: points round.
        n_along: rings along the path.
    """
    curve = smooth([[*point, radius] for point, radius in zip(path, radii, strict=True)], n_along)
    middle, radius = curve[:, :3], curve[:, 3]
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    bend = np.linspace(np.pi / 2, 0, 7)[:-1]
    sin, cos = np.sin(bend)[:, None], np.cos(bend)
    middle = np.concatenate(
        [
            middle[:1] - radius[0] * sin * along[:1],
            middle,
            (middle[-1:] + radius[-1] * sin * along[-1:])[::-1],
        ]
    )
    radius = np.concatenate([radius[0] * cos, radius, (radius[-1] * cos)[::-1]])
    along = np.concatenate([along[:1].repeat(6, 0), along, along[-1:].repeat(6, 0)])
    side = _carried_sideways(along)
    other = np.cross(along, side)
    angle = np.linspace(0, 2 * np.pi, n_around + 1)
    angle[-1] = 0
    grid = middle[:, None] + radius[:, None, None] * (
        np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None]
    )
    faces, corner = quad_grid(*grid.shape[:2])
    uvs = np.stack([corner[..., 1] / n_around, 1 - corner[..., 0] / (len(grid) - 1)], axis=-1)
    return closed_part(
        grid.reshape(-1, 3), faces, uvs, np.zeros(len(faces), int), (picture,), surface, 180.0
    )


def _carried_sideways(along: Array) -> Array:
    """A unit vector across each direction (P, 3), carried along without twisting."""
    start = np.zeros(3)
    start[np.abs(along[0]).argmin()] = 1
    side = []
    for direction in along:
        start = start - direction * (start @ direction)
        start = start / np.linalg.norm(start)
        side.append(start)
    return np.stack(side)


def sandwich(
    top: Array, bottom: Array, picture: Picture, surface: Surface, crease_deg: float = 40.0
) -> Part:
    """The solid between two sheets, closed round their borders.

    Args:
        top: (m, n, 3) points of the upper sheet.
        bottom: the points below them.
        picture: painted on from six sides.
        surface: how it shines.
        crease_deg: as in `Part`.
    """
    m, n = top.shape[:2]
    sheet, _ = quad_grid(m, n)
    border = _border(m, n)
    ring = np.stack([border, border + m * n])
    wall, _ = quad_grid(2, ring.shape[1])
    faces = np.concatenate([sheet, sheet[:, ::-1] + m * n, ring.reshape(-1)[wall][:, ::-1]])
    vertices = np.concatenate([top.reshape(-1, 3), bottom.reshape(-1, 3)])
    uvs = np.zeros((len(faces), 3, 2))
    picture_index = np.zeros(len(faces), int)
    part = closed_part(vertices, faces, uvs, picture_index, (picture,), surface, crease_deg)
    return box_mapped(part, picture)


def _border(m: int, n: int) -> Indices:
    """Indices of a grid's border, once round and back to the start."""
    index = np.arange(m * n).reshape(m, n)
    return np.concatenate(
        [index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0], index[0, :1]]
    )


def rounded_box(
    size: tuple[float, float, float],
    radius: float,
    picture: Picture,
    surface: Surface,
    n_corner: int = 3,
    n_side: int = 2,
) -> Part:
    """A box about the origin with round edges; the picture is painted on each of its sides.

    Args:
        size: along x, y, z.
        radius: of the edges.
        picture: what is painted on it; see `box_mapped` for more than one.
        surface: how it shines.
        n_corner: stretches from a side's end to the middle of an edge.
        n_side: stretches that a side is divided into.
    """
    half = np.array(size) / 2
    straight = half - radius
    corner = radius * np.tan(np.linspace(0, np.pi / 4, n_corner + 1))[1:]
    lines = [
        np.concatenate([-(s + corner)[::-1], np.linspace(-s, s, n_side + 1), s + corner])
        for s in straight
    ]
    vertices: list[Array] = []
    faces: list[Indices] = []
    count = len(lines[0])
    sheet, _ = quad_grid(count, count)
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1, 1):
            side = np.empty((count, count, 3))
            side[..., axis] = sign * half[axis]
            side[..., b], side[..., c] = np.meshgrid(lines[b], lines[c], indexing="ij")
            faces.append((sheet[:, ::-1] if sign > 0 else sheet) + len(vertices) * count**2)
            vertices.append(side.reshape(-1, 3))
    surface_points = np.concatenate(vertices)
    inner = np.clip(surface_points, -straight, straight)
    outward = surface_points - inner
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    triangles = np.concatenate(faces)
    part = closed_part(
        inner + radius * outward,
        triangles,
        np.zeros((len(triangles), 3, 2)),
        np.zeros(len(triangles), int),
        (picture,),
        surface,
    )
    return box_mapped(part, picture)
