"""Up to date? read → step → write, one sequence after another or many at once.

A table's provenance names everything its content depends on: package and schema versions, the
settings of its step, the identity of its input tables, and the files outside. Where the provenance
on disk equals the one expected, nothing is done; else the step is done again and its tables
replaced. Whatever reads them then differs in its own provenance, and so on down the pipeline.

A step's provenance names what the step has read: input tables by the metadata of the very files
whose rows it takes, files outside by what they were before the step.
"""

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any, NoReturn

import pyarrow as pa
from tqdm import tqdm

from imodbatch import __version__
from imodbatch.core.errors import ConfigError, ImodError, TableError
from imodbatch.run.context import Context
from imodbatch.run.steps import STEPS, Step, stages_of
from imodbatch.settings.manifest import SequenceSection
from imodbatch.tables.columns import Progress
from imodbatch.tables.parquet import (
    PER_RUN,
    Stored,
    TableInfo,
    digest,
    read_info,
    read_stored,
    table_path,
    write_table,
)
from imodbatch.tables.schemas import TABLES

UP_TO_DATE, DONE, FAILED = "up to date", "done", "failed"
STALE, MISSING = "stale", "missing"
PER_RUN_LABEL = "all"
Identities = dict[str, dict[str, str]]
"""Of tables, by name and then by sequence or `PER_RUN`."""


@dataclass(frozen=True)
class Plan:
    """A run: what to do, for which sequences, and where the tables lie."""

    context: Context
    sequences: tuple[SequenceSection, ...]

    @property
    def run_dir(self) -> Path:
        """Where the tables lie."""
        return self.context.run_dir

    def choose(self, ids: Iterable[str]) -> "Plan":
        """The same for some of the sequences.

        Raises:
            ConfigError: an id that the manifest does not have.
        """
        return replace(self, sequences=self.context.manifest.choose(tuple(ids)))


@dataclass(frozen=True)
class Outcome:
    """What became of one step for one sequence: `message` is its summary, or its error.

    `title` is the stage, or the name of a step beside the stage's main one.
    """

    stage: str
    title: str
    label: str
    state: str
    message: str
    warnings: tuple[str, ...] = ()


def pipeline_name(pipeline: Path | None) -> str:
    """What a pipeline is called: its file's name, or that of all defaults."""
    return "default" if pipeline is None else pipeline.stem


def default_run_dir(manifest_name: str, pipeline: Path | None) -> Path:
    """Where a run's tables go if nobody says, relative to the working directory."""
    return Path("runs") / f"{manifest_name}--{pipeline_name(pipeline)}"


def run_stage(
    plan: Plan, stage: str, *, overwrite: bool = False, executor: Executor | None = None
) -> Iterator[Outcome]:
    """Bring a stage's tables up to date; one outcome per step and sequence.

    A sequence that fails does not stop the others, but the stage's later steps are left out then.
    """
    for step in (step for step in STEPS if step.stage == stage):
        failed = False
        for outcome in _run_step(plan, step, overwrite, executor):
            failed |= outcome.state == FAILED
            yield outcome
        if failed:
            return


def states(plan: Plan) -> Iterator[Outcome]:
    """What each step would do, without doing it: its state is up to date, stale or missing.

    A table that fits the tables it was made from is stale all the same if one of those is.
    """
    behind: set[tuple[str, str]] = set()
    wanted = stages_of(plan.context)
    for step in (step for step in STEPS if step.stage in wanted):
        for sequences in _units(plan, step):
            reads_stale = any((name, s.id) in behind for name in step.reads for s in sequences)
            state, message = _state(plan, step, sequences, reads_stale)
            if state != UP_TO_DATE:
                behind |= {(name, s.id) for name in step.writes for s in sequences}
            yield Outcome(step.stage, step.title, _label(step, sequences), state, message)


def _state(
    plan: Plan, step: Step, sequences: tuple[SequenceSection, ...], reads_stale: bool
) -> tuple[str, str]:
    """State of one unit, and the summary of its table, or why it cannot be told."""
    infos = [read_info(path) for path in _output_paths(plan, step, sequences)]
    if any(info is None for info in infos):
        return MISSING, ""
    try:
        current = not reads_stale and _is_up_to_date(plan, step, sequences)
    except ImodError as error:
        return STALE, str(error)
    return (UP_TO_DATE if current else STALE), infos[0].summary  # type: ignore[union-attr]


