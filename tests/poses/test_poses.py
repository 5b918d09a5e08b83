"""poses: every frame gets a pose or is lost, and the world stands upright."""

import numpy as np
import pytest

from imodbatch.core.errors import DataError
from imodbatch.core.frames import make_transform, matrix_from_quaternion, rotation_between
from imodbatch.datasets.base import Odometry
from imodbatch.poses import association as poses
from imodbatch.settings.config import PosesConfig
from imodbatch.tables.columns import world_from_cam_of
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import FRAMES, POSES

MS = 1_000_000
CAMERA = {"width_px": 4, "height_px": 3, "fx_px": 5, "fy_px": 5, "cx_px": 2, "cy_px": 1.5}
UP = (0.0, 0.0, 1.0)
NO_FIGURES = {"figures": {}}


def frames_table(numbers, stamps_ms=None):
    stamps = [None] * len(numbers) if stamps_ms is None else [round(s * MS) for s in stamps_ms]
    return from_rows(
        FRAMES,
        [
            {
                "sequence_id": "s",
                "frame_index": number,
                "timestamp_ns": stamp,
                "color_path": f"{number}.png",
                "depth_scale_m": 0.001,
                **CAMERA,
                **{f"depth_{name}": value for name, value in CAMERA.items()},
            }
            for number, stamp in zip(numbers, stamps, strict=True)
        ],
    )


def pose(x, yaw_rad=0.0):
    return make_transform(
        matrix_from_quaternion([np.cos(yaw_rad / 2), 0, 0, np.sin(yaw_rad / 2)]), [x, 0.5, -0.25]
    )


def by_number(numbers, matrices):
    return Odometry(np.array(matrices), frame_index=np.array(numbers))


def by_stamp(stamps_ms, matrices):
    stamps = np.array([round(s * MS) for s in stamps_ms], dtype=np.int64)
    return Odometry(np.array(matrices, dtype=float).reshape(-1, 4, 4), timestamp_ns=stamps)


def run(frames, odometry, up=UP, how="up as given", **config):
    trajectory = poses.from_odometry(frames, odometry, PosesConfig(**config))
    return poses.run(frames, trajectory, up, how)


def statuses(result):
    return result.tables["poses"]["status"].to_pylist()


def xs(result):
    return result.tables["poses"]["tx_m"].to_pylist()


