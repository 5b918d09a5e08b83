"""UW annotation files: every way MATLAB writes them, every way they can be wrong, and real ones."""

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numpy.lib.recfunctions import repack_fields
from scipy.io import savemat

from imodbatch.core.errors import DataError
from imodbatch.datasets.annotations import annotation_files, read_annotations
from imodbatch.datasets.base import FrameFile
from imodbatch.settings.manifest import Manifest

DATA = os.environ.get("IMODBATCH_DATA")
CLASSES = ["bowl", "cap", "cereal_box", "coffee_mug", "soda_can"]
FIELDS = ("category", "instance", "top", "bottom", "left", "right")
WIDTH, HEIGHT = 640, 480


def manifest(root, frames=None, sequences=("desk/desk_1",), **annotations):
    return Manifest(
        name="tiny",
        adapter="rgbd_scenes_v1",
        root=str(root),
        classes=CLASSES,
        annotations={"format": "uw_mat", "path": "{sequence}.mat", **annotations},
        sequences=[{"id": Path(s).name, "path": s, "frames": frames} for s in sequences],
    )


def frame_files(numbers):
    return [FrameFile(n, None, f"desk/desk_1/desk_1_{n}.png", None) for n in numbers]


def structs(*boxes, dtype=np.float64, shape=None):
    """A struct array of (category, instance, top, bottom, left, right)."""
    array = np.empty((1, len(boxes)), dtype=[(name, object) for name in FIELDS])
    for i, (category, *numbers) in enumerate(boxes):
        array[0, i] = (category, *(np.array([[n]]).astype(dtype) for n in numbers))
    return array if shape is None else array.reshape(shape)


def cells(*contents):
    array = np.empty((1, len(contents)), dtype=object)
    for i, content in enumerate(contents):
        array[0, i] = np.zeros((0, 0)) if content is None else content
    return array


def write(root, content, name="bboxes", **more):
    path = root / "desk" / "desk_1.mat"
    path.parent.mkdir(exist_ok=True)
    savemat(path, {name: content}, **more)
    return path


def read(split, numbers=(1, 2, 3)):
    return read_annotations(split, split.sequences[0], frame_files(numbers), WIDTH, HEIGHT)


def boxes(reading):
    names = ("x0_px", "y0_px", "x1_px", "y1_px")
    return [(r["frame_index"], r["instance_id"], *(r[n] for n in names)) for r in reading.rows]


def fault(action, *mentions):
    with pytest.raises(DataError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


MUG = ("coffee_mug", 3, 11, 60, 21, 40)


def test_cell_n_is_frame_n_and_boxes_are_inclusive_from_1(tmp_path):
    path = write(tmp_path, cells(structs(("cap", 1, 1, 1, 1, 1)), None, structs(MUG)))
    split = manifest(tmp_path)
    reading = read(split)
    assert boxes(reading) == [(1, "cap_1", 0, 0, 1, 1), (3, "coffee_mug_3", 20, 10, 40, 60)]
    assert [row["class_id"] for row in reading.rows] == [1, 3]
    assert reading.left_out == Counter()
    assert annotation_files(split, split.sequences[0]) == [path]


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, np.int32, np.float32, np.float64])
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("shape", [(1, 2), (2, 1)])
def test_any_number_type_and_either_direction(tmp_path, dtype, compressed, shape):
    content = structs(MUG, ("bowl", 1, 2, 3, 4, 5), dtype=dtype, shape=shape)
    write(tmp_path, cells(content), do_compression=compressed)
    assert boxes(read(manifest(tmp_path), [1])) == [
        (1, "coffee_mug_3", 20, 10, 40, 60),
        (1, "bowl_1", 3, 1, 5, 3),
    ]


def test_a_column_of_cells(tmp_path):
    write(tmp_path, cells(None, structs(MUG)).T)
    assert [row[0] for row in boxes(read(manifest(tmp_path), [1, 2]))] == [2]


@pytest.mark.parametrize("category", [" coffee_mug  ", np.array([["coffee_mug"]], dtype=object)])
def test_names_in_cells_and_with_blanks(tmp_path, category):
    write(tmp_path, cells(structs((category, *MUG[1:]))))
    assert boxes(read(manifest(tmp_path), [1])) == [(1, "coffee_mug_3", 20, 10, 40, 60)]


