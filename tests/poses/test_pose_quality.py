"""pose_quality: figures are null where nothing can be told, and rise with planted faults."""

from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from scene import CAMERA, make_scene

from imodbatch.core.alignment import align_poses
from imodbatch.core.frames import exp_twist, invert, make_transform, matrix_from_quaternion
from imodbatch.core.trajectory import DENSE, LOST, TRACKED, FramePoses, Trajectory
from imodbatch.lab.analytic.path import look_at
from imodbatch.lab.analytic.render import trace
from imodbatch.poses import association as poses
from imodbatch.poses import quality as pose_quality
from imodbatch.poses.quality import ImageChecks, Reference
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.settings.config import PoseQualityConfig
from imodbatch.tables.columns import world_from_cam_of
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import FRAMES, POSE_QUALITY, REFERENCE_POSES

N = 12
TENTH_S = 100_000_000
ELSEWHERE = make_transform(matrix_from_quaternion([0.7, 0.1, 0.5, -0.5]), [4.0, -1.0, 2.0])
NOTHING = (np.zeros(0), np.zeros(0))


@cache
def walk():
    """Poses (N, 4, 4) in a world with +z up, and exact depth; read-only."""
    world = make_scene().world
    angle = 0.3 + 0.04 * np.arange(N)
    center = np.stack(
        [1.5 * np.cos(angle), 1.5 * np.sin(angle), 1.5 + 0.1 * np.sin(3 * angle)], axis=-1
    )
    true = look_at(center, np.array([0.0, 0.0, 0.85]))
    depth = np.stack([trace(world, CAMERA, pose).depth_m for pose in true]).astype(np.float32)
    for array in (true, depth):
        array.setflags(write=False)
    return true, depth


def frames_table(n=N, has_stamps=True):
    names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    camera = {name: getattr(CAMERA, name) for name in names}
    row = {"sequence_id": "s", "color_path": "c", "depth_path": "d", "depth_scale_m": 0.001}
    row |= camera | {f"depth_{name}": value for name, value in camera.items()}
    stamps = [i * TENTH_S if has_stamps else None for i in range(n)]
    keys = [{"frame_index": 3 * i, "timestamp_ns": stamps[i]} for i in range(n)]
    return from_rows(FRAMES, [row | key for key in keys])


def images(depth=None):
    n = N if depth is None else len(depth)
    depths = walk()[1] if depth is None else depth
    paths = tuple(Path(f"{i}.png") for i in range(n))
    return RgbdFrames(
        "s", 3 * np.arange(n), None, CAMERA, paths, lambda _: None, lambda i: depths[i]
    )


def says(reprojection_px=(), loops=NOTHING):
    return ImageChecks(lambda *_: np.array(reprojection_px), lambda *_: loops)


def judge(
    judged=None,
    true=None,
    up=None,
    checks=None,
    depth=None,
    has_stamps=True,
    is_judged=False,
    **how,
):
    """Run the stage on poses (F, 4, 4) as estimated; `how` says more of their source."""
    judged = walk()[0] if judged is None else judged
    status = how.pop("status", None)
    given = FramePoses.from_matrices(judged)
    if status is not None:
        given = FramePoses(given.world_from_cam, np.array(status))
    trajectory = Trajectory(given, **how)
    frames = frames_table(len(judged), has_stamps)
    placed = poses.run(frames, trajectory, (0.0, 0.0, 1.0), "as given").tables["poses"]
    reference = None if true is None else Reference(FramePoses.from_matrices(true), up, is_judged)
    return pose_quality.run(
        *(frames, placed, trajectory.figures, reference, images(depth)),
        checks or says(),
        PoseQualityConfig(rpe_delta_frames=2),
    )


def figures(result):
    table = result.tables["pose_quality"]
    assert table.schema.equals(POSE_QUALITY.schema)
    return {row["metric"]: (row["value"], row["n"]) for row in table.to_pylist()}


def value(result, metric):
    return figures(result)[metric][0]


def pushed(poses, frame, by):
    poses = np.array(poses)
    poses[frame, :3, 3] += by
    return poses


