"""True boxes: every format in its layout, its box convention, and every way a file can be wrong."""

import json
import math
import os
from collections import Counter
from pathlib import Path

import pytest

from imodbatch.core.errors import ConfigError, DataError, ImodError
from imodbatch.datasets.annotations import annotation_files, read_annotations
from imodbatch.datasets.base import FrameFile
from imodbatch.datasets.seven_scenes import LAYOUT
from imodbatch.settings.manifest import Manifest

WIDTH, HEIGHT = 100, 80
BOX = ("x0_px", "y0_px", "x1_px", "y1_px")
FORMATS = ("coco", "voc", "yolo")


def manifest(root, sequences=("seq-01",), frames=None, **annotations):
    return Manifest(
        name="tiny",
        adapter="folder",
        root=str(root),
        classes=["mug", "bowl"],
        annotations=annotations,
        sequences=[{"id": name, "path": name, "frames": frames} for name in sequences],
    )


def frame_files(sequence="seq-01", numbers=(0, 1, 2), pattern="{sequence}/rgb_{number:03d}.png"):
    return [
        FrameFile(number, None, pattern.format(sequence=sequence, number=number), None)
        for number in numbers
    ]


def read(split, frames=None, sequence=0):
    section = split.sequences[sequence]
    frames = frame_files(section.id) if frames is None else frames
    return read_annotations(split, section, frames, WIDTH, HEIGHT)


def boxes(reading):
    return [(row["frame_index"], *(row[name] for name in BOX)) for row in reading.rows]


def error_of(action, *mentions, kind=DataError):
    with pytest.raises(kind) as caught:
        action()
    text = str(caught.value)
    assert isinstance(caught.value, ImodError)
    assert len(text.splitlines()) == 1
    for mention in mentions:
        assert str(mention) in text
    return text


def touch(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def coco_annotation(image_id=0, category_id=1, bbox=(10, 20, 30, 40), **more):
    return {"image_id": image_id, "category_id": category_id, "bbox": list(bbox), **more}


def coco_document(annotations, file_names=("rgb_000.png", "rgb_001.png", "rgb_002.png")):
    return {
        "images": [{"id": i, "file_name": name} for i, name in enumerate(file_names)],
        "categories": [{"id": 1, "name": "mug"}, {"id": 2, "name": "Bowl"}],
        "annotations": annotations,
    }


def write_coco(path, annotations, **more):
    return write(path, json.dumps(coco_document(annotations, **more)))


def voc_object(name="mug", box=(11, 21, 40, 60), extra=""):
    tags = zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True)
    sides = "".join(f"<{tag}>{value}</{tag}>" for tag, value in tags)
    return f"<object><name>{name}</name>{extra}<bndbox>{sides}</bndbox></object>"


def write_voc(path, *objects, head=""):
    return write(path, f"<annotation>{head}{''.join(objects)}</annotation>")