def stale_inputs(plan: Plan, stage: str, with_itself: bool = False) -> list[str]:
    """What comes before a stage and no longer fits settings or files, as ``stage sequence``.

    Args:
        plan: the run.
        stage: the one that is about to read.
        with_itself: whether the stage's own tables are read, too.
    """
    before = _steps_before(stage) | ({stage} if with_itself else set())
    return [
        f"{outcome.title} {outcome.label}"
        for outcome in states(plan)
        if outcome.state == STALE and outcome.title in before
    ]


def _steps_before(stage: str) -> set[str]:
    """Titles of the steps whose tables a stage reads, and of those before; a report reads all."""
    if all(step.stage != stage for step in STEPS):
        return {step.title for step in STEPS}
    needed: set[str] = set()
    before: set[str] = set()
    for step in reversed(STEPS):
        if step.stage == stage or needed & set(step.writes):
            needed |= set(step.reads)
            if step.stage != stage:
                before.add(step.title)
    return before


def load(plan: Plan, table: str, columns: list[str] | None = None) -> pa.Table:
    """A table of all chosen sequences, or of the run."""
    return _joined(_open(plan, table, plan.sequences).values(), columns)


def _joined(parts: Iterable[Stored], columns: list[str] | None = None) -> pa.Table:
    rows = [part.rows.select(columns or part.rows.column_names) for part in parts]
    return pa.concat_tables(rows).combine_chunks()


@contextmanager
def open_executor(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """Local processes, a Dask scheduler's workers, or None = this process.

    Raises:
        ConfigError: the scheduler is not there, or `distributed` is not installed.
    """
    if scheduler is not None:
        try:
            from distributed import Client
        except ImportError:
            raise ConfigError(
                "--scheduler needs Dask: pip install 'imodbatch[dask]', or use --workers."
            ) from None
        try:
            with Client(scheduler, timeout="10s") as client:
                yield client.get_executor()
        except (OSError, TimeoutError):
            raise ConfigError(
                f"--scheduler {scheduler}: no Dask scheduler answers there. Start `dask scheduler`."
            ) from None
    elif workers > 1:
        spawn = get_context("spawn")
        with ProcessPoolExecutor(workers, spawn, initializer=_end_with_parent) as pool:
            yield pool
    else:
        yield None


def _end_with_parent() -> None:
    """Have this worker die with the process that holds the run folder's lock."""

    def wait_and_end() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=wait_and_end, daemon=True).start()


def _units(plan: Plan, step: Step) -> list[tuple[SequenceSection, ...]]:
    """The groups of sequences a step works on: each alone, or all together."""
    return [plan.sequences] if step.per_run else [(sequence,) for sequence in plan.sequences]


def _label(step: Step, sequences: tuple[SequenceSection, ...]) -> str:
    return PER_RUN_LABEL if step.per_run else sequences[0].id


def _run_step(
    plan: Plan, step: Step, overwrite: bool, executor: Executor | None
) -> Iterator[Outcome]:
    units = _units(plan, step)
    if executor is None or len(units) == 1:
        for sequences in units:
            yield _run_unit(plan, STEPS.index(step), sequences, overwrite, _bar(step, sequences))
        return
    futures = [
        executor.submit(_run_unit, plan, STEPS.index(step), sequences, overwrite, iter)
        for sequences in units
    ]
    done = tqdm(as_completed(futures), step.title, len(futures), leave=False, disable=None)
    yield from (future.result() for future in done)


def _bar(step: Step, sequences: tuple[SequenceSection, ...]) -> Progress[Any]:
    """A progress bar on stderr, shown where stderr is a terminal."""
    title = f"{step.title} {_label(step, sequences)}"
    return lambda items: tqdm(items, title, leave=False, disable=None)


def _run_unit(
    plan: Plan,
    step_number: int,
    sequences: tuple[SequenceSection, ...],
    overwrite: bool,
    progress: Progress[Any],
) -> Outcome:
    """One step for one sequence (or the whole run); errors become outcomes."""
    step = STEPS[step_number]
    label = _label(step, sequences)
    try:
        if not overwrite and _is_up_to_date(plan, step, sequences):
            info = read_info(_output_paths(plan, step, sequences)[0])
            return Outcome(step.stage, step.title, label, UP_TO_DATE, info.summary if info else "")
        # In this order: a file that changes while the step reads it leaves the table stale.
        files = _files_digest(plan, step, sequences)
        tables, identities = _read_inputs(plan, step, sequences)
        provenance = _provenance(plan, step, sequences, identities, files)
        result = step.execute(plan.context, sequences[0], tables, progress)
        for name, path in zip(step.writes, _output_paths(plan, step, sequences), strict=True):
            spec = TABLES[name]
            info = TableInfo(
                name, spec.version, spec.key, provenance, result.summary, result.attributes
            )
            write_table(path, result.tables[name], info)
    except ImodError as error:
        return Outcome(step.stage, step.title, label, FAILED, str(error))
    return Outcome(step.stage, step.title, label, DONE, result.summary, tuple(result.warnings))


