"""UW RGB-D Object crops: what is read, what is left out and counted."""

import cv2
import numpy as np
import pytest

from imodbatch.errors import DataError
from imodbatch.training import load_cutouts, read_turntable
from imodbatch.training.turntable import class_names_of


def write_crop(folder, name, sequence, frame, *, azimuth="90.0", mask=True):
    path = folder / name.rsplit("_", 1)[0] / name
    path.mkdir(parents=True, exist_ok=True)
    stem = f"{name}_{sequence}_{frame}"
    color = np.zeros((20, 30, 3), np.uint8)
    color[4:16, 6:26] = (10, 20, 200)  # BGR: red
    cv2.imwrite(str(path / f"{stem}_crop.png"), color)
    inside = np.zeros((20, 30), np.uint8)
    inside[4:16, 6:26] = 1 if mask is True else 0
    if mask is not None:
        cv2.imwrite(str(path / f"{stem}_maskcrop.png"), inside)
    if azimuth is not None:
        (path / f"{stem}_pose.txt").write_text(f"{azimuth}\n")


@pytest.fixture
def dataset(tmp_path):
    folder = tmp_path / "rgbd-dataset"
    for sequence in (1, 2, 4):
        for frame, azimuth in ((1, "0.5"), (2, "359.5"), (10, "120")):
            write_crop(folder, "bowl_1", sequence, frame, azimuth=azimuth)
    write_crop(folder, "bowl_2", 1, 1)
    write_crop(folder, "bowl_2", 1, 2, azimuth=None)
    write_crop(folder, "bowl_2", 1, 3, mask=None)
    write_crop(folder, "bowl_2", 1, 4, mask=False)
    write_crop(folder, "bowl_2", 1, 5, azimuth="nan")
    write_crop(folder, "bowl_2", 3, 1)
    write_crop(folder, "coffee_mug_1", 4, 1, azimuth="-90")
    return folder


def test_layout_angles_and_counts(dataset, tmp_path):
    tables, counts = read_turntable(dataset, tmp_path / "cache", symmetries={"bowl": "full"})
    assert str(counts) == (
        "16 crops = 11 used + 1 without pose + 1 without mask + 2 unreadable or empty + "
        "1 of another sequence"
    )
    bowl, other, mug = (load_cutouts(table) for table in tables)
    assert (bowl.instance, other.instance, mug.instance) == ("bowl_1", "bowl_2", "coffee_mug_1")
    assert class_names_of(tables) == ["bowl", "coffee_mug"]
    assert (bowl.symmetry, mug.symmetry) == ("full", "none")
    assert sorted(set(np.rad2deg(bowl.elevation_rad).round(6))) == [30, 45, 60]
    assert sorted(set(np.rad2deg(bowl.azimuth_rad).round(6))) == [0.5, 120, 359.5]
    assert np.rad2deg(mug.azimuth_rad).tolist() == pytest.approx([270])
    rgba = bowl.rgba(0)
    assert rgba.shape == (12, 20, 4)
    assert (rgba == (200, 20, 10, 255)).all()


def test_instances_are_disjoint_by_list(dataset, tmp_path):
    train, _ = read_turntable(dataset, tmp_path / "cache", without=["bowl_2"])
    test, counts = read_turntable(dataset, tmp_path / "cache", instances=["bowl_2"])
    names = [{load_cutouts(t).instance for t in tables} for tables in (train, test)]
    assert names == [{"bowl_1", "coffee_mug_1"}, {"bowl_2"}]
    assert str(counts).startswith("6 crops = 1 used")
    only, _ = read_turntable(dataset, tmp_path / "cache", categories=["coffee_mug"])
    assert class_names_of(only) == ["coffee_mug"]


def test_sense_of_rotation_is_a_setting(dataset, tmp_path):
    tables, _ = read_turntable(
        dataset, tmp_path / "cache", categories=["coffee_mug"], azimuth_sign=-1
    )
    assert np.rad2deg(load_cutouts(tables[0]).azimuth_rad).tolist() == pytest.approx([90])


def test_cache_notices_new_files_and_keeps_counts(dataset, tmp_path):
    first = read_turntable(dataset, tmp_path / "cache")
    again = read_turntable(dataset, tmp_path / "cache")
    assert first[0] == again[0]
    assert str(first[1]) == str(again[1])
    (dataset / "bowl" / "bowl_2" / "bowl_2_1_2_pose.txt").write_text("45")
    _, counts = read_turntable(dataset, tmp_path / "cache")
    assert str(counts).startswith("16 crops = 12 used + 1 without mask")


def test_errors_name_the_cure(dataset, tmp_path):
    cache = tmp_path / "cache"
    with pytest.raises(DataError, match="no such folder"):
        read_turntable(tmp_path / "nowhere", cache)
    with pytest.raises(DataError, match="no category 'cap'"):
        read_turntable(dataset, cache, categories=["cap"])
    with pytest.raises(DataError, match="no instance 'bowl_9'"):
        read_turntable(dataset, cache, without=["bowl_9"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="no instances"):
        read_turntable(tmp_path / "empty", cache)
    write_crop(tmp_path / "poor", "cap_1", 1, 1, azimuth=None)
    with pytest.raises(DataError, match="1 without pose"):
        read_turntable(tmp_path / "poor", cache)