def write_one(root, form, box=(10, 20, 40, 60), name="mug"):
    """One box of frame 1, of the same continuous extent in every format."""
    folder = root / "seq-01"
    x0, y0, x1, y1 = box
    if form == "coco":
        document = coco_document([coco_annotation(1, 1, (x0, y0, x1 - x0, y1 - y0))])
        document["categories"][0]["name"] = name
        write(folder / "labels.json", json.dumps(document))
        return manifest_keys(form, "labels.json")
    if form == "voc":
        write_voc(folder / "labels/rgb_001.xml", voc_object(name, (x0 + 1, y0 + 1, x1, y1)))
        return manifest_keys(form, "labels")
    cx, cy, w, h = (x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0
    line = f"1 {cx / WIDTH} {cy / HEIGHT} {w / WIDTH} {h / HEIGHT}\n"
    write(folder / "labels/rgb_001.txt", line)
    return manifest_keys(form, "labels", names=["spoon", name])


def manifest_keys(form, path, **more):
    return {"format": form, "path": path, **more}


# --- what all formats share ---


@pytest.mark.parametrize("form", FORMATS)
def test_the_same_box_reads_the_same_from_every_format(tmp_path, form):
    reading = read(manifest(tmp_path, **write_one(tmp_path, form)))
    (row,) = reading.rows
    assert [row[name] for name in BOX] == pytest.approx([10, 20, 40, 60])
    assert {key: row[key] for key in row if key not in BOX} == {
        "frame_index": 1,
        "annotation_index": 0,
        "class_id": 0,
        "is_ignored": False,
        "is_crowd": False,
        "instance_id": None,
        "own_azimuth_rad": None,
        "symmetry": None,
    }
    assert reading.left_out == Counter()


@pytest.mark.parametrize("form", FORMATS)
def test_a_box_partly_outside_is_cut_at_the_border(tmp_path, form):
    for outside in ("clip", "error"):
        keys = write_one(tmp_path, form, box=(-10, 30, 20, 95))
        reading = read(manifest(tmp_path, outside=outside, **keys))
        assert boxes(reading)[0] == pytest.approx((1, 0, 30, 20, HEIGHT))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("box", "reason"),
    [((110, 20, 130, 60), "outside image"), ((20, 30, 20, 60), "no area")],
)
def test_a_box_with_nothing_in_the_image_is_counted_or_refused(tmp_path, form, box, reason):
    keys = write_one(tmp_path, form, box=box)
    reading = read(manifest(tmp_path, **keys))
    assert (reading.rows, reading.left_out) == ([], {reason: 1})
    strict = manifest(tmp_path, outside="error", **keys)
    error_of(lambda: read(strict), tmp_path / "seq-01", reason, 'annotations.outside = "clip"')


@pytest.mark.parametrize("form", FORMATS)
def test_a_box_that_only_touches_the_border_is_outside(tmp_path, form):
    keys = write_one(tmp_path, form, box=(100, 20, 120, 60))
    assert read(manifest(tmp_path, **keys)).left_out == {"outside image": 1}


@pytest.mark.parametrize("form", FORMATS)
def test_foreign_class_names_are_renamed_counted_or_refused(tmp_path, form):
    keys = write_one(tmp_path, form, name="mugs")
    renamed = read(manifest(tmp_path, rename={"mugs": "bowl"}, **keys))
    assert [row["class_id"] for row in renamed.rows] == [1]
    skipped = read(manifest(tmp_path, **keys))
    assert (skipped.rows, skipped.left_out) == ([], {"unknown class": 1})
    strict = manifest(tmp_path, unknown_classes="error", **keys)
    error_of(lambda: read(strict), tmp_path / "seq-01", "'mugs'", "Did you mean 'mug'?")


@pytest.mark.parametrize("form", FORMATS)
def test_a_rename_to_no_class_is_refused(tmp_path, form):
    split = manifest(tmp_path, rename={"Mug": "mgu"}, **write_one(tmp_path, form))
    error_of(lambda: read(split), "annotations.rename", "'mgu'", "'mug'", kind=ConfigError)


@pytest.mark.parametrize("form", FORMATS)
def test_frames_outside_the_slice_are_counted_whatever_else_is_wrong(tmp_path, form):
    keys = write_one(tmp_path, form, name="unheard of", box=(150, 90, 150, 90))
    split = manifest(tmp_path, unknown_classes="error", outside="error", frames="2:", **keys)
    reading = read(split, frame_files(numbers=[2]))
    assert (reading.rows, reading.left_out) == ([], {"other frames": 1})


@pytest.mark.parametrize("form", FORMATS)
def test_a_missing_path_is_an_error(tmp_path, form):
    split = manifest(tmp_path, format=form, path="nowhere", names=["mug"])
    for action in (lambda: read(split), lambda: annotation_files(split, split.sequences[0])):
        error_of(action, tmp_path / "nowhere", "annotations.path")


