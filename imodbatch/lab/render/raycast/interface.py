"""What a renderer is given and what it gives back; no renderer's own types.

Light is linear inside. A light of intensity 1 makes a white surface that faces it at 1 m exactly
white (radiance 1, the factor π of Lambert's law is left out), a panel or point light falls off with
the square of the distance, and exposure multiplies everything before the tone curve.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
"""float32 in practice; numpy's type hints widen too often to say so."""
Rgb = tuple[float, float, float]
Point = tuple[float, float, float]
NO_INSTANCE = -1
WHITE: Rgb = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Textured triangles in their own frame; compared by identity, so its structures are cached.

    Attributes:
        vertices: (V, 3) float32 metres.
        faces: (F, 3) int32, counter-clockwise seen from outside; both sides are drawn.
        corner_uvs: (F, 3, 2) float32; (0, 0) is the top-left corner of the texture, (1, 1) the
            bottom-right one. Values outside repeat the texture.
        texture: (H, W, 3) uint8 sRGB.
        face_specular: (F,) float32 reflectance of the highlight, 0 to 1.
        face_shininess: (F,) float32 exponent of the highlight.
        corner_normals: (F, 3, 3) float32 unit shading normals; None = flat faces.
    """

    vertices: Floats
    faces: NDArray[np.int32]
    corner_uvs: Floats
    texture: NDArray[np.uint8]
    face_specular: Floats
    face_shininess: Floats
    corner_normals: Floats | None = None


@dataclass(frozen=True, eq=False)
class Instance:
    """A mesh at a place.

    Attributes:
        mesh: what stands there.
        world_from_mesh: (4, 4) rigid transform.
        instance_id: its number in the instance image; −1 for scenery, which has no visibility.
    """

    mesh: Mesh
    world_from_mesh: NDArray[np.float64]
    instance_id: int = NO_INSTANCE


@dataclass(frozen=True)
class BulbLight:
    """A glowing ball.

    Attributes:
        position: (3,) metres in the world.
        intensity: linear RGB radiance of a white surface at 1 m.
        radius_m: sets how soft its shadows are.
    """

    position: Point
    intensity: Rgb = WHITE
    radius_m: float = 0.05


@dataclass(frozen=True)
class PanelLight:
    """A glowing parallelogram, such as a window or a ceiling panel; it shines along u × v.

    Attributes:
        center: (3,) metres in the world.
        half_u: (3,) from the centre to the middle of one edge.
        half_v: (3,) from the centre to the middle of a neighbouring edge.
        intensity: linear RGB radiance of a white surface that faces the panel squarely at 1 m.
    """

    center: Point
    half_u: Point
    half_v: Point
    intensity: Rgb = WHITE


@dataclass(frozen=True)
class SunLight:
    """Parallel light.

    Attributes:
        to_sun: (3,) direction towards it, of any length.
        intensity: linear RGB radiance of a white surface that faces it.
        half_angle_rad: half the angle under which it appears; sets how soft its shadows are.
    """

    to_sun: Point
    intensity: Rgb = WHITE
    half_angle_rad: float = 0.005


Light = BulbLight | PanelLight | SunLight


@dataclass(frozen=True, eq=False)
class Sky:
    """Light from everywhere, and what is seen where no surface is.

    Attributes:
        from_above: linear RGB light that an open surface facing up receives.
        from_below: the same facing down: what the floor throws back.
        background: (3,) or (N, 3) sRGB uint8, rows from straight up to straight down; or an
            equirectangular panorama (H, W, 3) with +x in its middle and +y to the left of it.
    """

    from_above: Rgb = (0.35, 0.36, 0.38)
    from_below: Rgb = (0.22, 0.2, 0.18)
    background: NDArray[np.uint8] | tuple[int, int, int] = (190, 200, 210)


@dataclass(frozen=True, eq=False)
class Scene:
    """Instances and light."""

    instances: tuple[Instance, ...]
    lights: tuple[Light, ...] = ()
    sky: Sky = Sky()


@dataclass(frozen=True)
class RenderSettings:
    """What a picture costs and how it is exposed.

    Attributes:
        exposure: factor on the light; None adjusts it to each frame, as a camera does.
        shadow_rays: per light and shaded point; 0 = no shadows.
        ambient_rays: per shaded point, for corners that see less of the sky; 0 = none.
        ambient_reach_m: how far a surface darkens another's corner.
        light_stride: light is computed at every n-th pixel each way and filled in along surfaces.
        smooth_edges: ``none`` | ``edges`` (four rays where neighbouring pixels differ) |
            ``all`` (four rays per pixel).
        seed: of everything random; the same seed gives the same bytes.
    """

    exposure: float | None = 1.0
    shadow_rays: int = 4
    ambient_rays: int = 4
    ambient_reach_m: float = 0.6
    light_stride: int = 2
    smooth_edges: Literal["none", "edges", "all"] = "edges"
    seed: int = 0


@dataclass(frozen=True)
class View:
    """One picture of one object: from where, how large, and in which light.

    The camera looks at the middle of the object's bounding box, which appears in the middle of the
    picture.

    Attributes:
        azimuth_rad: of the camera about the object's +z, from its +x towards its +y.
        elevation_rad: of the camera above the object's horizon.
        size_px: width and height.
        distance_m: of the camera from the middle of the bounding box.
        focal_px: focal length.
        roll_rad: turns the picture counter-clockwise.
        lights: in the object's frame.
        sky: light from everywhere; not seen itself.
        settings: exposure and seed are every renderer's; what it costs, the ray caster's.
    """

    azimuth_rad: float
    elevation_rad: float
    size_px: int
    distance_m: float
    focal_px: float
    roll_rad: float = 0.0
    lights: tuple[SunLight, ...] = ()
    sky: Sky = Sky()
    settings: RenderSettings = RenderSettings()


@dataclass(frozen=True)
class InstanceView:
    """How an instance appears in a frame.

    A box is (x0, y0, x1, y1) in continuous pixels; None where there is no pixel to enclose.

    Attributes:
        instance_id: of the instance.
        n_visible_px: pixels that show it.
        visible_fraction: `n_visible_px` as a share of the pixels that would show it if it stood
            alone; 0 if there are none.
        inside_fraction: share of its whole outline that lies within the image.
        is_cut: whether its outline, standing alone, goes over the border of the image.
        outline_box_px: around the pixels that would show it if it stood alone, within the image.
    """

    instance_id: int
    n_visible_px: int
    visible_fraction: float
    inside_fraction: float
    is_cut: bool
    outline_box_px: tuple[float, float, float, float] | None


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered frame.

    Attributes:
        color: (H, W, 3) uint8 sRGB.
        depth_m: (H, W) float32 z-depth in metres, NaN where no surface is.
        instance_ids: (H, W) int32, −1 = none.
        views: one per instance with a number, in the scene's order.
    """

    color: NDArray[np.uint8]
    depth_m: Floats
    instance_ids: NDArray[np.int32]
    views: tuple[InstanceView, ...]
