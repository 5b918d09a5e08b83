"""COCO instances: one JSON file for a sequence or for several."""

import math
from collections.abc import Iterator

from imodbatch.datasets.annotations.entries import KEY, Entry, annotation_file
from imodbatch.datasets.base import Footage
from imodbatch.datasets.coco import CocoFile
from imodbatch.datasets.names import FrameNames


def read_entries(footage: Footage) -> Iterator[Entry]:
    """The entries of the file, those of other images without a frame.

    Raises:
        DataError: see `imodbatch.datasets.annotations.read_annotations`.
    """
    path = annotation_file(footage.manifest, footage.sequence)
    file = CocoFile(path, KEY)
    names = FrameNames(footage, KEY, footage.manifest.annotations.path or "")
    frame_of = names.frames_of_images(file)
    for box in file.boxes():
        x, y, width, height = box.bbox
        category = file.categories[box.category_id]
        azimuth_deg, symmetry = box.azimuth_deg, category.symmetry
        yield Entry(
            box.where,
            frame_of[box.image_id],
            category.name,
            (x, y, x + width, y + height),
            is_ignored=bool(box.ignore),
            is_crowd=bool(box.iscrowd),
            instance_id=box.instance_id,
            own_azimuth_rad=None if azimuth_deg is None else math.radians(azimuth_deg % 360.0),
            symmetry=None if symmetry is None else str(symmetry),
        )