def test_without_annotations_there_are_no_rows_and_no_files(tmp_path):
    split = manifest(tmp_path, format="none")
    assert read(split).rows == []
    assert annotation_files(split, split.sequences[0]) == []


@pytest.mark.parametrize("form", FORMATS)
def test_files_without_boxes_give_no_rows(tmp_path, form):
    keys = write_one(tmp_path, form)
    if form == "coco":
        write_coco(tmp_path / "seq-01/labels.json", [])
    elif form == "voc":
        write_voc(tmp_path / "seq-01/labels/rgb_001.xml")
    else:
        write(tmp_path / "seq-01/labels/rgb_001.txt", "\n")
    reading = read(manifest(tmp_path, **keys))
    assert (reading.rows, reading.left_out) == ([], Counter())


@pytest.mark.parametrize("form", FORMATS)
def test_provenance_names_the_files(tmp_path, form):
    split = manifest(tmp_path, **write_one(tmp_path, form))
    (path,) = annotation_files(split, split.sequences[0])
    assert path.is_file()
    assert path.suffix == {"coco": ".json", "voc": ".xml", "yolo": ".txt"}[form]


# --- COCO ---


def test_coco_flags_instances_and_order(tmp_path):
    path = tmp_path / "labels.json"
    write_coco(
        path,
        [
            coco_annotation(2, 1, instance="mug_white"),
            coco_annotation(0, 1, ignore=1, instance_id=7),
            coco_annotation(0, 1, iscrowd=1, bbox=(0, 0, 5.5, 6.25)),
            coco_annotation(0, 1, ignore=0, iscrowd=0, instance=None),
        ],
    )
    rows = read(manifest(tmp_path, format="coco", path="labels.json")).rows
    keys = ("frame_index", "annotation_index", "is_ignored", "is_crowd", "instance_id")
    assert [tuple(row[key] for key in keys) for row in rows] == [
        (0, 0, True, False, "7"),
        (0, 1, True, True, None),
        (0, 2, False, False, None),
        (2, 0, False, False, "mug_white"),
    ]
    assert [rows[1][name] for name in BOX] == [0, 0, 5.5, 6.25]


def test_coco_azimuth_and_symmetry_where_they_are_given(tmp_path):
    document = coco_document(
        [coco_annotation(0, 1, azimuth_deg=-90.0), coco_annotation(2, 1, azimuth_deg=None)]
    )
    document["categories"][0]["symmetry"] = 4
    write(tmp_path / "labels.json", json.dumps(document))
    rows = read(manifest(tmp_path, format="coco", path="labels.json")).rows
    assert rows[0]["own_azimuth_rad"] == pytest.approx(1.5 * math.pi)
    assert rows[1]["own_azimuth_rad"] is None
    assert [row["symmetry"] for row in rows] == ["4", "4"]


@pytest.mark.parametrize(
    ("entry", "category", "named"),
    [
        ({"azimuth_deg": "north"}, {}, "azimuth_deg"),
        ({"azimuth_deg": float("nan")}, {}, "azimuth_deg"),
        ({}, {"symmetry": 0}, "symmetry"),
        ({}, {"symmetry": True}, "symmetry"),
        ({}, {"symmetry": "round"}, "symmetry"),
    ],
)
def test_coco_azimuth_and_symmetry_that_cannot_be_meant(tmp_path, entry, category, named):
    document = coco_document([coco_annotation(0, 1, **entry)])
    document["categories"][0] |= category
    write(tmp_path / "labels.json", json.dumps(document))
    with pytest.raises(DataError, match=f'labels.json: .*"{named}" is '):
        read(manifest(tmp_path, format="coco", path="labels.json"))


@pytest.mark.parametrize(
    "name", ["seq-01/rgb_001.png", "rgb_001.png", "./rgb_001.png", "seq-01\\rgb_001.png"]
)
def test_coco_images_by_path_from_root_or_folder(tmp_path, name):
    write_coco(tmp_path / "all.json", [coco_annotation()], file_names=[name])
    assert [b[0] for b in boxes(read(manifest(tmp_path, format="coco", path="all.json")))] == [1]


