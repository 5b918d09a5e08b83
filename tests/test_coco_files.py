"""COCO files: what is written is read back; what is not meant is one line."""

import json

import pytest

from imodbatch.core.errors import DataError
from imodbatch.datasets.coco import CocoFile, box_entry, coco_text, image_entry

IMAGES = [image_entry(7, "color/7.png", (64, 48)), image_entry(9, "color/9.png", (64, 48))]
CUP = box_entry(0, (1.0, 2.0, 4.0, 8.0), 18.0, is_ignored=False, instance="cup_1", azimuth_deg=30.0)
LAMP = box_entry(1, (0.0, 0.0, 5.0, 5.0), 25.0, is_ignored=True)


def written(tmp_path, **changes):
    path = tmp_path / "found.json"
    text = coco_text({"description": "x"}, {"cup": 2, "lamp": None}, IMAGES, [[CUP], [LAMP, CUP]])
    path.write_text(json.dumps({**json.loads(text), **changes}))
    return CocoFile(path, "--data")


def test_what_is_written_is_read_back(tmp_path):
    file = written(tmp_path)
    assert {key: image.file_name for key, image in file.images.items()} == {
        7: "color/7.png",
        9: "color/9.png",
    }
    assert [(c.name, c.symmetry) for c in file.categories.values()] == [("cup", 2), ("lamp", None)]
    boxes = list(file.boxes())
    assert [(box.image_id, file.categories[box.category_id].name) for box in boxes] == [
        (7, "cup"),
        (9, "lamp"),
        (9, "cup"),
    ]
    assert boxes[0].bbox == (1.0, 2.0, 3.0, 6.0)
    assert (boxes[0].instance_id, boxes[0].azimuth_deg, boxes[0].elevation_deg) == (
        "cup_1",
        30.0,
        None,
    )
    assert [bool(box.ignore) for box in boxes] == [False, True, False]


@pytest.mark.parametrize(
    ("changes", "mention"),
    [
        ({"images": 3}, '"images" is no list'),
        ({"categories": [{"id": 1, "name": "cup", "symmetry": 0}]}, '"symmetry" is 0'),
        ({"annotations": [{"image_id": 7, "category_id": 1, "bbox": "x"}]}, "four finite numbers"),
        ({"annotations": [{"image_id": 8, "category_id": 1, "bbox": [0, 0, 1, 1]}]}, "image_id 8"),
    ],
)
def test_what_cannot_be_meant(tmp_path, changes, mention):
    with pytest.raises(DataError) as caught:
        list(written(tmp_path, **changes).boxes())
    assert mention in str(caught.value)
    assert "found.json" in str(caught.value)
    assert "\n" not in str(caught.value)
