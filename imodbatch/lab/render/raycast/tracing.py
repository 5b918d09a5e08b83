"""Light along the rays of a camera: cast, find where light falls, shade, smooth the edges."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.lab.render.raycast.geometry import MISS, Hits, RayCaster
from imodbatch.lab.render.raycast.interface import Floats, Instance, RenderSettings, Scene
from imodbatch.lab.render.raycast.openness import OpennessMap, OpennessProbe
from imodbatch.lab.render.raycast.parallel import in_chunks
from imodbatch.lab.render.raycast.shading import shade
from imodbatch.lab.render.raycast.surfaces import Surfaces, dot

EDGE_PX = 2.0
"""A neighbour this many pixels' sizes off a pixel's plane makes it an edge."""
EDGE_COSINE = 0.9
STEPS = np.array([[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]], np.float32)
"""Four places in a pixel of which no two share a row or column."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A camera at a place, and what turns pixels into rays.

    Attributes:
        camera: its intrinsics.
        origin: (3, 1) float32 in the world.
        axes: (3, 3) float32; columns are the camera's axes in the world.
    """

    camera: PinholeCamera
    origin: Floats
    axes: Floats

    @classmethod
    def of(cls, camera: PinholeCamera, world_from_cam: NDArray[np.float64]) -> "Shot":
        """From a (4, 4) transform."""
        matrix = np.asarray(world_from_cam, np.float32)
        return cls(camera, matrix[:3, 3:], matrix[:3, :3])

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.camera.height_px, self.camera.width_px

    @property
    def pixel_rad(self) -> float:
        """Angle of a pixel in the middle of the image."""
        return float(2 / (self.camera.fx_px + self.camera.fy_px))

    def centers(self) -> Floats:
        """Pixel centres (2, H × W), row by row."""
        centers = self.camera.pixel_centers().reshape(-1, 2).T
        return np.ascontiguousarray(centers, dtype=np.float32)

    def directions(self, pixels: Floats) -> Floats:
        """Directions (3, N), with unit z in the camera, of continuous pixels (2, N)."""
        camera = self.camera
        x = (pixels[0] - np.float32(camera.cx_px)) / np.float32(camera.fx_px)
        y = (pixels[1] - np.float32(camera.cy_px)) / np.float32(camera.fy_px)
        right, down, forward = self.axes.T[:, :, None]
        return x * right + y * down + forward


class Geometry:
    """The triangles of instances, sorted once for many pictures."""

    def __init__(self, instances: tuple[Instance, ...]) -> None:
        self.surfaces = Surfaces(instances)
        self.caster = RayCaster(self.surfaces.parts)


@dataclass(frozen=True, eq=False)
class Traced:
    """Light from surfaces.

    Attributes:
        light: (3, N) linear RGB, weighted with the coverage.
        coverage: (N,) share of each pixel that shows a surface.
        hits: of the rays through the pixel centres.
    """

    light: Floats
    coverage: Floats
    hits: Hits


@dataclass
class Stopwatch:
    """Seconds spent on each part of a frame."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def on(self, part: str) -> Iterator[None]:
        """Count what happens in here to a part."""
        start = perf_counter()
        yield
        self.seconds[part] = self.seconds.get(part, 0.0) + perf_counter() - start


def trace(
    geometry: Geometry, scene: Scene, settings: RenderSettings, shot: Shot, watch: Stopwatch
) -> Traced:
    """Light along the rays of all pixels, row by row.

    Args:
        geometry: of the scene's instances.
        scene: its lights and sky.
        settings: what a picture costs.
        shot: from where.
        watch: is told the time of each part.
    """
    pixels = shot.centers()
    directions = shot.directions(pixels)
    with watch.on("cast"):
        hits = geometry.caster.cast(shot.origin, directions)
    with watch.on("openness"):
        openness = _openness(geometry, scene, settings, shot, hits, directions)

    def radiance(
        hits: Hits, directions: Floats, pixels: Floats, wanted: NDArray[np.bool_]
    ) -> Floats:
        """Linear RGB and coverage (4, N) along rays that have been cast; 0 where not wanted."""
        result = np.zeros((4, pixels.shape[1]), np.float32)

        def work(index: NDArray[np.intp]) -> None:
            some = hits.take(index)
            places = geometry.surfaces.places(some, shot.origin, directions.take(index, axis=1))
            paint = geometry.surfaces.paint(some, places, shot.pixel_rad)
            seen = openness.look_up(places, pixels.take(index, axis=1))
            result[:3, index] = shade(scene, places, paint, seen)
            result[3, index] = 1

        in_chunks(work, np.flatnonzero(wanted & (hits.face != MISS)))
        return result

    with watch.on("edges"):
        is_edge = _edges(geometry, settings, shot, hits, directions)
        edge = np.flatnonzero(is_edge)
    with watch.on("shade"):
        result = radiance(hits, directions, pixels, ~is_edge)
    with watch.on("edges"):
        finer = np.repeat(np.floor(pixels[:, edge]), len(STEPS), axis=1)
        finer += np.tile(STEPS.T, edge.size)
        rays = shot.directions(finer)
        struck = geometry.caster.cast(shot.origin, rays)
        smooth = radiance(struck, rays, finer, np.ones(len(struck.face), np.bool_))
        # Very bright spots count as white, or their borders would stay jagged.
        smooth = np.minimum(smooth, np.float32(2)).reshape(4, edge.size, len(STEPS))
        result[:, edge] = smooth.mean(axis=2)
    return Traced(result[:3], result[3], hits)


def _openness(
    geometry: Geometry,
    scene: Scene,
    settings: RenderSettings,
    shot: Shot,
    hits: Hits,
    directions: Floats,
) -> OpennessMap:
    """Shadows on a grid of every n-th pixel."""
    stride = settings.light_stride
    grid = np.arange(directions.shape[1]).reshape(shot.shape)[::stride, ::stride]
    struck = hits.face[grid] != MISS
    index = grid[struck]
    places = geometry.surfaces.places(hits.take(index), shot.origin, directions[:, index])
    probe = OpennessProbe(geometry.caster, scene.lights, settings)
    return OpennessMap(probe, places, struck, stride, shot.pixel_rad)


def _edges(
    geometry: Geometry, settings: RenderSettings, shot: Shot, hits: Hits, directions: Floats
) -> NDArray[np.bool_]:
    """Pixels (N,) to be smoothed: unlike a neighbour in part, plane or direction."""
    if settings.smooth_edges == "none":
        return np.zeros(directions.shape[1], np.bool_)
    if settings.smooth_edges == "all":
        return np.ones(directions.shape[1], np.bool_)
    struck = hits.face != MISS
    depth = np.where(struck, hits.t, 0)
    position = (depth * directions).reshape(3, *shot.shape)
    normal = geometry.surfaces.face_normals(hits.face).reshape(3, *shot.shape)
    part = geometry.surfaces.instances(hits.face).reshape(shot.shape)
    far = np.float32(EDGE_PX * shot.pixel_rad) * depth.reshape(shot.shape)
    edge = np.zeros(shot.shape, np.bool_)
    for a, b in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
    ):
        here, there = (slice(None), *a), (slice(None), *b)
        away = dot(position[there] - position[here], normal[here])
        turned = np.abs(dot(normal[here], normal[there])) < EDGE_COSINE
        differs = (part[a] != part[b]) | (np.abs(away) > far[a]) | turned
        differs &= (part[a] >= 0) | (part[b] >= 0)
        edge[a] |= differs
        edge[b] |= differs
    return edge.ravel()
