"""Each bad input is one line that says where, what and how to cure it; or a status in a row."""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from PIL import Image

CLASSES = ["ball", "can", "carton", "bottle", "mug"]
NOBODY = 65534
QUICK = """
[fuse]
methods = ["single", "imod"]
mode = "online"
[sweep]
voxel_sizes_m = []
[report]
n_frames = 0
"""


@dataclass(frozen=True)
class Project:
    """A copy of one short walk, its manifest and a run folder; all of it may be spoilt."""

    folder: Path
    cli: Callable[..., Result]

    @property
    def manifest(self) -> Path:
        return self.folder / "manifest.toml"

    @property
    def walk(self) -> Path:
        return self.folder / "data" / "walk_1"

    def edit(self, old: str, new: str) -> None:
        """Replace a text that stands once in the manifest."""
        text = self.manifest.read_text(encoding="utf-8")
        assert text.count(old) == 1
        self.manifest.write_text(text.replace(old, new), encoding="utf-8")

    def call(self, command: str, *more: object) -> Result:
        folder = self.folder
        given = ("--pipeline", folder / "quick.toml", "--out", folder / "run", *more)
        return self.cli(command, self.manifest, *given)

    def error(self, *more: object, command: str = "run") -> str:
        """The one line of a run that ends with exit code 1."""
        result = self.call(command, *more)
        assert result.exit_code == 1, result.output
        (line,) = result.stderr.splitlines()
        assert line.startswith("imodbatch: error: ")
        return line

    def lines(self, *more: object, n_warnings: int = 0, has_page: bool = False) -> dict[str, str]:
        """Stage → what a run that ends with exit code 0 says of it; a page takes a second more."""
        with pytest.MonkeyPatch.context() as patch:
            if not has_page:
                patch.setattr("imodbatch.reporting.report.run", lambda *_: Path("report.html"))
            result = self.call("run", *more)
        assert result.exit_code == 0, result.output
        warnings = result.stderr.splitlines()
        assert len(warnings) == n_warnings, warnings
        assert all(line.startswith("imodbatch: warning: ") for line in warnings)
        said = (line.split(" ", 1) for line in result.stdout.splitlines())
        return {stage: line.removeprefix("walk_1: ") for stage, line in said if "all: " not in line}

    def table(self, name: str) -> pd.DataFrame:
        return pd.read_parquet(self.folder / "run" / name)

    def annotations(self, change: Callable[[dict[str, Any]], None]) -> Path:
        """Change the file of true boxes."""
        path = self.walk / "annotations.json"
        content = json.loads(path.read_text(encoding="utf-8"))
        change(content)
        path.write_text(json.dumps(content), encoding="utf-8")
        return path

    def detections(self, change: Callable[[pd.DataFrame], None]) -> Path:
        """Change the file of detections."""
        path = self.folder / "data" / "detections.parquet"
        table = pd.read_parquet(path)
        change(table)
        table.to_parquet(path)
        return path

    def report(self) -> str:
        return (self.folder / "run" / "report" / "report.html").read_text(encoding="utf-8")


@pytest.fixture
def project(
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    cli: Callable[..., Result],
    tmp_path: Path,
) -> Project:
    return make_project(tmp_path, analytic_data, analytic_manifest, cli)


def make_project(
    folder: Path,
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    cli: Callable[..., Result],
) -> Project:
    """The first four frames of one walk."""
    found = Project(folder, cli)
    for kind in ("color", "depth"):
        (found.walk / kind).mkdir(parents=True)
        for number in range(4):
            shutil.copy2(analytic_data / "walk_1" / kind / f"{number:06d}.png", found.walk / kind)
    for name in ("trajectory.txt", "annotations.json"):
        shutil.copy2(analytic_data / "walk_1" / name, found.walk)
    detections = pd.read_parquet(analytic_data / "detections.parquet")
    of_walk = (detections.sequence_id == "walk_1") & (detections.frame_index < 4)
    detections[of_walk].to_parquet(folder / "data" / "detections.parquet", index=False)
    found.manifest.write_text(analytic_manifest(Path("data"), "walk_1"), encoding="utf-8")
    (folder / "quick.toml").write_text(QUICK, encoding="utf-8")
    found.annotations(keep_first_frames)
    return found