def test_coco_images_by_absolute_path(tmp_path):
    name = str(tmp_path / "seq-01/rgb_001.png")
    write_coco(tmp_path / "all.json", [coco_annotation()], file_names=[name])
    assert [b[0] for b in boxes(read(manifest(tmp_path, format="coco", path="all.json")))] == [1]


def test_coco_images_by_mere_name(tmp_path):
    write_coco(tmp_path / "all.json", [coco_annotation()], file_names=["2.png"])
    frames = frame_files(pattern="{sequence}/color/{number}.png")
    reading = read(manifest(tmp_path, format="coco", path="all.json"), frames)
    assert [b[0] for b in boxes(reading)] == [2]


def test_coco_images_of_other_sequences_are_counted(tmp_path):
    names = ["seq-01/rgb_000.png", "seq-02/rgb_000.png", "gone.png"]
    write_coco(tmp_path / "all.json", [coco_annotation(i) for i in (0, 1, 1, 2)], file_names=names)
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="coco", path="all.json")
    first, second = read(split), read(split, sequence=1)
    assert (len(first.rows), first.left_out) == (1, {"other frames": 3})
    assert (len(second.rows), second.left_out) == (2, {"other frames": 2})


def test_a_name_that_two_sequences_have_is_refused(tmp_path):
    path = write_coco(tmp_path / "all.json", [coco_annotation()])
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="coco", path="all.json")
    touch(tmp_path / "seq-02/rgb_000.png")
    mentions = (path, "seq-01/rgb_000.png", "seq-02/rgb_000.png", "{sequence}")
    error_of(lambda: read(split), *mentions)


def test_a_name_that_only_one_sequence_has_is_taken(tmp_path):
    write_coco(tmp_path / "all.json", [coco_annotation()])
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="coco", path="all.json")
    touch(tmp_path / "seq-02/other_000.png")
    assert len(read(split).rows) == 1


def test_images_outside_the_sequences_folders_are_one_and_the_same(tmp_path):
    write_coco(tmp_path / "all.json", [coco_annotation()], file_names=["a.png"])
    touch(tmp_path / "color/a.png")
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="coco", path="all.json")
    assert len(read(split, [FrameFile(0, None, "color/a.png", None)]).rows) == 1


@pytest.mark.parametrize("path", ["labels.json", "{sequence}/labels.json"])
def test_a_name_in_a_sequences_own_file_is_its_own(tmp_path, path):
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="coco", path=path)
    for name in ("seq-01", "seq-02"):
        touch(tmp_path / name / "rgb_000.png")
        write_coco(tmp_path / name / "labels.json", [coco_annotation()])
    assert len(read(split).rows) == len(read(split, sequence=1).rows) == 1


def test_slices_of_one_folder_share_its_names(tmp_path):
    touch(tmp_path / "walk/rgb_000.png")
    write_coco(tmp_path / "all.json", [coco_annotation(0), coco_annotation(1)])
    split = Manifest(
        name="tiny",
        adapter="folder",
        root=str(tmp_path),
        classes=["mug"],
        annotations={"format": "coco", "path": "all.json"},
        sequences=[{"id": name, "path": "walk"} for name in ("early", "late")],
    )
    frames = frame_files("walk", numbers=[0])
    reading = read_annotations(split, split.sequences[0], frames, WIDTH, HEIGHT)
    assert (len(reading.rows), reading.left_out) == (1, {"other frames": 1})


def test_a_mere_name_in_two_folders_of_a_sequence_is_refused(tmp_path):
    path = write_coco(tmp_path / "all.json", [coco_annotation()], file_names=["a.png"])
    frames = [
        FrameFile(0, None, "seq-01/left/a.png", None),
        FrameFile(1, None, "seq-01/right/a.png", None),
    ]
    split = manifest(tmp_path, format="coco", path="all.json")
    error_of(lambda: read(split, frames), path, "seq-01/left/a.png", "seq-01/right/a.png")


