"""What a step of a run is, and how it says which settings its result depends on."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from imodbatch.run.plan import Plan
from imodbatch.tables.columns import Progress, StageResult

Tables = dict[str, pa.Table]
Execute = Callable[[Plan, Tables, Progress[Any]], StageResult]
Settings = Callable[[Plan], dict[str, Any]]
Files = Callable[[Plan], Iterable[Path]]


def no_files(part: Plan) -> Iterable[Path]:
    """Tables only."""
    del part
    return ()


@dataclass(frozen=True)
class Step:
    """One arrow of the pipeline. It gets the plan for what it is done for: a sequence, or the run.

    Attributes:
        stage: the command-line stage it belongs to.
        reads: tables it takes.
        writes: tables it gives, all of them every time.
        execute: does it.
        depends_on: the settings its result depends on.
        files: the files outside the run folder that its result depends on.
        per_run: whether it is done once for the run, with all sequences in each table.
        name: where it is not the stage's main step.
    """

    stage: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    execute: Execute
    depends_on: Settings
    files: Files = no_files
    per_run: bool = False
    name: str = ""

    @property
    def title(self) -> str:
        """What its lines begin with."""
        return self.name or self.stage

    def parts(self, plan: Plan) -> list[Plan]:
        """What it is done for, one after the other: each sequence alone, or all together."""
        return [plan] if self.per_run else plan.each()

    def label(self, part: Plan) -> str:
        """What it is done for, in words."""
        return "all" if self.per_run else part.sequence.id


def sections(*names: str) -> Settings:
    """Pipeline sections by name; manifest sections by name with a leading ``@``; ``grid``.

    The grid are the viewpoints told apart; how far outside a box may be seen (the rest of
    ``[viewpoint]``) matters to its place alone.
    """
    return lambda part: {name: _section(part, name) for name in names}


def _section(part: Plan, name: str) -> Any:
    if name == "grid":
        return part.pipeline.viewpoint.model_dump(include={"n_azimuths", "elevations_deg"})
    owner = part.manifest if name.startswith("@") else part.pipeline
    value = getattr(owner, name.removeprefix("@"))
    return dump(value) if hasattr(value, "model_dump") else value


def dump(section: Any) -> Any:
    """A section as JSON holds it; None = it is not there."""
    return None if section is None else section.model_dump(mode="json")
