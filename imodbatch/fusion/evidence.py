"""From tables to the arrays that fusion takes: what `fuse` and fusing again in `scoring` share."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.fusion import (
    MODES,
    FusedScores,
    Method,
    Mode,
    Sightings,
    absent_score,
    best_of_moment,
    fuse,
    marginal,
)
from imodbatch.core.voxels import group_labels
from imodbatch.settings.config import FuseConfig, ViewpointConfig
from imodbatch.tables.columns import column, stacked, view_scores_of

OFFLINE_SUFFIX = "_offline"


def variants(config: FuseConfig) -> dict[str, tuple[Method, Mode]]:
    """The METHOD names that a configuration gives; single view has no modes."""
    modes: tuple[Mode, ...] = MODES if config.mode == "both" else (config.mode,)
    found: dict[str, tuple[Method, Mode]] = {}
    for mode, method in product(modes, config.methods):
        is_offline = mode == "offline" and method != "single"
        found.setdefault(method + (OFFLINE_SUFFIX if is_offline else ""), (method, mode))
    return found


def shaped_scores(
    detections: pa.Table, n_classes: int, viewpoint: ViewpointConfig
) -> NDArray[np.float32]:
    """Score vectors as (n, K, M, N); M = N = 1 for a detector without viewpoints.

    Raises:
        DataError: the vectors fit neither 1×1 nor the viewpoint grid.
    """
    flat = view_scores_of(detections, n_classes)
    n_elevations, n_azimuths = len(viewpoint.elevations_deg), viewpoint.n_azimuths
    if flat.shape[-1] == 1:
        return flat[..., None]
    if flat.shape[-1] != n_elevations * n_azimuths:
        raise DataError(
            f"detections hold {flat.shape[-1]} scores per class, expected 1 or "
            f"{n_elevations}×{n_azimuths}. Set viewpoint.n_azimuths and viewpoint.elevations_deg "
            "to the detector's."
        )
    return flat.reshape(*flat.shape[:-1], n_elevations, n_azimuths)


def voxels_of(placed: pa.Table) -> NDArray[np.int64]:
    """Voxel indices (V, 3) of placed observations."""
    return stacked(placed, "voxel_i", "voxel_j", "voxel_k").astype(np.int64)


def places_of(observations: pa.Table) -> NDArray[np.float64]:
    """World places (V, 3) of observations, NaN where unknown."""
    return stacked(observations, "x_m", "y_m", "z_m")


def sightings_of(
    placed: pa.Table,
    scores: NDArray[np.float32],
    voxels: NDArray[np.int64],
    moments: NDArray[np.int64],
) -> Sightings:
    """Placed observations as fusion takes them.

    Args:
        placed: V rows of the observations table.
        scores: (V, K, M, N).
        voxels: (V, …) whatever tells the voxels apart.
        moments: (V,) frame numbers.
    """
    return Sightings(
        frame=moments.astype(np.int64),
        voxel=group_labels(voxels),
        azimuth_bin=column(placed, "azimuth_bin").astype(np.int64),
        elevation_bin=column(placed, "elevation_bin").astype(np.int64),
        view_scores=scores,
    )


def fuse_methods(sightings: Sightings, config: FuseConfig) -> dict[Method, dict[Mode, FusedScores]]:
    """Scores of the placed boxes under every method of a configuration, in both modes."""
    return {
        method: fuse(sightings, method, config.cell_reduce, config.probability_floor)
        for method in config.methods
    }


def taken(
    fused: Mapping[Method, Mapping[Mode, FusedScores]],
    sightings: Sightings,
    survives: NDArray[np.bool_],
    config: FuseConfig,
) -> dict[str, FusedScores]:
    """What boxes take of their voxels' scores: all, or one per voxel, frame and class.

    Args:
        fused: of `fuse_methods`.
        sightings: the placed boxes, V of them.
        survives: (V, K) classes that each box is a candidate for.
        config: says who takes the score.

    Returns:
        METHOD name → scores; those who stand aside are scored as if nothing had been seen.
    """
    found = {name: fused[method][mode] for name, (method, mode) in variants(config).items()}
    if config.takers == "all":
        return found
    stands = best_of_moment(sightings, survives)
    for name, (method, _) in variants(config).items():
        if method != "single":
            absent = absent_score(method, found[name].n_cells, config.probability_floor)
            score = np.where(stands, found[name].score, absent)
            found[name] = replace(found[name], score=score)
    return found


def everywhere(
    fused: FusedScores, placed: NDArray[np.int64], scores: NDArray[np.float32]
) -> FusedScores:
    """Scores of all boxes (n, K): fused where placed, single-view elsewhere."""
    score = marginal(scores)
    pose_bin = np.full(score.shape, -1, dtype=np.int64)
    n_cells = np.zeros(score.shape, dtype=np.int64)
    score[placed], pose_bin[placed], n_cells[placed] = fused.score, fused.pose_bin, fused.n_cells
    return FusedScores(score, pose_bin, n_cells)


def survival(detections: pa.Table, n_classes: int) -> NDArray[np.bool_]:
    """(n, K): for which classes each box survived NMS."""
    lists = detections["class_ids"].combine_chunks()
    survives = np.zeros((detections.num_rows, n_classes), dtype=np.bool_)
    lengths = np.asarray(lists.value_lengths()).astype(np.int64)
    survives[np.repeat(np.arange(len(lists)), lengths), np.asarray(lists.flatten())] = True
    return survives
