"""One run folder, one command that writes in it."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from imodbatch.core.errors import RunLockedError
from imodbatch.run import runner
from imodbatch.run.lock import LOCK, OWNER, only_writer
from imodbatch.run.steps import STAGES
from imodbatch.run.workers import open_executor

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture
def manifest(analytic_data: Path, analytic_manifest: Callable[..., str], tmp_path: Path) -> Path:
    path = tmp_path / "manifest.toml"
    path.write_text(analytic_manifest(analytic_data, "walk_1", "walk_2"))
    return path


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    return tmp_path / "run"


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


@pytest.mark.parametrize("options", [(), ("--workers", 2)], ids=["alone", "workers"])
@pytest.mark.parametrize("command", [*STAGES, "run"])
def test_who_comes_second_is_told_who_is_at_work(
    cli: Callable[..., Result],
    manifest: Path,
    run_dir: Path,
    command: str,
    options: tuple[Any, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "argv", ["somewhere/imodbatch", "run", "a b.toml"])
    with only_writer(run_dir):
        before = names(run_dir)
        result = cli(command, manifest, "--out", run_dir, *options)
        assert names(run_dir) == before
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    who = f"`imodbatch run 'a b.toml'` (process {os.getpid()} on {socket.gethostname()}, since "
    cure = "is writing there. Wait until it is done, stop it, or name another --out."
    said = re.escape(f"imodbatch: error: {run_dir}: {who}") + r"\d{4}-\d\d-\d\d [\d:]{8} UTC\) "
    assert re.fullmatch(said + re.escape(cure), line), line


@pytest.mark.parametrize("options", [(), ("--workers", 2)], ids=["alone", "workers"])
@pytest.mark.parametrize("command", [*STAGES, "run"])
def test_a_command_has_the_folder_for_itself_all_along(
    cli: Callable[..., Result],
    manifest: Path,
    run_dir: Path,
    command: str,
    options: tuple[Any, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = []

    def try_to_enter(*arguments: Any, **_: Any) -> Iterator[Any]:
        with pytest.raises(RunLockedError), only_writer(run_dir):
            pass
        seen.append(arguments)
        return iter(())

    monkeypatch.setattr(runner, "run_stage", try_to_enter)
    monkeypatch.setattr("imodbatch.run.publishing.write_report", try_to_enter)
    assert cli(command, manifest, "--out", run_dir, *options).exit_code == 0
    assert len(seen) == (len(STAGES) if command == "run" else 1)
    with only_writer(run_dir):
        pass


def test_reading_commands_do_not_wait_and_write_nothing(
    cli: Callable[..., Result], manifest: Path, run_dir: Path, tmp_path: Path
) -> None:
    for stage in ("index", "poses"):
        assert cli(stage, manifest, "--out", run_dir).exit_code == 0
    with only_writer(run_dir):
        before = names(run_dir)
        status = cli("status", manifest, "--out", run_dir)
        exported = cli("export", manifest, "--out", run_dir, "--to", tmp_path / "tum")
        assert names(run_dir) == before
    assert "poses        walk_1           up to date" in status.stdout
    assert (status.exit_code, exported.exit_code) == (0, 0)


def hold(run_dir: Path, ready: Connection) -> None:
    with only_writer(run_dir):
        ready.send(os.getpid())
        time.sleep(60)


def test_the_lock_of_a_dead_process_is_taken_over(run_dir: Path) -> None:
    processes = get_context("spawn")
    ready, theirs = processes.Pipe()
    process = processes.Process(target=hold, args=(run_dir, theirs))
    process.start()
    pid = ready.recv()
    left = run_dir / "poses" / ".walk_1.parquet.01234567.partial"
    left.parent.mkdir()
    left.touch()
    with pytest.raises(RunLockedError, match=f"process {pid} on "), only_writer(run_dir):
        pass
    assert left.exists()  # it may be in the making
    process.kill()
    process.join()
    assert json.loads((run_dir / OWNER).read_text())["pid"] == pid
    with only_writer(run_dir):
        assert json.loads((run_dir / OWNER).read_text())["pid"] == os.getpid()
        assert not left.exists()
    assert sorted(path.name for path in run_dir.iterdir()) == [LOCK, "poses"]


def test_a_command_that_fails_gives_the_folder_back(run_dir: Path) -> None:
    with pytest.raises(ZeroDivisionError), only_writer(run_dir):
        raise ZeroDivisionError
    with only_writer(run_dir):
        pass


def test_an_owner_who_has_not_said_who_it_is(run_dir: Path) -> None:
    with only_writer(run_dir):
        (run_dir / OWNER).write_text("{}")
        with pytest.raises(RunLockedError, match=r": another command is writing there\."):
            only_writer(run_dir).__enter__()


def work_with_workers(ready: Connection) -> None:
    with open_executor(2, None) as executor:
        assert executor is not None
        pids = list(executor.map(slow_pid, range(2)))
        ready.send(pids)
        list(executor.map(time.sleep, [60, 60]))


def slow_pid(_: int) -> int:
    time.sleep(0.5)  # so that the other worker takes the other one
    return os.getpid()


def test_workers_die_with_the_process_that_holds_the_lock() -> None:
    processes = get_context("spawn")
    ready, theirs = processes.Pipe()
    process = processes.Process(target=work_with_workers, args=(theirs,))
    process.start()
    workers = ready.recv()
    assert all(is_alive(pid) for pid in workers)
    os.kill(process.pid or 0, signal.SIGKILL)
    process.join()
    for _ in range(100):
        if not any(is_alive(pid) for pid in workers):
            return
        time.sleep(0.1)
    raise AssertionError("a worker lives on")


def is_alive(pid: int) -> bool:
    """Not gone, and no zombie that nobody has asked for its exit code."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_two_runs_at_once_leave_no_wrong_table() -> None:
    command = [sys.executable, "tests/benchmarks/two_runs_at_once.py", "--trials", "3"]
    here = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        command, cwd=REPOSITORY, env=here, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("3 trials: ")
