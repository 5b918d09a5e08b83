"""A part of an object: one closed surface whose faces are charted on a few pictures.

Objects are modelled in centimetres, part by part; a part's pictures become one texture only when
the parts are put together (see `assembly`). Texture coordinates belong to the corners of faces, so
a vertex on the seam of a chart is still one vertex, and every part is watertight.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.mesh import Surface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Picture = NDArray[np.uint8]
"""(H, W, 3) sRGB."""

WELD_CM = 1e-6
"""Vertices closer than this are one vertex."""


@dataclass(frozen=True, eq=False)
class Part:
    """A closed triangle mesh with pictures on it, in centimetres.

    Attributes:
        vertices: (V, 3).
        faces: (F, 3), counter-clockwise seen from outside.
        uvs: (F, 3, 2) place of each corner in its face's picture; (0, 0) is its top-left corner.
        face_picture: (F,) index into `pictures`.
        pictures: what is painted on the faces.
        surface: how the part shines.
        crease_deg: edges that bend by more than this are shaded as edges, others as round.
    """

    vertices: Array
    faces: Indices
    uvs: Array
    face_picture: Indices
    pictures: tuple[Picture, ...]
    surface: Surface
    crease_deg: float = 40.0

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Part":
        """The part, shifted."""
        return replace(self, vertices=self.vertices + np.array([x, y, z]))

    def scaled(self, x: float = 1.0, y: float = 1.0, z: float = 1.0) -> "Part":
        """The part, stretched along the axes by positive factors."""
        return replace(self, vertices=self.vertices * np.array([x, y, z]))

    def turned(self, x_deg: float = 0.0, y_deg: float = 0.0, z_deg: float = 0.0) -> "Part":
        """The part, turned about the x axis, then y, then z."""
        vertices = self.vertices
        for axis, angle_rad in enumerate(np.deg2rad([x_deg, y_deg, z_deg])):
            cos, sin = np.cos(angle_rad), np.sin(angle_rad)
            b, c = (axis + 1) % 3, (axis + 2) % 3
            turn = np.eye(3)
            turn[b, b], turn[b, c], turn[c, b], turn[c, c] = cos, -sin, sin, cos
            vertices = vertices @ turn.T
        return replace(self, vertices=vertices)

    def mirrored(self) -> "Part":
        """The same part on the other side of the plane y = 0."""
        return replace(
            self,
            vertices=self.vertices * np.array([1.0, -1.0, 1.0]),
            faces=self.faces[:, ::-1],
            uvs=self.uvs[:, ::-1],
        )

    def both_sides(self) -> "list[Part]":
        """The part and its mirror image: two ears, two arms."""
        return [self, self.mirrored()]


def closed_part(
    vertices: Array,
    faces: Indices,
    uvs: Array,
    face_picture: Indices,
    pictures: tuple[Picture, ...],
    surface: Surface,
    crease_deg: float = 40.0,
) -> Part:
    """A part of triangles that close once coinciding vertices are one; they may all face inward.

    Args:
        vertices: as in `Part`, with several vertices in one place along seams and at poles.
        faces: as in `Part`, all of one orientation.
        uvs: as in `Part`.
        face_picture: as in `Part`.
        pictures: as in `Part`.
        surface: as in `Part`.
        crease_deg: as in `Part`.
    """
    grid = np.round(vertices / WELD_CM).astype(np.int64)
    _, first, place = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    vertices, faces = vertices[first], place.reshape(-1)[faces]
    kept = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces, uvs, face_picture = faces[kept], uvs[kept], face_picture[kept]
    if signed_volume(vertices, faces) < 0:
        faces, uvs = faces[:, ::-1], uvs[:, ::-1]
    return Part(vertices, faces, uvs, face_picture, pictures, surface, crease_deg)


def signed_volume(vertices: Array, faces: Indices) -> float:
    """Volume enclosed by triangles; negative if they face inward."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def quad_grid(n_rows: int, n_columns: int) -> tuple[Indices, Array]:
    """Triangles of a grid of vertices in row-major order.

    Args:
        n_rows: rows of vertices.
        n_columns: vertices in a row.

    Returns:
        The faces (F, 3), and the corners' (row, column) (F, 3, 2) as floats.
    """
    row, column = (g.reshape(-1) for g in np.mgrid[: n_rows - 1, : n_columns - 1])
    corner = row * n_columns + column
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n_columns + 1], axis=1),
            np.stack([corner, corner + n_columns + 1, corner + n_columns], axis=1),
        ]
    )
    return faces, np.stack([faces // n_columns, faces % n_columns], axis=-1).astype(np.float64)
