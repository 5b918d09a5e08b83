"""What each RoI should answer: object or not, which class, from where it is seen.

A viewpoint is a distribution over the M·N cells. In the paper all of it lies in one cell. Two
liberties, both off by default:

- Smoothing: a view between two bins is partly either. The weight of azimuth bin b is von Mises',
  exp(κ cos(azimuth − centre of b)) with κ = 1 / sigma², normalised; of an elevation a Gaussian's.
  It comes from the continuous angle, so it tells more than the bin's number.
- Symmetry: nothing in the image of a bowl tells its azimuth. A class of n-fold symmetry gets the
  mean of the n distributions that look the same, a full one the uniform distribution.

Ignored boxes are neither object nor background: an anchor or RoI that mainly shows one of them
takes no part in any loss.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torchvision.models.detection._utils import BalancedPositiveNegativeSampler, Matcher
from torchvision.ops import box_iou

from imodbatch.core.symmetry import Symmetry, n_fold
from imodbatch.core.viewpoint import FULL_TURN_RAD, ViewGrid
from imodbatch.lab.learning.samples import Sample

TAKES_NO_PART = -1
BACKGROUND = 0
OBJECT = 1


@dataclass(frozen=True)
class ViewTargets:
    """Makes the distribution over the M·N viewpoints that a box should get.

    Attributes:
        grid: the viewpoint grid; M = N = 1 is a detector without viewpoints.
        azimuth_sigma_rad: width of the smoothing over azimuth; 0 = all in the nearest bin.
        elevation_sigma_rad: the same over elevation.
        symmetries: of each class; empty = treat every class as one without symmetry.
    """

    grid: ViewGrid
    azimuth_sigma_rad: float = 0.0
    elevation_sigma_rad: float = 0.0
    symmetries: tuple[Symmetry, ...] = ()

    def __call__(self, sample: Sample) -> Tensor:
        """Give (n, M·N) weights, C order of [elevation, azimuth].

        A row sums to 1, or is all 0 where the viewpoint is not known (and M·N > 1).
        """
        n, cells = len(sample.boxes), self.grid.n_elevations * self.grid.n_azimuths
        if cells == 1:
            return torch.ones(n, 1)
        rows = [
            self._one(float(azimuth), float(elevation), int(class_id)).reshape(-1)
            for azimuth, elevation, class_id in zip(
                sample.azimuth_rad, sample.elevation_rad, sample.class_ids, strict=True
            )
        ]
        weights = np.stack(rows) if rows else np.zeros((0, cells))
        return torch.from_numpy(weights.astype(np.float32))

    def _one(
        self, azimuth_rad: float, elevation_rad: float, class_id: int
    ) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        shape = (self.grid.n_elevations, self.grid.n_azimuths)
        turns = n_fold(self.symmetries[class_id]) if self.symmetries else 1
        if np.isnan(elevation_rad) or (np.isnan(azimuth_rad) and turns is not None):
            return np.zeros(shape)
        if turns is None:
            over_azimuth = np.full(self.grid.n_azimuths, 1 / self.grid.n_azimuths)
        else:
            equal = azimuth_rad + np.arange(turns) * (FULL_TURN_RAD / turns)
            over_azimuth = np.mean([self._over_azimuth(float(turn)) for turn in equal], axis=0)
        return np.outer(self._over_elevation(elevation_rad), over_azimuth)

    def _over_azimuth(self, azimuth_rad: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        if self.azimuth_sigma_rad == 0:
            return _one_hot(int(self.grid.azimuth_bins(azimuth_rad)), self.grid.n_azimuths)
        centres = np.arange(self.grid.n_azimuths) * self.grid.azimuth_step_rad
        exponent = (np.cos(azimuth_rad - centres) - 1) / self.azimuth_sigma_rad**2
        weights = np.exp(exponent - exponent.max())
        return np.asarray(weights / weights.sum())

    def _over_elevation(self, elevation_rad: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        if self.elevation_sigma_rad == 0:
            return _one_hot(int(self.grid.elevation_bins(elevation_rad)), self.grid.n_elevations)
        distance = (elevation_rad - np.array(self.grid.elevations_rad)) / self.elevation_sigma_rad
        exponent = -(distance**2) / 2
        weights = np.exp(exponent - exponent.max())
        return np.asarray(weights / weights.sum())


@dataclass(frozen=True)
class JointViewTargets:
    """The distributions of several grids side by side, for heads that are trained together.

    Attributes:
        parts: of each grid, the main head's first.
    """

    parts: tuple[ViewTargets, ...]

    def __call__(self, sample: Sample) -> Tensor:
        """Give (n, ΣM·N) weights."""
        return torch.cat([part(sample) for part in self.parts], dim=1)


def _one_hot(index: int, n: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    weights = np.zeros(n)
    weights[index] = 1
    return weights


@dataclass(frozen=True)
class ImageTargets:
    """The truth of one image, in pixels of the resized image.

    Attributes:
        boxes: (n, 4) objects that count.
        class_ids: (n,).
        views: (n, M·N) viewpoint distributions.
        ignored_boxes: (m, 4) boxes that count neither way.
    """

    boxes: Tensor
    class_ids: Tensor
    views: Tensor
    ignored_boxes: Tensor


def image_targets(sample: Sample, view_targets: ViewTargets | JointViewTargets) -> ImageTargets:
    """Part a sample's boxes into those that count and those that do not."""
    counts = torch.from_numpy(~np.asarray(sample.is_ignored, dtype=np.bool_))
    boxes = torch.from_numpy(np.asarray(sample.boxes, dtype=np.float32).reshape(-1, 4))
    class_ids = torch.from_numpy(np.asarray(sample.class_ids, dtype=np.int64))
    views = view_targets(sample)
    return ImageTargets(boxes[counts], class_ids[counts], views[counts], boxes[~counts])


