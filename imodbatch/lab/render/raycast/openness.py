"""How much of each light, and of the sky, points see: shadows and dark corners.

A few rays per point are noisy. Neighbouring points use different rays out of one evenly spread set
that fills a tile of 4×4 points, so the mean over any tile is as good as sixteen times the rays;
a blur of just that period, which does not cross from one surface to another, takes the noise away
(interleaved sampling, Keller and Heidrich 2001). This is done on a coarser grid than the image's
and filled in along surfaces; a point that no grid point resembles gets rays of its own.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.render.raycast.geometry import RayCaster
from imodbatch.lab.render.raycast.interface import Floats, Light, RenderSettings
from imodbatch.lab.render.raycast.lights import FAINT, arriving, hemisphere, shadow_rays
from imodbatch.lab.render.raycast.parallel import in_chunks
from imodbatch.lab.render.raycast.surfaces import Places, dot

TILE = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]], np.int32)
N_TILE = 16
R2 = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps of the sequence that fills the square most evenly (Roberts 2018)."""
BLUR = ((0, 1.0), (-1, 1.0), (1, 1.0), (-2, 0.5), (2, 0.5))
MEASURED_AT_ONCE = 1 << 14
REACH = 2
"""Grid points about one with disagreeing rays that are blurred with it."""
LEAST_COSINE = 0.6
"""Points whose normals differ more than this do not lend each other light."""
TOLERANCE_M = 0.002
LEAST_WEIGHT = 0.03


@dataclass(frozen=True, eq=False)
class OpennessProbe:
    """Asks the geometry, per point and light, which share of the light is in view.

    Attributes:
        caster: all triangles.
        lights: of the scene.
        settings: how many rays.
    """

    caster: RayCaster
    lights: tuple[Light, ...]
    settings: RenderSettings

    @property
    def n_channels(self) -> int:
        """One per light, and the sky last."""
        return len(self.lights) + 1

    def measure(self, places: Places, tile: NDArray[np.int32]) -> Floats:
        """Shares in view (C, N) in 0..1; 1 where the light does not reach anyway.

        Args:
            places: N points.
            tile: (N,) number of each point in its tile, 0..15.
        """
        origin = places.position + _lift(places) * places.face_normal
        openness = np.ones((self.n_channels, len(tile)), np.float32)
        n_rays = self.settings.shadow_rays
        for channel, light in enumerate(self.lights):
            if not n_rays:
                break
            direction, strength, _ = arriving(light, places.position)
            received = strength * dot(direction, places.normal) * np.float32(max(light.intensity))
            lit = np.flatnonzero(received > FAINT)
            if not lit.size:
                continue
            start, samples = origin[:, lit], self._samples(n_rays, channel)
            blocked = np.zeros(lit.size, np.float32)
            for ray in range(n_rays):
                way = shadow_rays(light, start, samples[ray][:, tile[lit]])
                blocked += self.caster.is_hit(start, way, 0.999)
            openness[channel, lit] = 1 - blocked / n_rays
        openness[-1] = self._open_sky(places, origin, tile, self.settings.ambient_rays)
        return openness

    def _open_sky(
        self, places: Places, origin: Floats, tile: NDArray[np.int32], n_rays: int
    ) -> Floats:
        """Share of the hemisphere (N,) without anything near."""
        blocked = np.zeros(len(tile), np.float32)
        samples = self._samples(n_rays, len(self.lights))
        for ray in range(n_rays):
            # Rays of different lengths: what is near darkens more than what is far.
            reach = np.sqrt((samples[ray, 0] * 7.31 + samples[ray, 1] * 3.17) % 1)
            reach = np.maximum(reach * np.float32(self.settings.ambient_reach_m), 1e-3)
            way = hemisphere(places.normal, places.face_normal, samples[ray][:, tile])
            blocked += self.caster.is_hit(origin, way * reach[tile].astype(np.float32), 1.0)
        return 1 - blocked / max(n_rays, 1)

    def _samples(self, n_rays: int, channel: int) -> Floats:
        """Points of the unit square (n_rays, 2, 16): each tile number has a run of the sequence."""
        offset = np.random.default_rng([self.settings.seed, channel]).random(2)
        sequence = (offset + np.arange(N_TILE * n_rays)[:, None] * R2) % 1
        sequence = np.minimum(sequence, 1 - 1e-6).astype(np.float32)
        return np.ascontiguousarray(sequence.reshape(N_TILE, n_rays, 2).transpose(1, 2, 0))


