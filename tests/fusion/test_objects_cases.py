"""Every column of the objects table, and fused scores, on paper: five boxes in three voxels."""

import math

import pytest
from hand_tables import detection, frame, observation, table

from imodbatch.fusion import fuse
from imodbatch.settings.config import FuseConfig, ViewpointConfig

MUG, BOX = 0, 1
VIEWPOINT = ViewpointConfig(n_azimuths=4, elevations_deg=(30.0,))


def config(mode="both"):
    return FuseConfig(methods=("single", "naive", "naive_log", "imod"), mode=mode)


def scores(mug=(0, 0.0), box=(0, 0.0)):
    """A score at one azimuth of each class, (bin, score); 2 classes × 1 elevation × 4 azimuths."""
    vector = [0.0] * 8
    vector[mug[0]], vector[4 + box[0]] = mug[1], box[1]
    return vector


# The mug is turned by d = 1 bin: seen from azimuth a it looks as from a + 1.
# frame, box, scores | place, voxel, azimuth bin, depth
CASES = [
    (10, (0, 0, 10, 10), scores((1, 0.6), (0, 0.1)), (1.0, 2.0, 0.5), (5, 10, 2), 0, 1.0),
    (20, (0, 0, 20, 20), scores((2, 0.5), (0, 0.1)), (1.1, 2.0, 0.5), (5, 10, 2), 1, 2.0),
    (20, (5, 5, 10, 10), scores((0, 0.05), (2, 0.9)), (-1.0, 0.0, 0.3), (-5, 0, 1), 2, 2.0),
    (30, (0, 0, 10, 5), scores((2, 0.7), (0, 0.1)), (1.5, 2.3, 0.8), (5, 10, 2), 1, 4.0),
    (30, (5, 5, 10, 10), scores((0, 0.3)), (9.0, 9.0, 0.3), (45, 45, 1), 0, 1.0),
]


def run(mode="both"):
    frames = [frame("s", 10), frame("s", 20, fx=200.0), frame("s", 30)]  # fx 100, 200, 100; fy 50
    boxes = [detection("s", f, i, b, v, (MUG, BOX)) for i, (f, b, v, *_) in enumerate(CASES)]
    boxes.append(detection("s", 30, 5, (0, 0, 1, 1), scores((0, 0.9)), (MUG,)))
    seen = [
        observation("s", f, i, xyz, voxel, (azimuth, 0), depth_m)
        for i, (f, _, _, xyz, voxel, azimuth, depth_m) in enumerate(CASES)
    ]
    seen.append(observation("s", 30, 5))  # has no place, so it is in no object
    result = fuse.run(
        table("frames", frames),
        table("detections", boxes),
        table("observations", seen),
        2,
        VIEWPOINT,
        config(mode),
    )
    assert result.summary == "6 detections = 5 fused + 1 single-view; 3 voxels"
    return result.tables


def objects(mode="both"):
    return {(r["method"], r["object_index"]): r for r in run(mode)["objects"].to_pylist()}


@pytest.mark.parametrize("mode", ["both", "online", "offline"])
def test_an_object_is_what_its_voxel_holds_after_all_frames(mode):
    """Whatever the frames of the run know."""
    mug = objects(mode)["imod", 0]
    assert mug["sequence_id"] == "s"
    assert mug["class_id"] == MUG
    # cells (a = 0) .6 and (a = 1) mean of .5 and .7, all for d = 1
    assert mug["score"] == pytest.approx(0.6 + 0.6)
    assert mug["n_cells"] == 2
    assert mug["n_detections"] == 3
    assert mug["yaw_rad"] == pytest.approx(3 * math.pi / 2)  # −1 bin of a quarter turn
    assert (mug["first_frame_index"], mug["last_frame_index"]) == (10, 30)


def test_place_is_a_mean_and_extent_a_median():
    mug = objects()["imod", 0]
    # x 1.0 1.1 1.5, y 2 2 2.3, z .5 .5 .8
    assert [mug[name] for name in ("x_m", "y_m", "z_m")] == pytest.approx([1.2, 2.1, 0.6])
    # widths 10·1/100 = .1, 20·2/200 = .2, 10·4/100 = .4; heights 10/50, 20·2/50, 5·4/50
    assert mug["extent_x_m"] == pytest.approx(0.2)
    assert mug["extent_z_m"] == pytest.approx(0.4)


def test_objects_are_numbered_by_falling_score():
    found = objects()
    second, third = found["imod", 1], found["imod", 2]
    assert second["class_id"] == BOX
    assert second["score"] == pytest.approx(0.9)
    assert second["yaw_rad"] == 0.0  # seen from azimuth 2 as from 2
    assert (second["n_cells"], second["n_detections"]) == (1, 1)
    assert (second["first_frame_index"], second["last_frame_index"]) == (20, 20)
    assert [second[name] for name in ("x_m", "y_m", "z_m")] == pytest.approx([-1.0, 0.0, 0.3])
    assert second["extent_x_m"] == pytest.approx(5 * 2 / 200)
    assert second["extent_z_m"] == pytest.approx(5 * 2 / 50)
    assert third["class_id"] == MUG
    assert third["score"] == pytest.approx(0.3)
    assert (third["first_frame_index"], third["last_frame_index"]) == (30, 30)


def test_sums_over_frames_know_no_yaw_and_count_frames():
    found = objects()
    assert {method for method, _ in found} == {
        "naive",
        "naive_log",
        "imod",
    }  # single knows no voxel
    naive, log = found["naive", 0], found["naive_log", 0]
    assert naive["score"] == pytest.approx(0.6 + 0.5 + 0.7)
    log_odds = math.log(0.6 / 0.4) + math.log(0.5 / 0.5) + math.log(0.7 / 0.3)
    second = math.log(0.9 / 0.1)  # one view of .9 outweighs three that are not so sure
    assert log["score"] == pytest.approx(second, rel=1e-6)
    assert found["naive_log", 1]["score"] == pytest.approx(log_odds, rel=1e-6)
    assert naive["yaw_rad"] is None
    assert log["yaw_rad"] is None
    assert naive["n_cells"] == 3


def test_scores_of_the_boxes_themselves():
    """Score, pose and cells of the mugs by frame, of the box, and of the mug without a place."""
    found = {
        (r["method"], r["detection_index"], r["class_id"]): (
            r["score"],
            r["pose_bin"],
            r["n_cells"],
        )
        for r in run()["fused"].to_pylist()
    }
    for method, scores_of, pose, cells in (
        ("single", (0.6, 0.5, 0.7), None, (1, 1, 1)),
        ("naive", (0.6, 1.1, 1.8), None, (1, 2, 3)),
        ("imod", (0.6, 1.1, 1.2), 1, (1, 2, 2)),
        ("imod_offline", (1.2, 1.2, 1.2), 1, (2, 2, 2)),
    ):
        for box, score, n in zip((0, 1, 3), scores_of, cells, strict=True):
            assert found[method, box, MUG] == (pytest.approx(score), pose, n)
        assert found[method, 5, MUG] == (pytest.approx(0.9), None, 0)
    assert found["imod", 2, BOX] == (pytest.approx(0.9), 0, 1)  # pose 0 is one
