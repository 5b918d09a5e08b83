"""What is up to date stays; what depends on a change is redone; a killed run is taken up again."""

import multiprocessing
import os
import re
import shutil
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import pytest
from click.testing import Result

from imodbatch.cli.main import main
from imodbatch.run import runner
from imodbatch.run.step import Step
from imodbatch.run.steps import STEPS
from imodbatch.tables import parquet as tables
from imodbatch.tables.parquet import read_info

QUICK = """
[fuse]
methods = ["single", "imod"]
mode = "online"
[sweep]
voxel_sizes_m = [0.2]
"""
BOTH = ("walk_1", "walk_2")
STAGES = ("index", "poses", "detect", "lift", "fuse", "score", "diagnose")
STEPS_OF = {"poses": ("poses", "pose_quality")}
ON_THE_RUN = {"score": 1, "diagnose": 3}
"""Lines of a stage on the whole run; `diagnose` has no others."""
UP_TO_DATE = " (up to date)"


@dataclass(frozen=True)
class Project:
    """A folder with a dataset, a manifest, a pipeline and a run. It may be copied as a whole."""

    folder: Path
    cli: Callable[..., Result]
    manifest_text: Callable[..., str]

    @property
    def tables(self) -> Path:
        return self.folder / "run"

    def write_manifest(self, *sequences: str) -> None:
        text = self.manifest_text(Path("data"), *sequences)
        (self.folder / "manifest.toml").write_text(text, encoding="utf-8")

    def arguments(self, command: str, *more: object) -> list[str]:
        manifest, pipeline = self.folder / "manifest.toml", self.folder / "quick.toml"
        return [
            str(a) for a in (command, manifest, "--pipeline", pipeline, "--out", self.tables, *more)
        ]

    def call(self, command: str, *more: object, exit_code: int = 0) -> Result:
        result = self.cli(*self.arguments(command, *more))
        assert result.exit_code == exit_code, result.output
        return result

    def redone(self, command: str, *more: object) -> list[str]:
        """``stage sequence`` of every line that does not say "up to date"."""
        lines = self.call(command, *more).stdout.splitlines()
        return [
            line.split(": ")[0]
            for line in lines
            if not line.endswith(UP_TO_DATE) and not line.startswith("report")
        ]

    def bytes_by_file(self) -> dict[str, bytes]:
        found = sorted(self.tables.rglob("*.parquet"))
        return {path.relative_to(self.tables).as_posix(): path.read_bytes() for path in found}

    def moments(self) -> dict[str, tuple[int, int]]:
        """What changes when a file is written anew, also within one tick of the disk's clock."""
        found = {
            path.relative_to(self.tables): path.stat() for path in self.tables.rglob("*.parquet")
        }
        return {path.as_posix(): (stat.st_ino, stat.st_mtime_ns) for path, stat in found.items()}

    def states(self, *more: object) -> dict[str, set[str]]:
        """State → what is in it, as `status` prints it."""
        found: dict[str, set[str]] = {}
        output = self.call("status", *more).stdout
        for stage, label, state in re.findall(r"(?m)^  (\w+) +(\w+) +(up to date|\w+)", output):
            found.setdefault(state, set()).add(f"{stage} {label}")
        return found


def lines_of(*stages: str, sequences: tuple[str, ...] = BOTH) -> list[str]:
    """The lines of whole stages, in order."""
    found: list[str] = []
    for stage in stages:
        if stage != "diagnose":
            steps = STEPS_OF.get(stage, (stage,))
            found += [f"{step} {sequence}" for step in steps for sequence in sequences]
        found += [f"{stage} all"] * ON_THE_RUN.get(stage, 0)
    return found


ALL_LINES = lines_of(*STAGES)


def touch(path: Path) -> None:
    stat = path.stat()
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns + 1_000_000_000))


