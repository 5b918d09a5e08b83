"""A SIMULATED detector: a noise model of boxes and of softmax scores over class and viewpoint.

No network runs. The model is meant to err the way a modest viewpoint detector does, not to suit
any method of fusion; its numbers were set once by looking at single frames only.

- Finding. An object is found with a chance that rises with the visible size. Its box is the true
  one with edges off by a few percent, now and then so loose that IoU falls below .5. Some objects
  get a second, looser box.
- Classes. Logits: the true class's strength grows with size and with what is visible; classes
  that the object resembles from that side (`catalogue.resemblance`) get theirs; then noise, part
  of it bound to the object and the view (`habits`), part fresh in every frame. A softmax with the
  background follows.
- Viewpoints. Given a class, the azimuth is a peak (von Mises) at a bin which is right, one off,
  opposite, or anything (`habits.ViewErrors`); the error is bound to the view or fresh by a coin;
  a lower peak stands opposite. Symmetric classes have no peak: all azimuths are alike. For a wrong
  class the peak stands at the view of that class that this view is taken for
  (`habits.wrong_class_views`). The elevation is a bell round the true one.
- False positives. Clutter: a few spots on walls, floor and furniture, always the same, look like
  one class each; in frames that see them they fire by chance, with a viewpoint that is fresh each
  time. And 3 to 6 boxes per frame anywhere, with low scores.

Scores of a box add up to 1 with the background's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import apply, invert
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.analytic.catalogue import CLASSES, SYMMETRIC, resemblance
from imodbatch.lab.analytic.detector_model import DetectorModel
from imodbatch.lab.analytic.habits import Peculiarities, wrong_class_views
from imodbatch.lab.analytic.truth import TrueObject

Array = NDArray[np.float64]
K = len(CLASSES)


@dataclass(frozen=True, eq=False)
class Detection:
    """A box and its softmax.

    Attributes:
        box_px: (4,) x0, y0, x1, y1, continuous pixels, within the image.
        view_scores: (K, M, N) float32.
        background_score: what is missing to 1.
        object_index: the object it was made from, -1 = a false positive. Never written to disk.
    """

    box_px: Array
    view_scores: NDArray[np.float32]
    background_score: float
    object_index: int = -1


class SimulatedDetector:
    """The detector on one sequence: habits of the dataset, peculiarities of the sequence."""

    def __init__(
        self,
        *,
        camera: PinholeCamera,
        grid: ViewGrid,
        n_objects: int,
        clutter_world: Array,
        seed: int,
        rng: np.random.Generator,
        model: DetectorModel | None = None,
    ) -> None:
        """Draw what stays the same.

        Args:
            camera: of the images.
            grid: of the scores.
            n_objects: objects in the sequence's world.
            clutter_world: (C, 3) places that look like some object, metres.
            seed: of the dataset; decides the network's habits.
            rng: of the sequence.
            model: the noise model; None = the defaults.
        """
        self.camera, self.grid, self.rng = camera, grid, rng
        self.model = model or DetectorModel()
        self.wrong_views = wrong_class_views(
            np.random.default_rng([seed, 0]), grid.n_azimuths, self.model.follow_fraction
        )
        self.odd = Peculiarities.draw(rng, n_objects, grid, self.model.view_errors)
        self.clutter_world = clutter_world
        self.clutter_class = rng.integers(K, size=len(clutter_world))
        self.clutter_side_m = rng.uniform(0.08, 0.2, size=len(clutter_world))

    def detect(
        self, seen: Sequence[TrueObject], depth_m: Array, world_from_cam: Array
    ) -> list[Detection]:
        """The detections of one frame.

        Args:
            seen: the objects in it.
            depth_m: (H, W) exact depth, to know which clutter is in view.
            world_from_cam: 4x4.
        """
        found = [true for true in seen if self.rng.random() < self._chance_to_find(true)]
        doubled = [true for true in found if self.rng.random() < self.model.double_chance]
        return [
            *(self._detect_object(true) for true in found),
            *(self._double(true) for true in doubled),
            *self._clutter(depth_m, world_from_cam),
            *(self._random_box() for _ in range(self.rng.integers(3, 7))),
        ]

    def _chance_to_find(self, true: TrueObject) -> float:
        excess = (np.sqrt(true.n_pixels) - self.model.half_found_px) / self.model.found_slope_px
        return float(self.model.most_found / (1 + np.exp(-excess)))

    def _detect_object(self, true: TrueObject) -> Detection:
        loose = self.rng.random() < self.model.loose_chance
        sigma = self.model.loose_sigma if loose else self.model.box_sigma
        return self._object_box(true, sigma, self.model.background)

    def _double(self, true: TrueObject) -> Detection:
        return self._object_box(true, self.model.double_sigma, self.model.doubtful_background)

    def _object_box(self, true: TrueObject, sigma: float, background: float) -> Detection:
        box = np.array(true.box_px)
        size = np.tile(box[2:] - box[:2], 2)
        scores = self._softmax(self._object_logits(true), background)
        peaks = self._object_peaks(true)
        return self._detection(
            box + self.rng.normal(size=4) * sigma * size,
            scores,
            self._views(peaks, true.elevation_rad),
            true.object_index,
        )

    def _object_logits(self, true: TrueObject) -> Array:
        """Class logits (K,) before fresh noise."""
        model, view = self.model, self._view_of(true)
        size = np.sqrt(true.n_pixels)
        clarity = (1 - np.exp(-size / model.strength_size_px)) * np.sqrt(true.visible_fraction)
        logits = model.bound_sigma * self.odd.class_logits[view]
        logits += model.resemblance * clarity * resemblance(true.class_id, true.azimuth_rad)
        logits[true.class_id] += model.strength * clarity
        return np.asarray(logits)

    def _object_peaks(self, true: TrueObject) -> NDArray[np.int64]:
        """The azimuth bin (K,) that each class would be seen from."""
        _, _, azimuth_bin = view = self._view_of(true)
        fresh = self.model.view_errors.draw(self.rng, self.grid.n_azimuths, ())
        is_bound = self.rng.random() < self.model.bound_view_chance
        error = self.odd.view_errors[view] if is_bound else fresh
        peaks = self.wrong_views[true.class_id, :, azimuth_bin] + error
        peaks[true.class_id] = azimuth_bin + error
        return np.asarray(peaks % self.grid.n_azimuths)

    def _view_of(self, true: TrueObject) -> tuple[int, int, int]:
        """Object, elevation bin and azimuth bin in the object's frame: what habits go by."""
        elevation_bin = int(self.grid.elevation_bins(true.elevation_rad))
        return true.object_index, elevation_bin, int(self.grid.azimuth_bins(true.azimuth_rad))

    def _clutter(self, depth_m: Array, world_from_cam: Array) -> list[Detection]:
        """Spots in view that fire."""
        points_cam = apply(invert(world_from_cam), self.clutter_world)
        pixels = self.camera.project(points_cam)
        found = []
        for spot, (point_cam, pixel) in enumerate(zip(points_cam, pixels, strict=True)):
            fires = self.rng.random() < self.model.clutter_chance
            if fires and self._is_in_view(pixel, point_cam[2], depth_m):
                side = self.clutter_side_m[spot] * self.camera.fx_px / point_cam[2]
                logits = np.zeros(K)
                logits[self.clutter_class[spot]] = self.model.clutter_strength
                box = np.r_[pixel - side / 2, pixel + side / 2]
                box += self.rng.normal(size=4) * self.model.box_sigma * side
                found.append(self._false_positive(box, logits, self.model.doubtful_background))
        return found

    def _is_in_view(self, pixel: Array, z_m: float, depth_m: Array) -> bool:
        """Whether a point at a pixel (2,) and z-depth lies on the surface that shows there."""
        size = (self.camera.width_px, self.camera.height_px)
        if not (np.isfinite(pixel).all() and (pixel >= 0).all() and (pixel < size).all()):
            return False
        column, row = np.floor(pixel).astype(np.int64)
        return bool(abs(depth_m[row, column] - z_m) < 0.02 + 0.03 * z_m)

    def _random_box(self) -> Detection:
        rng, image = self.rng, np.array([self.camera.width_px, self.camera.height_px])
        side, aspect = np.exp(rng.uniform(np.log(12), np.log(70))), np.exp(rng.normal() * 0.3)
        half = np.array([side / aspect, side * aspect]) / 2
        center = half + rng.random(2) * (image - 2 * half)
        logits = rng.normal(size=K) * self.model.bound_sigma
        box = np.r_[center - half, center + half]
        return self._false_positive(box, logits, self.model.random_background)

    def _false_positive(self, box: Array, logits: Array, background: float) -> Detection:
        """A box of nothing, seen from anywhere."""
        peaks = self.rng.integers(self.grid.n_azimuths, size=K)
        low, high = min(self.grid.elevations_rad), max(self.grid.elevations_rad)
        views = self._views(peaks, float(self.rng.uniform(low, high)))
        return self._detection(box, self._softmax(logits, background), views, -1)

    def _softmax(self, logits: Array, background: float) -> Array:
        """Scores (K + 1,) of classes and, last, of the background, with fresh noise."""
        noisy = np.r_[logits, background] + self.rng.normal(size=K + 1) * self.model.fresh_sigma
        weights = np.exp(noisy - noisy.max())
        return np.asarray(weights / weights.sum())

    def _views(self, peaks: NDArray[np.int64], elevation_rad: float) -> Array:
        """How each class's score is spread over views, (K, M, N) with sums 1.

        Args:
            peaks: (K,) azimuth bin seen from.
            elevation_rad: true elevation.
        """
        model, grid = self.model, self.grid
        turn = (np.arange(grid.n_azimuths) - peaks[:, None]) * grid.azimuth_step_rad
        peak = np.exp(model.concentration * (np.cos(turn) - 1))
        opposite = np.exp(model.concentration * (-np.cos(turn) - 1))
        azimuths = peak + model.opposite_peak * opposite + model.floor
        azimuths[sorted(SYMMETRIC)] = 1.0
        middle = elevation_rad + np.deg2rad(self.rng.normal() * model.elevation_error_deg)
        off = (np.array(grid.elevations_rad) - middle) / np.deg2rad(model.elevation_sigma_deg)
        elevations = np.exp(-0.5 * off**2) + model.floor
        noise = self.rng.lognormal(
            sigma=model.view_sigma, size=(K, grid.n_elevations, grid.n_azimuths)
        )
        views = azimuths[:, None, :] * elevations[:, None] * noise
        return np.asarray(views / views.sum(axis=(1, 2), keepdims=True))

    def _detection(self, box: Array, scores: Array, views: Array, object_index: int) -> Detection:
        """Put together; the box is clipped to the image and is at least 2 pixels wide and high."""
        limit = np.array([self.camera.width_px, self.camera.height_px], dtype=np.float64)
        first = np.clip(np.minimum(box[:2], box[2:]), 0, limit - 2)
        last = np.minimum(np.maximum(np.maximum(box[:2], box[2:]), first + 2), limit)
        view_scores = (scores[:K, None, None] * views).astype(np.float32)
        background = 1.0 - float(view_scores.sum(dtype=np.float64))
        return Detection(np.r_[first, last], view_scores, background, object_index)
