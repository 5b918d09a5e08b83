"""Rays against triangles (embree, through open3d). Nothing of open3d's types leaves this file.

Rays whose direction or origin is not finite would make embree search for minutes; callers pass
finite ones only.
"""

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.render.raycast.interface import Floats, Mesh
from imodbatch.libraries.open3d_library import open3d

MISS = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """First hits of N rays. `face` counts through all parts and is −1 where a ray hit nothing.

    Attributes:
        t: (N,) float32 in lengths of the ray's direction; inf for a miss.
        face: (N,) int32.
        uv: (2, N) float32 barycentric weights of the second and third corner.
    """

    t: Floats
    face: NDArray[np.int32]
    uv: Floats

    def take(self, index: NDArray[np.intp]) -> "Hits":
        """Some of the hits."""
        return Hits(self.t[index], self.face[index], self.uv[:, index])


class RayCaster:
    """Triangles, sorted for fast look-up. Each part is added with its own faces."""

    def __init__(self, parts: list[tuple[Floats, NDArray[np.int32]]]) -> None:
        self._o3d = open3d()
        self._scene: Any = self._o3d.t.geometry.RaycastingScene()
        sizes = [len(faces) for _, faces in parts]
        self._first_face = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
        for vertices, faces in parts:
            self._scene.add_triangles(
                self._tensor(vertices.astype(np.float32)), self._tensor(faces.astype(np.uint32))
            )
        self.is_empty = not sum(sizes)

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """First hits of rays; origins (3, N) or (3, 1), directions (3, N)."""
        n = directions.shape[1]
        if self.is_empty or not n:
            return Hits(
                np.full(n, np.inf, np.float32),
                np.full(n, MISS, np.int32),
                np.zeros((2, n), np.float32),
            )
        answer = self._scene.cast_rays(self._rays(origins, directions))
        t = answer["t_hit"].numpy()
        part = np.where(np.isfinite(t), answer["geometry_ids"].numpy().astype(np.int64), 0)
        face = self._first_face[part] + answer["primitive_ids"].numpy().view(np.int32)
        face[~np.isfinite(t)] = MISS
        return Hits(t, face, np.ascontiguousarray(answer["primitive_uvs"].numpy().T))

    def is_hit(
        self, origins: Floats, directions: Floats, t_max: float = np.inf
    ) -> NDArray[np.bool_]:
        """Whether anything lies on rays before `t_max` lengths of their direction, (N,)."""
        if self.is_empty or not directions.size:
            return np.zeros(directions.shape[1], dtype=np.bool_)
        rays = self._rays(origins, directions)
        return self._scene.test_occlusions(rays, tfar=float(t_max)).numpy()

    def _rays(self, origins: Floats, directions: Floats) -> Any:
        rays = np.empty((directions.shape[1], 6), dtype=np.float32)
        for axis in range(3):
            rays[:, axis], rays[:, 3 + axis] = origins[axis], directions[axis]
        return self._tensor(rays)

    def _tensor(self, array: NDArray[Any]) -> Any:
        return self._o3d.core.Tensor.from_numpy(np.ascontiguousarray(array))


_CASTERS: "weakref.WeakKeyDictionary[Mesh, RayCaster]" = weakref.WeakKeyDictionary()


def caster_of(mesh: Mesh) -> RayCaster:
    """The caster of one mesh in its own frame; made once."""
    if mesh not in _CASTERS:
        _CASTERS[mesh] = RayCaster([(mesh.vertices, mesh.faces)])
    return _CASTERS[mesh]