def fault(action, *mentions):
    with pytest.raises(DataError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


def test_by_number():
    lost = np.full((4, 4), -np.inf)
    odometry = by_number([9, 2, 5, 7], [pose(9), pose(2, 0.4), lost, pose(7)])
    result = run(frames_table([2, 3, 5, 9]), odometry)
    table = result.tables["poses"]
    assert table.schema.equals(POSES.schema)
    assert table["frame_index"].to_pylist() == [2, 3, 5, 9]
    assert statuses(result) == ["tracked", "lost", "lost", "tracked"]
    assert xs(result) == [2.0, None, None, 9.0]
    assert result.summary == "4 frames = 2 tracked + 2 lost; up as given"
    restored = world_from_cam_of(table)
    assert sorted(restored) == [2, 9]
    assert np.allclose(restored[2], pose(2, 0.4), atol=1e-12)


def test_lost_frames_are_null_in_every_column():
    result = run(frames_table([0, 1]), by_number([0], [pose(1)]))
    row = result.tables["poses"].to_pylist()[1]
    assert {name for name, value in row.items() if value is not None} == {
        "sequence_id",
        "frame_index",
        "status",
    }


def test_a_pose_that_is_no_transform_is_lost():
    odometry = by_number([0, 1], [np.diag([2.0, 2, 2, 1]), pose(1)])
    assert statuses(run(frames_table([0, 1]), odometry)) == ["lost", "tracked"]


def test_by_stamp_within_the_gap_and_over_it():
    frames = frames_table([0, 1, 2], [100, 200, 300])
    odometry = by_stamp([300.0, 110.0, 220.001], [pose(3), pose(1), pose(2)])
    result = run(frames, odometry, interpolate="never", max_gap_ms=20)
    assert statuses(result) == ["tracked", "lost", "tracked"]
    assert xs(result) == [1.0, None, 3.0]
    result = run(frames, odometry, interpolate="never", max_gap_ms=21)
    assert statuses(result) == ["tracked"] * 3
    result = run(frames, odometry, interpolate="never", max_gap_ms=0)
    assert statuses(result) == ["lost", "lost", "tracked"]


def test_a_pose_serves_one_frame():
    result = run(frames_table([0, 1], [100, 104]), by_stamp([103], [pose(1)]), interpolate="never")
    assert statuses(result) == ["lost", "tracked"]


def test_doubled_and_unsorted_stamps():
    odometry = by_stamp([200, 100, 100], [pose(2), pose(1), pose(7)])
    result = run(frames_table([0, 1, 2], [100, 150, 200]), odometry)
    assert xs(result) == pytest.approx([1.0, 1.5, 2.0])


@pytest.mark.parametrize(
    ("interpolate", "expected", "x"),
    [
        ("never", ["tracked", "tracked", "lost", "lost"], [0.0, 1.0, None, None]),
        ("gaps", ["tracked", "tracked", "interpolated", "lost"], [0.0, 1.0, 1.5, None]),
        ("always", ["tracked", "interpolated", "interpolated", "lost"], [0.0, 1.1, 1.5, None]),
    ],
)
def test_interpolation(interpolate, expected, x):
    frames = frames_table([0, 1, 2, 3], [0, 110, 150, 230])
    odometry = by_stamp([0, 100, 200], [pose(0), pose(1, 0.2), pose(2, 0.6)])
    result = run(frames, odometry, interpolate=interpolate)
    assert statuses(result) == expected
    assert xs(result) == [None if value is None else pytest.approx(value) for value in x]
    if interpolate != "never":
        turn = world_from_cam_of(result.tables["poses"])[2]
        assert np.allclose(turn, pose(1.5, 0.4), atol=1e-9)


def test_interpolation_does_not_bridge_long_gaps():
    frames = frames_table([0, 1, 2], [0, 150, 300])
    odometry = by_stamp([0, 300], [pose(0), pose(3)])
    assert statuses(run(frames, odometry)) == ["tracked", "lost", "tracked"]
    result = run(frames, odometry, max_interpolation_gap_ms=300)
    assert statuses(result) == ["tracked", "interpolated", "tracked"]
    assert result.summary.startswith("3 frames = 2 tracked + 1 interpolated; ")


def test_interpolation_steps_over_poses_that_are_none():
    odometry = by_stamp([0, 50, 100], [pose(0), np.full((4, 4), np.nan), pose(1)])
    result = run(frames_table([0, 1], [0, 50]), odometry)
    assert statuses(result) == ["tracked", "interpolated"]
    assert xs(result) == pytest.approx([0.0, 0.5])


@pytest.mark.parametrize(
    ("odometry", "mentions"),
    [
        (by_stamp([], []), ("None of the trajectory's 0 poses", "odometry.format")),
        (by_number([7, 9], [pose(1)] * 2), ("numbered 0 to 1, poses 7 to 9", "odometry.path")),
        (by_number([0], [np.full((4, 4), np.nan)]), ("trajectory's 1 poses", "odometry.format")),
        (by_stamp([-150, 240], [pose(1)] * 2), ("stamps are 140.000 ms apart", "max_gap_ms")),
    ],
    ids=["empty", "other numbers", "nan", "far"],
)
def test_all_lost(odometry, mentions):
    frames = frames_table([0, 1], [0, 100])
    fault(lambda: run(frames, odometry), "s: none of 2 frames", *mentions)


def test_clocks_apart_are_named_with_the_offset_that_joins_them():
    start_ms = 1_305_031_102_175.0
    frames = frames_table([0, 1], [start_ms, start_ms + 100])
    moving = [pose(0), pose(1)]
    fault(
        lambda: run(frames, by_stamp([2000, 2100], moving)),
        "Frames run from 1305031102.175 to 1305031102.275 s, the trajectory from 2.000 to 2.100 s",
        "odometry.clock_offset_ms; +1305031100175.000 ms would",
    )
    fault(
        lambda: run(frames_table([0, 1], [0, 100]), by_stamp([130, 150], moving)),
        "Frames run from 0.000 to 0.100 s, the trajectory from 0.130 to 0.150 s",
        "-130.000 ms would",
    )
    fault(lambda: run(frames_table([0], [0]), by_stamp([330, -340], moving)), "330.000 ms apart")


def test_contradicting_stamps_are_counted_and_the_first_counts():
    frames = frames_table([0, 1], [100, 200])
    odometry = by_stamp([200, 100, 200, 200, 100], [pose(2), pose(1), pose(5), pose(2), pose(1)])
    result = run(frames, odometry)
    assert xs(result) == [1.0, 2.0]
    (warning,) = result.warnings
    assert "1 of 2 stamps" in warning
    assert "3.000 m apart; the first" in warning


def test_contradicting_frame_numbers_are_counted_and_the_first_counts():
    nan = np.full((4, 4), np.nan)
    result = run(frames_table([4, 6]), by_number([6, 4, 6, 6], [nan, pose(1), pose(3), pose(2)]))
    assert xs(result) == [1.0, 3.0]
    (warning,) = result.warnings
    assert "1 of 2 frame numbers" in warning
    assert "1.000 m apart" in warning


def test_repeated_poses_are_no_contradiction():
    odometry = by_stamp([0, 0, 100], [pose(0), pose(0), pose(1)])
    assert run(frames_table([0, 1], [0, 100]), odometry).warnings == []


def test_poses_left_out_of_a_trajectory_by_stamp_are_counted():
    odometry = by_stamp([0, 50, 100], [pose(0), np.full((4, 4), np.nan), pose(1)])
    result = run(frames_table([0, 1], [0, 100]), odometry)
    assert "; 1 of the trajectory's 3 poses left out: no stamp or no transform; " in result.summary
    assert result.warnings == []


def test_an_empty_trajectory_by_number():
    empty = Odometry(np.zeros((0, 4, 4)), frame_index=np.zeros(0, dtype=np.int64))
    fault(lambda: run(frames_table([0]), empty), "none of 1 frames")


def test_no_trajectory():
    fault(lambda: run(frames_table([0]), None), "s: ", "no camera poses", "Add [odometry]")


def test_stamps_are_needed_for_a_trajectory_by_stamp():
    odometry = by_stamp([0], [pose(1)])
    fault(lambda: run(frames_table([0]), odometry), "no timestamps", "images.frames_per_second")


def test_numbers_need_no_stamps():
    assert statuses(run(frames_table([0]), by_number([0], [pose(1)]))) == ["tracked"]


@pytest.mark.parametrize("up", [(0, -1, 0), (0, 0, -1), (1, 0, 0), (0.2, -3, 0.5)])
def test_a_given_up_becomes_z(up):
    camera = make_transform(rotation_between([0, 0, 1], [1, 2, 3]), [1.0, 2.0, 3.0])
    result = run(frames_table([0]), by_number([0], [camera]), up=up)
    levelled = world_from_cam_of(result.tables["poses"])[0]
    up_cam = camera[:3, :3].T @ np.array(up) / np.linalg.norm(up)
    assert np.allclose(levelled[:3, :3] @ up_cam, [0, 0, 1], atol=1e-9)
    height_m = camera[:3, 3] @ np.array(up) / np.linalg.norm(up)
    assert levelled[2, 3] == pytest.approx(height_m)
    assert result.attributes == {
        "up": list(map(float, up)),
        "levelling": "up as given",
        "figures": {},
    }


def test_how_up_was_found_is_reported():
    frames, odometry = frames_table([0, 1]), by_number([1], [pose(4)])
    result = run(frames, odometry, up=(0.0, -1.0, 0.0), how="up from planes")
    assert result.summary == "2 frames = 1 tracked + 1 lost; up from planes"
    assert result.attributes == {
        "up": [0.0, -1.0, 0.0],
        "levelling": "up from planes",
        "figures": {},
    }
    levelled = world_from_cam_of(result.tables["poses"])[1]
    assert np.allclose(levelled[:3, :3] @ [0, -1, 0], [0, 0, 1], atol=1e-9)
