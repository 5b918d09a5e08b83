"""A robot's drives: what this package writes, read by five lines; and what a manifest changes."""

import json

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError, DataError, ImodError
from imodbatch.datasets import index, robot
from imodbatch.datasets.registry import annotated, camera_model, layout_of
from imodbatch.lab.houses import write_house_dataset
from imodbatch.lab.objects import load_object
from imodbatch.settings.manifest import Manifest, load_manifest

SMALL = PinholeCamera(96, 72, 80.0, 80.0, 48.0, 36.0)
CAMERA = {
    **{"width_px": 32, "height_px": 24, "fx_px": 30.0, "fy_px": 31.0, "cx_px": 16.0, "cy_px": 12.0},
    "depth_scale_m": 0.001,
    "frames_per_second": 5,
}
FIVE_LINES = """name = "tiny"
adapter = "robot"
root = {root}
classes = {classes}
sequences = [{{ id = "walk", path = {path} }}]
"""
LOOK = "0.0 0.0 0.0 1.0"


def write_manifest(folder, root, path="walk", classes=("mug",), more=""):
    text = FIVE_LINES.format(
        root=json.dumps(str(root)), classes=json.dumps(list(classes)), path=json.dumps(path)
    )
    (folder / "manifest.toml").write_text(text + more)
    return folder / "manifest.toml"


def write_drive(root, ending="jpg", numbers=(0, 1, 2)):
    walk = root / "walk"
    for kind in ("color", "depth"):
        (walk / kind).mkdir(parents=True)
    for number in numbers:
        Image.new("RGB", (32, 24), (number, 90, 90)).save(walk / f"color/{number:06d}.{ending}")
        depth = np.full((24, 32), 900, np.uint16)
        Image.fromarray(depth).save(walk / f"depth/{number:06d}.png")
    for name, height in (("odometry.txt", 1.0), ("trajectory_true.txt", 1.1)):
        lines = [f"{number / 5:.6f} {number} 0 {height} {LOOK}" for number in numbers]
        (walk / name).write_text("\n".join(lines) + "\n")
    boxes = [{"id": 1, "image_id": 0, "category_id": 1, "bbox": [2, 2, 9, 9]}]
    images = [{"id": 0, "file_name": f"color/000000.{ending}"}]
    document = {
        "images": images,
        "categories": [{"id": 1, "name": "mug"}],
        "annotations": boxes,
    }
    (walk / "annotations.json").write_text(json.dumps(document))
    (root / "camera.json").write_text(json.dumps(CAMERA))
    return walk


@pytest.fixture
def project(tmp_path):
    write_drive(tmp_path / "data")
    write_manifest(tmp_path, tmp_path / "data")
    return tmp_path


def call(cli, project, stage):
    return cli(stage, project / "manifest.toml", "--out", project / "run")


def error(cli, project, stage="index"):
    result = call(cli, project, stage)
    assert result.exit_code == 1, result.output
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: ")
    return line


def split(root, **more):
    sequences = [{"id": "walk", "path": "walk"}]
    return Manifest(
        name="tiny", adapter="robot", root=str(root), classes=["mug"], sequences=sequences, **more
    )


def fault(action, kind: type[ImodError], *mentions):
    with pytest.raises(kind) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


def test_five_lines_read_a_house_as_its_own_manifest_does(tmp_path):
    folder = tmp_path / "houses"
    models = [load_object("teacup"), load_object("kidney_beans_doll")]
    write_house_dataset(folder, "test", seed=1, n_worlds=1, n_frames=4, models=models, camera=SMALL)
    full = load_manifest(folder / "manifest.toml")
    path = write_manifest(tmp_path, folder, "house_1", full.classes)
    path.write_text(path.read_text().replace('"walk"', '"house_1"'))
    assert len(path.read_text().splitlines()) == 5
    short = load_manifest(path)
    section, same = short.sequences[0], full.sequences[0]
    by_short, by_full = index.run(short, section), index.run(full, same)
    assert by_short.summary == by_full.summary
    assert by_short.tables["frames"].num_rows == 4
    assert by_short.tables["annotations"].num_rows > 0
    for name in ("frames", "annotations"):
        assert by_short.tables[name].equals(by_full.tables[name])
    for what in ("odometry", "reference"):
        read, told = (
            getattr(layout_of(m), what)(m, s) for m, s in ((short, section), (full, same))
        )
        assert np.array_equal(read.world_from_color, told.world_from_color)
        assert np.array_equal(read.timestamp_ns, told.timestamp_ns)
        assert len(read.timestamp_ns) == 4