@pytest.fixture(autouse=True, scope="module")
def no_page() -> Iterator[None]:
    """The report reads its tables, but draws no page: that takes longer than all else here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("imodbatch.reporting.report.run", lambda *_: Path("report.html"))
        yield


@pytest.fixture(scope="module")
def finished(
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    cli: Callable[..., Result],
    tmp_path_factory: pytest.TempPathFactory,
) -> Project:
    """A finished run, only to be looked at."""
    project = Project(tmp_path_factory.mktemp("finished"), cli, analytic_manifest)
    shutil.copytree(analytic_data, project.folder / "data")
    (project.folder / "quick.toml").write_text(QUICK, encoding="utf-8")
    project.write_manifest(*BOTH)
    assert project.redone("run") == ALL_LINES
    return project


@pytest.fixture
def project(finished: Project, tmp_path: Path) -> Project:
    """A copy of the finished run, to be changed."""
    shutil.copytree(finished.folder, tmp_path / "project")
    return replace(finished, folder=tmp_path / "project")


@pytest.fixture
def fresh(project: Project) -> Project:
    """The same before its run."""
    shutil.rmtree(project.tables)
    return project


# What is redone


def test_a_second_run_touches_no_table(project: Project, finished: Project) -> None:
    before = project.moments()
    assert project.redone("run") == []
    assert project.moments() == before
    assert project.bytes_by_file() == finished.bytes_by_file()


@pytest.mark.parametrize(
    ("setting", "stages"),
    [
        ("poses.max_gap_ms=10.0", ("poses", "lift", "fuse", "score", "diagnose")),
        ("detect.score_threshold=0.1", ("detect", "lift", "fuse", "score", "diagnose")),
        ("lift.voxel_size_m=0.3", ("lift", "fuse", "score", "diagnose")),
        ("fuse.cell_reduce=max", ("fuse", "score", "diagnose")),
        ("matching.iou_percents=[30]", ("score", "diagnose")),
        ("report.n_frames=1", ()),
        ("detect.batch_size=2", ()),
    ],
)
def test_a_setting_redoes_its_stage_and_what_depends_on_it(
    project: Project, setting: str, stages: tuple[str, ...]
) -> None:
    before = project.moments()
    assert project.redone("run", "--set", setting) == lines_of(*stages)
    written = {name for step in STEPS if step.stage in stages for name in step.writes}
    after = project.moments()
    assert {file.split("/")[0] for file in after if after[file] != before[file]} == written


def test_a_setting_changes_what_it_should_and_back(project: Project, finished: Project) -> None:
    project.call("run", "--set", "lift.voxel_size_m=0.3")
    old, new = finished.bytes_by_file(), project.bytes_by_file()
    changed = {file.split("/")[0] for file in old if old[file] != new[file]}
    expected = {"observations", "fused", "objects", "matches", "metrics"}
    expected |= {"sweeps", "losses", "jitters"}  # the last is empty, but says what it was made of
    assert changed == expected
    assert project.redone("run") == lines_of("lift", "fuse", "score", "diagnose")
    assert project.bytes_by_file() == old


@pytest.mark.parametrize(
    ("setting", "tables"),
    [
        ("pose_quality.rpe_delta_frames=5", {"pose_quality", "reference_poses"}),
        ("metrics.threshold_step=0.1", {"metrics"}),
        ("sweep.voxel_sizes_m=[0.3]", {"sweeps"}),
        ("jitter.repeats=2", {"jitters"}),
    ],
)
def test_a_setting_that_judges_or_diagnoses_redoes_nothing_else(
    project: Project, setting: str, tables: set[str]
) -> None:
    before = project.moments()
    project.call("run", "--set", setting)
    after = project.moments()
    assert {file.split("/")[0] for file in after if after[file] != before[file]} == tables


def test_true_poses_added_later_estimate_nothing_anew(fresh: Project) -> None:
    manifest = fresh.folder / "manifest.toml"
    whole = manifest.read_text(encoding="utf-8")
    head, tail = whole.split("[reference]")
    manifest.write_text(head + tail[tail.index("[annotations]") :], encoding="utf-8")
    fresh.call("run")
    manifest.write_text(whole, encoding="utf-8")
    assert fresh.redone("run") == ["pose_quality walk_1", "pose_quality walk_2"]


def test_diagnosing_may_be_left_out(fresh: Project) -> None:
    off = ("--set", "diagnose.enabled=false")
    kept = lines_of(*(stage for stage in STAGES if stage != "diagnose"))
    assert fresh.redone("run", *off) == kept
    assert fresh.states(*off) == {"up to date": set(kept)}
    assert fresh.states() == {"up to date": set(kept), "missing": {"diagnose all"}}
    assert fresh.redone("run") == lines_of("diagnose")


def test_disturbing_poses_redoes_nothing_else(project: Project) -> None:
    before = project.moments()
    assert project.redone("run", "--set", "jitter.shifts_m=[0.05]") == ["diagnose all"]
    after = project.moments()
    assert [file for file in after if after[file] != before[file]] == ["jitters/run.parquet"]


@pytest.mark.parametrize(
    ("file", "stages", "sequences"),
    [
        ("walk_1/trajectory.txt", ("poses", "lift", "fuse", "score", "diagnose"), ("walk_1",)),
        ("walk_2/depth/000003.png", STAGES, ("walk_2",)),
        ("walk_2/annotations.json", STAGES, ("walk_2",)),
        ("detections.parquet", ("detect", "lift", "fuse", "score", "diagnose"), BOTH),
    ],
)
def test_a_file_redoes_what_was_made_from_it(
    project: Project, file: str, stages: tuple[str, ...], sequences: tuple[str, ...]
) -> None:
    touch(project.folder / "data" / file)
    before = project.moments()
    assert project.redone("run") == lines_of(*stages, sequences=sequences)
    after = project.moments()
    changed = {Path(name).stem for name in after if after[name] != before[name]}
    assert changed == {*sequences, "run"}
    assert project.redone("run") == []


def test_a_new_sequence_leaves_the_others_alone(fresh: Project, finished: Project) -> None:
    fresh.write_manifest("walk_1")
    assert fresh.redone("run") == lines_of(*STAGES, sequences=("walk_1",))
    before = fresh.moments()
    fresh.write_manifest(*BOTH)
    assert fresh.redone("run") == lines_of(*STAGES, sequences=("walk_2",))
    after = fresh.moments()
    assert {Path(name).stem for name in before if after[name] != before[name]} == {"run"}
    assert fresh.bytes_by_file() == finished.bytes_by_file()


@pytest.mark.parametrize(
    ("table", "redone"),
    [
        ("frames/walk_1", ["index walk_1"]),
        ("poses/walk_2", ["poses walk_2"]),
        ("detections/walk_1", ["detect walk_1"]),
        ("observations/walk_2", ["lift walk_2"]),
        ("objects/walk_1", ["fuse walk_1"]),
        ("matches/walk_2", ["score walk_2"]),
        ("losses/run", ["diagnose all"]),
    ],
)
def test_a_damaged_or_lost_table_is_redone(
    project: Project, finished: Project, table: str, redone: list[str]
) -> None:
    path = project.tables / f"{table}.parquet"
    whole = path.read_bytes()
    for content in (whole[:-100], whole[: len(whole) // 2], b"", b"PAR1 and no more"):
        path.write_bytes(content)
        assert project.redone(redone[0].split()[0]) == redone
        assert path.read_bytes() == whole
    path.unlink()
    assert project.redone("run") == redone
    assert project.bytes_by_file() == finished.bytes_by_file()


def test_a_table_damaged_inside_is_named(project: Project) -> None:
    """The footer is whole, so it looks up to date; but its pages have checksums."""
    path = project.tables / "detections" / "walk_1.parquet"
    content = bytearray(path.read_bytes())
    content[200:240] = bytes(40)
    path.write_bytes(content)
    result = project.call("lift", "--overwrite", "--sequence", "walk_1", exit_code=1)
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"imodbatch: error: {path}: damaged")
    assert "Delete it and run again." in line


def test_overwrite_redoes_what_is_up_to_date(project: Project, finished: Project) -> None:
    before = project.moments()
    assert project.redone("run", "--overwrite") == ALL_LINES
    after = project.moments()
    assert [file for file in before if after[file] == before[file]] == []
    assert project.bytes_by_file() == finished.bytes_by_file()


def test_overwriting_one_stage_leaves_the_next_up_to_date(project: Project) -> None:
    assert project.redone("fuse", "--overwrite") == lines_of("fuse")
    assert project.redone("run") == []


# What `status` says


def test_status_of_no_run_is_missing_and_writes_nothing(fresh: Project) -> None:
    assert fresh.states() == {"missing": set(ALL_LINES)}
    assert not fresh.tables.exists()


def test_status_of_a_finished_run_is_up_to_date(project: Project) -> None:
    assert project.states() == {"up to date": set(ALL_LINES)}


def test_status_tells_what_a_run_would_redo(project: Project) -> None:
    late = set(lines_of("lift", "fuse", "score", "diagnose"))
    states = project.states("--set", "lift.voxel_size_m=0.3")
    assert states == {"up to date": set(ALL_LINES) - late, "stale": late}


def test_status_behind_a_missing_table_is_stale(project: Project) -> None:
    (project.tables / "poses" / "walk_1.parquet").unlink()
    stale = set(lines_of("lift", "fuse", "score", "diagnose", sequences=("walk_1",)))
    assert project.states() == {
        "missing": {"poses walk_1"},
        "stale": stale | {"pose_quality walk_1"},
        "up to date": set(ALL_LINES) - stale - {"poses walk_1", "pose_quality walk_1"},
    }


# What changes while a run is at work


def replace_file(path: Path, content: bytes) -> None:
    """As another run does: under another name, then renamed."""
    beside = path.with_name(f"{path.name}.new")
    beside.write_bytes(content)
    beside.replace(path)


def step_with(stage: str, **hooks: Callable[[], None]) -> tuple[Step, ...]:
    """All steps; those of a stage call a hook first, wherever they call a function of that name."""

    def hooked(function: Callable[..., Any], hook: Callable[[], None]) -> Callable[..., Any]:
        return lambda *arguments: (hook(), function(*arguments))[1]

    def changed(step: Step) -> Step:
        calls = {name: hooked(getattr(step, name), hook) for name, hook in hooks.items()}
        return replace(step, **calls)

    return tuple(changed(step) if step.stage == stage else step for step in STEPS)


@pytest.mark.parametrize("moment", ["files", "depends_on", "execute"])
def test_an_input_that_is_replaced_while_a_step_begins(
    project: Project, finished: Project, moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows of one table must never stand under the identity of another."""
    path = project.tables / "detections" / "walk_1.parquet"
    ours = path.read_bytes()
    project.call("detect", "--set", "detect.score_threshold=0.3")
    theirs = path.read_bytes()
    replace_file(path, ours)
    with monkeypatch.context() as patch:
        steps = step_with("lift", **{moment: lambda: replace_file(path, theirs)})
        patch.setattr(runner, "STEPS", steps)
        patch.setattr(
            "imodbatch.run.states.stale_inputs", lambda *_: []
        )  # it asks for the files, too
        project.call("lift", "--overwrite", "--sequence", "walk_1")
    project.call("run")
    assert project.bytes_by_file() == finished.bytes_by_file()


