"""A thing that can be rendered: triangles, a texture, how it shines, and how symmetric it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.symmetry import Symmetry


@dataclass(frozen=True, eq=False)
class Surface:
    """How a surface answers to light (Blinn–Phong with an ambient term).

    Attributes:
        specular: strength of the highlight, 0 (paper) to 1 (polished metal).
        shininess: exponent of the highlight, about 5 (rubber) to 200 (glass).
    """

    specular: float = 0.05
    shininess: float = 20.0


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """Triangles with a texture atlas, in the object's own frame.

    The frame: metres, +z up, the object stands on z = 0, its footprint is centred on the origin,
    and its front (azimuth 0) looks along +x.

    Attributes:
        vertices: (V, 3) float32.
        faces: (F, 3) int32, counter-clockwise seen from outside.
        corner_uvs: (F, 3, 2) float32 texture coordinates of each face's corners; (0, 0) is the
            top-left corner of the texture image, (1, 1) the bottom-right one.
        texture: (H, W, 3) uint8 sRGB.
        face_surface: (F,) int16 index into `surfaces`.
        surfaces: how the parts shine.
        corner_normals: (F, 3, 3) float32 unit shading normals; None = flat faces.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    corner_uvs: NDArray[np.float32]
    texture: NDArray[np.uint8]
    face_surface: NDArray[np.int16]
    surfaces: tuple[Surface, ...] = (Surface(),)
    corner_normals: NDArray[np.float32] | None = None

    @property
    def extent_m(self) -> NDArray[np.float32]:
        """Size (3,) of the bounding box."""
        return np.ptp(self.vertices, axis=0)


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A named object.

    Attributes:
        name: class name.
        mesh: what it looks like.
        symmetry: ``full`` = looks the same from every azimuth; an integer n = n-fold; ``none``.
        instance: which object of its class; empty = there is one.
    """

    name: str
    mesh: TexturedMesh
    symmetry: Symmetry = "none"
    instance: str = ""

    @property
    def instance_name(self) -> str:
        """Tells it from other objects of its class."""
        return self.instance or self.name