def without(key, table=None):
    def change(document):
        del (document if table is None else document[table][0])[key]

    return change


def with_value(table, key, value):
    def change(document):
        document[table][0][key] = value

    return change


def doubled(table):
    def change(document):
        document[table].append(dict(document[table][0]))

    return change


def second_image_of_frame_0(document):
    document["images"].append({"id": "again", "file_name": "seq-01/rgb_000.png"})


COCO_FAULTS = [
    (without("images"), '"images"'),
    (without("annotations"), '"annotations"'),
    (without("categories"), '"categories"'),
    (without("id", "images"), 'images[0] has no "id"'),
    (without("file_name", "images"), 'images[0] has no "file_name"'),
    (without("name", "categories"), 'categories[0] has no "name"'),
    (without("bbox", "annotations"), 'annotations[0] has no "bbox"'),
    (without("image_id", "annotations"), 'annotations[0] has no "image_id"'),
    (without("category_id", "annotations"), 'annotations[0] has no "category_id"'),
    (with_value("annotations", "image_id", 99), "image_id 99"),
    (with_value("annotations", "image_id", [0]), "[0]"),
    (with_value("annotations", "category_id", 99), "category_id 99"),
    (with_value("annotations", "bbox", [1, 2, 3]), "four finite numbers"),
    (with_value("annotations", "bbox", [1, 2, 3, "4"]), "four finite numbers"),
    (with_value("annotations", "bbox", [1, 2, 3, True]), "four finite numbers"),
    (with_value("annotations", "bbox", [1, 2, 3, float("nan")]), "four finite numbers"),
    (with_value("annotations", "bbox", [1, 2, float("inf"), 4]), "four finite numbers"),
    (with_value("annotations", "bbox", [1, 2, 10**400, 4]), "four finite numbers"),
    (with_value("annotations", "ignore", "yes"), "Expected 0 or 1"),
    (with_value("annotations", "iscrowd", 2), "Expected 0 or 1"),
    (doubled("images"), "stands twice"),
    (doubled("categories"), "stands twice"),
    (second_image_of_frame_0, "both frame 0"),
    (lambda document: document["images"][0].update(width=200, height=160), "200x160"),
    (lambda document: document.update(annotations={}), "is no list"),
    (lambda document: document["annotations"].append(3), "annotations[1] is no object"),
]


@pytest.mark.parametrize(("change", "mention"), COCO_FAULTS)
def test_damaged_coco_files_are_refused_in_one_line(tmp_path, change, mention):
    document = coco_document([coco_annotation()])
    split = manifest(tmp_path, format="coco", path="labels.json")
    path = write(tmp_path / "labels.json", json.dumps(document))
    assert len(read(split).rows) == 1, "the fault below must be the only one"
    change(document)
    write(path, json.dumps(document))
    error_of(lambda: read(split), path, mention)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\xff"])
def test_what_is_not_json_is_refused(tmp_path, text):
    path = tmp_path / "labels.json"
    path.write_bytes(text.encode("latin-1"))
    split = manifest(tmp_path, format="coco", path="labels.json")
    error_of(lambda: read(split), path, "not JSON", "annotations.path")


def test_results_in_place_of_coco_instances_are_refused(tmp_path):
    path = write(tmp_path / "labels.json", json.dumps([coco_annotation(score=0.5)]))
    error_of(lambda: read(manifest(tmp_path, format="coco", path="labels.json")), path, '"images"')


# --- PASCAL VOC ---


