"""The manifests that lie beside a dataset of houses, so that the stages read it as it is.

`manifest.toml` takes poses from the wheels' odometry, `manifest_true.toml` the true ones. They say
what the shipped ``manifests/house_*.toml`` say, for other classes, cameras and numbers of houses.
"""

from collections.abc import Sequence

from imodbatch.core.camera import PinholeCamera
from imodbatch.lab.disk.manifest import camera_fields, quoted, safe_name
from imodbatch.lab.houses.drive import kind_of
from imodbatch.lab.houses.files import FRAMES_PER_SECOND, ODOMETRY_FILE, TRUE_POSES_FILE

MANIFEST, MANIFEST_TRUE = "manifest.toml", "manifest_true.toml"
WHAT_IT_DOES = {
    "circle": "circles the table",
    "approach": "approaches from afar",
    "wait": "waits on its way",
    "tour": "tours the room",
}
"""By kind of drive."""
_TEXT = """\
# Written by `imodbatch simulate` with the data; to change it, copy it elsewhere and set root.
# {poses}
name = {name}
description = {description}
adapter = "folder"
root = "."
classes = [
{classes}
]

[camera]
color = {{ {camera} }}

[world]
up = "+z"

[images]
color = "color/{{frame}}.jpg"
depth = "depth/{{frame}}.png"      # 16-bit millimetres in the colour camera, 0 = none
frames_per_second = {frames_per_second:.1f}

[odometry]
format = "tum"
path = "{{sequence}}/{path}"

[reference]                      # judges the poses, and is used for nothing else
format = "tum"
path = "{{sequence}}/{true_path}"
up = "+z"

[annotations]
format = "coco"
path = "{{sequence}}/annotations.json"
"""
_SEQUENCE = """
[[sequences]]   # {what}
id = "{sequence_id}"
path = "{sequence_id}"
"""


def manifest_texts(
    folder_name: str,
    split: str,
    classes: Sequence[str],
    camera: PinholeCamera,
    sequence_ids: Sequence[str],
) -> dict[str, str]:
    """File name → text of both manifests.

    Args:
        folder_name: of the dataset; becomes its name.
        split: which houses these are.
        classes: in the order of their numbers.
        camera: the robot's.
        sequence_ids: of the houses, from the first.
    """
    name = safe_name(folder_name)
    common = {
        "description": quoted(
            f"Simulated houses, {split} split: a robot with an RGB-D camera drives round and "
            "towards the objects; boxes are exact and enclose whole outlines."
        ),
        "classes": "\n".join(f"    {quoted(class_name)}," for class_name in classes),
        "camera": camera_fields(camera),
        "frames_per_second": FRAMES_PER_SECOND,
        "true_path": TRUE_POSES_FILE,
    }
    sequences = "".join(
        _SEQUENCE.format(what=WHAT_IT_DOES[kind_of(index)], sequence_id=sequence_id)
        for index, sequence_id in enumerate(sequence_ids)
    )
    driven = _TEXT.format(
        poses=f"Poses are wheel odometry; {MANIFEST_TRUE} has the true ones.",
        name=quoted(name),
        path=ODOMETRY_FILE,
        **common,
    )
    true = _TEXT.format(
        poses=f"As {MANIFEST}, but with the true poses in place of wheel odometry.",
        name=quoted(f"{name}_true"),
        path=TRUE_POSES_FILE,
        **common,
    )
    return {MANIFEST: driven + sequences, MANIFEST_TRUE: true + sequences}
