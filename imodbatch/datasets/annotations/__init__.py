"""True boxes of a data set, whatever their format, as rows of the `annotations` table."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from imodbatch.datasets.annotations import coco, uw_labelled_cloud, uw_mat, voc, yolo
from imodbatch.datasets.annotations.entries import Entry, to_reading
from imodbatch.datasets.base import FrameFile, Reading
from imodbatch.manifest import Manifest, SequenceSection

Reader = Callable[[Manifest, SequenceSection, Sequence[FrameFile], int, int], Iterator[Entry]]

READERS: dict[str, Reader] = {
    "coco": coco.read_entries,
    "voc": voc.read_entries,
    "yolo": yolo.read_entries,
    "uw_mat": uw_mat.read_entries,
    "uw_labelled_cloud": uw_labelled_cloud.read_entries,
    "none": lambda *_: iter(()),
}
FILES: dict[str, Callable[[Manifest, SequenceSection], list[Path]]] = {
    "coco": coco.files,
    "voc": voc.files,
    "yolo": yolo.files,
    "uw_mat": uw_mat.files,
    "uw_labelled_cloud": uw_labelled_cloud.files,
    "none": lambda *_: [],
}


def read_annotations(
    manifest: Manifest,
    sequence: SequenceSection,
    frames: Sequence[FrameFile],
    width_px: int,
    height_px: int,
) -> Reading:
    """Read the true boxes of a sequence.

    Args:
        manifest: the split; its `[annotations]` says where they are and what they mean.
        sequence: one of its sequences.
        frames: the frames of the sequence's slice.
        width_px: width of the colour images; boxes are cut at their border.
        height_px: their height.

    Returns:
        Rows by rising frame_index and annotation_index (from 0 in each frame, in the file's order)
        with class_id, the box in continuous pixels, is_ignored, is_crowd and instance_id. What gave
        no row is counted under "other frames", "unknown class", "outside image" or "no area", the
        first of them that applies; rows and counts add up to the entries of the files. Boxes that
        are derived from a cloud may have "no pose", or be of a "cluster too small", too.

    Raises:
        ConfigError: a rename to an unknown class, a path that cannot be meant, no class names.
        DataError: a file is missing or damaged, a name fits several frames, a coordinate is not
            finite, an image has another size; an unknown class or a box outside the image where the
            manifest makes them errors.
    """
    entries = READERS[manifest.annotations.format](manifest, sequence, frames, width_px, height_px)
    return to_reading(manifest, entries, width_px, height_px)


def annotation_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """All files that `read_annotations` reads, sorted, for provenance.

    Raises:
        ConfigError: the path cannot be meant.
        DataError: the file or folder is missing.
    """
    return sorted(FILES[manifest.annotations.format](manifest, sequence))
