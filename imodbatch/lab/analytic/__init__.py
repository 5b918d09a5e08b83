"""An analytic scene: a small RGB-D dataset whose truth is exact, ray cast in numpy alone.

The idea: where every surface has a formula, depth, silhouettes and viewpoints are known to the last
digit, and what fusion makes of a detector's scores can be held against them. The detector is
SIMULATED by a stated noise model (`detector`): this tests the arithmetic of fusion, no detector.

    shapes     a ray meets a sphere, box, cylinder, capsule, or the walls of a room
    catalogue  the five classes: their shapes, paint, symmetry, and which view looks like what
    world      furniture and objects at random places
    path       camera paths: round the table, or towards it
    render     rays → exact depth, visible surface, colour
    truth      exact boxes, visibility and viewpoints of the objects in a frame
    sensor     the depth camera's noise and holes
    detector   boxes and score vectors of the simulated detector (`detector_model`, `habits`)
    sequence   one walk: world, path, frames, all from one seed
    files      how a frame, a trajectory, annotations and detections are written
    dataset    `write_dataset`: everything on disk, whole or not at all
"""

from imodbatch.lab.analytic.dataset import write_dataset

__all__ = ["write_dataset"]
