"""ScanNet as exported: a camera of its own per scene, lost poses, and files that are damaged."""

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets import scannet
from imodbatch.datasets.registry import camera_model
from imodbatch.settings.manifest import Manifest

COLOR = (130.0, 131.0, 71.5, 53.5)  # fx fy cx cy for images of 144 × 108
DEPTH = (57.0, 58.0, 31.5, 23.5)  # of 64 × 48
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])  # looks down at the floor
SCENES = ("scene0000_00", "scene0000_01")
MANIFEST = """
name = "tiny"
adapter = "scannet"
root = "data"
classes = ["mug"]
"""


def matrix_of(intrinsics):
    fx, fy, cx, cy = intrinsics
    return np.array([[fx, 0, cx, 0], [0, fy, cy, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def write_matrix(path, matrix):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, matrix, fmt="%f")


def write_scene(folder, color=COLOR, depth=DEPTH, numbers=(0, 1, 2, 10), extrinsics=True):
    """The folders as the exporter writes them: %f, a file per frame, numbers without zeros."""
    write_matrix(folder / "intrinsic" / "intrinsic_color.txt", matrix_of(color))
    write_matrix(folder / "intrinsic" / "intrinsic_depth.txt", matrix_of(depth))
    if extrinsics:
        for kind in ("color", "depth"):
            write_matrix(folder / "intrinsic" / f"extrinsic_{kind}.txt", np.eye(4))
    for kind in ("color", "depth"):
        (folder / kind).mkdir()
    rng = np.random.default_rng(0)
    for number in numbers:
        pixels = np.kron(rng.integers(0, 255, (9, 12, 3), np.uint8), np.ones((12, 12, 1), np.uint8))
        Image.fromarray(pixels).save(folder / "color" / f"{number}.jpg")
        Image.fromarray(np.full((48, 64), 1500, np.uint16)).save(folder / "depth" / f"{number}.png")
        pose = DOWN.copy()
        pose[:3, 3] = (0.01 * number, 2.0, 1.5)
        write_matrix(folder / "pose" / f"{number}.txt", pose)
    return folder


def write_manifest(project, *scenes, more=""):
    listed = "".join(f'[[sequences]]\nid = "{name}"\npath = "{name}"\n' for name in scenes)
    (project / "manifest.toml").write_text(MANIFEST + more + listed)


@pytest.fixture
def project(tmp_path):
    write_manifest(tmp_path, SCENES[0])
    write_scene(tmp_path / "data" / SCENES[0])
    return tmp_path


def call(cli, project, stage):
    return cli(stage, project / "manifest.toml", "--out", project / "run")


def error(cli, project, stage="index"):
    result = call(cli, project, stage)
    assert result.exit_code == 1, result.output
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: ")
    return line


def split(root, *scenes, **more):
    sequences = [{"id": name, "path": name} for name in scenes or SCENES[:1]]
    return Manifest(
        name="tiny", adapter="scannet", root=str(root), classes=["mug"], sequences=sequences, **more
    )


def test_index_and_poses_of_a_scene_as_exported(project, cli):
    write_matrix(project / "data" / SCENES[0] / "pose" / "1.txt", np.full((4, 4), -np.inf))
    (project / "data" / SCENES[0] / "depth" / "2.png").unlink()
    result = call(cli, project, "index")
    assert result.exit_code == 0, result.output
    assert "4 frames = 3 with depth + 1 without" in result.stdout
    frames = pd.read_parquet(project / "run" / "frames")
    assert frames["frame_index"].tolist() == [0, 1, 2, 10]
    assert frames["color_path"][3] == "scene0000_00/color/10.jpg"
    row = frames.iloc[0]
    color = [row[name] for name in ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")]
    assert color == [144, 108, 130, 131, 72, 54]
    names = ("depth_width_px", "depth_height_px", "depth_fx_px", "depth_cx_px", "depth_scale_m")
    assert [row[name] for name in names] == [64, 48, 57, 32, 0.001]
    assert row["color_from_depth"] is None
    result = call(cli, project, "poses")
    assert result.exit_code == 0, result.output
    assert "4 frames = 3 tracked + 1 lost" in result.stdout
    poses = pd.read_parquet(project / "run" / "poses")
    assert poses["status"].tolist() == ["tracked", "lost", "tracked", "tracked"]
    assert poses["tx_m"].tolist()[3] == pytest.approx(0.1)
    assert poses["tz_m"].isna().tolist() == [False, True, False, False]


def test_each_scene_has_its_own_camera(project, cli):
    write_manifest(project, *SCENES)
    other = (125.0, 126.0, 70.5, 52.5)
    write_scene(project / "data" / SCENES[1], color=other, depth=(55.0, 55.0, 30.0, 24.0))
    assert call(cli, project, "index").exit_code == 0
    frames = pd.read_parquet(project / "run" / "frames").groupby("sequence_id", observed=True)
    assert frames["fx_px"].unique().map(list).to_dict() == {SCENES[0]: [130], SCENES[1]: [125]}
    assert frames["depth_cx_px"].unique().map(list).to_dict() == {
        SCENES[0]: [32.0],
        SCENES[1]: [30.5],
    }


def test_corrected_intrinsics_make_the_index_anew(project, cli):
    call(cli, project, "index")
    assert "up to date" in call(cli, project, "index").stdout
    path = project / "data" / SCENES[0] / "intrinsic" / "intrinsic_color.txt"
    write_matrix(path, matrix_of((140.25, 131.0, 71.5, 53.5)))
    assert "up to date" not in call(cli, project, "index").stdout
    assert pd.read_parquet(project / "run" / "frames")["fx_px"][0] == 140.25


def test_without_extrinsics_both_cameras_are_in_one_place(tmp_path):
    write_scene(tmp_path / SCENES[0], extrinsics=False)
    manifest = split(tmp_path)
    assert camera_model(manifest, manifest.sequences[0]).color_from_depth is None
    files = [path.name for path in scannet.LAYOUT.other_files(manifest, manifest.sequences[0])]
    assert files[:2] == ["intrinsic_color.txt", "intrinsic_depth.txt"]


def test_where_no_sequence_is_named_no_file_is_read(tmp_path):
    model = camera_model(split(tmp_path / "nowhere"))
    assert (model.depth_scale_m, model.depth_invalid) == (0.001, (0,))
    assert (model.color.width_px, model.depth.width_px) == (1296, 640)


def test_what_the_manifest_gives_is_not_looked_for(tmp_path):
    folder = write_scene(tmp_path / SCENES[0])
    (folder / "intrinsic" / "intrinsic_color.txt").unlink()
    write_matrix(folder / "intrinsic" / "extrinsic_depth.txt", np.full((4, 4), np.nan))
    color = {"width_px": 72, "height_px": 54, "fx_px": 60, "fy_px": 60, "cx_px": 36, "cy_px": 27}
    camera = {"color": color, "color_from_depth": np.eye(4).tolist()}
    manifest = split(tmp_path, camera=camera)
    model = camera_model(manifest, manifest.sequences[0])
    assert model.color == PinholeCamera(72, 54, 60, 60, 36, 27)
    assert model.depth == PinholeCamera(64, 48, 57, 58, 32, 24)
    assert np.array_equal(model.color_from_depth, np.eye(4))


def test_the_size_is_that_of_the_first_image_that_can_be_read(project, cli):
    path = project / "data" / SCENES[0] / "color" / "0.jpg"
    path.write_bytes(b"")
    result = call(cli, project, "index")
    assert result.exit_code == 0, result.output
    assert str(path) in result.stderr
    assert set(pd.read_parquet(project / "run" / "frames")["width_px"]) == {144}


def test_no_poses_no_reference(tmp_path):
    folder = write_scene(tmp_path / SCENES[0])
    manifest = split(tmp_path)
    section = manifest.sequences[0]
    assert len(scannet.LAYOUT.reference(manifest, section).world_from_color) == 4
    assert len(scannet.LAYOUT.odometry_files(manifest, section)) == 4
    for path in (folder / "pose").iterdir():
        path.unlink()
    assert scannet.LAYOUT.reference(manifest, section) is None


@pytest.mark.parametrize("kind", ["color", "depth"])
@pytest.mark.parametrize(
    ("text", "mention"),
    [
        (None, "no such file"),
        ("", "expected a 4×4 matrix, found 0×4"),
        ("130 0 71.5 0\n0 131 53.5 0\n0 0 1 0\n", "found 3×4 numbers"),
        ("130 0 71.5 0\n0 131 53.5 0\n0 0 1 0\n0 0 0\n", "line 4: expected 4 numbers, found 3"),
        ("130 0 71.5 0\n0 131 53,5 0\n0 0 1 0\n0 0 0 1\n", "line 2: expected 4 numbers, found 5"),
        ("nan 0 71.5 0\n0 131 53.5 0\n0 0 1 0\n0 0 0 1\n", "found fx nan"),
        ("-130 0 71.5 0\n0 131 53.5 0\n0 0 1 0\n0 0 0 1\n", "found fx -130"),
        ("130 0 inf 0\n0 131 53.5 0\n0 0 1 0\n0 0 0 1\n", "cx inf"),
        (b"\xff\xfe\x00", "cannot be read as text"),
    ],
)
def test_damaged_intrinsics(project, cli, kind, text, mention):
    path = project / "data" / SCENES[0] / "intrinsic" / f"intrinsic_{kind}.txt"
    path.unlink()
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    line = error(cli, project)
    assert str(path) in line
    assert mention in line
    assert f"give camera.{kind} in the manifest" in line


def test_resized_images_do_not_fit_the_intrinsics(project, cli):
    write_matrix(
        project / "data" / SCENES[0] / "intrinsic" / "intrinsic_color.txt",
        matrix_of((1170.19, 1170.19, 647.75, 483.75)),
    )
    line = error(cli, project)
    assert "(647.75, 483.75) is far from the middle of images of 144×108" in line


@pytest.mark.parametrize("defect", [0.02, np.nan, -np.inf])
def test_cameras_apart_must_be_said_by_the_manifest(project, cli, defect):
    matrix = np.eye(4)
    matrix[0, 3] = defect
    path = project / "data" / SCENES[0] / "intrinsic" / "extrinsic_color.txt"
    write_matrix(path, matrix)
    line = error(cli, project)
    assert f"{path}: expected the identity" in line
    assert "camera.color_from_depth" in line


@pytest.mark.parametrize(
    ("text", "mention"),
    [
        ("1 0 0 0\n0 -1 0\n", "line 2: expected 4 numbers, found 3"),
        ("1 0 0 0\n0 -1 0 0\n", "expected a 4×4 or 3×4 matrix, found 2 lines"),
        ("", "found 0 lines"),
        ("1 0 0 0\n0 -1 x 0\n0 0 -1 0\n0 0 0 1\n", "'x' is no number"),
    ],
)
def test_a_pose_file_that_breaks_off(project, cli, text, mention):
    call(cli, project, "index")
    path = project / "data" / SCENES[0] / "pose" / "2.txt"
    path.write_text(text)
    line = error(cli, project, "poses")
    assert str(path) in line
    assert mention in line


def test_all_poses_lost_or_none(project, cli):
    call(cli, project, "index")
    folder = project / "data" / SCENES[0] / "pose"
    for path in folder.iterdir():
        write_matrix(path, np.full((4, 4), -np.inf))
    assert "none of 4 frames has a pose" in error(cli, project, "poses")
    for path in folder.iterdir():
        path.unlink()
    assert "no pose file fits 'pose/{frame}.txt'" in error(cli, project, "poses")


def test_a_scene_that_is_not_there(tmp_path, cli):
    write_manifest(tmp_path, SCENES[0])
    assert "no such folder" in error(cli, tmp_path)
    (tmp_path / "data" / SCENES[0]).mkdir(parents=True)
    assert "no colour image fits the adapter 'scannet'" in error(cli, tmp_path)
