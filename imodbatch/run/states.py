"""What each step of a run has done and would do: up to date, stale or missing."""

from collections.abc import Iterator
from dataclasses import dataclass

from imodbatch.core.errors import ImodError
from imodbatch.run.plan import Plan
from imodbatch.run.provenance import is_up_to_date
from imodbatch.run.step import Step
from imodbatch.run.steps import STEPS, stages_of
from imodbatch.run.stored import output_paths
from imodbatch.tables.parquet import read_info

UP_TO_DATE, STALE, MISSING = "up to date", "stale", "missing"


@dataclass(frozen=True)
class Outcome:
    """What became of one step for one sequence: `message` is its summary, or its error.

    `title` is the stage, or the name of a step beside the stage's main one.
    """

    title: str
    label: str
    state: str
    message: str
    warnings: tuple[str, ...] = ()


def states(plan: Plan) -> Iterator[Outcome]:
    """What each step would do, without doing it: its state is up to date, stale or missing.

    A table that fits the tables it was made from is stale all the same if one of those is.
    """
    behind: set[tuple[str, str]] = set()
    wanted = stages_of(plan)
    for step in (step for step in STEPS if step.stage in wanted):
        for part in step.parts(plan):
            ids = [sequence.id for sequence in part.sequences]
            reads_stale = any((name, i) in behind for name in step.reads for i in ids)
            state, message = _state(part, step, reads_stale)
            if state != UP_TO_DATE:
                behind |= {(name, i) for name in step.writes for i in ids}
            yield Outcome(step.title, step.label(part), state, message)


def _state(part: Plan, step: Step, reads_stale: bool) -> tuple[str, str]:
    """State of one part, and the summary of its table, or why it cannot be told."""
    infos = [read_info(path) for path in output_paths(part, step)]
    if any(info is None for info in infos):
        return MISSING, ""
    try:
        current = not reads_stale and is_up_to_date(part, step)
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
