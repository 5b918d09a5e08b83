"""Another detector's results: every layout, what is left out, and every way a file can be wrong."""

import json
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from imodbatch.core.errors import ConfigError, DataError, ImodError
from imodbatch.datasets.base import FrameFile
from imodbatch.datasets.detections import detection_files, read_detections
from imodbatch.datasets.seven_scenes import LAYOUT
from imodbatch.settings.manifest import Manifest

WIDTH, HEIGHT = 100, 80
GRID = (3, 16)
CATEGORIES = [{"id": 1, "name": "mug"}, {"id": 2, "name": "Bowl"}, {"id": 3, "name": "Chair"}]
COLUMNS = ("frame_index", "x0_px", "y0_px", "x1_px", "y1_px")


def manifest(root, sequences=("seq-01",), frames=None, annotations=None, **detections):
    return Manifest(
        name="tiny",
        adapter="folder",
        root=str(root),
        classes=["mug", "bowl"],
        annotations=annotations or {},
        detections=detections or None,
        sequences=[{"id": name, "path": name, "frames": frames} for name in sequences],
    )


def frame_files(sequence="seq-01", numbers=(0, 1, 2)):
    return [FrameFile(n, None, f"{sequence}/rgb_{n:03d}.png", None) for n in numbers]


def read(split, numbers=(0, 1, 2), sequence=0, grid=GRID):
    section = split.sequences[sequence]
    return read_detections(split, section, frame_files(section.id, numbers), WIDTH, HEIGHT, grid)


def error_of(action, *mentions, kind=DataError):
    with pytest.raises(kind) as caught:
        action()
    text = str(caught.value)
    assert isinstance(caught.value, ImodError)
    assert len(text.splitlines()) == 1
    for mention in mentions:
        assert str(mention) in text


