"""From parts in centimetres to one mesh in metres: one texture, shading normals, a place to stand.

Parts may overlap (a doll's arm is stuck into its body): each is closed, so that seen from outside
only outward faces show.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.symmetry import Symmetry
from imodbatch.lab.mesh import ObjectModel, Surface, TexturedMesh
from imodbatch.lab.objects.atlas import pack
from imodbatch.lab.objects.part import Array, Part

METRES_PER_CM = 0.01


def assemble(name: str, parts: Iterable[Part], symmetry: Symmetry = "none") -> ObjectModel:
    """An object of parts, stood on z = 0 with its footprint centred.

    Args:
        name: class name.
        parts: what it consists of.
        symmetry: as in `ObjectModel`.
    """
    parts = list(parts)
    # Equal surfaces and pictures, by identity, are stored once.
    surfaces: dict[int, Surface] = {id(part.surface): part.surface for part in parts}
    pictures = {id(picture): picture for part in parts for picture in _used(part)}
    texture, rectangles = pack(list(pictures.values()))
    rectangle_of = dict(zip(pictures, rectangles, strict=True))
    vertices, faces, uvs, face_surface, normals = [], [], [], [], []
    n_vertices = 0
    for part in parts:
        rectangle = np.stack(
            [rectangle_of.get(id(picture), np.zeros(4)) for picture in part.pictures]
        )[part.face_picture]
        uvs.append(rectangle[:, None, :2] + np.clip(part.uvs, 0, 1) * rectangle[:, None, 2:])
        vertices.append(part.vertices)
        faces.append(part.faces + n_vertices)
        face_surface.append(np.full(len(part.faces), list(surfaces).index(id(part.surface))))
        normals.append(shading_normals(part))
        n_vertices += len(part.vertices)
    mesh = TexturedMesh(
        vertices=(_standing(np.concatenate(vertices)) * METRES_PER_CM).astype(np.float32),
        faces=np.concatenate(faces).astype(np.int32),
        corner_uvs=np.concatenate(uvs).astype(np.float32),
        texture=texture,
        face_surface=np.concatenate(face_surface).astype(np.int16),
        surfaces=tuple(surfaces.values()),
        corner_normals=np.concatenate(normals),
    )
    return ObjectModel(name, mesh, symmetry)


def _used(part: Part) -> list[NDArray[np.uint8]]:
    """Pictures of which a part shows something."""
    return [part.pictures[index] for index in np.unique(part.face_picture)]


def _standing(vertices: Array) -> Array:
    """Vertices shifted so that the lowest is on z = 0 and the footprint's middle on the origin."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    below_middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return np.asarray(vertices - below_middle)


def shading_normals(part: Part) -> NDArray[np.float32]:
    """Normals (F, 3, 3) of the corners: the mean over the faces round the vertex.

    Faces that meet at more than the part's crease angle don't share a normal. Each face weighs by
    its angle at the vertex, so that how a quad is cut into triangles doesn't show.
    """
    corners = part.vertices[part.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    edges = np.roll(corners, -1, axis=1) - corners
    edges /= np.maximum(np.linalg.norm(edges, axis=2, keepdims=True), 1e-12)
    cosine = -np.einsum("fki,fki->fk", edges, np.roll(edges, 1, axis=1))
    weight = np.arccos(np.clip(cosine, -1, 1)).reshape(-1)

    vertex = part.faces.reshape(-1)
    face = np.arange(len(vertex)) // 3
    order = np.argsort(vertex, kind="stable")
    count = np.bincount(vertex, minlength=len(part.vertices))
    start = np.cumsum(count) - count
    least_cosine = np.cos(np.deg2rad(part.crease_deg)) - 1e-9
    total = np.zeros((len(vertex), 3))
    for k in range(int(count.max())):
        corner = np.flatnonzero(count[vertex] > k)
        neighbour = order[start[vertex[corner]] + k]
        agree = np.einsum("ci,ci->c", flat[face[corner]], flat[face[neighbour]]) >= least_cosine
        share = weight[neighbour] * agree
        total[corner] += share[:, None] * flat[face[neighbour]]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals = np.where(length > 1e-9, total / np.maximum(length, 1e-12), flat[face])
    return normals.reshape(-1, 3, 3).astype(np.float32)
