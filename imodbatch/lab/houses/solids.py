"""Furniture is made of boxes and turned pieces; each material's faces become one mesh.

Texture coordinates are in metres over the material's size, so that a texture's grain has the same
scale on a shelf and on a table; fibres run along the longer side of a face.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.lab.mesh import Surface, TexturedMesh

Array = NDArray[np.float64]
FACE_AXES = ((1, 2, 0), (0, 2, 1), (0, 1, 2))
"""For the faces across x, y and z: the axes along which they stretch, and the one across."""


PLAIN = Surface()


@dataclass(frozen=True, eq=False)
class Material:
    """A texture and how it shines; compared by identity.

    Attributes:
        texture: (H, W, 3) uint8 sRGB.
        size_m: how many metres it spans.
        surface: how it shines.
        is_upright: on upright faces its columns stand upright, as wallpaper's do.
    """

    texture: NDArray[np.uint8]
    size_m: float
    surface: Surface = PLAIN
    is_upright: bool = False


@dataclass
class _Faces:
    corners: list[Array] = field(default_factory=list)
    uvs: list[Array] = field(default_factory=list)
    normals: list[Array] = field(default_factory=list)


class Solids:
    """Collects pieces; `meshes` gives one mesh per material."""

    def __init__(self) -> None:
        self._of: dict[Material, _Faces] = {}

    def box(
        self, material: Material, low: Sequence[float], high: Sequence[float], fit: bool = False
    ) -> None:
        """A box between two corners; with `fit` each face shows the whole texture once."""
        corner = np.array([low, high], np.float64)
        for across, (u_axis, v_axis, n_axis) in enumerate(FACE_AXES):
            for side in (0, 1):
                points = np.empty((4, 3))
                points[:, u_axis] = corner[[0, 1, 1, 0], u_axis]
                points[:, v_axis] = corner[[0, 0, 1, 1], v_axis]
                points[:, n_axis] = corner[side, n_axis]
                uv = points[:, [u_axis, v_axis]]
                if fit:
                    uv = (uv - uv.min(axis=0)) / np.maximum(np.ptp(uv, axis=0), 1e-9)
                    uv[:, 1] = 1 - uv[:, 1]
                else:
                    stays = material.is_upright and v_axis == 2
                    shift = 0.0 if stays else corner[0].sum() * 3.7 + across
                    if np.ptp(uv[:, 0]) < np.ptp(uv[:, 1]) and not stays:
                        uv = uv[:, ::-1]
                    uv = uv / material.size_m + shift
                # The quad turns about +axis for across x and z, about −y for across y.
                forward = (side == 1) != (across == 1)
                order = [0, 1, 2, 3] if forward else [0, 3, 2, 1]
                normal = np.zeros(3)
                normal[n_axis] = 2 * side - 1
                self._quads(material, points[order][None], uv[order][None], normal)

    def turned(
        self,
        material: Material,
        center: tuple[float, float],
        profile: Sequence[tuple[float, float]],
        n_sides: int = 20,
    ) -> None:
        """A profile of (radius, height) turned about an upright axis, bottom to top."""
        radius, height = np.array(profile, np.float64).T
        angle = np.linspace(0, 2 * np.pi, n_sides + 1)
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        points = np.empty((len(radius), n_sides + 1, 3))
        points[..., :2] = np.asarray(center) + radius[:, None, None] * ring
        points[..., 2] = height[:, None]
        along = np.concatenate([[0], np.cumsum(np.hypot(np.diff(radius), np.diff(height)))])
        around = angle / (2 * np.pi) * max(1, round(2 * np.pi * radius.max() / material.size_m))
        uv = np.stack(np.meshgrid(around, along / material.size_m), axis=-1)
        grids = [grid[:-1, :-1] for grid in (points, uv)], [grid[:-1, 1:] for grid in (points, uv)]
        upper = [grid[1:, 1:] for grid in (points, uv)], [grid[1:, :-1] for grid in (points, uv)]
        quads = [
            np.stack([part[k] for part in (*grids, *upper)], axis=2).reshape(-1, 4, (3, 2)[k])
            for k in (0, 1)
        ]
        # Level rings are laid on flat, the rest is wrapped round.
        level = np.repeat(np.diff(height) == 0, n_sides)
        quads[1][level] = quads[0][level][..., :2] / material.size_m
        slope = np.stack([np.diff(height), -np.diff(radius)], axis=-1)
        slope /= np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-9)
        normals = np.empty((len(slope), n_sides, 4, 3))
        for corner, step in enumerate((0, 1, 1, 0)):
            at = ring[step : n_sides + step]
            normals[:, :, corner, :2] = slope[:, None, :1] * at
            normals[:, :, corner, 2] = slope[:, 1:]
        self._quads(material, quads[0], quads[1], normals.reshape(-1, 4, 3))

    def meshes(self) -> list[TexturedMesh]:
        """One mesh per material."""
        return [_mesh(material, faces) for material, faces in self._of.items()]

    def _quads(self, material: Material, corners: Array, uvs: Array, normal: ArrayLike) -> None:
        faces = self._of.setdefault(material, _Faces())
        normals = np.broadcast_to(np.asarray(normal, np.float64), corners.shape)
        for pick in ([0, 1, 2], [0, 2, 3]):
            faces.corners.append(corners[:, pick])
            faces.uvs.append(uvs[:, pick])
            faces.normals.append(normals[:, pick])


def _mesh(material: Material, faces: _Faces) -> TexturedMesh:
    corners = np.concatenate(faces.corners)
    n_faces = len(corners)
    return TexturedMesh(
        vertices=corners.reshape(-1, 3).astype(np.float32),
        faces=np.arange(3 * n_faces, dtype=np.int32).reshape(-1, 3),
        corner_uvs=np.concatenate(faces.uvs).astype(np.float32),
        texture=material.texture,
        face_surface=np.zeros(n_faces, np.int16),
        surfaces=(material.surface,),
        corner_normals=np.concatenate(faces.normals).astype(np.float32),
    )
