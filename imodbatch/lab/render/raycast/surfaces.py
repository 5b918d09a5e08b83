"""What a ray meets: all faces of a scene in one table, and the points that rays hit on them."""

import weakref
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.render.raycast.geometry import MISS, Hits
from imodbatch.lab.render.raycast.interface import Floats, Instance, Mesh
from imodbatch.lab.render.raycast.textures import Pyramid, TexelStore, make_pyramid

LEAST_COSINE = 0.15
"""Seen more slantwise than this, print is blurred no further along the surface."""

_PYRAMIDS: "weakref.WeakKeyDictionary[Mesh, Pyramid]" = weakref.WeakKeyDictionary()


def pyramid_of(mesh: Mesh) -> Pyramid:
    """The levels of a mesh's texture; made once."""
    if mesh not in _PYRAMIDS:
        _PYRAMIDS[mesh] = make_pyramid(mesh.texture, mesh.corner_uvs)
    return _PYRAMIDS[mesh]


@dataclass(frozen=True, eq=False)
class Places:
    """N points on surfaces, and how the surfaces lie there.

    Attributes:
        position: (3, N) world.
        face_normal: (3, N) unit, of the flat face, turned towards the viewer.
        normal: (3, N) unit, smooth, on the viewer's side.
        to_viewer: (3, N) unit.
        depth_m: (N,) z-depth.
    """

    position: Floats
    face_normal: Floats
    normal: Floats
    to_viewer: Floats
    depth_m: Floats

    def take(self, index: NDArray[np.intp]) -> "Places":
        """Some of the points."""
        return Places(
            self.position.take(index, axis=1),
            self.face_normal.take(index, axis=1),
            self.normal.take(index, axis=1),
            self.to_viewer.take(index, axis=1),
            self.depth_m.take(index),
        )


@dataclass(frozen=True, eq=False)
class Paint:
    """What N points are made of: albedo (3, N) linear RGB, specular (N,), shininess (N,)."""

    albedo: Floats
    specular: Floats
    shininess: Floats


class Surfaces:
    """The faces of all instances, in the order in which the ray caster counts them."""

    def __init__(self, instances: tuple[Instance, ...]) -> None:
        meshes = list({id(i.mesh): i.mesh for i in instances}.values())
        texture_of = {id(mesh): k for k, mesh in enumerate(meshes)}
        self._store = TexelStore([pyramid_of(mesh) for mesh in meshes])
        self.parts: list[tuple[Floats, NDArray[np.int32]]] = []
        normal_rows = [np.zeros((0, 12), np.float32)]
        paint_rows = [np.zeros((0, 9), np.float32)]
        texture, instance = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
        for number, item in enumerate(instances):
            mesh = item.mesh
            rotation = np.asarray(item.world_from_mesh[:3, :3], np.float32)
            vertices = mesh.vertices @ rotation.T + item.world_from_mesh[:3, 3].astype(np.float32)
            self.parts.append((vertices, mesh.faces))
            flat, log_density = _measure(vertices, mesh)
            normals = np.repeat(flat[:, None], 3, axis=1)
            if mesh.corner_normals is not None:
                normals = mesh.corner_normals @ rotation.T
            normal_rows.append(np.concatenate([_affine(normals), flat], axis=1))
            material = [mesh.face_specular, mesh.face_shininess, log_density]
            paint_rows.append(np.column_stack([_affine(mesh.corner_uvs), *material]))
            texture.append(np.full(len(mesh.faces), texture_of[id(mesh)], np.int32))
            instance.append(np.full(len(mesh.faces), number, np.int32))
        self._normals = _columns(normal_rows)
        self._paint = _columns(paint_rows)
        self._texture = np.concatenate(texture)
        # One more entry, found by index −1, stands for a miss.
        self._instance = np.concatenate([*instance, np.array([MISS], np.int32)])
        self._face_normal = np.pad(self._normals[9:], ((0, 0), (0, 1)))

    def face_normals(self, face: NDArray[np.int32]) -> Floats:
        """Unit normals (3, N) of flat faces; of a miss, 0."""
        return self._face_normal.take(face, axis=1, mode="wrap")

    def instances(self, face: NDArray[np.int32]) -> NDArray[np.int32]:
        """Which instance (N,) faces belong to, by its place in the scene; of a miss, −1."""
        return self._instance[face]

    def places(self, hits: Hits, origin: Floats, directions: Floats) -> Places:
        """Where rays from one origin hit; all must have hit.

        Args:
            hits: of N rays.
            origin: (3, 1) of all of them.
            directions: (3, N) with unit z in the camera, so that t is z-depth.
        """
        row = self._normals.take(hits.face, axis=1)
        u, v = hits.uv
        position = origin + hits.t * directions
        to_viewer = directions * (-1 / length(directions))
        normal = row[0:3] + u * row[3:6]
        normal += v * row[6:9]
        flat = row[9:]
        # Both sides are drawn: turn the flat normal to the viewer, the smooth one to the flat one.
        flat *= np.copysign(np.float32(1), dot(flat, to_viewer))
        normal *= np.copysign(1 / np.maximum(length(normal), np.float32(1e-6)), dot(normal, flat))
        return Places(position, flat, normal, to_viewer, hits.t)

    def paint(self, hits: Hits, places: Places, pixel_rad: float) -> Paint:
        """What the points that rays hit are made of.

        Args:
            hits: of N rays.
            places: where they hit.
            pixel_rad: angle between two rays in the middle of the image.
        """
        row = self._paint.take(hits.face, axis=1)
        uv = row[0:2] + hits.uv[0] * row[2:4] + hits.uv[1] * row[4:6]
        slant = np.maximum(dot(places.face_normal, places.to_viewer), np.float32(LEAST_COSINE))
        # Half of the slant's stretch: as much too sharp along it as too blurred across it.
        covered = places.depth_m * np.float32(pixel_rad) / np.sqrt(slant)
        level = row[8] + np.log2(covered)
        albedo = self._store.sample(self._texture.take(hits.face), uv, level)
        return Paint(albedo, row[6], row[7])


def _measure(vertices: Floats, mesh: Mesh) -> tuple[Floats, Floats]:
    """Unit face normals (F, 3), and log2 of the texels per metre on each face (F,)."""
    corners = vertices[mesh.faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_area = np.linalg.norm(cross, axis=1)
    flat = cross / np.maximum(doubled_area, 1e-30)[:, None]
    height, width = mesh.texture.shape[:2]
    edges = (mesh.corner_uvs[:, 1:] - mesh.corner_uvs[:, :1]) * np.array([width, height])
    texels = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    density = np.sqrt(np.maximum(texels, 1e-12) / np.maximum(doubled_area, 1e-18))
    return flat.astype(np.float32), np.log2(density).astype(np.float32)


def _affine(corners: Floats) -> Floats:
    """Corner values (F, 3, C) as the first and the way from it to the others, (F, 3 C)."""
    first = corners[:, 0]
    return np.concatenate([first, corners[:, 1] - first, corners[:, 2] - first], axis=1)


def _columns(rows: list[Floats]) -> Floats:
    """Rows of several tables (F, C) as one table (C, F)."""
    return np.ascontiguousarray(np.concatenate(rows).T, dtype=np.float32)


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar products (N,) of vectors (3, N)."""
    product = a[0] * b[0]
    product += a[1] * b[1]
    product += a[2] * b[2]
    return product


def length(a: Floats) -> Floats:
    """Lengths (N,) of vectors (3, N)."""
    return np.sqrt(dot(a, a))
