"""The default renderer: rays against triangles (embree through open3d), shaded in numpy.

Fast rather than exact: light bounces once, the rest of it is a sky whose light corners see less
of. Vectors of N points are (3, N) in here: numpy is several times faster along long rows. What a
user needs is in `interface` (what is given and returned), `Renderer` and `render_view`.

    interface   meshes, instances, lights, sky, settings → frames; no renderer's own types
    renderer    `Renderer`: a scene's frames
    views       `render_view`, `render_views`: one object from viewpoints, cut out
    tracing     cast, find where light falls, shade, smooth the edges
    geometry    rays against triangles; the only file that knows open3d
    surfaces    what a ray meets: normals, texture coordinates, materials
    textures    texels at every power-of-two size
    lights      from where light comes and how strong
    openness    shadows and dark corners from few rays
    shading     light that a point sends to the viewer; the background
    parallel    pieces of work side by side
    tone        sRGB, exposure, tone curve
    visibility  outlines alone, against what the frame shows
"""

from imodbatch.lab.render.raycast.interface import (
    NO_INSTANCE,
    BulbLight,
    Frame,
    Instance,
    InstanceView,
    Light,
    Mesh,
    PanelLight,
    RenderSettings,
    Scene,
    Sky,
    SunLight,
    View,
)
from imodbatch.lab.render.raycast.renderer import Renderer
from imodbatch.lab.render.raycast.views import render_view, render_views, viewpoint_transform

__all__ = [
    "NO_INSTANCE",
    "BulbLight",
    "Frame",
    "Instance",
    "InstanceView",
    "Light",
    "Mesh",
    "PanelLight",
    "RenderSettings",
    "Renderer",
    "Scene",
    "Sky",
    "SunLight",
    "View",
    "render_view",
    "render_views",
    "viewpoint_transform",
]
