"""Fusion against a plain Python loop over its formula, and matching against faster-coco-eval.

Prints ratios measured in one run; `make bench`. No threshold is tested here.
"""

import time
from collections.abc import Callable

import numpy as np

from imodbatch.core.fusion import Sightings, fuse, marginal
from imodbatch.core.precision import ap_voc07_11pt
from imodbatch.core.scoring import Candidates, ScoredBoxes, Truth, average_precisions, match_all
from imodbatch.scoring.coco import coco_ap


def seconds(function: Callable[[], object], repeats: int = 3) -> float:
    """Best time of a few runs."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - start)
    return best


def loop_imod(sightings: Sightings) -> np.ndarray:
    """The online rule, slot by slot, with ``last`` in every slot."""
    n_azimuths = sightings.view_scores.shape[-1]
    slots: dict[tuple[int, int, int], np.ndarray] = {}
    h = np.zeros(marginal(sightings.view_scores).shape)
    for v in np.argsort(sightings.frame, kind="stable"):
        voxel, a, e = (
            int(x[v]) for x in (sightings.voxel, sightings.azimuth_bin, sightings.elevation_bin)
        )
        slots[voxel, a, e] = sightings.view_scores[v, :, e, :].astype(np.float64)
        poses = np.zeros((h.shape[1], n_azimuths))
        for (where, azimuth, _), scores in slots.items():
            if where == voxel:
                for d in range(n_azimuths):
                    poses[:, d] += scores[:, (azimuth + d) % n_azimuths]
        h[v] = poses.max(axis=1)
    return h


def main() -> None:
    """Print the figures."""
    rng = np.random.default_rng(0)
    n, n_classes, n_elevations, n_azimuths = 3000, 17, 3, 16
    sightings = Sightings(
        frame=np.arange(n),  # one box a frame: the loop knows no "best of a frame"
        voxel=rng.integers(0, 100, n),
        azimuth_bin=rng.integers(0, n_azimuths, n),
        elevation_bin=rng.integers(0, n_elevations, n),
        view_scores=rng.random((n, n_classes, n_elevations, n_azimuths), dtype=np.float32),
    )
    ours = fuse(sightings, "imod", "last")["online"].score
    difference = np.abs(ours - loop_imod(sightings)).max()
    fast = seconds(lambda: fuse(sightings, "imod", "last"))
    slow = seconds(lambda: loop_imod(sightings), repeats=1)
    print(
        f"imod, {n:,} boxes of 17×3×16 scores: {n / fast:,.0f} boxes/s; python loop "
        f"{n / slow:,.0f} boxes/s; ratio {slow / fast:.1f}; largest difference {difference:.1e}"
    )

    n_images, per_image = 2000, 20
    image = np.repeat(np.arange(n_images), per_image)
    corner = rng.random((len(image), 2)) * 400
    boxes = np.concatenate([corner, corner + 20 + rng.random((len(image), 2)) * 60], axis=1)
    class_id, scores = rng.integers(0, n_classes, len(image)), rng.random(len(image))
    true = rng.random(len(image)) < 0.3
    no = np.zeros(true.sum(), dtype=bool)
    truth = Truth(image[true], class_id[true], boxes[true] + 3, no, no)
    candidates = Candidates(image, class_id, boxes)

    def own() -> object:
        found = match_all(candidates, scores, truth, 0.5, "voc")
        counted = truth.counted(n_classes)
        boxes = ScoredBoxes.ranked(scores, found.outcome, candidates.class_id, candidates.image)
        return average_precisions(boxes, counted, ap_voc07_11pt)

    def library() -> object:
        return coco_ap(candidates, scores, truth, n_classes)

    a, b = seconds(own), seconds(library)
    print(
        f"AP of {len(image):,} boxes: own, one IoU {a:.2f} s; faster-coco-eval, ten IoUs "
        f"{b:.2f} s; ratio {a / b:.2f}"
    )


if __name__ == "__main__":
    main()
