"""True boxes of a data set, whatever their format, as rows of the `annotations` table."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from imodbatch.datasets.annotations import coco, uw_labelled_cloud, uw_mat, voc, yolo
from imodbatch.datasets.annotations.entries import Entry, annotation_file, to_reading
from imodbatch.datasets.annotations.per_image import label_files
from imodbatch.datasets.base import Footage, FrameFile, Reading
from imodbatch.settings.manifest import Manifest, SequenceSection

Files = Callable[[Manifest, SequenceSection], list[Path]]


@dataclass(frozen=True)
class Format:
    """A format of annotations: the files of a sequence, and the boxes in them."""

    files: Files
    read_entries: Callable[[Footage], Iterator[Entry]]


def _one_file(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    return [annotation_file(manifest, sequence)]


def _labels(suffix: str) -> Files:
    return lambda manifest, sequence: [f.path for f in label_files(manifest, sequence, suffix)]


FORMATS: dict[str, Format] = {
    "coco": Format(_one_file, coco.read_entries),
    "voc": Format(_labels(voc.SUFFIX), voc.read_entries),
    "yolo": Format(yolo.files, yolo.read_entries),
    "uw_mat": Format(_one_file, uw_mat.read_entries),
    "uw_labelled_cloud": Format(uw_labelled_cloud.files, uw_labelled_cloud.read_entries),
    "none": Format(lambda *_: [], lambda _: iter(())),
}


def read_entries(footage: Footage) -> Iterator[Entry]:
    """The true boxes as the files have them, with those of other frames and classes.

    Raises:
        ImodError: as `read_annotations`.
    """
    return FORMATS[footage.manifest.annotations.format].read_entries(footage)


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
    footage = Footage(manifest, sequence, frames, (width_px, height_px))
    return to_reading(footage, read_entries(footage))


def annotation_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """All files that `read_annotations` reads, sorted, for provenance.

    Raises:
        ConfigError: the path cannot be meant.
        DataError: the file or folder is missing.
    """
    return sorted(FORMATS[manifest.annotations.format].files(manifest, sequence))
