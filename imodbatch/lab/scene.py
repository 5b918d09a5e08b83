"""Placed object models and lights → frames, through whichever renderer engine is chosen.

A world is put together once; its `Renderer` keeps the sorted triangles, so every further frame
costs its rays alone. The renderer draws `Mesh`es, which hold no names or symmetries; the mesh of an
`ObjectModel` is converted once, however often it is placed.
"""

import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.mesh import ObjectModel, TexturedMesh
from imodbatch.lab.render import blender, raycast
from imodbatch.lab.render.raycast import NO_INSTANCE, Light, Renderer, RenderSettings, Sky, View

ViewRenderer = Literal["embree", "blender"]
_VIEW_RENDERERS: dict[
    ViewRenderer,
    Callable[[raycast.Mesh, Sequence[View]], Iterator[NDArray[np.uint8]]],
] = {"embree": raycast.render_views, "blender": blender.render_views}

_MESHES: "weakref.WeakKeyDictionary[TexturedMesh, raycast.Mesh]" = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class PlacedModel:
    """An object model somewhere in the world.

    Attributes:
        model: what it is.
        world_from_object: (4, 4) rigid transform.
        instance_id: its number in the frames' instance images; −1 = scenery, which has none.
    """

    model: ObjectModel
    world_from_object: NDArray[np.float64]
    instance_id: int = NO_INSTANCE


def make_scene(
    placed: list[PlacedModel], lights: list[Light], sky: Sky | None = None
) -> raycast.Scene:
    """A renderer's scene of placed models."""
    instances = tuple(
        raycast.Instance(_mesh(item.model.mesh), item.world_from_object, item.instance_id)
        for item in placed
    )
    return raycast.Scene(instances, tuple(lights), sky or Sky())


def make_renderer(
    placed: list[PlacedModel],
    lights: list[Light],
    sky: Sky | None = None,
    settings: RenderSettings | None = None,
) -> Renderer:
    """A renderer of a world: ``make_renderer(…).render(camera, world_from_cam)``."""
    return Renderer(make_scene(placed, lights, sky), settings or RenderSettings())


def render_view(
    model: ObjectModel, azimuth_rad: float, elevation_rad: float, size_px: int = 160, **how: Any
) -> NDArray[np.uint8]:
    """One object from a viewpoint, (size, size, 4) uint8 RGBA, transparent around it.

    Args:
        model: the object.
        azimuth_rad: of the camera about the object's +z, from its front (+x) towards +y.
        elevation_rad: of the camera above the object's horizon.
        size_px: width and height.
        **how: roll, distance, focal length, lights, sky, settings (`raycast.render_view`).
    """
    return raycast.render_view(_mesh(model.mesh), azimuth_rad, elevation_rad, size_px, **how)


def render_views(
    model: ObjectModel, views: Sequence[View], renderer: ViewRenderer = "embree"
) -> Iterator[NDArray[np.uint8]]:
    """One object from many viewpoints: per view a (size, size, 4) uint8 RGBA.

    All renderers mean the same by a view: the same pixels show the object. They differ in how
    light falls.

    Raises:
        ConfigError: Blender is not there, or failed.
    """
    return _VIEW_RENDERERS[renderer](_mesh(model.mesh), views)


def _mesh(mesh: TexturedMesh) -> raycast.Mesh:
    """A mesh as the renderer wants it: how parts shine, face by face."""
    if mesh not in _MESHES:
        specular = np.array([surface.specular for surface in mesh.surfaces], np.float32)
        shininess = np.array([surface.shininess for surface in mesh.surfaces], np.float32)
        _MESHES[mesh] = raycast.Mesh(
            mesh.vertices,
            mesh.faces,
            mesh.corner_uvs,
            mesh.texture,
            specular[mesh.face_surface],
            shininess[mesh.face_surface],
            mesh.corner_normals,
        )
    return _MESHES[mesh]
