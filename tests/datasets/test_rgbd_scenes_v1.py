"""UW RGB-D Scenes v1: frames from 1, one registered camera, and poses of a later release."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.io import savemat

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError, DataError
from imodbatch.core.frames import make_transform, matrix_from_quaternion
from imodbatch.datasets import index
from imodbatch.datasets.registry import annotated, camera_model, layout_of
from imodbatch.settings.manifest import Manifest, load_manifest

MANIFESTS = Path(__file__).parents[2] / "manifests"
ALIGNED = "rgbd-scenes_aligned/desk/desk_1/desk_1.pose"


@pytest.fixture
def root(tmp_path):
    folder = tmp_path / "rgbd-scenes"
    (folder / "desk" / "desk_1").mkdir(parents=True)
    return folder


def touch(root, *names):
    for name in names:
        (root / "desk" / "desk_1" / name).touch()


def frame_names(number):
    return f"desk_1_{number}.png", f"desk_1_{number}_depth.png"


def split(root, frames=None, n_frames=None, **more):
    section = {"id": "desk_1", "path": "desk/desk_1", "frames": frames, "n_frames": n_frames}
    more = {"classes": ["cap", "coffee_mug"], "sequences": [section], **more}
    return Manifest(name="uw", adapter="rgbd_scenes_v1", root=str(root), **more)


def frames_of(manifest):
    return layout_of(manifest).frames(manifest, manifest.sequences[0])


def odometry_of(manifest):
    return layout_of(manifest).odometry(manifest, manifest.sequences[0])


def pose_lines(count):
    """Frame n, from 1, stands at (n, 0, -n) and is turned about the y axis by 120°."""
    return [
        f"1300000{n}.5 1300000{n}.6 0.5 0 0.866025404 0 {n} 0 -{n}" for n in range(1, count + 1)
    ]


def write_poses(path, count):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(pose_lines(count)) + "\n")
    return path


def test_colour_and_depth_are_told_apart_and_numbers_kept(root):
    touch(root, *frame_names(1), *frame_names(2), *frame_names(10), "desk_1_3.png")
    touch(root, "desk_1_4_depth.png", "desk_10_5.png", "desk_1_6.jpg", "Thumbs.db")
    folder = "desk/desk_1"
    assert [(f.frame_index, f.color_path, f.depth_path) for f in frames_of(split(root))] == [
        (1, f"{folder}/desk_1_1.png", f"{folder}/desk_1_1_depth.png"),
        (2, f"{folder}/desk_1_2.png", f"{folder}/desk_1_2_depth.png"),
        (3, f"{folder}/desk_1_3.png", None),
        (10, f"{folder}/desk_1_10.png", f"{folder}/desk_1_10_depth.png"),
    ]
    assert [f.frame_index for f in frames_of(split(root, frames="2:10"))] == [2, 3]


def test_the_camera_and_its_centre():
    """MATLAB's pixel (320, 240), the 319th and 239th from 0, looks straight ahead."""
    model = camera_model(split("."))
    assert model.color == model.depth
    assert (model.color.width_px, model.color.height_px) == (640, 480)
    center = model.color.pixel_centers()[239, 319]
    assert np.allclose(model.color.unproject(center, 2.0), [0, 0, 2])
    assert np.allclose(model.color.project([[0.1, 0, 1]]) - center, [57.03, 0])
    assert (model.depth_scale_m, model.depth_invalid) == (0.001, (0,))
    assert model.color_from_depth is None


def test_a_camera_of_the_manifest_replaces_both():
    color = {"width_px": 64, "height_px": 48, "fx_px": 57, "fy_px": 58, "cx_px": 31, "cy_px": 23}
    model = camera_model(split(".", camera={"color": color}))
    assert model.color == model.depth == PinholeCamera(64, 48, 57, 58, 31, 23)


def test_the_first_release_has_no_poses(root):
    touch(root, *frame_names(1))
    manifest, adapter = split(root), layout_of(split(root))
    section = manifest.sequences[0]
    assert odometry_of(manifest) is None
    assert adapter.reference(manifest, section) is None
    assert adapter.odometry_files(manifest, section) == []
    assert adapter.reference_files(manifest, section) == []


@pytest.mark.parametrize("place", [ALIGNED, "rgbd-scenes/desk/desk_1/desk_1.pose"])
def test_poses_of_the_aligned_release_are_found(root, tmp_path, place):
    touch(root, *frame_names(1), *frame_names(2))
    path = write_poses(tmp_path / place, 2)
    manifest = split(root)
    adapter, section = layout_of(manifest), manifest.sequences[0]
    assert adapter.odometry_files(manifest, section) == [path]
    assert adapter.reference_files(manifest, section) == [path]
    for read in (odometry_of(manifest), adapter.reference(manifest, section)):
        assert read.frame_index.tolist() == [1, 2]
        assert read.timestamp_ns is None
        turn = matrix_from_quaternion([0.5, 0, np.sqrt(0.75), 0])
        expected = [make_transform(turn, [n, 0, -n]) for n in (1, 2)]
        assert np.allclose(read.world_from_color, expected, atol=1e-8)


