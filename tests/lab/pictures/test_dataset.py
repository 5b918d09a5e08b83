"""Training pictures on disk: COCO that adds up, resumed to the same bytes."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from imodbatch.core.errors import ConfigError
from imodbatch.lab.pictures import dataset, write_dataset


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(dataset, "CHUNK", 5)


@pytest.fixture(scope="module")
def whole(recipe, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataset, "CHUNK", 5)
        return folder, write_dataset(folder, recipe, 12)


def contents(folder):
    paths = [*(folder / "images").iterdir(), folder / "annotations.json"]
    return {path.name: path.read_bytes() for path in paths}


def test_coco_says_what_compose_says(recipe, whole):
    folder, summary = whole
    coco = json.loads((folder / "annotations.json").read_text())
    composer = recipe.composer()
    assert [c["name"] for c in coco["categories"]] == list(composer.class_names)
    assert [c["symmetry"] for c in coco["categories"]] == ["none", "full", 4]
    assert [image["id"] for image in coco["images"]] == list(range(12))
    assert [a["id"] for a in coco["annotations"]] == list(range(1, len(coco["annotations"]) + 1))
    for image in coco["images"]:
        picture = composer.compose(image["id"])
        stored = cv2.imread(str(folder / image["file_name"]))[..., ::-1].astype(int)
        assert stored.shape == (image["height"], image["width"], 3)
        assert np.abs(stored - picture.image).mean() < 4
        own = [a for a in coco["annotations"] if a["image_id"] == image["id"]]
        boxes = np.array([a["bbox"] for a in own]).reshape(-1, 4)
        boxes[:, 2:] += boxes[:, :2]
        assert np.array_equal(boxes, picture.boxes)
        for key, values in {
            "category_id": picture.class_ids + 1,
            "azimuth_bin": picture.azimuth_bins,
            "elevation_bin": picture.elevation_bins,
            "ignore": picture.ignore,
        }.items():
            assert [a[key] for a in own] == values.tolist()
        assert [a["azimuth_deg"] for a in own] == pytest.approx(
            np.rad2deg(picture.azimuth_rad), abs=1e-3
        )
    ignored = sum(a["ignore"] for a in coco["annotations"])
    assert (summary.n_made, summary.n_found) == (12, 0)
    assert (summary.n_annotations, summary.n_ignored) == (len(coco["annotations"]), ignored)
    assert sum(summary.n_by_blending.values()) == 12
    assert str(summary).startswith("12 pictures = 12 made + 0 there already = ")


def test_killed_and_resumed_it_ends_with_the_same_bytes(recipe, whole, tmp_path, monkeypatch):
    real, made = dataset.write_bytes, []

    def killed(path, content, sync):
        made.append(path)
        if len(made) > 7:
            path.with_name(f".{path.name}.partial").write_bytes(b"half")
            raise KeyboardInterrupt
        real(path, content, sync)

    monkeypatch.setattr(dataset, "write_bytes", killed)
    with pytest.raises(KeyboardInterrupt):
        write_dataset(tmp_path, recipe, 12)
    assert not (tmp_path / "annotations.json").exists()
    monkeypatch.setattr(dataset, "write_bytes", real)
    calls = []
    summary = write_dataset(tmp_path, recipe, 12, progress=lambda *n: calls.append(n))
    assert calls == [(5, 12), (10, 12), (12, 12)]
    assert (summary.n_made, summary.n_found) == (7, 5)
    assert contents(tmp_path) == contents(whole[0])


def test_two_processes_write_what_one_does(recipe, whole, tmp_path):
    write_dataset(tmp_path, recipe, 12, workers=2)
    assert contents(tmp_path) == contents(whole[0])


def test_more_pictures_add_to_those_there(recipe, whole, tmp_path):
    write_dataset(tmp_path, recipe, 7)
    summary = write_dataset(tmp_path, recipe, 12)
    assert (summary.n_made, summary.n_found) == (7, 5)
    assert contents(tmp_path) == contents(whole[0])


@pytest.mark.parametrize("harm", ["lost", "cut short"])
def test_a_damaged_picture_is_made_again(recipe, whole, tmp_path, harm):
    write_dataset(tmp_path, recipe, 12)
    picture = tmp_path / "images" / "000006.jpg"
    if harm == "lost":
        picture.unlink()
    else:
        picture.write_bytes(picture.read_bytes()[:-1])
    assert write_dataset(tmp_path, recipe, 12).n_made == 5
    assert contents(tmp_path) == contents(whole[0])


def test_pictures_of_two_recipes_are_not_mixed(recipe, tmp_path):
    write_dataset(tmp_path, recipe, 3)
    other = replace(recipe, seed=5)
    with pytest.raises(ConfigError, match="--overwrite") as error:
        write_dataset(tmp_path, other, 3)
    assert "\n" not in str(error.value)
    before = contents(tmp_path)
    assert write_dataset(tmp_path, other, 3, overwrite=True).n_made == 3
    assert contents(tmp_path) != before
    with pytest.raises(ConfigError, match="n: expected"):
        write_dataset(tmp_path, other, 0)