def test_other_classes_are_left_out_and_counted(tmp_path):
    write(tmp_path, cells(structs(MUG, ("flashlight", 2, 5, 9, 5, 9))))
    reading = read(manifest(tmp_path), [1])
    assert (len(reading.rows), reading.left_out) == (1, Counter({"unknown class": 1}))
    fault(
        lambda: read(manifest(tmp_path, unknown_classes="error"), [1]),
        "bboxes{1}(2)",
        "'flashlight'",
        "annotations.rename",
    )
    renamed = read(manifest(tmp_path, rename={"flashlight": "cap"}), [1])
    assert [(r["class_id"], r["instance_id"]) for r in renamed.rows] == [
        (3, "coffee_mug_3"),
        (1, "flashlight_2"),
    ]


def test_boxes_beyond_the_border_and_reversed_ones(tmp_path):
    beyond = ("cap", 1, 400, 500, 600, 700)
    outside, reversed_ = ("cap", 1, 490, 500, 1, 9), ("cap", 1, 60, 11, 21, 40)
    write(tmp_path, cells(structs(beyond, outside, reversed_)))
    reading = read(manifest(tmp_path), [1])
    assert boxes(reading) == [(1, "cap_1", 599, 399, 640, 480)]
    assert reading.left_out == Counter({"outside image": 1, "no area": 1})
    strict = manifest(tmp_path, outside="error")
    fault(lambda: read(strict, [1]), "bboxes{1}(2)", "outside image", "annotations.outside")


def test_a_slice_counts_the_boxes_of_other_frames(tmp_path):
    write(tmp_path, cells(structs(MUG), structs(MUG, MUG), structs(MUG)))
    reading = read(manifest(tmp_path, frames="2:3"), [2])
    assert len(reading.rows) == 2
    assert reading.left_out == Counter({"other frames": 2})


def test_frames_without_a_cell_do_not_pass_for_empty_ones(tmp_path):
    path = write(tmp_path, cells(structs(MUG), None))
    split = manifest(tmp_path)
    fault(lambda: read(split, [1, 2, 3]), path, "2 cells", "1 to 3", 'sequences.frames = "1:3"')
    fault(lambda: read(split, [0, 1]), "0 to 1", "count from 1")


def test_more_cells_than_frames(tmp_path):
    write(tmp_path, cells(structs(MUG), structs(MUG), None))
    reading = read(manifest(tmp_path), [1])
    assert (len(reading.rows), reading.left_out) == (1, Counter({"other frames": 1}))


@pytest.mark.parametrize(
    ("box", "mention"),
    [
        (("cap", 1, np.nan, 9, 5, 9), "not finite"),
        (("cap", 1, 5, 9, 5, np.inf), "not finite"),
        (("cap", 1.5, 5, 9, 5, 9), "instance is 1.5"),
        (("cap", np.nan, 5, 9, 5, 9), "instance is nan"),
        (("cap", 1, [5, 6], 9, 5, 9), "top is not a single number"),
        (("cap", 1, 5, 9, [], 9), "left is not a single number"),
        (("", 1, 5, 9, 5, 9), "category is no name"),
        ((7, 1, 5, 9, 5, 9), "category is no name"),
        ((np.array(["cap", "cup"]), 1, 5, 9, 5, 9), "category is no name"),
    ],
)
def test_a_struct_that_is_no_box(tmp_path, box, mention):
    path = write(tmp_path, cells(None, structs(MUG, box)))
    fault(lambda: read(manifest(tmp_path), [1, 2]), path, "bboxes{2}(2)", mention)


def test_missing_fields_and_cells_without_structs(tmp_path):
    write(tmp_path, cells(repack_fields(structs(MUG)[list(FIELDS[:-1])])))
    fault(lambda: read(manifest(tmp_path), [1]), "bboxes{1}", "no field 'right'", "bottom, left")
    write(tmp_path, cells(np.ones((2, 4))))
    fault(lambda: read(manifest(tmp_path), [1]), "bboxes{1}", "float64", "expected structs")