def test_without_truth():
    result = judge(checks=says([0.5, 0.7, 3.0], (np.array([0.1, 0.3]), np.radians([1.0, 2.0]))))
    found = figures(result)
    assert found["frames"] == (12, 12)
    assert found["tracked"] == (12, 12)
    assert (found["dense"][0], found["interpolated"][0], found["lost"][0]) == (0, 0, 0)
    step_m = np.linalg.norm(np.diff(walk()[0][:, :3, 3], axis=0), axis=1)
    assert found["path_length_m"] == (pytest.approx(step_m.sum()), 12)
    assert found["duration_s"] == (pytest.approx(1.1), 12)
    assert found["reprojection_median_px"] == (pytest.approx(0.7), 3)
    assert found["reprojection_p90_px"] == (pytest.approx(2.54), 3)
    assert found["loop_pairs"] == (2, 0)
    assert found["loop_error_median_m"] == (pytest.approx(0.2), 2)
    assert found["loop_error_median_deg"] == (pytest.approx(1.5), 2)
    assert found["depth_consistency_median_m"][0] < 0.002
    assert found["depth_consistency_share"][0] > 0.98
    assert not [name for name in found if name.startswith(("ate", "rpe", "sim3", "up"))]
    assert result.tables["reference_poses"].num_rows == 0
    assert result.tables["reference_poses"].schema.equals(REFERENCE_POSES.schema)
    assert result.summary == "reprojection 0.7 px, depth 0.0 cm, loops 20.0 cm"
    assert result.warnings == []


def test_what_cannot_be_told_is_null():
    unknown = np.full((N, CAMERA.height_px, CAMERA.width_px), np.nan, dtype=np.float32)
    result = judge(depth=unknown, has_stamps=False)
    found = figures(result)
    for name in (
        *("reprojection_median_px", "depth_consistency_median_m", "depth_consistency_share"),
        *("duration_s", "loop_error_median_m", "loop_error_median_deg"),
    ):
        assert found[name] == (None, 0)
    assert result.summary == ""
    assert judge(depth=[None] * N).summary == ""


def test_statuses_are_counted_and_lost_frames_make_no_pairs():
    poses = np.array(walk()[0])
    poses[[3, 4]] = np.nan
    seen = []

    def reprojection(_, world_from_cam, pairs):
        seen.append((world_from_cam, pairs.tolist()))
        return np.zeros(0)

    status = [TRACKED] * 3 + [LOST] * 2 + [DENSE] * 7
    result = judge(poses, status=status, checks=ImageChecks(reprojection, lambda *_: NOTHING))
    found = figures(result)
    assert [found[name][0] for name in ("frames", "tracked", "dense", "interpolated", "lost")] == [
        *(12, 3, 7, 0, 2)
    ]
    (world_from_cam, pairs), *_ = seen
    assert np.isnan(world_from_cam[[3, 4]]).all()
    assert np.allclose(world_from_cam[5], poses[5])
    assert pairs == [[0, 1], [1, 2]] + [[i, i + 1] for i in range(5, 11)]


def test_exact_poses_in_another_world_have_no_error():
    result = judge(true=ELSEWHERE @ walk()[0], up=ELSEWHERE[:3, 2])
    found = figures(result)
    for name in ("ate_se3_rmse_m", "ate_se3_median_m", "ate_se3_max_m", "ate_sim3_rmse_m"):
        assert found[name] == (pytest.approx(0, abs=1e-9), 12)
    assert found["sim3_scale"] == (pytest.approx(1), 12)
    assert found["rpe_translation_rmse_m"] == (pytest.approx(0, abs=1e-9), 10)
    assert found["rpe_rotation_rmse_deg"] == (pytest.approx(0, abs=1e-6), 10)
    assert found["up_error_deg"] == (pytest.approx(0, abs=1e-6), 12)
    aligned = world_from_cam_of(with_status(result.tables["reference_poses"]))
    assert np.allclose([aligned[3 * i] for i in range(N)], walk()[0], atol=1e-9)
    assert result.summary.endswith("ATE 0.0 cm")


def with_status(reference_poses):
    known = np.array([x is not None for x in reference_poses["tx_m"].to_pylist()])
    return reference_poses.append_column("status", pa.array(np.where(known, TRACKED, LOST)))


def test_a_wrong_scale_is_told_apart_from_a_wrong_shape():
    judged = np.array(walk()[0])
    judged[:, :3, 3] *= 0.8
    found = figures(judge(judged, true=walk()[0]))
    assert found["sim3_scale"][0] == pytest.approx(1.25)
    assert found["ate_sim3_rmse_m"][0] == pytest.approx(0, abs=1e-9)
    assert found["ate_se3_rmse_m"][0] > 0.01


