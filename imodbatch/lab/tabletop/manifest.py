"""The manifest that lies beside a dataset of tables and desks: the stages read it as it is."""

from collections.abc import Mapping

from imodbatch.core.camera import PinholeCamera
from imodbatch.lab.disk.manifest import camera_fields, safe_name
from imodbatch.lab.tabletop.files import SCENES, TRUTH, Place
from imodbatch.lab.tabletop.world import CLASSES

_TEXT = """\
# Written by `imodbatch simulate --layout rgbd_scenes_v1` with the data; to change it, copy it
# elsewhere and set root. The layout holds no poses: the pipeline estimates them.
name = "{name}"
description = \"\"\"Simulated tables and desks, {split} split: a hand-held RGB-D camera; bowls, \\
caps, cereal boxes, coffee mugs and soda cans among other things.\"\"\"
adapter = "rgbd_scenes_v1"
root = "{scenes}"
classes = [{classes}]

[camera]
color = {{ {camera} }}

[world]
up = "estimate"

[reference]                      # judges the poses, and is used for nothing else
format = "uw"
path = "../{truth}/{{sequence}}/poses.pose"
up = "+z"

[annotations]
format = "uw_mat"
path = "{{sequence}}.mat"
"""
_SEQUENCE = """
[[sequences]]
id = "{sequence_id}"
path = "{path}"
n_frames = {n_frames}
"""


def manifest_text(
    folder_name: str, split: str, camera: PinholeCamera, n_frames: Mapping[Place, int]
) -> str:
    """The manifest of a dataset.

    Args:
        folder_name: of the dataset; becomes its name.
        split: of which its worlds are.
        camera: that is carried.
        n_frames: of each sequence.
    """
    head = _TEXT.format(
        name=safe_name(folder_name),
        split=split,
        scenes=SCENES,
        truth=TRUTH,
        classes=", ".join(f'"{name}"' for name in CLASSES),
        camera=camera_fields(camera),
    )
    return head + "".join(
        _SEQUENCE.format(n_frames=n, sequence_id=place.sequence_id, path=place.path)
        for place, n in n_frames.items()
    )