@pytest.mark.parametrize(
    "content", [structs(MUG), np.ones((3, 4)), cells(*[None] * 4).reshape(2, 2)]
)
def test_a_variable_that_is_no_row_of_cells(tmp_path, content):
    path = write(tmp_path, content)
    fault(lambda: read(manifest(tmp_path), [1]), path, "bboxes is", "Expected a 1×N cell")


def test_a_missing_variable_lists_those_that_are_there(tmp_path):
    path = write(tmp_path, cells(None), name="boxes")
    fault(lambda: read(manifest(tmp_path), [1]), path, "no variable 'bboxes', only boxes")


def test_a_missing_file(tmp_path):
    path = tmp_path / "desk" / "desk_1.mat"
    fault(lambda: read(manifest(tmp_path), [1]), path, "no such file", "annotations.path")


@pytest.mark.parametrize("head", [b"", b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"])
def test_version_7_3(tmp_path, head):
    path = write(tmp_path, cells(None))
    signature = b"\x89HDF\r\n\x1a\n"
    path.write_bytes(head.ljust(512 if head else 0, b"\0") + signature + bytes(2000))
    fault(lambda: read(manifest(tmp_path), [1]), path, "v7.3", "-v7")


@pytest.mark.parametrize("compressed", [False, True])
def test_truncated_and_foreign_files(tmp_path, compressed):
    content = cells(*[structs(MUG, MUG)] * 30)
    path = write(tmp_path, content, do_compression=compressed)
    whole = path.read_bytes()
    for n_bytes in (0, 3, 60, 127, 130, 200, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:n_bytes])
        fault(lambda: read(manifest(tmp_path), [1]), path)
    path.write_bytes(b"<annotation/>" * 50)
    fault(lambda: read(manifest(tmp_path), [1]), path, "no MAT file, or a damaged one")


# Counted by a plain loop over scipy.io.loadmat, apart from the code under test.
REAL = {
    "desk/desk_1": (98, {"cap": 42, "coffee_mug": 75, "soda_can": 69}, 0),
    "kitchen_small/kitchen_small_1": (
        180,
        {"bowl": 96, "cap": 53, "cereal_box": 85, "coffee_mug": 94, "soda_can": 156},
        171,
    ),
    "table/table_1": (
        125,
        {"bowl": 115, "cap": 225, "cereal_box": 119, "coffee_mug": 153, "soda_can": 77},
        75,
    ),
    "table_small/table_small_1": (
        199,
        {"bowl": 181, "cereal_box": 199, "coffee_mug": 184, "soda_can": 177},
        0,
    ),
}


@pytest.mark.skipif(not DATA, reason="IMODBATCH_DATA is not set: no UW annotation files")
@pytest.mark.parametrize("path", REAL)
def test_real_files(path):
    n_frames, counts, n_flashlights = REAL[path]
    split = manifest(Path(DATA or "") / "uw_rgbd_scenes_v1", sequences=[path])
    reading = read(split, range(1, n_frames + 1))
    found = Counter(CLASSES[row["class_id"]] for row in reading.rows)
    assert found == counts
    assert reading.left_out == Counter({"unknown class": n_flashlights} if n_flashlights else {})
    for row in reading.rows:
        name, _, number = row["instance_id"].rpartition("_")
        assert name == CLASSES[row["class_id"]]
        assert number.isdecimal()
        assert 0 <= row["x0_px"] < row["x1_px"] <= WIDTH
        assert 0 <= row["y0_px"] < row["y1_px"] <= HEIGHT
    fault(lambda: read(split, range(1, n_frames + 2)), f"{n_frames} cells", "1 frames have none")


@pytest.mark.skipif(not DATA, reason="IMODBATCH_DATA is not set: no UW annotation files")
def test_the_first_box_of_a_real_file():
    """soda_can 6: top 271, bottom 410, left 1, right 37, inclusive from 1."""
    split = manifest(Path(DATA or "") / "uw_rgbd_scenes_v1")
    first = boxes(read(split, range(1, 99)))[0]
    assert first[1:] == ("soda_can_6", 0, 270, 37, 410)
