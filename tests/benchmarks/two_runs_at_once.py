"""Two runs started at once in one folder: do the tables ever come out wrong?

    python tests/benchmarks/two_runs_at_once.py [--trials 50] [--seed 0]

Each trial starts `imodbatch run` twice in one folder on a small analytic dataset, a random moment
apart, half of the trials with the same settings and half with different ones. A run must succeed or
be refused with the lock's message. Afterwards what `imodbatch status` calls up to date under a
setting must be byte for byte what a run of that setting alone writes, and so must all tables after
one more `imodbatch run`. Prints counts; exits with 1 on any wrong table.
"""

import argparse
import random
import shutil
import sys
import time
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from imodbatch.cli.main import main
from imodbatch.lab.analytic import write_dataset

MANIFEST = Path(__file__).parents[2] / "manifests/analytic.toml"
SEQUENCE = '\n[[sequences]]\nid = "walk_1"\npath = "walk_1"\n'
PIPELINE = """
[fuse]
methods = ["single", "imod"]
mode = "online"
[sweep]
voxel_sizes_m = [0.2]
"""
SETTINGS = ("detect.score_threshold=0.05", "detect.score_threshold=0.4", "lift.voxel_size_m=0.3")
PRELOAD = [
    "imodbatch.cli.main",
    "imodbatch.run.runner",
    "imodbatch.run.publishing",
    "faster_coco_eval",
]
LATEST_START_S = 0.6
Tables = dict[str, bytes]


def tables_of(run_dir: Path) -> Tables:
    return {p.relative_to(run_dir).as_posix(): p.read_bytes() for p in run_dir.rglob("*.parquet")}


def arguments(command: str, folder: Path, run_dir: Path, setting: str) -> list[str]:
    files = [str(folder / "manifest.toml"), "--pipeline", str(folder / "quick.toml")]
    return [command, *files, "--out", str(run_dir), "--set", setting]


def call(arguments: list[str], wait_s: float, log: Path) -> None:
    """The command line in this process, without drawing the report's page, which no table needs."""
    from imodbatch.reporting import report

    report.run = lambda *_: Path("report.html")
    time.sleep(wait_s)
    with log.open("w") as file, redirect_stdout(file), redirect_stderr(file):
        main(arguments)


class Trials:
    """A folder with the dataset, and what each setting gives alone."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes = get_context("forkserver")
        self.processes.set_forkserver_preload(PRELOAD)
        write_dataset(folder / "data", n_sequences=1, n_frames=8)
        text = MANIFEST.read_text(encoding="utf-8").replace("../data/analytic", "data")
        head = text[: text.index("[[sequences]]")]
        (folder / "manifest.toml").write_text(head + SEQUENCE, encoding="utf-8")
        (folder / "quick.toml").write_text(PIPELINE, encoding="utf-8")
        self.alone = {setting: self._alone(setting) for setting in SETTINGS}
        assert len({alone["fused/walk_1.parquet"] for alone in self.alone.values()}) == len(
            SETTINGS
        )

    def _alone(self, setting: str) -> Tables:
        run_dir = self.folder / "alone"
        ((code, said),) = self.run_all([("run", setting, 0.0)], run_dir)
        assert code == 0, said
        tables = tables_of(run_dir)
        shutil.rmtree(run_dir)
        return tables

    def run_all(self, calls: list[tuple[str, str, float]], run_dir: Path) -> list[tuple[int, str]]:
        """Exit code and output of commands, each started so many seconds from now."""
        logs = [self.folder / f"{index}.log" for index in range(len(calls))]
        started = []
        for (command, setting, wait_s), log in zip(calls, logs, strict=True):
            words = arguments(command, self.folder, run_dir, setting)
            started.append(self.processes.Process(target=call, args=(words, wait_s, log)))
        for process in started:
            process.start()
        for process in started:
            process.join()
        return [(p.exitcode or 0, log.read_text()) for p, log in zip(started, logs, strict=True)]

    def wrong(self, run_dir: Path, setting: str) -> list[str]:
        """Tables that differ from those of the setting alone."""
        found, expected = tables_of(run_dir), self.alone[setting]
        return [name for name in expected if found.get(name) != expected[name]]

    def trial(self, pair: tuple[str, str], offset_s: float) -> Counter[str]:
        """One trial; what is wrong has a name that begins with WRONG."""
        run_dir, counts = self.folder / "run", Counter[str]()
        waits = (0.0, offset_s)
        calls = [("run", setting, wait) for setting, wait in zip(pair, waits, strict=True)]
        for code, said in self.run_all(calls, run_dir):
            refused = code == 1 and "is writing there. Wait until it is done" in said
            counts["ran" if code == 0 else "refused" if refused else "WRONG exit"] += 1
            if code and not refused:
                print(f"  exit {code}: {said.strip().splitlines()[-1:]}")
        for setting in dict.fromkeys(pair):
            ((_, states),) = self.run_all([("status", setting, 0.0)], run_dir)
            is_current = "stale" not in states and "missing" not in states
            counts["WRONG though up to date"] += is_current and bool(self.wrong(run_dir, setting))
            counts["whole run of one setting"] += is_current
        for setting in dict.fromkeys(pair):
            ((code, said),) = self.run_all([("run", setting, 0.0)], run_dir)
            wrong = self.wrong(run_dir, setting)
            counts["WRONG after one more run"] += code != 0 or bool(wrong)
            if code or wrong:
                print(f"  {setting}: exit {code}, differs: {wrong}", said if code else "")
        left = [path for path in run_dir.rglob(".*") if path.name.endswith(".partial")]
        counts["WRONG left-over files"] += len(left)
        shutil.rmtree(run_dir)
        return counts


def run_trials(n: int, seed: int) -> Counter[str]:
    """Counts of n trials, whose start offsets and settings the seed decides."""
    rng, counts = random.Random(seed), Counter[str]()
    with TemporaryDirectory(prefix="imodbatch-two-runs-") as name:
        trials = Trials(Path(name))
        for index in range(n):
            first, second = rng.sample(SETTINGS, 2)
            pair = (first, first if index % 2 == 0 else second)
            counts += trials.trial(pair, rng.uniform(0.0, LATEST_START_S))
    return counts


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    total = run_trials(options.trials, options.seed)
    print(
        f"{options.trials} trials:", ", ".join(f"{n} {what}" for what, n in sorted(total.items()))
    )
    sys.exit(any(n for what, n in total.items() if what.startswith("WRONG")))
