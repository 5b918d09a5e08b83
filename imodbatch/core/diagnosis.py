"""What holds fusion back, with a figure for each cause.

A box that is right can be of no use to its neighbours when it lands in another voxel, and a box
that is wrong can borrow their score when it lands in the same one. The causes, per class:

- ``no_box``: share of annotations that no box overlaps by 0.3 or more (the detector missed it).
- ``loose_box``: share whose best box overlaps by 0.3 or more but less than the IoU asked.
- ``unplaced``: share of sightings of instances without a place (no depth, no pose): they keep their
  single-view score and rank below all fused ones.
- ``split_pairs``: share of pairs of sightings of one instance that lie in different voxels.
- ``voxels_per_instance``: mean number of voxels over which an instance's sightings are spread.
- ``place_spread_m``: median distance of a sighting from its instance's median place.
- ``behind_share``: share of sightings more than 3 cm behind that place, seen from the camera: a
  mug's far inner wall, or the background beside it.
- ``false_in_true_voxel``: share of boxes on no annotation that lie in a voxel which also holds a
  sighting of the class, and so share its score.
- ``ap_iou_30``, ``ap_oracle_voxels``: AP of imod if loose boxes counted, and if each instance had
  one voxel of its own: what loose boxes and voxels cost.
- ``ap_perfect_ranking``: AP of the same boxes if every right one outranked every wrong one; the
  rest up to 1 is what missed objects cost, and no fusion of these boxes can pass it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.boxes import iou_matrix
from imodbatch.core.scoring import Candidates, Truth, alike

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
LOOSE_IOU = 0.3
BEHIND_M = 0.03


@dataclass(frozen=True)
class Overlaps:
    """Best overlaps: per annotation (A,), per candidate (D,) and its annotation."""

    annotation_iou: Array
    candidate_iou: Array
    candidate_annotation: Ints


def overlaps(candidates: Candidates, truth: Truth) -> Overlaps:
    """Largest IoU of each annotation and each candidate within image and class."""
    annotation_iou = np.zeros(len(truth.image))
    candidate_iou = np.zeros(len(candidates.image))
    partner = np.full(len(candidates.image), -1, dtype=np.int64)
    for rows, true_rows in alike(candidates, truth):
        iou = iou_matrix(candidates.boxes[rows], truth.boxes[true_rows])
        annotation_iou[true_rows] = iou.max(axis=0)
        candidate_iou[rows] = iou.max(axis=1)
        partner[rows] = np.where(iou.max(axis=1) > 0, true_rows[iou.argmax(axis=1)], -1)
    return Overlaps(annotation_iou, candidate_iou, partner)


@dataclass(frozen=True)
class Spread:
    """How the S sightings of instances scatter."""

    split_pairs: float
    n_pairs: int
    voxels_per_instance: float
    n_instances: int
    place_spread_m: float
    behind_share: float
    n_sightings: int


def spread(instance: Ints, voxel: Ints, xyz_world: Array, camera_world: Array) -> Spread:
    """Scatter of sightings about their instances.

    Args:
        instance: (S,) number of the instance seen.
        voxel: (S,) number of the voxel.
        xyz_world: (S, 3) places, metres.
        camera_world: (S, 3) camera centres.
    """
    n_pairs, n_split = 0, 0
    distance, behind, n_voxels = [], [], []
    for number in np.unique(instance):
        rows = np.flatnonzero(instance == number)
        shares = np.unique(voxel[rows], return_counts=True)[1]
        pairs = len(rows) * (len(rows) - 1) // 2
        n_pairs += pairs
        n_split += pairs - int((shares * (shares - 1) // 2).sum())
        n_voxels.append(len(shares))
        center = np.median(xyz_world[rows], axis=0)
        ray = xyz_world[rows] - camera_world[rows]
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        offset = xyz_world[rows] - center
        distance += np.linalg.norm(offset, axis=-1).tolist()
        behind += ((offset * ray).sum(axis=-1) > BEHIND_M).tolist()
    nan = float("nan")
    return Spread(
        n_split / n_pairs if n_pairs else nan,
        n_pairs,
        float(np.mean(n_voxels)) if n_voxels else nan,
        len(n_voxels),
        float(np.median(distance)) if distance else nan,
        float(np.mean(behind)) if behind else nan,
        len(instance),
    )