class OpennessMap:
    """Openness on a grid of points, looked up for any point of the image."""

    def __init__(
        self,
        probe: OpennessProbe,
        places: Places,
        hit: NDArray[np.bool_],
        stride: int,
        pixel_rad: float,
    ) -> None:
        """Measure and blur.

        Args:
            probe: for grid points, and for points that no grid point resembles.
            places: of the M grid points that hit a surface, row by row.
            hit: (h, w) which grid points did.
            stride: pixels from one grid point to the next.
            pixel_rad: angle of a pixel.
        """
        self._probe, self._stride, self._pixel_rad = probe, stride, pixel_rad
        self._shape = hit.shape
        rows, columns = np.nonzero(hit)
        tile = TILE[rows % 4, columns % 4]
        measured = np.empty((probe.n_channels, len(tile)), np.float32)

        def work(index: NDArray[np.intp]) -> None:
            measured[:, index] = probe.measure(places.take(index), tile[index])

        in_chunks(work, np.arange(len(tile)), MEASURED_AT_ONCE)
        # A grid point without a surface has normal 0, which resembles nothing.
        height, width = hit.shape
        grid = np.zeros((7 + probe.n_channels, height * width), np.float32)
        struck = np.flatnonzero(hit)
        grid[0:3, struck], grid[3:6, struck] = places.position, places.face_normal
        grid[6, struck] = self._tolerance(places)
        grid[7:, struck] = measured
        self._grid = grid.reshape(-1, height, width)
        noisy = self._noisy()
        for axis in (0, 1):
            self._grid[7:] = np.where(noisy, self._blurred(axis), self._grid[7:])

    def look_up(self, places: Places, pixels: Floats) -> Floats:
        """Openness (C, N) of points seen at continuous pixels (2, N)."""
        height, width = self._shape
        x = np.clip((pixels[0] - np.float32(0.5)) / np.float32(self._stride), 0, width - 1)
        y = np.clip((pixels[1] - np.float32(0.5)) / np.float32(self._stride), 0, height - 1)
        left, top = x.astype(np.int32), y.astype(np.int32)
        fx, fy = x - left, y - top
        right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
        grid = self._grid.reshape(len(self._grid), -1)
        total = np.zeros((self._probe.n_channels, len(x)), np.float32)
        weight_sum = np.zeros(len(x), np.float32)
        inverse_tolerance = 1 / self._tolerance(places)
        for row, column, share in (
            (top, left, (1 - fx) * (1 - fy)),
            (top, right, fx * (1 - fy)),
            (bottom, left, (1 - fx) * fy),
            (bottom, right, fx * fy),
        ):
            near = grid.take(row * width + column, axis=1)
            away = np.abs(dot(near[:3] - places.position, places.face_normal))
            alike = dot(near[3:6], places.face_normal) - np.float32(LEAST_COSINE)
            weight = np.maximum(1 - away * inverse_tolerance, 0)
            weight *= np.maximum(alike, 0) * (share + np.float32(1e-3))
            total += weight * near[7:]
            weight_sum += weight
        openness = total / np.maximum(weight_sum, np.float32(1e-9))
        alone = np.flatnonzero(weight_sum < LEAST_WEIGHT * (1 - LEAST_COSINE))
        if alone.size:
            tile = np.arange(alone.size, dtype=np.int32) % N_TILE
            openness[:, alone] = self._probe.measure(places.take(alone), tile)
        return openness

    def _tolerance(self, places: Places) -> Floats:
        """How far (N,) in metres a neighbour may lie off a point's plane."""
        footprint = np.float32(self._stride * self._pixel_rad) * places.depth_m
        return np.float32(TOLERANCE_M) + np.float32(1.5) * footprint

    def _noisy(self) -> NDArray[np.bool_]:
        """Where to blur (C, h, w): near points whose rays disagree. Sharp shadows stay sharp."""
        noisy = np.ones((self._probe.n_channels, *self._shape), np.bool_)
        if self._probe.settings.shadow_rays > 1 and noisy.size:
            reach = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
            for channel, share in enumerate(self._grid[7:-1]):
                disagree = ((share > 0) & (share < 1)).astype(np.uint8)
                noisy[channel] = cv2.dilate(disagree, reach) > 0
        return noisy

    def _blurred(self, axis: int) -> Floats:
        """One pass of the blur, (C, h, w): a weighted mean along an axis within a surface."""
        grid = self._grid
        total = np.zeros_like(grid[7:])
        weight_sum = np.full(self._shape, 1e-9, np.float32)
        n = self._shape[axis]
        for step, share in BLUR:
            here, there = [slice(None)] * 3, [slice(None)] * 3
            here[1 + axis] = slice(max(-step, 0), n - max(step, 0))
            there[1 + axis] = slice(max(step, 0), n - max(-step, 0))
            a, b = grid[tuple(here)], grid[tuple(there)]
            away = np.abs(dot(b[:3] - a[:3], a[3:6]))
            alike = dot(b[3:6], a[3:6])
            weight = ((away < a[6]) & (alike > LEAST_COSINE)) * np.float32(share)
            total[tuple(here)] += weight * b[7:]
            weight_sum[tuple(here[1:])] += weight
        return total / weight_sum


def _lift(places: Places) -> Floats:
    """How far (N,) off a surface rays start, so that they do not hit what they start from."""
    scale = np.abs(places.position).max(axis=0)
    return np.float32(2e-4) + np.float32(4e-6) * scale
