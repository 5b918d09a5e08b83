"""Pictures of one object from a chosen viewpoint, cut out: fast, for training by thousands."""

import weakref
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import make_transform
from imodbatch.lab.render.raycast.interface import (
    BulbLight,
    Instance,
    Light,
    Mesh,
    RenderSettings,
    Scene,
    Sky,
    View,
)
from imodbatch.lab.render.raycast.tone import expose
from imodbatch.lab.render.raycast.tracing import Geometry, Shot, Stopwatch, trace

VIEW_SETTINGS = RenderSettings(shadow_rays=2, ambient_rays=2, light_stride=2)
FILL = 0.9
"""Share of the picture's side that the object's bounding sphere spans by default."""

_GEOMETRIES: "weakref.WeakKeyDictionary[Mesh, Geometry]" = weakref.WeakKeyDictionary()


def render_view(
    mesh: Mesh,
    azimuth_rad: float,
    elevation_rad: float,
    size_px: int = 160,
    *,
    roll_rad: float = 0.0,
    distance_m: float | None = None,
    focal_px: float | None = None,
    lights: tuple[Light, ...] | None = None,
    sky: Sky | None = None,
    settings: RenderSettings = VIEW_SETTINGS,
) -> NDArray[np.uint8]:
    """One object seen from a viewpoint, (size, size, 4) uint8 RGBA, transparent elsewhere.

    Args:
        mesh: the object in its own frame.
        azimuth_rad: of the camera about the object's +z, from its +x towards its +y.
        elevation_rad: of the camera above the object's horizon.
        size_px: width and height.
        roll_rad: turns the picture counter-clockwise.
        distance_m: of the camera from the middle of the bounding box; by default four times the
            bounding sphere's radius, at least 0.3 m.
        focal_px: focal length; by default such that the bounding sphere spans 0.9 of the picture.
        lights: in the object's frame; by default one above the viewer's left shoulder.
        sky: light from everywhere.
        settings: what it costs and how it is exposed.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle = 0.5 * (low + high).astype(np.float64)
    radius_m = max(0.5 * float(np.linalg.norm(high - low)), 1e-6)
    distance_m = max(4 * radius_m, 0.3) if distance_m is None else distance_m
    if focal_px is None:
        # A sphere's outline lies where rays touch it, a little outside its equator.
        tangent = radius_m / np.sqrt(max(distance_m**2 - radius_m**2, 1e-12))
        focal_px = FILL * 0.5 * size_px / tangent
    camera = PinholeCamera(size_px, size_px, focal_px, focal_px, 0.5 * size_px, 0.5 * size_px)
    object_from_cam = viewpoint_transform(middle, azimuth_rad, elevation_rad, distance_m, roll_rad)
    if lights is None:
        lights = (_shoulder_light(object_from_cam, middle, distance_m),)
    scene = Scene((Instance(mesh, np.eye(4)),), lights, sky or Sky())
    if mesh not in _GEOMETRIES:
        _GEOMETRIES[mesh] = Geometry(scene.instances)
    shot = Shot.of(camera, object_from_cam)
    traced = trace(_GEOMETRIES[mesh], scene, settings, shot, Stopwatch())
    # Colours are kept whole; the coverage goes into alpha.
    light = traced.light / np.maximum(traced.coverage, np.float32(1e-6))
    picture = np.empty((size_px, size_px, 4), np.uint8)
    picture[..., :3] = expose(light.T.reshape(size_px, size_px, 3), settings.exposure)
    picture[..., 3] = np.rint(255 * traced.coverage).reshape(size_px, size_px)
    picture[picture[..., 3] == 0] = 0
    return picture


def render_views(mesh: Mesh, views: Sequence[View]) -> Iterator[NDArray[np.uint8]]:
    """One picture per view, (size, size, 4) uint8 RGBA, transparent around the object."""
    for view in views:
        yield render_view(
            mesh,
            view.azimuth_rad,
            view.elevation_rad,
            view.size_px,
            roll_rad=view.roll_rad,
            distance_m=view.distance_m,
            focal_px=view.focal_px,
            lights=view.lights,
            sky=view.sky,
            settings=view.settings,
        )


def viewpoint_transform(
    target: NDArray[np.float64],
    azimuth_rad: float,
    elevation_rad: float,
    distance_m: float,
    roll_rad: float = 0.0,
) -> NDArray[np.float64]:
    """``world_from_cam`` (4, 4) of a camera that looks at a target (3,) from a viewpoint.

    Straight from above, the picture's top is where azimuth π would be.
    """
    sin_a, cos_a = np.sin(azimuth_rad), np.cos(azimuth_rad)
    sin_e, cos_e = np.sin(elevation_rad), np.cos(elevation_rad)
    backward = np.array([cos_e * cos_a, cos_e * sin_a, sin_e])
    right = np.array([-sin_a, cos_a, 0.0])
    down = np.array([sin_e * cos_a, sin_e * sin_a, -cos_e])
    sin_r, cos_r = np.sin(roll_rad), np.cos(roll_rad)
    axes = np.stack([cos_r * right + sin_r * down, cos_r * down - sin_r * right, -backward], axis=1)
    return make_transform(axes, target + distance_m * backward)


def _shoulder_light(
    object_from_cam: NDArray[np.float64], middle: NDArray[np.float64], distance_m: float
) -> BulbLight:
    """A light above the viewer's left shoulder, as bright at any distance."""
    right, down, _ = object_from_cam[:3, :3].T
    place = object_from_cam[:3, 3] + distance_m * (-0.6 * right - 0.8 * down)
    square = float(((place - middle) ** 2).sum())
    x, y, z = (float(value) for value in place)
    return BulbLight((x, y, z), (0.8 * square,) * 3, 0.15 * distance_m)
