"""True poses judge, and change nothing that is computed."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result

SPAN = ("--set", "pose_quality.rpe_delta_frames=2")


@dataclass(frozen=True)
class Project:
    """A walk whose odometry drifts to the side; the true poses lie beside it."""

    folder: Path
    cli: Callable[..., Result]

    def call(self, *more: object) -> Result:
        where = (self.folder / "manifest.toml", "--out", self.folder / "run")
        assert self.cli("index", *where).exit_code == 0
        return self.cli("poses", *where, *SPAN, *more)

    def judged(self, *more: object) -> str:
        """The line on how good the poses are."""
        result = self.call(*more)
        assert (result.exit_code, result.stderr) == (0, "")
        _, line = result.stdout.splitlines()
        assert line.startswith("pose_quality walk_1: ")
        return line

    def edit(self, old: str, new: str) -> None:
        path = self.folder / "manifest.toml"
        text = path.read_text(encoding="utf-8")
        assert text.count(old) == 1
        path.write_text(text.replace(old, new), encoding="utf-8")

    def table(self, name: str) -> pd.DataFrame:
        return pd.read_parquet(self.folder / "run" / name / "walk_1.parquet")

    def figures(self) -> dict[str, float]:
        return dict(self.table("pose_quality").set_index("metric").value)


REFERENCE = 'path = "{sequence}/trajectory.txt"\nup = "+z"'


@pytest.fixture
def project(
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    cli: Callable[..., Result],
    tmp_path: Path,
) -> Project:
    shutil.copytree(analytic_data / "walk_1", tmp_path / "data" / "walk_1")
    text = analytic_manifest(Path("data"), "walk_1")
    assert text.count(REFERENCE) == 1
    (tmp_path / "manifest.toml").write_text(text, encoding="utf-8")
    made = Project(tmp_path, cli)
    made.edit(REFERENCE, REFERENCE.replace("trajectory", "true"))
    walk = tmp_path / "data" / "walk_1"
    lines = (walk / "trajectory.txt").read_text(encoding="utf-8").splitlines()
    (walk / "true.txt").write_text("\n".join(lines), encoding="utf-8")
    drifting = [line.split() for line in lines if not line.startswith("#")]
    for step, parts in enumerate(drifting):
        parts[1] = str(float(parts[1]) + 0.01 * step**2)
    text = "\n".join(" ".join(parts) for parts in drifting)
    (walk / "trajectory.txt").write_text(text, encoding="utf-8")
    return made


def test_drifting_odometry_is_judged(project: Project) -> None:
    line = project.judged()
    figures = project.figures()
    assert figures["ate_se3_rmse_m"] > 0.005
    assert figures["rpe_translation_rmse_m"] > 0.01
    assert figures["up_error_deg"] < 0.01
    assert figures["sim3_scale"] == pytest.approx(1, abs=0.2)
    assert line.endswith(f"ATE {100 * figures['ate_se3_rmse_m']:.1f} cm")
    true, given = project.table("reference_poses"), project.table("poses")
    off = (true[["tx_m", "ty_m", "tz_m"]] - given[["tx_m", "ty_m", "tz_m"]]).to_numpy()
    rmse_m = np.sqrt((off**2).sum(axis=1).mean())
    assert rmse_m == pytest.approx(figures["ate_se3_rmse_m"], rel=1e-6)


def test_the_reference_changes_no_pose(project: Project) -> None:
    project.judged()
    with_truth = project.table("poses")
    project.edit("[reference] ", "[unread] ")
    path = project.folder / "manifest.toml"
    head, tail = path.read_text(encoding="utf-8").split("[unread]")
    path.write_text(head + "[annotations]" + tail.split("[annotations]")[1], encoding="utf-8")
    line = project.judged()
    assert "ATE" not in line
    pd.testing.assert_frame_equal(project.table("poses"), with_truth)
    assert len(project.table("reference_poses")) == 0
    assert "ate_se3_rmse_m" not in project.figures()


def test_a_changed_reference_is_judged_anew(project: Project) -> None:
    before = project.judged()
    assert project.judged() == f"{before} (up to date)"
    path = project.folder / "data" / "walk_1" / "true.txt"
    trajectory = path.with_name("trajectory.txt").read_text(encoding="utf-8")
    path.write_text(trajectory, encoding="utf-8")
    assert project.judged().endswith("no ATE: the poses are the reference itself")


def test_a_reference_that_is_not_there_is_an_error(project: Project) -> None:
    (project.folder / "data" / "walk_1" / "true.txt").unlink()
    result = project.call()
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: [reference] ")
    assert "true.txt: no such" in line


def test_the_span_of_the_relative_error_is_a_setting(project: Project) -> None:
    project.judged()
    n = project.table("pose_quality").set_index("metric").n
    assert n["rpe_translation_rmse_m"] == 6
    project.judged("--set", "pose_quality.rpe_delta_frames=5")
    n = project.table("pose_quality").set_index("metric").n
    assert n["rpe_translation_rmse_m"] == 3
