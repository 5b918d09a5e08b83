"""UW RGB-D Object pictures: what is read, what is left out and counted."""

import cv2
import numpy as np
import pytest

from imodbatch.core.errors import DataError
from imodbatch.lab.pictures import load_cutouts, read_turntable
from imodbatch.lab.pictures.turntable import class_names_of


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
        "16 pictures = 11 used + 1 without pose + 1 without mask + 2 unreadable or empty + "
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
    assert str(counts).startswith("6 pictures = 1 used")
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
    assert str(counts).startswith("16 pictures = 12 used + 1 without mask")


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


def write_whole(folder, frame, *, mask=None, loc=None, mask_crop=True):
    """A picture of 40 × 30 with a red object of 20 × 12, whose left upper pixel is (15, 9)."""
    path = folder / "bowl" / "bowl_1"
    path.mkdir(parents=True, exist_ok=True)
    stem = f"bowl_1_1_{frame}"
    color = np.zeros((30, 40, 3), np.uint8)
    color[9:21, 15:35] = (10, 20, 200)  # BGR: red
    cv2.imwrite(str(path / f"{stem}.png"), color)
    cv2.imwrite(str(path / f"{stem}_depth.png"), np.full((30, 40), 800, np.uint16))
    inside = np.zeros((30, 40), np.uint8)
    inside[9:21, 15:35] = 255
    if mask is not None:
        cv2.imwrite(str(path / f"{stem}_mask.png"), inside if mask else inside[:20])
    if mask_crop:
        cv2.imwrite(str(path / f"{stem}_maskcrop.png"), inside[6:24, 12:38])
        cv2.imwrite(str(path / f"{stem}_depthcrop.png"), np.full((18, 26), 800, np.uint16))
    if loc is not None:
        (path / f"{stem}_loc.txt").write_text(loc)
    (path / f"{stem}_pose.txt").write_text(f"{frame}")


def test_whole_pictures_are_cut_out_by_their_mask_or_by_the_crops_place(tmp_path):
    folder = tmp_path / "rgbd-dataset"
    write_whole(folder, 10, mask=True, mask_crop=False)
    write_whole(folder, 20, loc="13,7\n")  # counted from 1: the crop begins at (12, 6)
    write_whole(folder, 30, loc="13,7", mask=True)
    tables, counts = read_turntable(folder, tmp_path / "cache")
    assert str(counts) == "3 pictures = 3 used"
    cutouts = load_cutouts(tables[0])
    assert np.rad2deg(cutouts.azimuth_rad).tolist() == pytest.approx([10, 20, 30])
    for index in range(3):
        rgba = cutouts.rgba(index)
        assert rgba.shape == (12, 20, 4)
        assert (rgba == (200, 20, 10, 255)).all()


def test_a_frame_with_crop_and_whole_picture_counts_once(tmp_path):
    folder = tmp_path / "rgbd-dataset"
    write_crop(folder, "bowl_1", 1, 5, azimuth="45")
    write_whole(folder, 5, mask=False)  # of the wrong size: only the crop is of use
    write_crop(folder, "bowl_1", 1, 5, azimuth="45")
    tables, counts = read_turntable(folder, tmp_path / "cache")
    assert str(counts) == "1 pictures = 1 used"
    assert np.rad2deg(load_cutouts(tables[0]).azimuth_rad).tolist() == pytest.approx([45])


@pytest.mark.parametrize(
    "loc", ["", "13", "13 7", "x,y", "0,7", "13,-7", "30,7", "13,7,1", "1e9,7"]
)
def test_a_damaged_place_is_counted(tmp_path, loc):
    folder = tmp_path / "rgbd-dataset"
    write_whole(folder, 10, mask=True)
    write_whole(folder, 20, loc=loc)
    _, counts = read_turntable(folder, tmp_path / "cache")
    assert str(counts) == "2 pictures = 1 used + 1 unreadable or empty"


def test_a_mask_crop_without_a_place_is_no_mask(tmp_path):
    folder = tmp_path / "rgbd-dataset"
    write_whole(folder, 10, mask=True)
    write_whole(folder, 20)
    _, counts = read_turntable(folder, tmp_path / "cache")
    assert str(counts) == "2 pictures = 1 used + 1 without mask"