@dataclass(frozen=True)
class RoiTargets:
    """The RoIs drawn from one image and what each should answer.

    Attributes:
        rois: (R, 4).
        class_ids: (R,) category, K for background.
        views: (R, M·N) distributions, 0 for background.
        boxes: (R, 4) the object that a RoI is to be refined to; its own box for background.
    """

    rois: Tensor
    class_ids: Tensor
    views: Tensor
    boxes: Tensor


def draw_rois(
    proposals: Tensor, targets: ImageTargets, n_classes: int, n_rois: int, object_fraction: float
) -> RoiTargets:
    """Draw RoIs of one image from proposals and true boxes, with torch's global generator.

    Args:
        proposals: (P, 4).
        targets: of the image.
        n_classes: K.
        n_rois: how many to draw at most.
        object_fraction: largest share of objects among them.

    Returns:
        At most `n_rois` RoIs.
    """
    candidates = torch.cat([proposals, targets.boxes])
    labels, matched = label_candidates(candidates, targets)
    sampler = BalancedPositiveNegativeSampler(n_rois, object_fraction)
    (is_object,), (is_background,) = sampler([labels])
    drawn = torch.nonzero(is_object | is_background).flatten()
    rois, is_object = candidates[drawn], is_object[drawn].bool()
    class_ids = torch.full((len(drawn),), n_classes, dtype=torch.int64)
    views = targets.views.new_zeros((len(drawn), targets.views.shape[1]))
    boxes = rois.clone()
    rows = matched[drawn][is_object]
    class_ids[is_object] = targets.class_ids[rows]
    views[is_object] = targets.views[rows]
    boxes[is_object] = targets.boxes[rows]
    return RoiTargets(rois, class_ids, views, boxes)


def label_candidates(candidates: Tensor, targets: ImageTargets) -> tuple[Tensor, Tensor]:
    """Label RoIs: an object at IoU ≥ 0.5, background below, neither on an ignored box.

    Args:
        candidates: (P, 4).
        targets: of the image.

    Returns:
        (P,) `OBJECT`, `BACKGROUND` or `TAKES_NO_PART`, and (P,) the object's number, 0 if none.
    """
    labels = torch.zeros(len(candidates), dtype=torch.int64)
    matched = torch.zeros(len(candidates), dtype=torch.int64)
    if len(targets.boxes):
        matcher = Matcher(0.5, 0.5, allow_low_quality_matches=False)
        matched = matcher(box_iou(targets.boxes, candidates))
        labels = torch.where(matched >= 0, OBJECT, BACKGROUND)
        matched = matched.clamp(min=0)
    return without_ignored(labels, candidates, targets.ignored_boxes), matched


def without_ignored(labels: Tensor, boxes: Tensor, ignored_boxes: Tensor) -> Tensor:
    """Take background boxes out that lie at least by half in an ignored box or overlap one.

    "Lie in" is the share of the box itself: a small box inside a large ignored one shows only it.
    """
    if not len(ignored_boxes) or not len(boxes):
        return labels
    inside = covered_share(boxes, ignored_boxes).amax(dim=1) >= 0.5
    overlaps = box_iou(boxes, ignored_boxes).amax(dim=1) >= 0.3
    return torch.where((labels == BACKGROUND) & (inside | overlaps), TAKES_NO_PART, labels)


def covered_share(boxes: Tensor, regions: Tensor) -> Tensor:
    """(B, R) share of each box that lies inside each region; 0 for a box without area."""
    starts = torch.maximum(boxes[:, None, :2], regions[None, :, :2])
    ends = torch.minimum(boxes[:, None, 2:], regions[None, :, 2:])
    shared = (ends - starts).clamp(min=0).prod(dim=2)
    areas = (boxes[:, 2:] - boxes[:, :2]).clamp(min=0).prod(dim=1)
    return shared / areas.clamp(min=1e-6)[:, None]