def test_an_input_that_is_replaced_between_its_metadata_and_its_rows(
    project: Project, finished: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = project.tables / "detections" / "walk_1.parquet"
    ours = path.read_bytes()
    project.call("detect", "--set", "detect.score_threshold=0.3")
    theirs = path.read_bytes()
    assert len(ours) != len(theirs)
    replace_file(path, ours)
    told = []

    class Told(tables.pq.ParquetFile):  # type: ignore[misc]
        def read(self, *arguments: Any, **options: Any) -> Any:
            if "view_scores" in self.schema_arrow.names:
                replace_file(path, theirs)
                told.append(path)
            return super().read(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(tables.pq, "ParquetFile", Told)
        project.call("lift", "--overwrite", "--sequence", "walk_1")
    assert told
    lifted = "observations/walk_1.parquet"
    assert project.bytes_by_file()[lifted] == finished.bytes_by_file()[lifted]


def test_a_file_that_changes_while_a_step_reads_it_leaves_the_table_stale(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    trajectory = project.folder / "data" / "walk_1" / "trajectory.txt"
    with monkeypatch.context() as patch:
        steps = step_with("poses", execute=lambda: touch(trajectory))
        patch.setattr(runner, "STEPS", steps)
        project.call("poses", "--overwrite", "--sequence", "walk_1")
    assert project.redone("run")[0] == "poses walk_1"
    assert project.redone("run") == []


# One stage alone


@pytest.mark.parametrize(
    ("stage", "after", "needed"),
    [
        ("poses", (), "index"),
        ("detect", (), "index"),
        ("lift", ("index",), "poses"),
        ("lift", ("index", "poses"), "detect"),
        ("fuse", ("index", "poses", "detect"), "lift"),
        ("score", ("index", "poses", "detect", "lift"), "fuse"),
        ("report", (), "index"),
        ("report", ("index", "poses", "detect", "lift", "fuse"), "score"),
        ("report", ("index", "poses", "detect", "lift", "fuse", "score"), "diagnose"),
    ],
)
def test_a_stage_without_its_inputs_names_the_stage_to_run(
    fresh: Project, stage: str, after: tuple[str, ...], needed: str
) -> None:
    for name in after:
        fresh.call(name, "--sequence", "walk_1")
    result = fresh.call(stage, "--sequence", "walk_1", exit_code=1)
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"imodbatch: error: {fresh.tables}")
    assert f"no such table. Run `imodbatch {needed}` or `imodbatch run` first." in line


@pytest.mark.parametrize(
    ("stage", "setting", "stale"),
    [
        ("fuse", "lift.voxel_size_m=0.3", lines_of("lift")),
        ("fuse", "poses.max_gap_ms=10.0", ["poses walk_1", "poses walk_2", *lines_of("lift")]),
        ("lift", "pose_quality.rpe_delta_frames=5", []),
        ("report", "fuse.cell_reduce=max", lines_of("fuse", "score", "diagnose")),
        ("detect", "poses.max_gap_ms=10.0", []),
        ("lift", "fuse.cell_reduce=max", []),
    ],
)
def test_a_stage_with_stale_inputs_warns(
    project: Project, stage: str, setting: str, stale: list[str]
) -> None:
    lines = project.call(stage, "--set", setting).stderr.splitlines()
    if stale:
        (line,) = lines
        assert line.startswith(f"imodbatch: warning: {', '.join(stale)} no longer fit")
        assert "`imodbatch run` brings all up to date" in line
    else:
        assert lines == []


def test_only_the_sequence_asked_for(fresh: Project, finished: Project) -> None:
    assert fresh.redone("run", "--sequence", "walk_2") == lines_of(*STAGES, sequences=("walk_2",))
    assert {path.stem for path in fresh.tables.rglob("*.parquet")} == {"walk_2", "run"}
    assert fresh.redone("run") == lines_of(*STAGES, sequences=("walk_1",))
    assert fresh.bytes_by_file() == finished.bytes_by_file()


def test_an_unknown_sequence_is_an_error(fresh: Project) -> None:
    result = fresh.call("run", "--sequence", "walk_7", exit_code=1)
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: --sequence walk_7: not in manifest analytic.")
    assert "walk_1, walk_2" in line
    assert not fresh.tables.exists()


def test_a_sequence_that_fails_stops_no_other_but_the_next_stage(fresh: Project) -> None:
    (fresh.folder / "data" / "walk_1" / "trajectory.txt").unlink()
    result = fresh.call("run", exit_code=1)
    lines = [line.split(": ")[0] for line in result.stdout.splitlines()]
    assert lines == [*lines_of("index"), "poses walk_2"]
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: ")


# Many processes, and dead ones


def test_two_workers_write_the_same_bytes(fresh: Project, finished: Project) -> None:
    assert sorted(fresh.redone("run", "--workers", 2)) == sorted(ALL_LINES)
    assert fresh.bytes_by_file() == finished.bytes_by_file()


def die(*_: object) -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("still alive")


def run_and_die_computing(number: int, arguments: list[str]) -> None:
    """Run, and die in a step when it comes to the last sequence."""
    execute = STEPS[number].execute

    def mortal(part: Any, tables: Any, progress: Any) -> Any:
        is_last = STEPS[number].per_run or part.sequence.id == BOTH[-1]
        return (die if is_last else execute)(part, tables, progress)

    steps = list(STEPS)
    steps[number] = replace(STEPS[number], execute=mortal)
    runner.STEPS = tuple(steps)
    main(arguments)


def run_and_die_renaming(number: int, arguments: list[str]) -> None:
    """Run, and die when the step's last table is written but does not bear its name yet."""
    last = last_table(STEPS[number])
    rename = Path.replace

    def mortal(self: Path, target: Path) -> Path:
        is_last = Path(target).as_posix().endswith(f"/{last}")
        return die() if is_last else rename(self, target)

    Path.replace = mortal  # type: ignore[method-assign]
    main(arguments)


def last_table(step: Step) -> str:
    return f"{step.writes[-1]}/{'run' if step.per_run else BOTH[-1]}.parquet"


@pytest.mark.parametrize("number", range(len(STEPS)), ids=[step.writes[-1] for step in STEPS])
def test_a_killed_run_is_taken_up_again(number: int, fresh: Project, finished: Project) -> None:
    """`kill -9` in the middle of a step, then once more between writing and renaming a table."""
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(
        ["imodbatch.cli.main", "imodbatch.run.runner", "faster_coco_eval"]
    )
    path = fresh.tables / last_table(STEPS[number])
    for run_and_die in (run_and_die_computing, run_and_die_renaming):
        process = processes.Process(target=run_and_die, args=(number, fresh.arguments("run")))
        process.start()
        process.join()
        assert process.exitcode == -signal.SIGKILL
        assert not path.exists()
    (partial,) = fresh.tables.rglob(".*.partial")
    assert partial.parent == path.parent
    assert read_info(partial) is not None  # it was whole; only its name was not its own yet

    label = "all" if STEPS[number].per_run else BOTH[-1]
    redone = fresh.redone("run")
    assert redone[0] == f"{STEPS[number].title} {label}"  # all before it stood
    assert redone == ALL_LINES[-len(redone) :]
    assert fresh.bytes_by_file() == finished.bytes_by_file()
    assert list(fresh.tables.rglob("*.partial")) == []


def test_a_kill_between_two_tables_of_a_step_leaves_both_to_be_redone(
    project: Project, tmp_path: Path
) -> None:
    """The first is of the new settings already, the second of the old ones: neither is kept."""
    alone = replace(project, folder=tmp_path / "alone")
    shutil.copytree(project.folder, alone.folder)
    setting = ("--set", "fuse.cell_reduce=max")
    alone.call("run", *setting)

    number = next(i for i, step in enumerate(STEPS) if step.writes == ("fused", "objects"))
    processes = multiprocessing.get_context("forkserver")
    arguments = project.arguments("run", *setting)
    process = processes.Process(target=run_and_die_renaming, args=(number, arguments))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    new, old = (project.tables / name / "walk_2.parquet" for name in STEPS[number].writes)
    infos = [read_info(new), read_info(old)]
    assert [i.provenance["settings"]["fuse"]["cell_reduce"] for i in infos if i] == ["max", "mean"]

    assert project.redone("run", *setting)[0] == "fuse walk_2"
    assert project.bytes_by_file() == alone.bytes_by_file()
