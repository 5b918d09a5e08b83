"""7-Scenes: two cameras, poses of the depth one, and frames whose tracking was lost."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.core.frames import make_transform, matrix_from_quaternion
from imodbatch.datasets import index, seven_scenes
from imodbatch.datasets.registry import camera_model, layout_of
from imodbatch.poses import association as poses
from imodbatch.settings.config import PosesConfig
from imodbatch.settings.manifest import Manifest, load_manifest
from imodbatch.settings.sections import OdometrySection

DATA = os.environ.get("IMODBATCH_DATA")
MANIFESTS = Path(__file__).parents[2] / "manifests"
TURN = matrix_from_quaternion([0.9, 0.1, -0.3, 0.2])
WORLD_FROM_DEPTH = make_transform(TURN, [0.5, -1.0, 2.0])
COLOR_FROM_DEPTH = make_transform(matrix_from_quaternion([1, 0.01, 0.02, 0]), [-0.025, 0.001, 0.0])


def write_frame(root, number, ending="png", depth=True, pose=WORLD_FROM_DEPTH):
    stem = root / "seq-01" / f"frame-{number:06d}"
    stem.parent.mkdir(exist_ok=True)
    Image.new("RGB", (640, 480), (number, 0, 0)).save(f"{stem}.color.{ending}")
    if depth:
        Image.fromarray(np.full((480, 640), 1500, np.uint16)).save(f"{stem}.depth.png")
    if pose is not None:
        np.savetxt(f"{stem}.pose.txt", pose)


def split(root, frames=None, **more):
    return Manifest(
        name="scene",
        adapter="seven_scenes",
        root=str(root),
        classes=["mug"],
        sequences=[{"id": "seq-01", "path": "seq-01", "frames": frames}],
        **more,
    )


def found(manifest):
    section = manifest.sequences[0]
    frames = seven_scenes.LAYOUT.frames(manifest, section)
    return frames, seven_scenes.LAYOUT.odometry(manifest, section)


def test_png_and_jpg_colour_and_frames_without_depth(tmp_path):
    write_frame(tmp_path, 0)
    write_frame(tmp_path, 1, "jpg")
    write_frame(tmp_path, 12, depth=False)
    (tmp_path / "seq-01" / "frame-000013.depth.png").touch()
    (tmp_path / "seq-01" / "Thumbs.db").touch()
    frames, _ = found(split(tmp_path))
    assert [(f.frame_index, f.color_path, f.depth_path) for f in frames] == [
        (0, "seq-01/frame-000000.color.png", "seq-01/frame-000000.depth.png"),
        (1, "seq-01/frame-000001.color.jpg", "seq-01/frame-000001.depth.png"),
        (12, "seq-01/frame-000012.color.png", None),
    ]
    assert all(f.timestamp_ns is None for f in frames)


def test_slices(tmp_path):
    for number in range(4):
        write_frame(tmp_path, number, depth=False)
    frames, odometry = found(split(tmp_path, frames="1:3"))
    assert [f.frame_index for f in frames] == [1, 2]
    assert odometry.frame_index.tolist() == [1, 2]


def test_the_cameras_of_the_layout():
    model = camera_model(split("."))
    assert model.color == PinholeCamera(640, 480, 525, 525, 320, 240)
    assert model.depth == PinholeCamera(640, 480, 585, 585, 320, 240)
    assert (model.depth_scale_m, model.depth_invalid) == (0.001, (0, 65535))
    assert model.color_from_depth is None


def test_the_manifest_overrides_key_by_key():
    """Another colour camera does not make the depth image a registered one."""
    color = {"width_px": 640, "height_px": 480, "fx_px": 530, "fy_px": 531, "cx_px": 1, "cy_px": 2}
    layout = camera_model(split("."))
    model = camera_model(split(".", camera={"color": color}))
    assert model.color == PinholeCamera(640, 480, 530, 531, 1, 2)
    assert (model.depth, model.depth_invalid) == (layout.depth, layout.depth_invalid)
    model = camera_model(split(".", camera={"depth": {"scale_m": 0.002}}))
    assert (model.depth_scale_m, model.depth_invalid) == (0.002, (0, 65535))
    assert (model.color, model.depth) == (layout.color, layout.depth)
    model = camera_model(split(".", camera={"depth": {"invalid": [0]}}))
    assert (model.depth_scale_m, model.depth_invalid) == (0.001, (0,))
    model = camera_model(split(".", camera={"depth": color}))
    assert (model.depth, model.color) == (PinholeCamera(640, 480, 530, 531, 1, 2), layout.color)
    model = camera_model(split(".", camera={"color_from_depth": COLOR_FROM_DEPTH.tolist()}))
    assert np.array_equal(model.color_from_depth, COLOR_FROM_DEPTH)


def test_without_a_baseline_both_cameras_have_one_pose(tmp_path):
    write_frame(tmp_path, 3)
    _, odometry = found(split(tmp_path))
    assert odometry.frame_index.tolist() == [3]
    assert odometry.timestamp_ns is None
    assert np.allclose(odometry.world_from_color, WORLD_FROM_DEPTH, atol=1e-12)


def test_with_a_baseline_poses_are_those_of_the_colour_camera(tmp_path):
    write_frame(tmp_path, 3)
    _, odometry = found(split(tmp_path, camera={"color_from_depth": COLOR_FROM_DEPTH.tolist()}))
    expected = WORLD_FROM_DEPTH @ np.linalg.inv(COLOR_FROM_DEPTH)
    assert np.allclose(odometry.world_from_color[0], expected, atol=1e-12)
    assert not np.allclose(expected, WORLD_FROM_DEPTH, atol=1e-3)
    point_depth = np.array([0.1, 0.2, 1.5, 1.0])
    point_color = COLOR_FROM_DEPTH @ point_depth
    assert np.allclose(odometry.world_from_color[0] @ point_color, WORLD_FROM_DEPTH @ point_depth)


@pytest.mark.parametrize("baseline", [None, COLOR_FROM_DEPTH.tolist()])
@pytest.mark.parametrize("lost", [-np.inf, np.nan, np.inf])
def test_lost_tracking_loses_the_frame_alone(tmp_path, lost, baseline):
    write_frame(tmp_path, 0)
    write_frame(tmp_path, 1, pose=np.full((4, 4), lost))
    write_frame(tmp_path, 2, pose=None)
    write_frame(tmp_path, 3)
    manifest = split(tmp_path, camera={"color_from_depth": baseline})
    section = manifest.sequences[0]
    frames = index.run(manifest, section).tables["frames"]
    trajectory = poses.from_odometry(frames, found(manifest)[1], PosesConfig())
    result = poses.run(frames, trajectory, [0, 0, 1], "as given")
    table = result.tables["poses"]
    assert table["status"].to_pylist() == ["tracked", "lost", "lost", "tracked"]
    assert [value is None for value in table["qw"].to_pylist()] == [False, True, True, False]
    assert result.summary.startswith("4 frames = 2 tracked + 2 lost")


def test_no_pose_files_at_all(tmp_path):
    write_frame(tmp_path, 0, pose=None)
    with pytest.raises(DataError, match="no pose file fits 'frame") as caught:
        found(split(tmp_path))
    assert len(str(caught.value).splitlines()) == 1


def test_other_poses_can_be_pointed_at(tmp_path):
    write_frame(tmp_path, 0)
    (tmp_path / "seq-01" / "slam.txt").write_text("1 9 8 7 0 0 0 1\n")
    manifest = split(tmp_path, odometry={"format": "tum", "path": "slam.txt"})
    _, odometry = found(manifest)
    assert odometry.world_from_color[0, :3, 3].tolist() == [9, 8, 7]
    files = seven_scenes.LAYOUT.odometry_files(manifest, manifest.sequences[0])
    assert files == [tmp_path / "seq-01" / "slam.txt"]


def test_the_reference_is_the_datasets_own_unless_another_is_named(tmp_path):
    write_frame(tmp_path, 0)
    (tmp_path / "seq-01" / "slam.txt").write_text("1 9 8 7 0 0 0 1\n")
    other = OdometrySection(format="tum", path="slam.txt")
    manifest = split(tmp_path, odometry=other.model_dump())
    section = manifest.sequences[0]
    true = seven_scenes.LAYOUT.reference(manifest, section)
    assert np.allclose(true.world_from_color[0], WORLD_FROM_DEPTH)
    assert [path.name for path in seven_scenes.LAYOUT.reference_files(manifest, section)] == [
        "frame-000000.pose.txt"
    ]
    named = split(tmp_path, reference=other.model_dump())
    assert seven_scenes.LAYOUT.reference(named, section).world_from_color[0, :3, 3].tolist() == [
        9,
        8,
        7,
    ]
    assert seven_scenes.LAYOUT.reference_files(named, section) == [tmp_path / "seq-01" / "slam.txt"]


def test_without_pose_files_there_is_no_reference(tmp_path):
    write_frame(tmp_path, 0, pose=None)
    manifest = split(tmp_path)
    assert seven_scenes.LAYOUT.reference(manifest, manifest.sequences[0]) is None
    assert seven_scenes.LAYOUT.reference_files(manifest, manifest.sequences[0]) == []


def test_files_behind_the_poses(tmp_path):
    write_frame(tmp_path, 0)
    write_frame(tmp_path, 1)
    manifest = split(tmp_path)
    files = seven_scenes.LAYOUT.odometry_files(manifest, manifest.sequences[0])
    assert [path.name for path in files] == ["frame-000000.pose.txt", "frame-000001.pose.txt"]


@pytest.mark.skipif(not DATA, reason="IMODBATCH_DATA is not set: no real 7-Scenes frames")
def test_real_frames_of_the_red_kitchen():
    manifest = load_manifest(MANIFESTS / "redkitchen.toml")
    section = manifest.sequences[0].model_copy(update={"frames": "0:20"})
    result = index.run(manifest, section)
    frames = result.tables["frames"]
    assert frames["frame_index"].to_pylist() == list(range(20))
    assert result.summary.startswith("20 frames = 20 with depth; ")
    assert result.warnings == []
    assert set(frames["fx_px"].to_pylist()) == {525.37}
    assert set(frames["depth_fx_px"].to_pylist()) == {585.0}
    assert frames["color_path"][0].as_py() == "seq-01/frame-000000.color.jpg"
    odometry = layout_of(manifest).odometry(manifest, section)
    assert odometry.frame_index.tolist() == list(range(20))
    steps_m = np.linalg.norm(np.diff(odometry.world_from_color[:, :3, 3], axis=0), axis=1)
    assert (steps_m > 0).all()
    assert steps_m.max() < 0.05
