"""A walk on disk, in the layout of the UW RGB-D Scenes v1; what is true lies apart.

rgbd-scenes/desk/desk_1/desk_1_1.png  desk_1_1_depth.png (16-bit mm, 0 = none)   n from 1
rgbd-scenes/desk/desk_1.mat           `bboxes`: category, instance, top, bottom, left, right
truth/desk/desk_1/poses.pose          two stamps, qw qx qy qz tx ty tz, world_from_cam
truth/desk/desk_1/annotations.json    COCO with viewpoints, for training; objects.json
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import quaternion_from_matrix
from imodbatch.core.symmetry import Symmetry
from imodbatch.lab.disk.images import write_depth, write_image
from imodbatch.lab.houses.files import true_place, write_annotations
from imodbatch.lab.houses.sequence import LEAST_SIDE_PX, LEAST_VISIBLE, HouseFrame, SeenTarget
from imodbatch.lab.houses.world import House
from imodbatch.tables.atomic import replacing, write_text

SCENES, TRUTH = "rgbd-scenes", "truth"
LEAST_INSIDE = 0.5
"""Of an object's outline: of one that the image's border cuts further there is no box."""


@dataclass(frozen=True)
class Place:
    """Where a sequence lies below a dataset's root."""

    kind: str
    number: int

    @property
    def sequence_id(self) -> str:
        """Its name, such as ``desk_1``."""
        return f"{self.kind}_{self.number}"

    @property
    def path(self) -> str:
        """Below `SCENES` and `TRUTH`."""
        return f"{self.kind}/{self.sequence_id}"

    def color_file(self, frame_index: int) -> str:
        """Below the dataset's root; frames count from 0 here and from 1 in names."""
        return f"{SCENES}/{self.path}/{self.sequence_id}_{frame_index + 1}.png"

    def depth_file(self, frame_index: int) -> str:
        """Below the dataset's root."""
        return f"{SCENES}/{self.path}/{self.sequence_id}_{frame_index + 1}_depth.png"

    @property
    def boxes_file(self) -> str:
        """Below the dataset's root."""
        return f"{SCENES}/{self.path}.mat"


def write_frame(root: Path, place: Place, frame_index: int, frame: HouseFrame) -> None:
    """Colour, and measured depth in millimetres."""
    write_image(root / place.color_file(frame_index), frame.color, compress_level=3)
    write_depth(root / place.depth_file(frame_index), frame.measured_depth_m, compress_level=3)


def write_boxes(path: Path, seen_by_frame: Sequence[Sequence[SeenTarget]]) -> None:
    """A cell per frame, empty or a struct array of 1-based inclusive boxes (MAT v5).

    There is no mark for ignored boxes in this layout: what is hidden, cut or tiny is left out.
    """
    cells = np.empty((1, len(seen_by_frame)), dtype=object)
    for frame_index, all_seen in enumerate(seen_by_frame):
        cells[0, frame_index] = _structs([one for one in all_seen if is_annotated(one)])
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        savemat(file, {"bboxes": cells}, do_compression=True)


def is_annotated(seen: SeenTarget) -> bool:
    """Whether enough of a target shows for a box."""
    x0, y0, x1, y1 = seen.box_px
    is_large = min(x1 - x0, y1 - y0) >= LEAST_SIDE_PX
    return is_large and seen.visibility >= LEAST_VISIBLE and seen.inside >= LEAST_INSIDE


def _structs(all_seen: Sequence[SeenTarget]) -> NDArray[Any]:
    fields = ("category", "instance", "top", "bottom", "left", "right")
    structs = np.empty((1, len(all_seen)), dtype=[(field, object) for field in fields])
    for k, seen in enumerate(all_seen):
        category, _, number = seen.target.instance_id.rpartition("_")
        x0, y0, x1, y1 = seen.box_px
        edges = (np.floor(y0) + 1, np.ceil(y1), np.floor(x0) + 1, np.ceil(x1))
        structs[0, k] = (category, float(number), *edges)
    return structs if len(all_seen) else np.zeros((0, 0))


def write_truth(
    root: Path,
    place: Place,
    house: House,
    camera: PinholeCamera,
    walk_world_from_cam: NDArray[np.float64],
    seen_by_frame: Sequence[Sequence[SeenTarget]],
    classes: Mapping[str, Symmetry],
) -> None:
    """True poses, boxes with viewpoints, and where objects stand."""
    folder = root / TRUTH / place.path
    folder.mkdir(parents=True, exist_ok=True)
    lines = [_pose_line(k, pose) for k, pose in enumerate(walk_world_from_cam)]
    write_text(folder / "poses.pose", "".join(lines))
    up = "../" * (len(Path(TRUTH, place.path).parts))
    write_annotations(
        folder / "annotations.json",
        camera,
        classes,
        seen_by_frame,
        lambda frame_index: up + place.color_file(frame_index),
    )
    objects = [true_place(target) for target in house.targets]
    write_text(folder / "objects.json", json.dumps(objects, indent=1) + "\n")


def _pose_line(frame_index: int, world_from_cam: NDArray[np.float64]) -> str:
    numbers = (*quaternion_from_matrix(world_from_cam[:3, :3]), *world_from_cam[:3, 3])
    return f"{frame_index} {frame_index} " + " ".join(f"{v:.9f}" for v in numbers) + "\n"