def _output_paths(plan: Plan, step: Step, sequences: tuple[SequenceSection, ...]) -> list[Path]:
    unit = PER_RUN if step.per_run else sequences[0].id
    return [table_path(plan.run_dir, name, unit) for name in step.writes]


def _is_up_to_date(plan: Plan, step: Step, sequences: tuple[SequenceSection, ...]) -> bool:
    infos = [read_info(path) for path in _output_paths(plan, step, sequences)]
    if any(info is None for info in infos):
        return False
    identities = {
        name: {unit: _identity(plan, name, unit) for unit in _table_units(name, sequences)}
        for name in step.reads
    }
    files = _files_digest(plan, step, sequences)
    expected = _provenance(plan, step, sequences, identities, files)
    return all(
        info is not None
        and info.version == TABLES[name].version
        and digest(info.provenance) == digest(expected)
        for name, info in zip(step.writes, infos, strict=True)
    )


def _provenance(
    plan: Plan,
    step: Step,
    sequences: tuple[SequenceSection, ...],
    identities: Identities,
    files: str,
) -> dict[str, Any]:
    """Everything that the tables of a step depend on.

    Args:
        plan: the run.
        step: of it.
        sequences: that the step is done for.
        identities: of the tables it reads.
        files: digest of the files outside that it reads.
    """
    return {
        "imodbatch": __version__,
        "stage": step.stage,
        "settings": step.depends_on(plan.context, sequences[0]),
        "inputs": identities,
        "files": files,
    }


def _table_units(table: str, sequences: tuple[SequenceSection, ...]) -> list[str]:
    return [PER_RUN] if TABLES[table].per_run else [sequence.id for sequence in sequences]


def _identity(plan: Plan, table: str, unit: str) -> str:
    path = table_path(plan.run_dir, table, unit)
    info = read_info(path)
    if info is None:
        _explain_missing(path, table)
    return info.digest


def _read_inputs(
    plan: Plan, step: Step, sequences: tuple[SequenceSection, ...]
) -> tuple[dict[str, pa.Table], Identities]:
    """The tables that a step reads, and the identities of the files that they are from."""
    tables, identities = {}, {}
    for name in step.reads:
        parts = _open(plan, name, sequences)
        tables[name] = _joined(parts.values())
        identities[name] = {unit: part.info.digest for unit, part in parts.items()}
    return tables, identities


def _open(plan: Plan, table: str, sequences: tuple[SequenceSection, ...]) -> dict[str, Stored]:
    """The parts of a table by unit, each read once."""
    paths = {unit: table_path(plan.run_dir, table, unit) for unit in _table_units(table, sequences)}
    for path in paths.values():
        if read_info(path) is None:
            _explain_missing(path, table)
    return {unit: read_stored(path, TABLES[table]) for unit, path in paths.items()}


def _explain_missing(path: Path, table: str) -> NoReturn:
    """Say which stage writes a table that is not there or cannot be read."""
    stage = next(step.stage for step in STEPS if table in step.writes)
    fault = "damaged" if path.exists() else "no such table"
    raise TableError(f"{path}: {fault}. Run `imodbatch {stage}` or `imodbatch run` first.")


def _files_digest(plan: Plan, step: Step, sequences: tuple[SequenceSection, ...]) -> str:
    """Digest of paths, sizes and modification times; a missing file is a state of its own."""
    root = plan.context.manifest.root_path
    facts: list[tuple[str, int, int]] = []
    for path in step.files(plan.context, sequences[0]):
        name = path.relative_to(root).as_posix() if path.is_relative_to(root) else str(path)
        try:
            stat = path.stat()
            facts.append((name, stat.st_size, stat.st_mtime_ns))
        except OSError:
            facts.append((name, -1, -1))
    return digest(sorted(facts))