def keep_first_frames(content: dict[str, Any]) -> None:
    content["images"] = [image for image in content["images"] if image["id"] < 4]
    content["annotations"] = [a for a in content["annotations"] if a["image_id"] < 4]


def truncate(path: Path) -> Path:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    return path


def statuses(project: Project, frame: int) -> set[str]:
    observations = project.table("observations")
    return set(observations[observations.frame_index == frame].status)


def test_good_input_gives_no_error(project: Project) -> None:
    """Else none of what follows would mean anything."""
    lines = project.lines()
    assert lines["index"].startswith("4 frames = 4 with depth; ")
    assert "left out" not in lines["index"] + lines["detect"]
    assert set(project.table("observations").status) == {"placed"}


# Depth and colour images


def test_missing_depth_is_a_status(project: Project) -> None:
    (project.walk / "depth" / "000002.png").unlink()
    lines = project.lines()
    assert lines["index"].startswith("4 frames = 3 with depth + 1 without; ")
    assert statuses(project, 2) == {"no_depth"}
    assert statuses(project, 1) == {"placed"}
    assert set(project.table("fused").query("frame_index == 2").n_cells) == {0}


def test_truncated_depth_is_a_status_and_a_warning(project: Project) -> None:
    path = truncate(project.walk / "depth" / "000002.png")
    result = project.call("run")
    assert result.exit_code == 0
    (warning,) = result.stderr.splitlines()
    assert warning.startswith(f"imodbatch: warning: {path}: damaged image")
    assert statuses(project, 2) == {"unreadable_depth"}
    assert " unreadable_depth" in result.stdout


def test_an_empty_depth_file_is_a_status_and_a_warning(project: Project) -> None:
    (project.walk / "depth" / "000002.png").write_bytes(b"")
    project.lines(n_warnings=2, has_page=True)  # index reads its header, lift the image
    assert statuses(project, 2) == {"unreadable_depth"}


def test_8_bit_depth_is_an_error(project: Project) -> None:
    path = project.walk / "depth" / "000001.png"
    Image.fromarray(np.zeros((240, 320), dtype=np.uint8)).save(path)
    line = project.error(command="index")  # at once, not when lift reads it
    assert f"{path}: expected a 16-bit single-channel depth image, found Pillow mode 'L'" in line
    assert "Point the manifest at the raw depth images." in line


@pytest.mark.parametrize(
    ("kind", "dtype", "shape"),
    [("color", np.uint8, (120, 160, 3)), ("depth", np.uint16, (120, 160))],
)
def test_a_wrong_image_size_is_an_error(
    project: Project, kind: str, dtype: type, shape: tuple[int, ...]
) -> None:
    path = project.walk / kind / "000001.png"
    Image.fromarray(np.zeros(shape, dtype=dtype)).save(path)
    line = project.error(command="index")
    assert f"{path}: image is 160×120, expected 320×240. Correct camera.{kind}" in line


def test_truncated_colour_only_costs_its_picture(project: Project) -> None:
    """No stage but the report looks at colours when the detections come from a file."""
    for path in sorted((project.walk / "color").iterdir()):
        truncate(path)
    project.lines("--set", "report.n_frames=2", has_page=True)
    assert "damaged image" in project.report()
    assert "data:image/jpeg" not in project.report()


# Poses