@pytest.mark.parametrize("ending", ["jpg", "png"])
def test_index_and_poses(tmp_path, cli, ending):
    write_drive(tmp_path / "data", ending)
    write_manifest(tmp_path, tmp_path / "data")
    result = call(cli, tmp_path, "index")
    assert result.exit_code == 0, result.output
    assert "3 frames = 3 with depth; 1 annotations = 1 counted" in result.stdout
    frames = pd.read_parquet(tmp_path / "run" / "frames")
    assert frames["color_path"][2] == f"walk/color/000002.{ending}"
    assert frames["timestamp_ns"].tolist() == [0, 200_000_000, 400_000_000]
    assert frames["fy_px"].tolist() == [31.0] * 3
    result = call(cli, tmp_path, "poses")
    assert result.exit_code == 0, result.output
    poses = pd.read_parquet(tmp_path / "run" / "poses")
    assert poses["status"].tolist() == ["tracked"] * 3
    assert poses["tz_m"].tolist() == [1.0] * 3
    assert "ATE" in result.stdout


def test_files_that_come_and_go_make_the_index_anew(project, cli):
    call(cli, project, "index")
    assert "up to date" in call(cli, project, "index").stdout
    (project / "data" / "walk" / "annotations.json").unlink()
    assert "0 annotations" in call(cli, project, "index").stdout
    content = {**CAMERA, "fx_px": 29.5, "frames_per_second": 10}
    (project / "data" / "camera.json").write_text(json.dumps(content))
    assert "3 frames" in call(cli, project, "index").stdout
    frames = pd.read_parquet(project / "run" / "frames")
    assert frames["fx_px"][0] == 29.5
    assert frames["timestamp_ns"][1] == 100_000_000


def test_true_boxes_and_true_poses_need_not_be_there(tmp_path):
    walk = write_drive(tmp_path)
    manifest = split(tmp_path)
    section = manifest.sequences[0]
    assert annotated(manifest, section).annotations.format == "coco"
    assert len(robot.LAYOUT.reference(manifest, section).world_from_color) == 3
    none = split(tmp_path, annotations={"format": "none"})
    assert annotated(none, section).annotations.format == "none"
    voc = split(tmp_path, annotations={"format": "voc", "path": "boxes"})
    assert annotated(voc, section).annotations.format == "voc"
    (walk / "annotations.json").unlink()
    (walk / "trajectory_true.txt").unlink()
    assert annotated(manifest, section).annotations.format == "none"
    assert robot.LAYOUT.reference(manifest, section) is None
    assert robot.LAYOUT.reference_files(manifest, section) == []


def test_the_manifest_replaces_line_by_line(tmp_path):
    walk = write_drive(tmp_path)
    (walk / "color").rename(walk / "rgb")
    (walk / "wheels.txt").write_text(f"0 7 0 0 {LOOK}\n")
    color = {"width_px": 64, "height_px": 48, "fx_px": 50, "fy_px": 50, "cx_px": 31.5, "cy_px": 23}
    manifest = split(
        tmp_path,
        images={"color": "rgb/{frame}.jpg", "frames_per_second": 10},
        odometry={"format": "tum", "path": "wheels.txt"},
        reference={"format": "tum", "path": "odometry.txt"},
        camera={"color": color, "pixel_origin": "center"},
    )
    section = manifest.sequences[0]
    frames = robot.LAYOUT.frames(manifest, section)
    assert [(f.color_path, f.depth_path, f.timestamp_ns) for f in frames][1] == (
        "walk/rgb/000001.jpg",
        "walk/depth/000001.png",
        100_000_000,
    )
    assert robot.LAYOUT.odometry(manifest, section).world_from_color[0, 0, 3] == 7
    assert robot.LAYOUT.reference(manifest, section).world_from_color[0, 2, 3] == 1.0
    model = camera_model(manifest, section)
    assert model.color == model.depth == PinholeCamera(64, 48, 50, 50, 32, 23.5)


