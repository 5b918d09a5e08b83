"""Are the tests awake? Plant one mistake at a time in a copy of the package and run its tests.

    python tests/benchmarks/mutants.py [--only PATTERN] [--list] [--jobs 2]

The mistakes stand in `mutants_of_core.py`, `mutants_of_stages.py` and `mutants_of_reporting.py`,
chosen from the code, not from the tests. Each should fail a test; at most one in twenty may live.
The working tree is never touched.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import cache_from_source
from pathlib import Path
from queue import SimpleQueue

from mutants_of_core import CORE
from mutants_of_reporting import REPORTING
from mutants_of_stages import STAGES

ROOT = Path(__file__).parents[2]
HEAVY = {"runs", "data", "shared", "docs"}
FEWEST_KILLED = 0.95
PASSED, FAILED = 0, 1  # pytest's exit codes; any other is no verdict of a test


@dataclass(frozen=True)
class Mutant:
    """One mistake.

    Attributes:
        file: where it is planted, relative to the repository.
        old: the right text, which occurs once.
        new: the wrong text.
        tests: paths of the tests that should fail.
        breaks: what it does, in a line.
    """

    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    breaks: str

    def __str__(self) -> str:
        return f"{self.file}: {self.breaks}"


MUTANTS = [
    Mutant(file, old, new, tuple(tests.split()), breaks)
    for planted in (CORE, STAGES, REPORTING)
    for (file, tests), mistakes in planted.items()
    for old, new, breaks in mistakes
]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", metavar="PATTERN", help="text in file or remark")
    parser.add_argument("--list", action="store_true", help="say what would be planted")
    parser.add_argument("--jobs", type=int, default=2, help="copies at work at once")
    options = parser.parse_args(arguments)
    chosen = [mutant for mutant in MUTANTS if options.only in str(mutant)]
    if options.list or not chosen:
        print(*chosen, f"{len(chosen)} mutants", sep="\n")
        return 0 if chosen else 1
    _require_fitting(chosen)
    with tempfile.TemporaryDirectory() as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(options.jobs):
            copy = Path(folder, str(number))
            shutil.copytree(ROOT, copy, ignore=_left_out)
            copies.put(copy)
        _require_sound(copy, sorted({path for mutant in chosen for path in mutant.tests}))

        def judge(mutant: Mutant) -> bool:
            copy = copies.get()
            try:
                return is_killed(mutant, copy)
            finally:
                copies.put(copy)

        n_killed = 0
        with ThreadPoolExecutor(options.jobs) as pool:
            for mutant, killed in zip(chosen, pool.map(judge, chosen), strict=True):
                print("killed" if killed else "LIVES ", mutant, flush=True)
                n_killed += killed
    print(f"{len(chosen)} mutants = {n_killed} killed + {len(chosen) - n_killed} alive")
    return 0 if n_killed >= FEWEST_KILLED * len(chosen) else 1


def is_killed(mutant: Mutant, copy: Path) -> bool:
    """Plant a mistake in a copy of the repository, run its tests, and mend the copy."""
    path = copy / mutant.file
    sound = path.read_text(encoding="utf-8")
    _write(path, sound.replace(mutant.old, mutant.new))
    try:
        code, output = _run_tests(copy, mutant.tests)
    finally:
        _write(path, sound)
    if code not in (PASSED, FAILED):
        raise SystemExit(f"{mutant}: pytest ended with {code}, no verdict.\n{output}")
    return code == FAILED


def _left_out(folder: str, names: list[str]) -> set[str]:
    """What no test here reads: hidden and heavy things."""
    top = HEAVY & set(names) if Path(folder) == ROOT else set()
    return top | shutil.ignore_patterns(".*", "*.safetensors")(folder, names)


def _write(path: Path, text: str) -> None:
    """A compiled file of equal age and size would hide the change."""
    path.write_text(text, encoding="utf-8")
    Path(cache_from_source(str(path))).unlink(missing_ok=True)


def _run_tests(copy: Path, tests: Sequence[str]) -> tuple[int, str]:
    found = subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests],
        cwd=copy,
        env=os.environ | {"PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    return found.returncode, found.stdout + found.stderr


def _require_fitting(mutants: Sequence[Mutant]) -> None:
    """A mistake has one place, and is not one of grammar."""
    for mutant in mutants:
        sound = (ROOT / mutant.file).read_text(encoding="utf-8")
        if sound.count(mutant.old) != 1:
            raise SystemExit(f"{mutant}: {mutant.old!r} stands {sound.count(mutant.old)} times.")
        compile(sound.replace(mutant.old, mutant.new), mutant.file, "exec")


def _require_sound(copy: Path, tests: Sequence[str]) -> None:
    """Tests that fail without a mistake tell nothing."""
    code, output = _run_tests(copy, tests)
    if code != PASSED:
        raise SystemExit(f"The tests fail with no mistake planted.\n{output}")


if __name__ == "__main__":
    sys.exit(main())