@pytest.mark.parametrize("column", [1, 4], ids=["place", "quaternion"])
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400"])
def test_a_pose_that_is_not_finite_is_lost_or_interpolated(
    project: Project, column: int, value: str
) -> None:
    spoil_poses(project, {2: (column, value)})
    given = project.call("index"), project.call("poses", "--set", "poses.interpolate=never")
    assert [result.exit_code for result in given] == [0, 0]
    assert project.table("poses").status.tolist() == ["tracked", "tracked", "lost", "tracked"]
    assert project.call("poses").exit_code == 0
    poses = project.table("poses")
    assert poses.status.tolist() == ["tracked", "tracked", "interpolated", "tracked"]
    assert np.isfinite(poses[["tx_m", "ty_m", "tz_m", "qw"]].to_numpy()).all()


def test_boxes_of_a_lost_frame_say_so(project: Project) -> None:
    spoil_poses(project, {2: (1, "nan")})
    lines = project.lines("--set", "poses.interpolate=never")
    assert lines["poses"].startswith("4 frames = 3 tracked + 1 lost; ")
    assert statuses(project, 2) == {"no_pose"}
    assert project.table("poses").query("frame_index == 2").tx_m.isna().all()


def test_no_good_pose_at_all_is_an_error(project: Project) -> None:
    spoil_poses(project, dict.fromkeys(range(8), (1, "nan")))
    line = project.error()
    assert "walk_1: none of 4 frames has a pose. None of the trajectory's 8 poses is" in line


def test_a_missing_trajectory_is_an_error(project: Project) -> None:
    (project.walk / "trajectory.txt").unlink()
    line = project.error()
    assert f"{project.walk / 'trajectory.txt'}: no such" in line
    assert "odometry.path" in line


def spoil_poses(project: Project, changes: dict[int, tuple[int, str]]) -> None:
    """Frame → a column of its line and what stands there instead."""
    path = project.walk / "trajectory.txt"
    rows = [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]
    for frame, (column, value) in changes.items():
        rows[frame][column] = value
    path.write_text("\n".join(" ".join(row) for row in rows) + "\n")


# Annotations


def rename_mug(content: dict[str, Any]) -> None:
    (mug,) = [c for c in content["categories"] if c["name"] == "mug"]
    mug["name"] = "mugg"


def test_an_unknown_class_is_counted_or_an_error(project: Project) -> None:
    true = json.loads((project.walk / "annotations.json").read_text())["annotations"]
    n_mugs = sum(entry["category_id"] == 5 for entry in true)
    assert n_mugs > 0
    path = project.annotations(rename_mug)
    assert f" + {n_mugs} left out (unknown class)" in project.lines()["index"]
    assert len(project.table("annotations")) == len(true) - n_mugs
    project.edit("[annotations]", '[annotations]\nunknown_classes = "error"')
    line = project.error()
    assert f"{path}: annotations[" in line
    assert "'mugg' is not a class of manifest analytic. Did you mean 'mug'?" in line
    assert "annotations.rename" in line


def test_a_box_outside_the_image_is_counted_or_an_error(project: Project) -> None:
    def push_out(content: dict[str, Any]) -> None:
        content["annotations"][0]["bbox"] = [400.0, 10.0, 20.0, 20.0]

    path = project.annotations(push_out)
    assert " + 1 left out (outside image)" in project.lines()["index"]
    project.edit("[annotations]", '[annotations]\noutside = "error"')
    line = project.error()
    assert f"{path}: annotations[0]: the box [400.0, 10.0, 420.0, 30.0]" in line
    assert 'annotations.outside = "clip"' in line


def test_without_annotations_the_report_says_so(project: Project) -> None:
    text = project.manifest.read_text()
    section = text[text.index("[annotations]") : text.index("[detections]")]
    project.edit(section, '[annotations]\nformat = "none"\n')
    lines = project.lines("--set", "report.n_frames=2", n_warnings=1, has_page=True)
    assert lines["index"].endswith("; 0 annotations = 0 counted")
    assert "There are no annotations: nothing can be scored" in project.report()
    assert project.table("metrics").query("metric.str.startswith('ap_')").value.isna().all()


def test_a_list_without_annotations_is_no_annotations(project: Project) -> None:
    project.annotations(lambda content: content.update(annotations=[]))
    project.lines(n_warnings=1, has_page=True)
    assert "There are no annotations: nothing can be scored" in project.report()