def touch(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")


def write_json(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def result(image_id=0, category_id=1, bbox=(10, 20, 30, 40), score=0.75):
    return {
        "image_id": image_id,
        "category_id": category_id,
        "bbox": list(bbox),
        "score": score,
    }


def write_results(root, *results, key="detections", name="found.json", **more):
    write_json(root / name, {"categories": CATEGORIES, key: list(results), **more})
    return {"format": "coco", "path": name}


def images(*names, first_id=0):
    return [{"id": first_id + i, "file_name": name} for i, name in enumerate(names)]


def instances(names, categories=CATEGORIES):
    return {"images": names, "categories": categories, "annotations": []}


def write_csv(root, header, *rows, name="found.csv"):
    lines = [",".join(header), *(",".join(map(str, row)) for row in rows)]
    (root / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return {"format": "csv", "path": name}


def write_parquet(root, columns, name="found.parquet"):
    parquet.write_table(pa.table(columns), root / name)
    return {"format": "parquet", "path": name}


def one_row(**columns):
    return {**dict(zip(COLUMNS, [[0], [1.0], [2.0], [3.0], [4.0]], strict=True)), **columns}


# --- COCO results ---


@pytest.mark.parametrize("key", ["detections", "annotations"])
def test_a_coco_score_becomes_the_entry_of_its_class(tmp_path, key):
    keys = write_results(
        tmp_path,
        result(2, 1, score=0.25),
        result(0, 2, (50, 40, 100, 100), score=1),
        key=key,
    )
    found = read(manifest(tmp_path, rename={"Bowl": "bowl"}, **keys))
    assert found.frame_index.tolist() == [2, 0]
    assert found.boxes.tolist() == [[10, 20, 40, 60], [50, 40, WIDTH, HEIGHT]]
    assert found.scores.tolist() == [[0.25, 0], [0, 1]]
    assert found.background.tolist() == [0.75, 0]
    assert found.left_out == Counter()
    types = [a.dtype for a in (found.frame_index, found.boxes, found.scores, found.background)]
    assert types == [np.int64, np.float64, np.float32, np.float32]


def test_other_classes_are_counted_and_several_names_may_become_one(tmp_path):
    keys = write_results(tmp_path, result(0, 1), result(0, 2), result(1, 3))
    found = read(manifest(tmp_path, rename={"Bowl": "mug"}, **keys))
    assert (found.scores > 0).tolist() == [[True, False], [True, False]]
    assert found.left_out == {"other classes": 1}


def test_a_list_of_results_takes_names_from_the_annotations(tmp_path):
    write_json(tmp_path / "found.json", [result(7, 2), result(8, 1)])
    names = images("rgb_001.png", "seq-01/rgb_000.png", first_id=7)
    true_boxes = write_json(tmp_path / "true.json", instances(names))
    annotations = {"format": "coco", "path": "true.json"}
    split = manifest(tmp_path, annotations=annotations, format="coco", path="found.json")
    found = read(split)
    assert found.frame_index.tolist() == [0]
    assert found.left_out == {"other classes": 1}
    files = detection_files(split, split.sequences[0])
    assert files == [tmp_path / "found.json", true_boxes]


def test_a_list_of_results_takes_names_from_the_images_file(tmp_path):
    write_json(tmp_path / "found.json", [result("a"), result("b")])
    names = [{"id": "a", "file_name": "rgb_002.png"}, {"id": "b", "file_name": "rgb_001.png"}]
    write_json(tmp_path / "images.json", instances(names))
    split = manifest(tmp_path, format="coco", path="found.json", images="images.json")
    assert read(split).frame_index.tolist() == [2, 1]
    assert tmp_path / "images.json" in detection_files(split, split.sequences[0])


def test_images_of_the_results_themselves_come_first(tmp_path):
    keys = write_results(tmp_path, result(5), images=images("rgb_001.png", first_id=5))
    write_json(tmp_path / "images.json", instances(images("rgb_002.png", first_id=5)))
    split = manifest(tmp_path, images="images.json", **keys)
    assert read(split).frame_index.tolist() == [1]


def test_without_images_an_id_is_a_frame_number_or_a_file_name(tmp_path):
    keys = write_results(tmp_path, result(2), result("rgb_001.png"), result("seq-01/rgb_000.png"))
    assert read(manifest(tmp_path, **keys)).frame_index.tolist() == [2, 1, 0]


def test_results_whose_categories_mean_nothing_are_refused(tmp_path):
    path = write_json(tmp_path / "found.json", [result()])
    split = manifest(tmp_path, format="coco", path="found.json")
    error_of(lambda: read(split), path, "categories", "detections.images")
    keys = write_results(tmp_path, result(category_id=9))
    error_of(lambda: read(manifest(tmp_path, **keys)), path, "detections[0]", "category_id 9")


def test_no_results_give_no_detections(tmp_path):
    for content in ([], {"categories": CATEGORIES, "detections": []}):
        write_json(tmp_path / "found.json", content)
        found = read(manifest(tmp_path, format="coco", path="found.json"))
        shapes = [a.shape for a in (found.frame_index, found.boxes, found.scores)]
        assert shapes == [(0,), (0, 4), (0, 2)]
        assert found.left_out == Counter()


def change_of(key, value):
    def change(entry):
        if value is None:
            del entry[key]
        else:
            entry[key] = value

    return change


COCO_FAULTS = [
    (change_of("bbox", None), 'detections[1] has no "bbox"'),
    (change_of("score", None), 'detections[1] has no "score"'),
    (change_of("image_id", None), 'detections[1] has no "image_id"'),
    (change_of("category_id", None), 'detections[1] has no "category_id"'),
    (change_of("bbox", [1, 2, 3]), "four finite numbers"),
    (change_of("bbox", [1, 2, 3, float("nan")]), "four finite numbers"),
    (change_of("bbox", [10, 2, -3, 4]), "runs backwards"),
    (change_of("score", float("nan")), "detections[1]: the score nan"),
    (change_of("score", float("inf")), "detections[1]: the score inf"),
    (change_of("score", 3.2), "logits"),
    (change_of("score", -0.1), "logits"),
    (change_of("score", "0.5"), "Expected a number"),
    (change_of("image_id", 1.5), "Expected a whole number or a string"),
]


@pytest.mark.parametrize(("change", "mention"), COCO_FAULTS)
def test_damaged_coco_results_are_refused_in_one_line(tmp_path, change, mention):
    faulty = result()
    change(faulty)
    keys = write_results(tmp_path, result(), faulty)
    error_of(lambda: read(manifest(tmp_path, **keys)), tmp_path / "found.json", mention)


@pytest.mark.parametrize("content", [{}, 3, {"detections": {}}, [1]])
def test_json_that_is_no_coco_results_is_refused(tmp_path, content):
    path = write_json(tmp_path / "found.json", content)
    error_of(lambda: read(manifest(tmp_path, format="coco", path="found.json")), path, "COCO")


def test_coco_results_with_a_viewpoint_grid_are_refused(tmp_path):
    keys = write_results(tmp_path, result())
    split = manifest(tmp_path, n_azimuths=16, elevations_deg=[10.0, 30.0, 50.0], **keys)
    error_of(lambda: read(split), "tiny", "n_azimuths", kind=ConfigError)


# --- which frames ---


def test_frames_of_the_dataset_outside_the_slice_are_counted(tmp_path):
    keys = write_results(tmp_path, result(0), result(1), result(2), result(700))
    found = read(manifest(tmp_path, frames="0:4:2", **keys), numbers=(0, 2))
    assert found.frame_index.tolist() == [0, 2]
    assert found.left_out == {"other frames": 2}


def test_a_frame_that_the_slice_keeps_but_does_not_exist_is_unknown(tmp_path):
    keys = write_results(tmp_path, result(0), result(40), result(41), result(700))
    path = tmp_path / "found.json"
    split = manifest(tmp_path, frames="0:450", **keys)
    cure = 'detections.unknown_frames = "skip"'
    error_of(lambda: read(split), path, "detections[1]", "40", "2 such", cure)
    found = read(manifest(tmp_path, frames="0:450", unknown_frames="skip", **keys))
    assert found.left_out == {"unknown frames": 2, "other frames": 1}


def test_an_image_id_that_no_image_has_is_unknown(tmp_path):
    keys = write_results(tmp_path, result(0), result(9), images=images("rgb_000.png"))
    error_of(lambda: read(manifest(tmp_path, **keys)), tmp_path / "found.json", "9", "1 such")


def test_an_image_is_of_other_frames_only_if_it_exists(tmp_path):
    names = images("rgb_000.png", "rgb_055.png", "seq-02/rgb_000.png", "elsewhere_1.png")
    keys = write_results(tmp_path, *(result(i) for i in range(4)), images=names)
    split = manifest(tmp_path, ("seq-01", "seq-02"), **keys)
    error_of(lambda: read(split), tmp_path / "found.json", "detections[1]", "3 such")
    for name in ("seq-01/rgb_055.png", "seq-02/rgb_000.png", "seq-02/elsewhere_1.png"):
        touch(tmp_path / name)
    skip = manifest(tmp_path, ("seq-01",), **keys)
    error_of(lambda: read(skip), tmp_path / "found.json", "detections[3]", "1 such")
    (tmp_path / "seq-02/rgb_000.png").unlink()
    touch(tmp_path / "elsewhere_1.png")
    error_of(lambda: read(split), tmp_path / "found.json", "detections[2]", "1 such")


def test_images_of_other_sequences_are_counted(tmp_path):
    names = images("seq-01/rgb_000.png", "seq-02/rgb_000.png", "seq-02/rgb_001.png")
    keys = write_results(tmp_path, *(result(i) for i in range(3)), images=names)
    for name in ("seq-02/rgb_000.png", "seq-02/rgb_001.png"):
        touch(tmp_path / name)
    split = manifest(tmp_path, ("seq-01", "seq-02"), unknown_frames="skip", **keys)
    first, second = read(split), read(split, sequence=1)
    assert (first.frame_index.tolist(), first.left_out) == ([0], {"other frames": 2})
    assert (second.frame_index.tolist(), second.left_out) == ([0, 1], {"unknown frames": 1})


def test_numbers_in_a_file_of_several_sequences_are_refused(tmp_path):
    rows = [(0, 1, 2, 3, 4, "mug", 0.5)]
    for keys, cure in (
        (write_results(tmp_path, result(0)), "detections.images"),
        (write_csv(tmp_path, (*COLUMNS, "class_name", "score"), *rows), "sequence_id"),
    ):
        split = manifest(tmp_path, ("seq-01", "seq-02"), **keys)
        error_of(lambda split=split: read(split), tmp_path / keys["path"], cure, "{sequence}")


def test_numbers_in_each_sequences_own_file_are_its_own(tmp_path):
    write_results(tmp_path, result(0), name="seq-01/found.json")
    write_results(tmp_path, result(1), name="seq-02/found.json")
    for path in ("found.json", "{sequence}/found.json"):
        split = manifest(tmp_path, ("seq-01", "seq-02"), format="coco", path=path)
        assert read(split).frame_index.tolist() == [0]
        assert read(split, sequence=1).frame_index.tolist() == [1]


# --- boxes ---


def test_boxes_are_cut_and_those_with_nothing_in_the_image_are_counted(tmp_path):
    keys = write_results(
        tmp_path,
        result(bbox=(-5, -5, 10, 10)),
        result(bbox=(200, 5, 10, 10)),
        result(bbox=(100, 5, 10, 10)),
        result(bbox=(10, 5, 0, 10)),
    )
    found = read(manifest(tmp_path, **keys))
    assert found.boxes.tolist() == [[0, 0, 5, 5]]
    assert found.left_out == {"outside image": 2, "no area": 1}


def test_every_entry_is_kept_or_counted_once(tmp_path):
    keys = write_results(
        tmp_path,
        result(0, 3, (200, 5, 10, 10)),
        result(9, 3, (200, 5, 10, 10)),
        result(0, 1, (200, 5, 0, 10)),
        result(0, 1),
    )
    found = read(manifest(tmp_path, frames=":5", **keys))
    assert found.left_out == {"other classes": 1, "other frames": 1, "no area": 1}
    assert len(found.boxes) == 1


# --- tables ---


def test_csv_with_class_names(tmp_path):
    header = (*COLUMNS, "class_name", "score", "comment")
    rows = [
        (1, 10, 20, 30.5, 40, "mug", 0.25, "x"),
        (0, 1, 2, 3, 4, "Bowl", 1, ""),
        (0, 1, 2, 3, 4, "chair", 0.5, ""),
        (0, 1, 2, 3, 4, "", 0.5, ""),
    ]
    keys = write_csv(tmp_path, header, *rows)
    found = read(manifest(tmp_path, rename={"Bowl": "bowl"}, **keys))
    assert found.frame_index.tolist() == [1, 0]
    assert found.boxes.tolist() == [[10, 20, 30.5, 40], [1, 2, 3, 4]]
    assert found.scores.tolist() == [[0.25, 0], [0, 1]]
    assert found.background.tolist() == [0.75, 0]
    assert found.left_out == {"other classes": 2}


def test_csv_sequence_ids_are_names_even_if_they_look_like_numbers(tmp_path):
    header = ("sequence_id", *COLUMNS, "class_name", "score")
    rows = [("01", 0, 1, 2, 3, 4, "mug", 0.5), ("1", 1, 1, 2, 3, 4, "mug", 0.5)]
    split = manifest(tmp_path, ("01", "1"), **write_csv(tmp_path, header, *rows))
    first, second = read(split), read(split, sequence=1)
    assert (first.frame_index.tolist(), first.left_out) == ([0], {"other sequences": 1})
    assert (second.frame_index.tolist(), second.left_out) == ([1], {"other sequences": 1})


def test_rows_of_other_sequences_are_never_of_unknown_frames(tmp_path):
    header = ("sequence_id", "file_name", *COLUMNS[1:], "class_name", "score")
    rows = [
        ("seq-02", "rgb_900.png", 1, 2, 3, 4, "mug", 0.5),
        ("seq-01", "rgb_002.png", 1, 2, 3, 4, "mug", 0.5),
    ]
    found = read(manifest(tmp_path, **write_csv(tmp_path, header, *rows)))
    assert (found.frame_index.tolist(), found.left_out) == ([2], {"other sequences": 1})


def test_a_name_that_two_sequences_have_needs_a_sequence_id(tmp_path):
    touch(tmp_path / "seq-02/rgb_000.png")
    header = ("file_name", *COLUMNS[1:], "class_name", "score")
    row = ("rgb_000.png", 1, 2, 3, 4, "mug", 0.5)
    split = manifest(tmp_path, ("seq-01", "seq-02"), **write_csv(tmp_path, header, row))
    error_of(lambda: read(split), tmp_path / "found.csv", "seq-01/rgb_000.png", "seq-02/rgb_000")
    write_csv(tmp_path, ("sequence_id", *header), ("seq-01", *row), ("seq-02", *row))
    for number in (0, 1):
        found = read(split, sequence=number)
        assert (found.frame_index.tolist(), found.left_out) == ([0], {"other sequences": 1})


def test_csv_with_score_vectors(tmp_path):
    header = (*COLUMNS, "view_score_1", "view_score_0")
    keys = write_csv(tmp_path, header, (0, 1, 2, 3, 4, 0.5, 0.125))
    found = read(manifest(tmp_path, **keys))
    assert found.scores.tolist() == [[0.125, 0.5]]
    assert found.background.tolist() == [0.375]


@pytest.mark.parametrize("kind", [pa.float16(), pa.float32(), pa.float64()])
@pytest.mark.parametrize("is_fixed", [False, True])
def test_parquet_with_score_vectors_in_c_order(tmp_path, kind, is_fixed):
    scores = np.zeros((2, 3, 4))
    scores[1, 2, 3] = 0.5
    scores[0, 1, 2] = 0.25
    dtype = pa.list_(kind, 24) if is_fixed else pa.list_(kind)
    flat = scores.ravel().astype(kind.to_pandas_dtype())
    keys = write_parquet(tmp_path, one_row(view_scores=pa.array([list(flat)], dtype)))
    split = manifest(tmp_path, n_azimuths=4, elevations_deg=[10.0, 30.0, 50.0], **keys)
    found = read(split, grid=(3, 4))
    assert found.scores.dtype == np.float32
    np.testing.assert_array_equal(found.scores.reshape(2, 3, 4), scores)
    assert found.background.tolist() == [0.25]


def test_parquet_vectors_of_classes_alone_fit_any_pipeline(tmp_path):
    keys = write_parquet(tmp_path, one_row(view_scores=[[0.25, 0.5]], background_score=[0.125]))
    found = read(manifest(tmp_path, **keys), grid=(5, 7))
    assert found.scores.tolist() == [[0.25, 0.5]]
    assert found.background.tolist() == [0.125]


def test_rounding_never_makes_a_negative_background(tmp_path):
    keys = write_parquet(tmp_path, one_row(view_scores=[[0.5, 0.505]]))
    assert read(manifest(tmp_path, **keys)).background.tolist() == [0]


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_table_without_rows_gives_no_detections(tmp_path, form):
    if form == "csv":
        keys = write_csv(tmp_path, (*COLUMNS, "class_name", "score"))
    else:
        empty = {name: pa.array([], pa.float64()) for name in COLUMNS}
        keys = write_parquet(
            tmp_path, {**empty, "view_scores": pa.array([], pa.list_(pa.float32()))}
        )
    found = read(manifest(tmp_path, **keys))
    assert (found.boxes.shape, found.scores.shape) == ((0, 4), (0, 2))
    assert found.left_out == Counter()


@pytest.mark.parametrize(
    ("own", "pipeline"),
    [
        ({"n_azimuths": 8, "elevations_deg": [10.0, 30.0, 50.0]}, (3, 16)),
        ({"n_azimuths": 16}, (3, 16)),
        ({"elevations_deg": [10.0, 30.0]}, (1, 2)),
    ],
)
def test_a_grid_that_is_not_the_pipelines_is_refused(tmp_path, own, pipeline):
    keys = write_parquet(tmp_path, one_row(view_scores=[[0.5, 0.5]]))
    split = manifest(tmp_path, **own, **keys)
    error_of(lambda: read(split, grid=pipeline), "tiny", "viewpoint.n_azimuths", kind=ConfigError)


def test_class_names_with_a_viewpoint_grid_are_refused(tmp_path):
    keys = write_parquet(tmp_path, one_row(class_name=["mug"], score=[0.5]))
    split = manifest(tmp_path, n_azimuths=4, **keys)
    path = tmp_path / "found.parquet"
    error_of(lambda: read(split, grid=(1, 4)), path, "view_scores", kind=ConfigError)


def changed(**columns):
    return {**one_row(class_name=["mug"], score=[0.5]), **columns}


def lacking(name):
    return {key: values for key, values in changed().items() if key != name}


def with_vectors(values, **more):
    return one_row(view_scores=values, **more)


TABLE_FAULTS = [
    (changed(x0_px=[None]), "row 0"),
    (changed(x0_px=[float("nan")]), "not finite"),
    (changed(y1_px=[float("inf")]), "not finite"),
    (changed(x0_px=[50.0]), "width, height"),
    (changed(y0_px=["top"]), "y0_px"),
    (changed(score=[1.5]), "logits"),
    (changed(score=[float("nan")]), "the score nan"),
    (changed(frame_index=[0.5]), "frame_index"),
    (changed(frame_index=pa.array([None], pa.int64())), "row 0 (from 0) has no frame"),
    (changed(class_name=pa.array([None], pa.string())), "has no class_name"),
    (changed(sequence_id=pa.array([None], pa.string())), "has no sequence_id"),
    (lacking("x1_px"), "has no column x1_px"),
    (lacking("frame_index"), "file_name"),
    (lacking("score"), "has no scores"),
    (with_vectors([[0.5]]), "2 = 2 classes x 1 elevations x 1 azimuths"),
    (with_vectors(pa.array([None], pa.list_(pa.float32()))), "row 0"),
    (with_vectors([[0.5, None]]), "the score nan"),
    (with_vectors([[0.5, 2.0]]), "logits"),
    (with_vectors([[0.5, -0.5]]), "logits"),
    (with_vectors([[0.75, 0.75]]), "sum to 1.5"),
    (with_vectors([[0.5, 0.5]], background_score=[2.0]), "logits"),
    (with_vectors([0.5]), "Expected lists of numbers"),
    (with_vectors([["a", "b"]]), "Expected lists of numbers"),
    (one_row(view_score_0=[0.5]), "2 = 2 classes"),
    (one_row(view_score_0=[0.5], view_score_2=[0.5]), "2 = 2 classes"),
]


@pytest.mark.parametrize(("columns", "mention"), TABLE_FAULTS)
def test_damaged_tables_are_refused_in_one_line(tmp_path, columns, mention):
    keys = write_parquet(tmp_path, columns)
    error_of(lambda: read(manifest(tmp_path, **keys)), tmp_path / "found.parquet", mention)


def test_a_damaged_csv_names_the_column(tmp_path):
    header = (*COLUMNS, "class_name", "score")
    keys = write_csv(tmp_path, header, (0, 1, 2, 3, 4, "mug", "high"))
    error_of(lambda: read(manifest(tmp_path, **keys)), tmp_path / "found.csv", "score")


def test_a_repeated_column_is_refused(tmp_path):
    header = (*COLUMNS, "class_name", "score", "score")
    keys = write_csv(tmp_path, header, (0, 1, 2, 3, 4, "mug", 0.5, 0.5))
    error_of(lambda: read(manifest(tmp_path, **keys)), tmp_path / "found.csv", "score")


# --- files ---


@pytest.mark.parametrize("form", ["coco", "csv", "parquet"])
def test_missing_and_unreadable_files_are_refused(tmp_path, form):
    path = tmp_path / "found"
    split = manifest(tmp_path, format=form, path="found")
    for action in (lambda: read(split), lambda: detection_files(split, split.sequences[0])):
        error_of(action, path, "detections.path")
    path.write_bytes(b"")
    error_of(lambda: read(split), path)


def test_a_missing_images_file_is_refused(tmp_path):
    keys = write_results(tmp_path, result())
    split = manifest(tmp_path, images="images.json", **keys)
    for action in (lambda: read(split), lambda: detection_files(split, split.sequences[0])):
        error_of(action, tmp_path / "images.json", "detections.images")


def test_a_manifest_without_detections_is_refused(tmp_path):
    split = manifest(tmp_path)
    for action in (lambda: read(split), lambda: detection_files(split, split.sequences[0])):
        error_of(action, "tiny", "[detections]", kind=ConfigError)


def test_a_rename_to_no_class_is_refused(tmp_path):
    split = manifest(tmp_path, rename={"Mug": "mgu"}, **write_results(tmp_path, result()))
    error_of(lambda: read(split), "detections.rename", "'mgu'", "'mug'", kind=ConfigError)


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
        detections={
            "format": "coco",
            "path": "detections_ssd_oidv4.json",
            "rename": {"Mug": "coffee_mug"},
        },
        sequences=[{"id": "seq-01", "path": "seq-01", "frames": "0:450"}],
    )
    section = split.sequences[0]
    frames = LAYOUT.frames(split, section)
    found = read_detections(split, section, frames, 640, 480, GRID)
    assert len(found.boxes) == 350
    assert found.left_out == {"other classes": 17_650}
    assert found.scores.shape == (350, 1)
    np.testing.assert_allclose(found.scores[:, 0] + found.background, 1.0, atol=1e-6)
