"""One walk through one random world: everything that is true of it, and what its detector says.

Every purpose has its own random numbers, seeded by dataset, sequence and purpose: a sequence does
not change when another is added, nor the world when the detector is.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import apply
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.analytic.detector import Detection, SimulatedDetector
from imodbatch.lab.analytic.path import PATHS
from imodbatch.lab.analytic.render import Trace, shade, trace
from imodbatch.lab.analytic.sensor import DepthNoise, disturb
from imodbatch.lab.analytic.truth import TrueObject, true_objects
from imodbatch.lab.analytic.world import BACKGROUND, World, random_world

Array = NDArray[np.float64]
CAMERA = PinholeCamera(320, 240, 290.0, 290.0, 160.0, 120.0)
GRID = ViewGrid(16, (np.deg2rad(10.0), np.deg2rad(30.0), np.deg2rad(50.0)))
FEWEST_OBJECTS, MOST_OBJECTS = 6, 8
WORLD_STREAM, PATH_STREAM, SENSOR_STREAM, DETECTOR_STREAM, CLUTTER_STREAM = range(5)


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame: truth, measurement and detections.

    Attributes:
        color: (H, W, 3) uint8 RGB.
        exact_depth_m: (H, W) z-depth, NaN = nothing there.
        measured_depth_m: (H, W) the same as the sensor gives it.
        seen: the objects that show.
        detections: what the simulated detector says.
    """

    color: NDArray[np.uint8]
    exact_depth_m: Array
    measured_depth_m: Array
    seen: list[TrueObject]
    detections: list[Detection]


@dataclass(frozen=True, eq=False)
class Walk:
    """A sequence before its frames are rendered.

    Attributes:
        sequence_id: ``walk_1``, ``walk_2``, …
        world: the scene.
        world_from_cam: (F, 4, 4).
        seed: of the dataset.
        index: ordinal of the sequence.
    """

    sequence_id: str
    world: World
    world_from_cam: Array
    seed: int
    index: int

    def random(self, stream: int) -> np.random.Generator:
        """This sequence's random numbers for one purpose."""
        return np.random.default_rng([self.seed, 1 + self.index, stream])

    def frames(self, noise: DepthNoise | None = None) -> Iterator[Frame]:
        """Render frame by frame, in order; None = the default noise."""
        detector, sensor = self._detector(), self.random(SENSOR_STREAM)
        for world_from_cam in self.world_from_cam:
            traced = trace(self.world, CAMERA, world_from_cam)
            seen = true_objects(self.world, world_from_cam, traced)
            yield Frame(
                shade(self.world, CAMERA, world_from_cam, traced),
                traced.depth_m,
                disturb(traced.depth_m, sensor, noise or DepthNoise()),
                seen,
                detector.detect(seen, traced.depth_m, world_from_cam),
            )

    def _detector(self) -> SimulatedDetector:
        rng = self.random(DETECTOR_STREAM)
        n_objects = len(self.world.objects)
        return SimulatedDetector(
            camera=CAMERA,
            grid=GRID,
            n_objects=n_objects,
            clutter_world=self._clutter(),
            seed=self.seed,
            rng=rng,
        )

    def _clutter(self, n_spots: int = 5) -> Array:
        """Places (n_spots, 3) on surfaces other than objects, each seen by some frame."""
        rng = self.random(CLUTTER_STREAM)
        chosen = self.world_from_cam[rng.integers(len(self.world_from_cam), size=n_spots)]
        traces = [trace(self.world, CAMERA, world_from_cam) for world_from_cam in chosen]
        places = [_background_point(rng, *pair) for pair in zip(traces, chosen, strict=True)]
        return np.stack(places)


def make_walk(seed: int, index: int, n_frames: int) -> Walk:
    """The sequence of an ordinal (from 0): its world and path, nothing rendered yet."""
    world_rng = np.random.default_rng([seed, 1 + index, WORLD_STREAM])
    path_rng = np.random.default_rng([seed, 1 + index, PATH_STREAM])
    n_objects = int(world_rng.integers(FEWEST_OBJECTS, MOST_OBJECTS + 1))
    world = random_world(world_rng, n_objects)
    path = PATHS[index % len(PATHS)](path_rng, n_frames)
    return Walk(f"walk_{index + 1}", world, path, seed, index)


def _background_point(rng: np.random.Generator, traced: Trace, world_from_cam: Array) -> Array:
    """A surface point (3,) in the world, at a random pixel that shows no object."""
    rows, columns = np.nonzero((traced.owner == BACKGROUND) & np.isfinite(traced.depth_m))
    pick = rng.integers(len(rows))
    row, column = rows[pick], columns[pick]
    point_cam = CAMERA.unproject([column + 0.5, row + 0.5], traced.depth_m[row, column])
    return apply(world_from_cam, point_cam)