def test_an_empty_annotations_file_is_an_error(project: Project) -> None:
    path = project.walk / "annotations.json"
    path.write_bytes(b"")
    line = project.error()
    assert f"{path}: is not JSON" in line
    assert "check annotations.path" in line


def test_a_missing_annotations_file_is_an_error(project: Project) -> None:
    path = project.walk / "annotations.json"
    path.unlink()
    assert f"{path}: no such file or folder. Check annotations.path" in project.error()


def test_a_class_in_no_annotation_has_no_ap(project: Project) -> None:
    def take_out_mugs(content: dict[str, Any]) -> None:
        kept = [entry for entry in content["annotations"] if entry["category_id"] != 5]
        content["annotations"] = kept

    project.annotations(take_out_mugs)
    project.lines(has_page=True)
    metrics = project.table("metrics").query("method == 'imod'").set_index(["metric", "class_name"])
    ap = metrics.value["ap_voc07_11pt"]
    assert np.isnan(ap["mug"])
    assert ap["mean"] == pytest.approx(ap[CLASSES[:4]].mean())
    assert ap[CLASSES[:4]].notna().all()
    assert metrics.value["n_false_positives", "mug"] > 0


# The manifest, the pipeline, and the folders they name


def test_an_empty_sequence_is_an_error(project: Project) -> None:
    shutil.rmtree(project.walk / "color")
    line = project.error()
    assert f"{project.walk}: empty sequence 'walk_1'" in line
    assert "Check sequences.path and images.color." in line


def test_a_slice_without_frames_is_an_error(project: Project) -> None:
    project.edit('path = "walk_1"', 'path = "walk_1"\nframes = "100:200"')
    line = project.error()
    assert f"{project.walk}: no frame of sequence 'walk_1' lies in the slice '100:200'." in line


def test_a_missing_sequence_folder_is_an_error(project: Project) -> None:
    shutil.rmtree(project.walk)
    line = project.error()
    assert f"{project.walk}: no such folder (sequence 'walk_1')." in line
    assert "Correct root or sequences.path." in line


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[world]", "[wolrd]", "wolrd: unknown key. Did you mean 'world'?"),
        ("[world]\nup =", "[world]\nupp =", "world.upp: unknown key. Did you mean 'up'?"),
        ("frames_per_second", "frame_per_second", "images.frame_per_second: unknown key. Did you"),
        ('[world]\nup = "+z"', '[world]\nup = "up"', "world.up: "),
        ('name = "analytic"', 'name = "an/alytic"', "name: must be made of letters"),
    ],
)
def test_a_manifest_that_cannot_be_meant(project: Project, old: str, new: str, said: str) -> None:
    project.edit(old, new)
    assert f"{project.manifest}: {said}" in project.error()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[fuse]\ncell_reduse = 'max'",
            "fuse.cell_reduse: unknown key. Did you mean 'cell_reduce'?",
        ),
        ("[fusion]\n", "fusion: unknown key. Did you mean 'fuse'?"),
        (
            "[fuse]\ncell_reduce = 'median'",
            "fuse.cell_reduce: Input should be 'mean', 'max'",
        ),
        (
            "[lift]\nvoxel_size_m = 0.0",
            "lift.voxel_size_m: Input should be greater than 0 (got 0.0)",
        ),
        ("[fuse", "not valid TOML: "),
    ],
)
def test_a_pipeline_that_cannot_be_meant(project: Project, text: str, said: str) -> None:
    (project.folder / "quick.toml").write_text(text)
    assert f"{project.folder / 'quick.toml'}: {said}" in project.error()


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("fuse.cell_reduse=max", "fuse.cell_reduse: unknown key. Did you mean 'cell_reduce'?"),
        ("cell_reduce=max", "--set cell_reduce=max: expected STAGE.KEY=VALUE"),
        ("fuse.cell_reduce", "--set fuse.cell_reduce: expected STAGE.KEY=VALUE"),
    ],
)
def test_a_setting_that_cannot_be_meant(project: Project, setting: str, said: str) -> None:
    assert said in project.error("--set", setting)


