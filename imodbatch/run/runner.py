"""Up to date? read → step → write, one sequence after another or many at once.

A step's provenance names what the step has read: input tables by the metadata of the very files
whose rows it takes, files outside by what they were before the step.
"""

from collections.abc import Iterator
from concurrent.futures import Executor, as_completed
from typing import Any

from tqdm import tqdm

from imodbatch.core.errors import ImodError
from imodbatch.run.plan import Plan
from imodbatch.run.provenance import files_digest, is_up_to_date, provenance
from imodbatch.run.states import UP_TO_DATE, Outcome
from imodbatch.run.step import Step
from imodbatch.run.steps import STEPS
from imodbatch.run.stored import output_paths, read_inputs
from imodbatch.tables.columns import Progress
from imodbatch.tables.parquet import TableInfo, read_info, write_table
from imodbatch.tables.schemas import TABLES

DONE, FAILED = "done", "failed"


def run_stage(
    plan: Plan, stage: str, *, overwrite: bool = False, executor: Executor | None = None
) -> Iterator[Outcome]:
    """Bring a stage's tables up to date; one outcome per step and sequence.

    A sequence that fails does not stop the others, but the stage's later steps are left out then.
    """
    for number, step in enumerate(STEPS):
        if step.stage != stage:
            continue
        failed = False
        for outcome in _run_step(plan, number, overwrite, executor):
            failed |= outcome.state == FAILED
            yield outcome
        if failed:
            return


def _run_step(
    plan: Plan, number: int, overwrite: bool, executor: Executor | None
) -> Iterator[Outcome]:
    """A step goes to other processes by its number: its functions cannot be sent."""
    step = STEPS[number]
    parts = step.parts(plan)
    if executor is None or len(parts) == 1:
        for part in parts:
            yield _run_part(part, number, overwrite, _bar(step, part))
        return
    futures = [executor.submit(_run_part, part, number, overwrite, iter) for part in parts]
    done = tqdm(as_completed(futures), step.title, len(futures), leave=False, disable=None)
    yield from (future.result() for future in done)


def _bar(step: Step, part: Plan) -> Progress[Any]:
    """A progress bar on stderr, shown where stderr is a terminal."""
    title = f"{step.title} {step.label(part)}"
    return lambda items: tqdm(items, title, leave=False, disable=None)


def _run_part(part: Plan, number: int, overwrite: bool, progress: Progress[Any]) -> Outcome:
    """One step for one sequence (or the whole run); errors become outcomes."""
    step = STEPS[number]
    title, label = step.title, step.label(part)
    try:
        if not overwrite and is_up_to_date(part, step):
            old = read_info(output_paths(part, step)[0])
            return Outcome(title, label, UP_TO_DATE, old.summary if old else "")
        # In this order: a file that changes while the step reads it leaves the table stale.
        files = files_digest(part, step)
        tables, identities = read_inputs(part, step)
        origin = provenance(part, step, identities, files)
        result = step.execute(part, tables, progress)
        for name, path in zip(step.writes, output_paths(part, step), strict=True):
            version, key = TABLES[name].version, TABLES[name].key
            info = TableInfo(name, version, key, origin, result.summary, result.attributes)
            write_table(path, result.tables[name], info)
    except ImodError as error:
        return Outcome(title, label, FAILED, str(error))
    return Outcome(title, label, DONE, result.summary, tuple(result.warnings))