def test_voc_pixels_count_from_one_and_include_the_last(tmp_path):
    write_voc(tmp_path / "seq-01/rgb_000.xml", voc_object(box=(1, 1, WIDTH, HEIGHT)))
    write_voc(tmp_path / "seq-01/rgb_001.xml", voc_object(box=(5, 7, 5, 7)))
    reading = read(manifest(tmp_path, format="voc", path="."))
    assert boxes(reading) == [(0, 0, 0, WIDTH, HEIGHT), (1, 4, 6, 5, 7)]


def test_voc_difficult_objects_are_ignored(tmp_path):
    objects = [voc_object(extra=f"<difficult>{value}</difficult>") for value in (1, 0)]
    write_voc(tmp_path / "labels/rgb_002.xml", *objects, voc_object())
    rows = read(manifest(tmp_path, format="voc", path="labels")).rows
    assert [row["is_ignored"] for row in rows] == [True, False, False]
    assert [row["annotation_index"] for row in rows] == [0, 1, 2]
    assert not any(row["is_crowd"] for row in rows)


@pytest.mark.parametrize(
    ("path", "file"),
    [
        ("labels/{sequence}", "labels/seq-01/rgb_002.xml"),
        ("{sequence}", "seq-01/rgb_002.xml"),
        ("labels/{sequence}/{frame}.xml", "labels/seq-01/2.xml"),
        ("labels/{sequence}_{frame}.xml", "labels/seq-01_0002.xml"),
        ("xml/{frame}.xml", "seq-01/xml/000002.xml"),
        ("{frame}.label.xml", "seq-01/02.label.xml"),
    ],
)
def test_voc_files_in_folders_and_patterns(tmp_path, path, file):
    write_voc(tmp_path / file, voc_object())
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="voc", path=path)
    assert [b[0] for b in boxes(read(split))] == [2]
    assert annotation_files(split, split.sequences[0]) == [tmp_path / file]


def test_voc_files_of_other_names_go_by_their_filename_element(tmp_path):
    head = "<filename>rgb_001.png</filename>"
    write_voc(tmp_path / "labels/abc.xml", voc_object(), head=head)
    write_voc(tmp_path / "labels/def.xml", voc_object(), voc_object())
    reading = read(manifest(tmp_path, format="voc", path="labels"))
    assert [b[0] for b in boxes(reading)] == [1]
    assert reading.left_out == {"other frames": 2}


def test_voc_files_shared_by_sequences_with_the_same_names_are_refused(tmp_path):
    path = write_voc(tmp_path / "labels/rgb_000.xml", voc_object())
    touch(tmp_path / "seq-02/rgb_000.png")
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="voc", path="labels")
    error_of(lambda: read(split), path, "seq-01/rgb_000.png", "seq-02/rgb_000.png", "{sequence}")


VOC_FAULTS = [
    ("<annotation>", "not XML"),
    ("<package></package>", "<package>"),
    ("<annotation><object></object></annotation>", "object 1 has no <name>"),
    ("<annotation><object><name>mug</name></object></annotation>", "<bndbox/xmin>"),
    (f"<annotation>{voc_object(box=(1, 2, 'x', 4))}</annotation>", "<bndbox/xmax> is 'x'"),
    (f"<annotation>{voc_object(box=(1, 2, 'nan', 4))}</annotation>", "object 1"),
    (f"<annotation>{voc_object(box=(1, 2, 3, 'inf'))}</annotation>", "not finite"),
    (
        f"<annotation>{voc_object(extra='<difficult>2</difficult>')}</annotation>",
        "Expected 0 or 1",
    ),
    (
        "<annotation><size><width>640</width><height>480</height></size></annotation>",
        "640x480",
    ),
    ("<annotation><filename>rgb_002.png</filename></annotation>", "frame 2"),
]


@pytest.mark.parametrize(("text", "mention"), VOC_FAULTS)
def test_damaged_voc_files_are_refused_in_one_line(tmp_path, text, mention):
    path = write(tmp_path / "labels/rgb_001.xml", text)
    error_of(lambda: read(manifest(tmp_path, format="voc", path="labels")), path, mention)


