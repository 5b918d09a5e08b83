"""TUM RGB-D: lists of images, nearest depth, cameras by series, and lists that are damaged."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError, ImodError
from imodbatch.datasets import tum
from imodbatch.datasets.registry import camera_model, layout_of
from imodbatch.settings.manifest import Manifest

DESK = "rgbd_dataset_freiburg1_desk"
START = 1305031453
TURN = "0.7907 0.4393 -0.1770 -0.3879"  # x y z w; looks at a desk from above
MANIFEST = f"""
name = "tiny"
adapter = "tum"
root = "data"
classes = ["mug"]

[[sequences]]
id = "desk"
path = "{DESK}"
"""


def stamp(ms):
    return f"{START}.{ms:03d}000"


def write_lists(folder, color_ms, depth_ms):
    folder.mkdir(parents=True, exist_ok=True)
    for name, kind, moments in (("rgb.txt", "rgb", color_ms), ("depth.txt", "depth", depth_ms)):
        lines = [f"{stamp(ms)} {kind}/{stamp(ms)}.png" for ms in moments]
        head = f"# {kind} images\n# file: 'x.bag'\n# timestamp filename\n"
        (folder / name).write_text(head + "\n".join(lines) + "\n")


def write_sequence(folder, color_ms=(100, 133, 166, 200), depth_ms=(98, 131, 162, 196)):
    """The layout as it is unpacked; the camera moves 1 mm in x per millisecond."""
    write_lists(folder, color_ms, depth_ms)
    rng = np.random.default_rng(0)
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir()
    for ms in color_ms:
        pixels = np.kron(
            rng.integers(0, 255, (30, 40, 3), np.uint8), np.ones((16, 16, 1), np.uint8)
        )
        Image.fromarray(pixels).save(folder / "rgb" / f"{stamp(ms)}.png")
    for ms in depth_ms:
        depth = np.full((480, 640), 7500, np.uint16)
        Image.fromarray(depth).save(folder / "depth" / f"{stamp(ms)}.png")
    poses = [f"{stamp(ms)} {ms / 1000:.4f} 0.5 1.7 {TURN}" for ms in range(90, 210, 10)]
    (folder / "groundtruth.txt").write_text("# ground truth\n" + "\n".join(poses) + "\n")
    (folder / "associations.txt").write_text("nonsense that nobody reads\n")
    return folder


@pytest.fixture
def project(tmp_path):
    (tmp_path / "manifest.toml").write_text(MANIFEST)
    write_sequence(tmp_path / "data" / DESK)
    return tmp_path


def call(cli, project, stage):
    return cli(stage, project / "manifest.toml", "--out", project / "run")


def split(root, path=DESK, **more):
    sequences = [{"id": "s", "path": path}]
    return Manifest(
        name="tiny", adapter="tum", root=str(root), classes=["mug"], sequences=sequences, **more
    )


def listed(root, **more):
    manifest = split(root, **more)
    return layout_of(manifest).frames(manifest, manifest.sequences[0])


def fault(action, *mentions, kind=ImodError):
    with pytest.raises(kind) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


def test_index_and_poses_of_a_sequence_as_it_is_unpacked(project, cli):
    result = call(cli, project, "index")
    assert result.exit_code == 0, result.output
    assert "index desk: 4 frames = 4 with depth; 0 annotations" in result.stdout
    frames = pd.read_parquet(project / "run" / "frames")
    assert frames["frame_index"].tolist() == [0, 1, 2, 3]
    assert frames["timestamp_ns"].tolist() == [
        START * 10**9 + ms * 10**6 for ms in (100, 133, 166, 200)
    ]
    assert frames["color_path"][1] == f"{DESK}/rgb/{stamp(133)}.png"
    assert frames["depth_path"][1] == f"{DESK}/depth/{stamp(131)}.png"
    assert frames["depth_scale_m"].tolist() == [0.0002] * 4
    assert frames["fx_px"][0] == frames["depth_fx_px"][0] == 517.3
    result = call(cli, project, "poses")
    assert result.exit_code == 0, result.output
    poses = pd.read_parquet(project / "run" / "poses")
    assert poses["status"].tolist() == ["tracked"] * 4
    assert poses["tx_m"].tolist() == pytest.approx([0.100, 0.130, 0.170, 0.200], abs=1e-6)
    assert np.allclose(
        poses[["qx", "qy", "qz", "qw"]].abs(), [0.7907, 0.4393, 0.1770, 0.3879], atol=1e-4
    )
    assert "no ATE: the poses are the reference itself" in result.stdout
    assert "up to date" in call(cli, project, "index").stdout


def test_another_list_makes_the_index_anew(project, cli):
    call(cli, project, "index")
    write_lists(project / "data" / DESK, (100, 133), (98,))
    result = call(cli, project, "index")
    assert "2 frames = 1 with depth + 1 without" in result.stdout


def test_frames_are_numbered_by_their_lines_whatever_depth_there_is(tmp_path):
    write_lists(tmp_path / DESK, (100, 133, 166, 200), (134, 187))
    frames = listed(tmp_path)
    assert [f.frame_index for f in frames] == [0, 1, 2, 3]
    depths = [f.depth_path and f.depth_path.rsplit("/", 1)[1] for f in frames]
    assert depths == [None, f"{stamp(134)}.png", None, f"{stamp(187)}.png"]
    sequence = {"id": "s", "path": DESK, "frames": "1:3"}
    manifest = split(tmp_path).model_copy(
        update={"sequences": (split(tmp_path).sequences[0].model_copy(update=sequence),)}
    )
    kept = tum.LAYOUT.frames(manifest, manifest.sequences[0])
    assert [(f.frame_index, f.depth_path) for f in kept] == [
        (1, frames[1].depth_path),
        (2, None),
    ]


def test_the_gap_is_a_setting_and_a_depth_image_serves_one_frame(tmp_path):
    write_lists(tmp_path / DESK, (100, 110, 200), (106, 221))
    assert [f.depth_path is not None for f in listed(tmp_path)] == [False, True, False]
    wide = listed(tmp_path, images={"max_gap_ms": 21})
    assert [f.depth_path is not None for f in wide] == [False, True, True]


def test_the_order_of_depth_lines_and_repeated_ones_do_no_harm(tmp_path):
    write_lists(tmp_path / DESK, (100, 133, 166), (166, 98, 131, 131))
    depths = [f.depth_path.rsplit("/", 1)[1] for f in listed(tmp_path)]
    assert depths == [f"{stamp(ms)}.png" for ms in (98, 131, 166)]


def test_an_empty_depth_list_means_no_depth(tmp_path):
    write_lists(tmp_path / DESK, (100, 133), ())
    assert [f.depth_path for f in listed(tmp_path)] == [None, None]


@pytest.mark.parametrize(
    ("path", "intrinsics"),
    [
        ("rgbd_dataset_freiburg1_desk", (517.3, 516.5, 319.1, 255.8)),
        ("rgbd_dataset_freiburg2_xyz", (520.9, 521.0, 325.6, 250.2)),
        ("fr/rgbd_dataset_freiburg3_long_office_household", (535.4, 539.2, 320.6, 248.1)),
        ("office", (525.0, 525.0, 320.0, 240.0)),
        ("rgbd_dataset_freiburg12", (525.0, 525.0, 320.0, 240.0)),
        ("rgbd_dataset_freiburg1_desk/own/office", (517.3, 516.5, 319.1, 255.8)),
    ],
)
def test_cameras_by_series(path, intrinsics):
    """Published centres count from a pixel's middle, ours from the image's corner."""
    manifest = split("/data", path)
    model = camera_model(manifest, manifest.sequences[0])
    camera = model.color
    found = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    assert found == pytest.approx(intrinsics)
    assert (camera.width_px, camera.height_px) == (640, 480)
    assert model.depth == camera
    assert (model.depth_scale_m, model.depth_invalid) == (0.0002, (0,))
    assert model.color_from_depth is None


def test_the_root_may_be_the_sequence_itself():
    manifest = split(f"/data/{DESK}", ".")
    assert camera_model(manifest, manifest.sequences[0]).color.fx_px == 517.3


def test_depth_follows_a_camera_that_the_manifest_gives():
    color = {"width_px": 64, "height_px": 48, "fx_px": 50, "fy_px": 50, "cx_px": 32, "cy_px": 24}
    manifest = split("/data", camera={"color": color})
    model = camera_model(manifest, manifest.sequences[0])
    assert model.color == model.depth == PinholeCamera(64, 48, 50, 50, 32, 24)
    assert model.depth_scale_m == 0.0002


def test_other_poses_and_no_true_ones(tmp_path):
    write_sequence(tmp_path / DESK)
    (tmp_path / DESK / "slam.txt").write_text(f"{stamp(100)} 9 8 7 0 0 0 1\n")
    manifest = split(tmp_path, odometry={"format": "tum", "path": "slam.txt"})
    section = manifest.sequences[0]
    assert tum.LAYOUT.odometry(manifest, section).world_from_color[0, :3, 3].tolist() == [9, 8, 7]
    assert len(tum.LAYOUT.reference(manifest, section).world_from_color) == 12
    (tmp_path / DESK / "groundtruth.txt").unlink()
    (tmp_path / "groundtruth.txt").write_text(f"{stamp(100)} 1 1 1 0 0 0 1\n")  # of nobody
    assert tum.LAYOUT.reference(manifest, section) is None
    assert tum.LAYOUT.odometry_files(manifest, section) == [tmp_path / DESK / "slam.txt"]
    assert tum.LAYOUT.other_files(manifest, section) == [
        tmp_path / DESK / "rgb.txt",
        tmp_path / DESK / "depth.txt",
    ]


def good(ms):
    return f"{stamp(ms)} rgb/{ms}.png"


@pytest.mark.parametrize("name", ["rgb.txt", "depth.txt"])
@pytest.mark.parametrize(
    ("text", "mentions"),
    [
        (f"# a\n{stamp(100)}\n", ("line 2", "found 1 columns")),
        (f"{good(100)} {good(100)}\n", ("line 1", "found 4 columns")),
        ("soon rgb/1.png\n", ("line 1", "'soon'", "a stamp in seconds")),
        ("nan rgb/1.png\n", ("line 1", "no moment in seconds")),
        ("1403636579763555584 rgb/1.png\n", ("line 1", "no moment in seconds")),
        (f"{stamp(100)} /data/1.png\n", ("line 1", "'/data/1.png'")),
        (b"\xff\xfe\x00", ("cannot be read as text",)),
        (None, ("no such file",)),
    ],
)
def test_damaged_lists(project, cli, name, text, mentions):
    path = project / "data" / DESK / name
    path.unlink()
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    line = error(cli, project)
    assert str(path) in line
    for mention in mentions:
        assert mention in line


def error(cli, project, stage="index"):
    result = call(cli, project, stage)
    assert result.exit_code == 1, result.output
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: ")
    return line


@pytest.mark.parametrize(
    ("moments", "mention"),
    [
        ((100, 166, 133), "rgb/" + stamp(133) + ".png is earlier than"),
        ((100, 133, 133), "has the same stamp as"),
        ((), "lists no image"),
    ],
)
def test_colour_must_be_in_order_of_time(tmp_path, moments, mention):
    write_lists(tmp_path / DESK, moments, (100,))
    fault(lambda: listed(tmp_path), tmp_path / DESK / "rgb.txt", mention)


def test_depth_of_another_recording(tmp_path):
    write_lists(tmp_path / DESK, (100, 133), (160, 700))
    fault(
        lambda: listed(tmp_path), "within 20 ms", "nearest two are 27.000 ms", "images.max_gap_ms"
    )
    assert listed(tmp_path, images={"max_gap_ms": 27})[1].depth_path is not None


def test_a_folder_that_is_not_there(tmp_path, cli):
    (tmp_path / "manifest.toml").write_text(MANIFEST)
    assert "no such file. A sequence of TUM RGB-D has rgb.txt" in error(cli, tmp_path)


def test_a_listed_image_that_is_not_there_is_a_warning(project, cli):
    path = project / "data" / DESK / "rgb" / f"{stamp(133)}.png"
    path.unlink()
    result = call(cli, project, "index")
    assert result.exit_code == 0
    assert f"{path}: no such file" in result.stderr
    assert "4 frames = 4 with depth" in result.stdout


def test_patterns_mean_nothing(tmp_path):
    write_lists(tmp_path / DESK, (100,), (100,))
    images = {"color": "rgb/{stamp}.png"}
    fault(lambda: listed(tmp_path, images=images), "images.color", "rgb.txt", kind=ConfigError)


def test_poses_of_another_time_are_one_line(project, cli):
    call(cli, project, "index")
    path = project / "data" / DESK / "groundtruth.txt"
    path.write_text(f"100.0 0 0 0 {TURN}\n")
    assert "their clocks differ" in error(cli, project, "poses")
    path.write_text("100.0 0 0 0\n")
    assert "groundtruth.txt, line 1: expected 8 numbers, found 4" in error(cli, project, "poses")
    path.unlink()
    assert "no such file" in error(cli, project, "poses")


def test_shipped_manifest_names_the_series(monkeypatch):
    from imodbatch.settings.manifest import load_manifest

    monkeypatch.setenv("IMODBATCH_DATA", "/data")
    manifest = load_manifest(Path(__file__).parents[2] / "manifests" / "tum_fr1_desk.toml")
    assert camera_model(manifest, manifest.sequences[0]).color.fx_px == 517.3
