"""index: what a folder holds becomes rows; what cannot be meant is one line with its cure."""

import json

import numpy as np
import pytest
from PIL import Image

from imodbatch.core.errors import DataError
from imodbatch.datasets import index
from imodbatch.settings.manifest import Manifest
from imodbatch.tables.schemas import ANNOTATIONS, FRAMES

WIDTH, HEIGHT = 32, 24
COLOR = {"width_px": 32, "height_px": 24, "fx_px": 30, "fy_px": 31, "cx_px": 16, "cy_px": 12}
DEPTH = {"width_px": 16, "height_px": 12, "fx_px": 20, "fy_px": 21, "cx_px": 8, "cy_px": 6}


def save(root, name, size=(WIDTH, HEIGHT), mode="RGB"):
    path = root / "walk" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.ones((size[1], size[0]), dtype=np.uint16)
    image = Image.fromarray(pixels) if mode == "I;16" else Image.new(mode, size)
    image.save(path)
    return path


def split(root, frames=None, camera=None, path="walk", **more):
    return Manifest(
        name="tiny",
        adapter="folder",
        root=str(root),
        classes=["mug", "bowl"],
        camera={"color": COLOR, **(camera or {})},
        images={"color": "c/{frame}.png", "depth": "d/{frame}.png", "frames_per_second": 10},
        sequences=[{"id": "s", "path": path, "frames": frames}],
        **more,
    )


def run(manifest, **more):
    return index.run(manifest, manifest.sequences[0], **more)


def fault(action, *mentions):
    with pytest.raises(DataError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


@pytest.fixture
def walk(tmp_path):
    for number in (3, 10, 4):
        save(tmp_path, f"c/{number}.png")
    for number in (3, 10):
        save(tmp_path, f"d/{number}.png", mode="I;16")
    return tmp_path


def test_a_row_per_frame(walk):
    result = run(split(walk))
    frames = result.tables["frames"]
    assert frames.schema.equals(FRAMES.schema)
    assert frames.to_pylist()[2] == {
        "sequence_id": "s",
        "frame_index": 10,
        "timestamp_ns": 10**9,
        "color_path": "walk/c/10.png",
        "depth_path": "walk/d/10.png",
        "depth_scale_m": 0.001,
        **COLOR,
        **{f"depth_{name}": value for name, value in COLOR.items()},
        "color_from_depth": None,
    }
    assert frames["frame_index"].to_pylist() == [3, 4, 10]
    assert frames["depth_path"].to_pylist() == ["walk/d/3.png", None, "walk/d/10.png"]
    assert result.summary == "3 frames = 2 with depth + 1 without; 0 annotations = 0 counted"
    assert result.warnings == []
    assert result.tables["annotations"].num_rows == 0
    assert result.tables["annotations"].schema.equals(ANNOTATIONS.schema)


def test_a_depth_camera_of_its_own(walk):
    for number in (3, 10):
        save(walk, f"d/{number}.png", (16, 12), "I;16")
    baseline = np.eye(4)
    baseline[0, 3] = 0.05
    camera = {"depth": {**DEPTH, "scale_m": 0.0002}, "color_from_depth": baseline.tolist()}
    row = run(split(walk, camera=camera)).tables["frames"].to_pylist()[0]
    assert {name: row[f"depth_{name}"] for name in DEPTH} == DEPTH
    assert {name: row[name] for name in COLOR} == COLOR
    assert row["depth_scale_m"] == 0.0002
    assert np.array_equal(np.reshape(row["color_from_depth"], (4, 4)), baseline)


def test_annotations_add_up(walk):
    boxes = [
        {"image_id": 0, "category_id": 1, "bbox": [1, 2, 10, 10]},
        {"image_id": 0, "category_id": 2, "bbox": [1, 2, 10, 10], "ignore": 1},
        {"image_id": 1, "category_id": 3, "bbox": [1, 2, 10, 10]},
        {"image_id": 1, "category_id": 1, "bbox": [100, 2, 10, 10]},
    ]
    categories = [{"id": i, "name": name} for i, name in ((1, "mug"), (2, "bowl"), (3, "cat"))]
    images = [{"id": i, "file_name": f"c/{name}.png"} for i, name in enumerate((3, 10))]
    document = {"images": images, "categories": categories, "annotations": boxes}
    (walk / "walk" / "a.json").write_text(json.dumps(document))
    result = run(split(walk, annotations={"format": "coco", "path": "a.json"}))
    table = result.tables["annotations"]
    assert table["sequence_id"].to_pylist() == ["s", "s"]
    assert table["class_id"].to_pylist() == [0, 1]
    assert table["is_ignored"].to_pylist() == [False, True]
    assert "4 annotations = 1 counted + 1 ignored + 1 left out (" in result.summary
    assert result.summary.count("left out") == 2


@pytest.mark.parametrize(
    ("name", "mode", "section"), [("c/4.png", "RGB", "color"), ("d/3.png", "I;16", "depth")]
)
def test_another_size(walk, name, mode, section):
    path = save(walk, name, (WIDTH, HEIGHT - 1), mode)
    fault(
        lambda: run(split(walk)), path, "32×23, expected 32×24", f"camera.{section} in the manifest"
    )


@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_depth_of_8_bits(walk, mode):
    path = save(walk, "d/3.png", mode=mode)
    fault(lambda: run(split(walk)), path, "16-bit single-channel", repr(mode), "Point the manifest")


def test_depth_in_place_of_colour(walk):
    path = save(walk, "c/4.png", mode="I;16")
    fault(lambda: run(split(walk)), path, "a depth image?", "Point the manifest at the colour")


def test_a_damaged_image_only_warns(walk):
    path = walk / "walk" / "d" / "3.png"
    path.write_bytes(b"")
    result = run(split(walk))
    assert len(result.warnings) == 1
    assert str(path) in result.warnings[0]
    assert result.tables["frames"].num_rows == 3


def test_a_missing_folder(walk):
    fault(lambda: run(split(walk, path="wlk")), walk / "wlk", "no such folder", "sequences.path")


def test_an_empty_folder(walk):
    (walk / "empty").mkdir()
    fault(
        lambda: run(split(walk, path="empty")),
        walk / "empty",
        "empty sequence 's'",
        "no colour image fits",
        "images.color",
    )


def test_a_slice_without_frames(walk):
    fault(lambda: run(split(walk, frames="11:20")), "'11:20'", "Widen sequences.frames")


def test_only_the_slice_is_looked_at(walk):
    save(walk, "c/4.png", (5, 5))
    result = run(split(walk, frames="5:"))
    assert result.tables["frames"]["frame_index"].to_pylist() == [10]


def test_progress_sees_every_frame(walk):
    seen = []

    def progress(files):
        for file in files:
            seen.append(file.frame_index)
            yield file

    run(split(walk), progress=progress)
    assert seen == [3, 4, 10]


def test_the_files_behind_it(walk):
    manifest = split(walk)
    files = index.image_files(manifest, manifest.sequences[0])
    names = ["c/3.png", "d/3.png", "c/4.png", "c/10.png", "d/10.png"]
    assert files == [walk / "walk" / name for name in names]
