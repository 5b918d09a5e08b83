"""Another detector's results in place of running one.

Two layouts. COCO results know a class and a score per box; the score becomes the class's entry of
`view_scores`, all others an exact 0 ("nothing said"), and the background gets the rest. Tables (CSV
or Parquet) say the same with class_name and score, or hold whole score vectors over classes and
viewpoints.
"""

from collections.abc import Sequence
from pathlib import Path

from imodbatch.core.errors import ConfigError
from imodbatch.datasets.base import Footage, FrameFile
from imodbatch.datasets.detections import coco, table
from imodbatch.datasets.detections.found import KEY, Grid, ImportedDetections, select
from imodbatch.datasets.names import existing_file
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import DetectionsSection

__all__ = ["ImportedDetections", "detection_files", "read_detections"]


def read_detections(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],
    width_px: int,
    height_px: int,
    grid_size: tuple[int, int],
) -> ImportedDetections:
    """Read the detections of a sequence.

    Args:
        manifest: the split; its `[detections]` says where they are and what they mean.
        sequence: one of its sequences.
        frames: the frames of the sequence's slice.
        width_px: width of the colour images; boxes are cut at their border.
        height_px: their height.
        grid_size: (M, N) elevations and azimuths of the pipeline's `[viewpoint]`.

    Returns:
        Detections in the file's order. View scores have K·M·N columns where `[detections]` declares
        the grid, else K (K = number of classes). What gave no detection is counted under "other
        sequences", "other frames", "unknown frames", "other classes", "no area" or "outside image",
        the first of them that applies; detections and counts add up to the entries of the file.

    Raises:
        ConfigError: no `[detections]`; its grid is not the pipeline's, or the file has no
            viewpoints; a rename to an unknown class.
        DataError: a file is missing or damaged; classes or frames cannot be told; a box or score is
            not finite or impossible; a frame is unknown and `unknown_frames` is "error".
    """
    section = _section(manifest)
    grid = _grid(manifest, section, grid_size)
    footage = Footage(manifest, sequence, frames, (width_px, height_px))
    if section.format == "coco":
        found = coco.read_found(footage, section)
    else:
        found = table.read_found(footage, section, grid)
    return select(found, section.unknown_frames, footage.size_px)


def detection_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """All files that `read_detections` reads, sorted, for provenance.

    With COCO results this includes the file that may say which image and category an id means.

    Raises:
        ConfigError: the manifest has no `[detections]`.
        DataError: a file is missing.
    """
    section = _section(manifest)
    path = existing_file(manifest.path_in(sequence, section.path), KEY)
    beside = coco.files_beside(manifest, section, sequence) if section.format == "coco" else []
    return sorted({path, *beside})


def _section(manifest: Manifest) -> DetectionsSection:
    if manifest.detections is None:
        raise ConfigError(
            f"manifest {manifest.name}: has no [detections]. Add one with format and path, or let "
            "a detector run (detect.weights)."
        )
    return manifest.detections


def _grid(manifest: Manifest, section: DetectionsSection, grid_size: tuple[int, int]) -> Grid:
    """The grid of the file's score vectors: 1x1 or the pipeline's."""
    grid = Grid(
        len(manifest.classes), max(1, len(section.elevations_deg)), max(1, section.n_azimuths)
    )
    own = (grid.n_elevations, grid.n_azimuths)
    if own not in ((1, 1), grid_size):
        raise ConfigError(
            f"manifest {manifest.name}: [detections] has {own[0]} elevations x {own[1]} azimuths, "
            f"the pipeline's [viewpoint] {grid_size[0]} x {grid_size[1]}. Set viewpoint.n_azimuths "
            "and viewpoint.elevations_deg to the detector's, or correct [detections]."
        )
    if own != (1, 1) and section.format == "coco":
        raise ConfigError(
            f"manifest {manifest.name}: COCO results hold no viewpoints, but [detections] declares "
            f"{own[0]} x {own[1]}. Take n_azimuths and elevations_deg out, or give a Parquet file."
        )
    return grid