def test_errors_are_those_of_the_definition():
    rng = np.random.default_rng(0)
    judged = walk()[0] @ exp_twist(rng.normal(scale=0.02, size=(N, 6)))
    found = figures(judge(judged, true=ELSEWHERE @ walk()[0]))
    moved = align_poses(walk()[0], judged).poses(judged)
    distance = np.linalg.norm(moved[:, :3, 3] - walk()[0][:, :3, 3], axis=1)
    assert found["ate_se3_rmse_m"][0] == pytest.approx(np.sqrt(np.mean(distance**2)))
    assert found["ate_se3_max_m"][0] == pytest.approx(distance.max())
    slips = []
    for i in range(N - 2):
        true, given = (invert(p[i]) @ p[i + 2] for p in (walk()[0], judged))
        slips.append(np.linalg.norm((invert(true) @ given)[:3, 3]))
    assert found["rpe_translation_rmse_m"][0] == pytest.approx(np.sqrt(np.mean(np.square(slips))))


def test_a_tilted_world_shows():
    tilt = make_transform(matrix_from_quaternion([np.cos(0.05), np.sin(0.05), 0, 0]), np.zeros(3))
    result = judge(tilt @ walk()[0], true=walk()[0], up=(0.0, 0.0, 2.0))
    assert value(result, "up_error_deg") == pytest.approx(np.degrees(0.1))
    assert value(result, "ate_se3_rmse_m") == pytest.approx(0, abs=1e-9)


def test_planted_faults_raise_the_figures():
    true = judge(true=ELSEWHERE @ walk()[0])
    moved = judge(pushed(walk()[0], 5, [0.05, 0, 0]), true=ELSEWHERE @ walk()[0])
    for metric in ("ate_se3_max_m", "rpe_translation_rmse_m"):
        assert value(moved, metric) > 0.01
    assert value(moved, "depth_consistency_share") < value(true, "depth_consistency_share")
    inverse = judge(invert(walk()[0]), true=ELSEWHERE @ walk()[0])
    assert value(inverse, "depth_consistency_median_m") > 0.02
    scaled = judge(depth=1.5 * walk()[1])
    good = value(true, "depth_consistency_median_m")
    assert value(scaled, "depth_consistency_median_m") > 5 * good


def test_poses_are_not_judged_by_themselves():
    result = judge(true=walk()[0], is_judged=True)
    assert not [name for name in figures(result) if name.startswith(("ate", "rpe"))]
    assert result.tables["reference_poses"].num_rows == 0
    assert result.summary.endswith("no ATE: the poses are the reference itself")


def test_frames_that_the_reference_lacks_are_null():
    true = np.array(ELSEWHERE @ walk()[0])
    true[[0, 7]] = np.nan
    result = judge(true=true)
    rows = result.tables["reference_poses"].to_pylist()
    assert [row["frame_index"] for row in rows if row["qw"] is None] == [0, 21]
    assert len(rows) == N
    assert figures(result)["ate_se3_rmse_m"][1] == 10


def test_two_shared_poses_make_no_error():
    true = np.full((N, 4, 4), np.nan)
    true[[2, 3]] = ELSEWHERE @ pushed(walk()[0], 3, [1, 0, 0])[[2, 3]]
    result = judge(true=true)
    assert not [name for name in figures(result) if name.startswith("ate")]
    assert result.summary.endswith("no ATE: too few poses are in both")


def test_figures_of_the_source_are_rows():
    given = {"loop_closures": 3, "map_points": 1200.0, "drift_m": float("nan")}
    found = figures(judge(figures=given))
    assert found["drift_m"] == (None, 12)
    assert found["loop_closures"] == (3, 12)
    assert found["map_points"] == (1200, 12)


def test_poses_that_contradict_the_images_are_warned_of():
    (warning,) = judge(checks=says([10.0, 11.0])).warnings  # 2 % of 160 px is 3.2
    assert warning.startswith("s: features lie 10 px from where depth and poses put them")
    assert "convention" in warning
    rng = np.random.default_rng(0)
    shaken = walk()[0] @ exp_twist(rng.normal(scale=0.1, size=(N, 6)))
    (warning,) = judge(shaken).warnings
    assert "the depth of nearby frames agrees in" in warning


def test_one_frame():
    found = figures(judge(np.array(walk()[0][:1]), true=ELSEWHERE @ walk()[0][:1], up=(0, 0, 1)))
    assert found["path_length_m"] == (0.0, 1)
    assert found["rpe_translation_rmse_m"] == (None, 0)
    assert found["depth_consistency_median_m"] == (None, 0)