def test_a_line_belongs_to_its_frame_where_images_are_missing_or_a_slice_is_asked(root, tmp_path):
    write_poses(tmp_path / ALIGNED, 4)
    touch(root, *frame_names(1), *frame_names(2), *frame_names(4))
    for frames in (None, "2:4"):
        read = odometry_of(split(root, frames=frames))
        assert read.frame_index.tolist() == [1, 2, 3, 4]
        assert read.world_from_color[:, 0, 3].tolist() == [1, 2, 3, 4]


def test_too_few_poses(root, tmp_path):
    path = write_poses(tmp_path / ALIGNED, 2)
    touch(root, *(name for n in (1, 2, 3, 4) for name in frame_names(n)))
    with pytest.raises(DataError, match="2 lines for 4 frames numbered 1 to 4") as caught:
        odometry_of(split(root))
    assert str(path) in str(caught.value)


def test_the_manifest_may_point_elsewhere(root, tmp_path):
    touch(root, *frame_names(1))
    write_poses(tmp_path / ALIGNED, 1)
    (tmp_path / "other.txt").write_text("1 0 0 0 7 8 9\n")
    section = {"format": "uw", "path": "../other.txt"}
    manifest = split(root, odometry=section)
    assert odometry_of(manifest).world_from_color[0, :3, 3].tolist() == [7, 8, 9]
    reference = layout_of(manifest).reference(manifest, manifest.sequences[0])
    assert reference.world_from_color[0, :3, 3].tolist() == [1, 0, -1]


def save_images(root, count):
    for number in range(1, count + 1):
        color, depth = (root / "desk" / "desk_1" / name for name in frame_names(number))
        Image.new("RGB", (640, 480)).save(color)
        Image.fromarray(np.full((480, 640), 1500, np.uint16)).save(depth)


def test_the_whole_layout_through_index(root):
    save_images(root, 2)
    names = ("category", "instance", "top", "bottom", "left", "right")
    box = np.empty((1, 1), dtype=[(name, object) for name in names])
    box[0, 0] = ("cap", 4.0, 11.0, 20.0, 101.0, 140.0)
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = np.zeros((0, 0)), box
    savemat(root / "desk" / "desk_1.mat", {"bboxes": cells})
    manifest = split(root, n_frames=2)
    result = index.run(manifest, manifest.sequences[0])
    assert result.warnings == []
    assert result.summary == "2 frames = 2 with depth; 1 annotations = 1 counted"
    (row,) = result.tables["annotations"].to_pylist()
    assert (row["frame_index"], row["class_id"], row["instance_id"]) == (2, 0, "cap_4")
    assert [row[name] for name in ("x0_px", "y0_px", "x1_px", "y1_px")] == [100, 10, 140, 20]


def test_the_boxes_are_those_that_the_manifest_names_if_it_names_any(root):
    manifest = split(root)
    assert annotated(manifest, manifest.sequences[0]).annotations.format == "none"
    (root / "desk" / "desk_1.mat").touch()
    assert annotated(manifest, manifest.sequences[0]).annotations.path == "{sequence}.mat"
    without = split(root, annotations={"format": "none"})
    assert annotated(without, without.sequences[0]).annotations.format == "none"


@pytest.mark.parametrize("frames", [None, "1:2"])
def test_a_folder_with_another_number_of_frames_warns(root, frames):
    save_images(root, 2)
    manifest = split(root, frames=frames, n_frames=98)
    (warning,) = index.run(manifest, manifest.sequences[0]).warnings
    assert "desk_1: 2 of 98 frames" in warning
    assert "n_frames" in warning


def test_a_folder_that_is_not_there(root):
    manifest = split(root, sequences=[{"id": "desk_9", "path": "desk/desk_9"}])
    with pytest.raises(DataError, match="desk_9: no such folder"):
        index.run(manifest, manifest.sequences[0])


def test_a_mistyped_adapter():
    manifest = split(".").model_copy(update={"adapter": "rgbd_scenes1"})
    with pytest.raises(ConfigError, match="Did you mean 'rgbd_scenes_v1'"):
        layout_of(manifest)


def test_the_shipped_manifest(monkeypatch, tmp_path):
    monkeypatch.setenv("IMODBATCH_DATA", str(tmp_path))
    manifest = load_manifest(MANIFESTS / "rgbd_scenes_v1.toml")
    assert {s.id: s.n_frames for s in manifest.sequences} == {
        "desk_1": 98,
        "desk_2": 190,
        "desk_3": 228,
        "kitchen_small_1": 180,
        "meeting_small_1": 180,
        "table_1": 125,
        "table_small_1": 199,
        "table_small_2": 234,
    }
    for section in manifest.sequences:
        assert section.path == f"{section.id.rpartition('_')[0]}/{section.id}"
        path = manifest.path_in(section, manifest.annotations.path or "")
        assert path == tmp_path / "rgbd-scenes" / f"{section.path}.mat"
    assert manifest.world.direction() is None