def test_stamps_of_their_own(tmp_path):
    walk = write_drive(tmp_path)
    (walk / "stamps.txt").write_text("7\n8\n9\n")
    manifest = split(tmp_path, images={"timestamps": "stamps.txt"})
    frames = robot.LAYOUT.frames(manifest, manifest.sequences[0])
    assert [f.timestamp_ns for f in frames] == [7 * 10**9, 8 * 10**9, 9 * 10**9]
    names = [path.name for path in robot.LAYOUT.other_files(manifest, manifest.sequences[0])]
    assert names == ["camera.json", "stamps.txt"]


def test_the_camera_may_be_the_manifests_alone(tmp_path):
    write_drive(tmp_path)
    (tmp_path / "camera.json").unlink()
    bare = split(tmp_path)
    fault(lambda: camera_model(bare), ConfigError, "needs camera.json", "camera.color")
    color = {name: value for name, value in CAMERA.items() if name.endswith("_px")}
    assert camera_model(split(tmp_path, camera={"color": color})).color.fy_px == 31.0
    assert robot.LAYOUT.frames(bare, bare.sequences[0])[0].timestamp_ns is None


@pytest.mark.parametrize(
    ("change", "mention"),
    [
        ({"fx_px": 0}, "camera.json: fx_px: "),
        ({"fx_px": None}, "camera.json: fx_px: "),
        ({"frames_per_second": -5}, "camera.json: frames_per_second: "),
        ({"distortion": [0.1]}, "distortion: unknown key"),
    ],
)
def test_a_camera_file_that_cannot_be_meant(project, cli, change, mention):
    (project / "data" / "camera.json").write_text(json.dumps({**CAMERA, **change}))
    assert mention in error(cli, project)


@pytest.mark.parametrize("text", [b"{", b"", b"\xff\xfe", b"[1, 2]", b"null", b'{"fx_px": NaN}'])
def test_a_damaged_camera_file(project, cli, text):
    path = project / "data" / "camera.json"
    path.write_bytes(text)
    assert str(path) in error(cli, project)


def test_both_endings_side_by_side(project, cli):
    folder = project / "data" / "walk" / "color"
    Image.new("RGB", (32, 24)).save(folder / "000009.png")
    line = error(cli, project)
    assert "both color/{frame}.jpg and color/{frame}.png" in line
    assert "images.color" in line


def test_missing_trajectories_and_stamps_are_one_line(project, cli):
    call(cli, project, "index")
    (project / "data" / "walk" / "odometry.txt").unlink()
    assert "no such file" in error(cli, project, "poses")
    (project / "data" / "walk" / "odometry.txt").write_text("0 0 0\n")
    assert "line 1: expected 8 numbers, found 3" in error(cli, project, "poses")
    (project / "data" / "walk" / "odometry.txt").write_text(f"0 0 0 0 {LOOK}\n")
    content = {name: value for name, value in CAMERA.items() if name != "frames_per_second"}
    (project / "data" / "camera.json").write_text(json.dumps(content))
    call(cli, project, "index")
    assert "frames have no timestamps" in error(cli, project, "poses")


def test_a_drive_that_is_not_there(tmp_path, cli):
    write_manifest(tmp_path, tmp_path / "data")
    assert "no such folder" in error(cli, tmp_path)
    (tmp_path / "data" / "walk").mkdir(parents=True)
    (tmp_path / "data" / "camera.json").write_text(json.dumps(CAMERA))
    assert "no colour image fits the adapter 'robot'" in error(cli, tmp_path)


def test_a_mistyped_adapter_gets_a_suggestion():
    for wrong, right in (("scanet", "scannet"), ("robots", "robot"), ("tumm", "tum")):
        manifest = split("/data").model_copy(update={"adapter": wrong})
        fault(lambda m=manifest: layout_of(m), ConfigError, f"Did you mean '{right}'?")


def test_damaged_boxes_are_one_line(project, cli):
    path = project / "data" / "walk" / "annotations.json"
    path.write_text("{")
    assert str(path) in error(cli, project)
    manifest = split(project / "data")
    fault(lambda: index.run(manifest, manifest.sequences[0]), DataError, path)