def test_an_unknown_voc_size_is_no_fault(tmp_path):
    head = "<size><width>0</width><height>0</height></size>"
    write_voc(tmp_path / "labels/rgb_001.xml", voc_object(), head=head)
    assert len(read(manifest(tmp_path, format="voc", path="labels")).rows) == 1


# --- YOLO ---


def test_yolo_shares_become_pixels(tmp_path):
    write(tmp_path / "labels/rgb_000.txt", "0 0.5 0.5 1 1\n\n1 0.25 0.125 0.1 0.05\n")
    split = manifest(tmp_path, format="yolo", path="labels", names=["mug", "bowl"])
    rows = read(split).rows
    assert [row["class_id"] for row in rows] == [0, 1]
    assert boxes(read(split))[0] == (0, 0, 0, WIDTH, HEIGHT)
    assert boxes(read(split))[1] == pytest.approx((0, 20, 8, 30, 12))


@pytest.mark.parametrize("place", ["labels/seq-01", "labels", "."])
def test_yolo_names_from_a_classes_file(tmp_path, place):
    write(tmp_path / "labels/seq-01/rgb_000.txt", "1 0.5 0.5 0.5 0.5")
    names = write(tmp_path / place / "classes.txt", "spoon\nbowl\n")
    split = manifest(tmp_path, format="yolo", path="labels/{sequence}")
    assert [row["class_id"] for row in read(split).rows] == [1]
    assert names in annotation_files(split, split.sequences[0])


def test_yolo_names_of_the_manifest_come_first(tmp_path):
    write(tmp_path / "labels/rgb_000.txt", "0 0.5 0.5 0.5 0.5")
    names = write(tmp_path / "labels/classes.txt", "bowl\n")
    split = manifest(tmp_path, format="yolo", path="labels", names=["mug"])
    assert [row["class_id"] for row in read(split).rows] == [0]
    assert names not in annotation_files(split, split.sequences[0])


def test_yolo_without_names_is_refused(tmp_path):
    path = write(tmp_path / "labels/rgb_000.txt", "0 0.5 0.5 0.5 0.5")
    split = manifest(tmp_path, format="yolo", path="labels")
    error_of(lambda: read(split), path.parent, "annotations.names", kind=ConfigError)


def test_yolo_patterns_and_images_without_a_file(tmp_path):
    write(tmp_path / "labels/seq-01/0001.txt", "0 0.5 0.5 0.5 0.5")
    write(tmp_path / "labels/seq-01/0077.txt", "0 0.5 0.5 0.5 0.5\n0 0.5 0.5 0.5 0.5")
    path = "labels/{sequence}/{frame}.txt"
    reading = read(manifest(tmp_path, format="yolo", path=path, names=["mug"]))
    assert [b[0] for b in boxes(reading)] == [1]
    assert reading.left_out == {"other frames": 2}


def test_other_text_files_beside_yolo_labels_are_passed_over(tmp_path):
    write(tmp_path / "seq-01/rgb_000.txt", "0 0.5 0.5 0.5 0.5")
    write(tmp_path / "seq-01/README.txt", "Labels drawn by hand.")
    reading = read(manifest(tmp_path, format="yolo", path=".", names=["mug"]))
    assert (len(reading.rows), reading.left_out) == (1, Counter())


YOLO_FAULTS = [
    ("0 0.5 0.5 0.5 0.5\n5 0.5 0.5 0.5 0.5", "line 2: class 5"),
    ("-1 0.5 0.5 0.5 0.5", "line 1: class -1"),
    ("0 0.5 0.5 0.5", "line 1"),
    ("0 0.5 0.5 0.5 0.5 0.9", "line 1"),
    ("mug 0.5 0.5 0.5 0.5", "line 1"),
    ("0 50 40 20 20", "pixels"),
    ("0 0.5 nan 0.5 0.5", "line 1"),
    ("0 0.5 0.5 0.5 inf", "line 1"),
]