def test_an_unset_environment_variable_is_an_error(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    project.edit('root = "data"', 'root = "${IMODBATCH_NOWHERE}/data"')
    monkeypatch.delenv("IMODBATCH_NOWHERE", raising=False)
    line = project.error()
    assert f"{project.manifest}: the environment variable IMODBATCH_NOWHERE is not set." in line
    assert "export IMODBATCH_NOWHERE=" in line
    monkeypatch.setenv("IMODBATCH_NOWHERE", str(project.folder))
    assert project.call("index").exit_code == 0


def test_a_manifest_that_is_not_there(project: Project) -> None:
    project.manifest.rename(project.folder / "manifests.toml")
    line = project.error()
    assert f"{project.manifest}: no such file. Did you mean 'manifests.toml'?" in line


@pytest.mark.parametrize("content", [b"name = ", b"\xff\xfe\x00", b"\x89PNG\r\n"])
def test_a_manifest_that_is_not_toml(project: Project, content: bytes) -> None:
    project.manifest.write_bytes(content)
    line = project.error()
    assert f"{project.manifest}: " in line
    assert "not valid TOML" in line or "cannot be read" in line


def test_a_manifest_that_is_a_folder(project: Project) -> None:
    project.manifest.unlink()
    project.manifest.mkdir()
    assert f"{project.manifest}: is a folder, expected a TOML file." in project.error()


def test_an_unknown_adapter_is_an_error(project: Project) -> None:
    project.edit('adapter = "folder"', 'adapter = "foldr"')
    line = project.error()
    assert "manifest analytic: unknown adapter 'foldr'. Did you mean 'folder'?" in line


def test_an_out_that_is_a_file_is_an_error(project: Project) -> None:
    (project.folder / "run").write_text("not a folder")
    line = project.error()
    assert f"{project.folder / 'run'}: is a file, expected a folder. Name another --out." in line
    assert (project.folder / "run").read_text() == "not a folder"


@pytest.fixture
def open_project(
    analytic_data: Path, analytic_manifest: Callable[..., str], cli: Callable[..., Result]
) -> Iterator[Project]:
    """A project that users other than root may read too, which pytest's folders are not."""
    with tempfile.TemporaryDirectory() as name:
        made = make_project(Path(name), analytic_data, analytic_manifest, cli)
        for path in (made.folder, *made.folder.rglob("*")):
            path.chmod(0o755)
        yield made


@contextmanager
def bound_by_permissions(readable: Path) -> Iterator[None]:
    """Nobody in place of root, whom no permission stops; skips where that cannot be had."""
    if os.geteuid() != 0:
        yield
        return
    try:
        os.seteuid(NOBODY)
    except OSError:
        pytest.skip("root cannot become nobody here")
    try:
        if not os.access(readable, os.R_OK, effective_ids=True):
            pytest.skip("nobody cannot read the folder of temporary files here")
        yield
    finally:
        os.seteuid(0)


def test_an_out_that_may_not_be_written_is_an_error(open_project: Project) -> None:
    assert open_project.call("index").exit_code == 0  # loads what is needed, while we may
    (open_project.folder / "locked").mkdir(mode=0o555)
    out = open_project.folder / "locked" / "run"
    with bound_by_permissions(open_project.manifest):
        line = open_project.error("--out", out)
    assert line.startswith(f"imodbatch: error: {out}")
    assert line.endswith("Permission denied. Check the path and its permissions.")


# Detections from a file


def test_detections_of_frames_that_do_not_exist(project: Project) -> None:
    def move_one(table: pd.DataFrame) -> None:
        table.loc[0, "frame_index"] = 99

    path = project.detections(move_one)
    line = project.error()
    assert f"{path}: row 0 (from 0): the dataset has no frame 99 (1 such entries)." in line
    assert 'detections.unknown_frames = "skip"' in line
    project.edit("[detections]", '[detections]\nunknown_frames = "skip"')
    assert " + 1 left out (unknown frames)" in project.lines()["detect"]


def test_a_missing_detections_file_is_an_error(project: Project) -> None:
    path = project.folder / "data" / "detections.parquet"
    path.unlink()
    assert f"{path}: no such file or folder. Check detections.path" in project.error()


@pytest.mark.parametrize("damage", [truncate, lambda path: path.write_bytes(b"")])
def test_a_damaged_detections_file_is_an_error(
    project: Project, damage: Callable[[Path], object]
) -> None:
    path = project.folder / "data" / "detections.parquet"
    damage(path)
    line = project.error()
    assert f"{path}: cannot be read as parquet" in line
    assert "Check detections.format." in line


def test_score_vectors_of_a_wrong_length_are_an_error(project: Project) -> None:
    def shorten(table: pd.DataFrame) -> None:
        table["view_scores"] = [scores[:-1] for scores in table["view_scores"]]

    path = project.detections(shorten)
    line = project.error()
    assert f"{path}: row 0 (from 0): view_scores has 239 values (" in line
    assert "Expected 240 = 5 classes x" in line


def test_a_grid_that_is_not_the_pipelines_is_an_error(project: Project) -> None:
    line = project.error("--set", "viewpoint.n_azimuths=8")
    assert "[detections] has 3 elevations x 16 azimuths, the pipeline's [viewpoint] 3 x 8." in line


def test_neither_detections_nor_weights_is_an_error(project: Project) -> None:
    text = project.manifest.read_text()
    project.edit(text[text.index("[detections]") : text.index("[[sequences]]")], "")
    line = project.error()
    assert "manifest analytic: no detector. Set detect.weights" in line


# A detector of our own


def save_tiny_detector(
    path: Path, n_azimuths: int, elevations_deg: tuple[float, ...], seed: int = 7
) -> Path:
    """A random network that finds many boxes, none of them right."""
    import torch
    from detectors import LIGHT

    from imodbatch.detection.card import DetectorCard
    from imodbatch.detection.checkpoint import save_checkpoint
    from imodbatch.detection.network import build_detector

    small = {"fpn_channels": 16, "head_width": 32, "roi_size": 3, "n_rois": 12}
    card = DetectorCard(
        format_version=1,
        name="tiny",
        architecture=LIGHT.model_copy(update=small),
        classes=tuple(CLASSES),
        n_azimuths=n_azimuths,
        elevations_deg=elevations_deg,
        image_size=(128, 96),
        licence="CC0-1.0",
        data={},
        seed=seed,
        figures={},
    )
    torch.manual_seed(seed)
    save_checkpoint(build_detector(card), card, path)
    return path


@pytest.fixture(scope="module")
def tiny_detector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny_detector(tmp_path_factory.mktemp("weights") / "tiny.safetensors", 1, ())


@pytest.fixture
def weights(tiny_detector: Path, tmp_path: Path) -> Path:
    """A checkpoint that may be spoilt."""
    for path in (tiny_detector, tiny_detector.with_suffix(".json")):
        shutil.copy2(path, tmp_path)
    return tmp_path / "tiny.safetensors"


@pytest.fixture
def two_frames(project: Project) -> Project:
    project.edit('path = "walk_1"', 'path = "walk_1"\nframes = "0:2"')
    return project


def with_weights(weights: Path) -> tuple[str, ...]:
    return ("--set", f"detect.weights={weights}", "--set", "detect.score_threshold=0.0")


@pytest.mark.parametrize(
    ("n_azimuths", "elevations_deg"), [(1, ()), (16, (10.0, 30.0, 50.0))], ids=["1x1", "3x16"]
)
def test_a_detector_runs_through(
    two_frames: Project, tmp_path: Path, n_azimuths: int, elevations_deg: tuple[float, ...]
) -> None:
    path = save_tiny_detector(tmp_path / "own.safetensors", n_azimuths, elevations_deg)
    lines = two_frames.lines(*with_weights(path))
    detections, fused = two_frames.table("detections"), two_frames.table("fused")
    assert sorted(set(detections.frame_index)) == [0, 1]
    assert lines["detect"].startswith(f"24 boxes = {len(detections)} kept")
    scores = np.stack(detections.view_scores)
    assert scores.shape[1] == 5 * max(1, len(elevations_deg)) * n_azimuths
    sums = scores.sum(axis=1) + detections.background_score.to_numpy()
    assert sums == pytest.approx(np.ones(len(sums)), abs=1e-4)
    placed = fused[(fused.method == "imod") & (fused.n_cells > 0)]
    assert len(placed) > 0
    assert placed.pose_bin.isna().all() == (n_azimuths == 1)
    assert two_frames.lines(*with_weights(path))["detect"].endswith("(up to date)")


def test_other_weights_of_the_same_name_are_noticed(two_frames: Project, weights: Path) -> None:
    two_frames.call("index")
    assert two_frames.call("detect", *with_weights(weights)).exit_code == 0
    first = two_frames.table("detections")
    save_tiny_detector(weights, 1, (), seed=8)
    result = two_frames.call("detect", *with_weights(weights))
    assert "up to date" not in result.stdout
    assert not two_frames.table("detections").equals(first)


def test_missing_weights_are_an_error(two_frames: Project, tmp_path: Path) -> None:
    path = tmp_path / "none.safetensors"
    line = two_frames.error(*with_weights(path))
    assert f"{path}: there is no such weights file. Set detect.weights" in line


def test_damaged_weights_are_an_error(two_frames: Project, weights: Path) -> None:
    truncate(weights)
    line = two_frames.error(*with_weights(weights))
    assert f"{weights}: not a readable safetensors file" in line
    assert "Copy or download it again." in line


def test_a_damaged_card_is_an_error(two_frames: Project, weights: Path) -> None:
    path = truncate(weights.with_suffix(".json"))
    assert f"{path}: not a readable JSON card" in two_frames.error(*with_weights(weights))


def test_a_detector_of_other_classes_is_an_error(two_frames: Project, weights: Path) -> None:
    two_frames.edit('"carton", "bottle"', '"bottle", "carton"')
    line = two_frames.error(*with_weights(weights))
    assert "Copy the detector's list, in its order." in line


def test_a_detector_of_another_grid_is_an_error(two_frames: Project, tmp_path: Path) -> None:
    path = save_tiny_detector(tmp_path / "own.safetensors", 12, (30.0, 45.0, 60.0))
    line = two_frames.error(*with_weights(path))
    assert "the detector knows 12 azimuths at [30.0, 45.0, 60.0]°; set viewpoint.n_az" in line


@pytest.mark.parametrize("device", ["cuda", "cuda:99", "abacus"])
def test_a_device_that_is_not_there(two_frames: Project, weights: Path, device: str) -> None:
    import torch

    if device == "cuda" and torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    line = two_frames.error("--device", device, *with_weights(weights))
    assert f'detect.device: "{device}" is not available' in line
    assert 'Set detect.device = "cpu".' in line


def test_truncated_colour_stops_the_detector_or_is_skipped(
    two_frames: Project, weights: Path
) -> None:
    path = truncate(two_frames.walk / "color" / "000001.png")
    line = two_frames.error(*with_weights(weights))
    assert f"{path}: damaged image" in line
    assert "Or set detect.unreadable_color = 'skip' to go on without it." in line
    skip = ("--set", "detect.unreadable_color=skip")
    lines = two_frames.lines(*with_weights(weights), *skip, n_warnings=1)
    assert lines["detect"].endswith("; 1 frames skipped (unreadable)")
    assert set(two_frames.table("detections").frame_index) == {0}
