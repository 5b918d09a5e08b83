"""Poses leave as trajectory files and come back as the same poses."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result

from imodbatch.datasets.trajectories import read_odometry
from imodbatch.run.exporting import tum_text
from imodbatch.settings.manifest import load_manifest
from imodbatch.settings.sections import OdometrySection
from imodbatch.tables.columns import world_from_cam_of
from imodbatch.tables.parquet import from_rows, read_table, table_path
from imodbatch.tables.schemas import FRAMES, POSES

WALKS = ("walk_1", "walk_2")


@dataclass(frozen=True)
class Project:
    """Two walks with their poses; frame 3 of the second is lost."""

    folder: Path
    cli: Callable[..., Result]

    @property
    def manifest(self) -> Path:
        return self.folder / "manifest.toml"

    def call(self, command: str, *more: object) -> Result:
        settings = ("--set", "poses.interpolate=never")
        return self.cli(command, self.manifest, "--out", self.folder / "run", *settings, *more)

    def export(self, *more: object) -> Result:
        return self.call("export", "--to", self.folder / "tum", *more)


@pytest.fixture(scope="module")
def project(
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    cli: Callable[..., Result],
    tmp_path_factory: pytest.TempPathFactory,
) -> Project:
    made = Project(tmp_path_factory.mktemp("exported"), cli)
    shutil.copytree(analytic_data, made.folder / "data")
    made.manifest.write_text(analytic_manifest(Path("data"), *WALKS), encoding="utf-8")
    path = made.folder / "data" / "walk_2" / "trajectory.txt"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    del lines[[i for i, line in enumerate(lines) if not line.startswith("#")][3]]
    path.write_text("".join(lines), encoding="utf-8")
    for stage in ("index", "poses"):
        assert made.call(stage).exit_code == 0
    return made


def test_one_line_per_sequence_that_adds_up(project: Project) -> None:
    result = project.export()
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.splitlines() == [
        "export walk_1: 8 poses = 8 written",
        "export walk_2: 8 poses = 7 written + 1 lost",
    ]
    assert sorted(path.name for path in (project.folder / "tum").iterdir()) == [
        "walk_1.txt",
        "walk_2.txt",
    ]


def test_only_the_sequence_asked_for(project: Project, tmp_path: Path) -> None:
    result = project.call("export", "--to", tmp_path / "a" / "b", "--sequence", "walk_2")
    assert result.stdout == "export walk_2: 8 poses = 7 written + 1 lost\n"
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["walk_2.txt"]


@pytest.mark.parametrize("walk", WALKS)
def test_what_is_read_back_is_what_was_written(project: Project, walk: str) -> None:
    project.export()
    manifest = load_manifest(project.manifest)
    back = OdometrySection(format="tum", path=str(project.folder / "tum" / "{sequence}.txt"))
    odometry = read_odometry(back, manifest, manifest.choose([walk])[0], [])
    run = project.folder / "run"
    frames = read_table(table_path(run, "frames", walk), FRAMES).to_pandas()
    poses = read_table(table_path(run, "poses", walk), POSES)
    known = world_from_cam_of(poses)
    stamp_of = frames.set_index("frame_index").timestamp_ns
    assert odometry.timestamp_ns is not None
    assert odometry.timestamp_ns.tolist() == [stamp_of[i] for i in known]
    assert np.allclose(odometry.world_from_color, list(known.values()), atol=1e-8)


def test_exported_poses_as_odometry_give_the_same_poses(project: Project, tmp_path: Path) -> None:
    project.export()
    text = project.manifest.read_text(encoding="utf-8")
    old = 'path = "{sequence}/trajectory.txt"'
    again = Project(tmp_path, project.cli)
    shutil.copytree(project.folder / "data", tmp_path / "data")
    for walk in WALKS:
        shutil.copy(project.folder / "tum" / f"{walk}.txt", tmp_path / "data" / walk / "back.txt")
    again.manifest.write_text(
        text.replace(old, 'path = "{sequence}/back.txt"', 1), encoding="utf-8"
    )
    for stage in ("index", "poses"):
        assert again.call(stage).exit_code == 0
    first, second = (pd.read_parquet(p.folder / "run" / "poses") for p in (project, again))
    pd.testing.assert_frame_equal(first, second, atol=1e-8)


def frame(number, moment_ns):
    camera = {"width_px": 4, "height_px": 3, "fx_px": 5, "fy_px": 5, "cx_px": 2, "cy_px": 1.5}
    depth = {f"depth_{name}": value for name, value in camera.items()}
    key = {"sequence_id": "s", "frame_index": number, "timestamp_ns": moment_ns}
    return key | {"color_path": "c", "depth_scale_m": 0.001} | camera | depth


def pose(number, x_m):
    key = {"sequence_id": "s", "frame_index": number, "status": "tracked"}
    turn = {"qw": 0.5, "qx": 0.5, "qy": -0.5, "qz": 0.5}
    return key | {"tx_m": x_m, "ty_m": 0.0, "tz_m": -1.5} | turn


def lines_of(moments):
    numbers = (7, 9)
    frames = [frame(*pair) for pair in zip(numbers, moments, strict=True)]
    poses = [pose(number, 0.1 * number) for number in reversed(numbers)]
    return tum_text(from_rows(FRAMES, frames), from_rows(POSES, poses)).splitlines()


def test_stamps_keep_their_nanoseconds() -> None:
    comment, *lines = lines_of([1_700_000_000_123_456_789, 1_700_000_001_000_000_001])
    assert comment.startswith("# stamp in seconds, tx ty tz in metres, qx qy qz qw")
    assert [line.split()[0] for line in lines] == ["1700000000.123456789", "1700000001.000000001"]
    assert lines[0].split()[1:] == [
        *("0.700000000", "0.000000000", "-1.500000000"),
        *("0.500000000", "-0.500000000", "0.500000000", "0.500000000"),
    ]
    assert lines_of([-1_500_000_000, 0])[1].startswith("-1.500000000 ")


@pytest.mark.parametrize("moments", [(None, None), (5, None)])
def test_without_stamps_frame_numbers_stand_for_them(
    moments: tuple[int | None, int | None],
) -> None:
    comment, *lines = lines_of(moments)
    assert "stamp = frame number" in comment
    assert [line.split()[0] for line in lines] == ["7", "9"]


def test_poses_that_are_not_there_are_an_error(project: Project, tmp_path: Path) -> None:
    result = project.cli(
        "export", project.manifest, "--out", tmp_path / "none", "--to", tmp_path / "tum"
    )
    assert result.exit_code == 1
    (line,) = [x for x in result.stderr.splitlines() if "error" in x]
    assert "Run `imodbatch index` or `imodbatch run` first." in line
    assert not (tmp_path / "tum").exists()


def test_stale_poses_are_warned_of(project: Project) -> None:
    result = project.export("--set", "poses.max_gap_ms=10.0")
    assert result.exit_code == 0
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: warning: poses walk_1, poses walk_2 no longer fit")


def test_usage(project: Project) -> None:
    assert project.call("export").exit_code == 2  # where to?
    assert project.export("--format", "kitti").exit_code == 2