@pytest.mark.parametrize(("text", "mention"), YOLO_FAULTS)
def test_damaged_yolo_files_are_refused_in_one_line(tmp_path, text, mention):
    path = write(tmp_path / "labels/rgb_001.txt", text)
    split = manifest(tmp_path, format="yolo", path="labels", names=["mug", "bowl"])
    error_of(lambda: read(split), path, mention)


def test_a_yolo_file_that_is_no_text_is_refused(tmp_path):
    path = write(tmp_path / "labels/rgb_001.txt", "")
    path.write_bytes(b"\xff\xfe\x00")
    split = manifest(tmp_path, format="yolo", path="labels", names=["mug"])
    error_of(lambda: read(split), path, "cannot be read as text")


# --- files per image: patterns that cannot be meant ---


@pytest.mark.parametrize(
    "path", ["{frame}/label.xml", "{frame}/{frame}.xml", "{frame}_{frame}.xml"]
)
def test_the_frame_must_stand_once_in_the_files_name(tmp_path, path):
    split = manifest(tmp_path, format="voc", path=path)
    error_of(lambda: read(split), "annotations.path", path, kind=ConfigError)


def test_frame_numbers_that_sequences_share_are_refused(tmp_path):
    write_voc(tmp_path / "labels/000.xml", voc_object())
    split = manifest(tmp_path, ("seq-01", "seq-02"), format="voc", path="labels/{frame}.xml")
    error_of(lambda: read(split), "seq-01", "seq-02", "{sequence}", kind=ConfigError)


def test_a_pattern_that_no_file_fits_is_refused(tmp_path):
    path = write_voc(tmp_path / "labels/img-0001.xml", voc_object())
    split = manifest(tmp_path, format="voc", path="labels/{frame}.xml")
    error_of(lambda: read(split), path.parent, "img-0001.xml", "annotations.path")


def test_two_files_of_one_frame_are_refused(tmp_path):
    write_voc(tmp_path / "labels/1.xml", voc_object())
    write_voc(tmp_path / "labels/001.xml", voc_object())
    split = manifest(tmp_path, format="voc", path="labels/{frame}.xml")
    error_of(lambda: read(split), tmp_path / "labels", "001.xml", "1.xml", "frame 1")


def test_two_files_that_claim_one_image_are_refused(tmp_path):
    write_voc(tmp_path / "labels/rgb_001.xml", voc_object())
    head = "<filename>rgb_001.png</filename>"
    path = write_voc(tmp_path / "labels/rgb_1b.xml", voc_object(), head=head)
    split = manifest(tmp_path, format="voc", path="labels")
    error_of(lambda: read(split), path, "rgb_001.xml", "frame 1")


def test_a_file_in_place_of_a_folder_is_refused(tmp_path):
    path = write_voc(tmp_path / "one.xml", voc_object())
    error_of(lambda: read(manifest(tmp_path, format="voc", path="one.xml")), path, "{frame}")


def test_the_real_red_kitchen():
    if "IMODBATCH_DATA" not in os.environ:
        pytest.skip("IMODBATCH_DATA is not set: no real data")
    root = Path(os.environ["IMODBATCH_DATA"]) / "redkitchen"
    split = Manifest(
        name="redkitchen",
        adapter="seven_scenes",
        root=str(root),
        classes=["coffee_mug"],
        annotations={"format": "coco", "path": "mugs_coco.json"},
        sequences=[{"id": "seq-01", "path": "seq-01", "frames": "0:450"}],
    )
    section = split.sequences[0]
    reading = read_annotations(split, section, LAYOUT.frames(split, section), 640, 480)
    assert len(reading.rows) == 485
    assert sum(row["is_ignored"] for row in reading.rows) == 118
    assert {row["instance_id"] for row in reading.rows} == {"mug_white", "mug_patterned"}
    assert reading.left_out == Counter()
