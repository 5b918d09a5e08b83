"""The commands that make a run: one per stage, and `run` for all. Heavy libraries load inside."""

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from imodbatch.cli.options import warn_of_stale_inputs, with_plan
from imodbatch.cli.plugins import make_data

if TYPE_CHECKING:
    from imodbatch.run.plan import Plan
    from imodbatch.run.states import Outcome

STAGE_HELP = {
    "index": "Dataset folder → frames, annotations.",
    "poses": "frames + odometry → poses, in a world with +z up, and how good they are.",
    "detect": "frames + detector (or its results file) → detections.",
    "lift": "frames + poses + detections → observations: each box gets a place in the world.",
    "fuse": "detections + observations → fused scores and objects.",
    "score": "fused + annotations → matches, metrics.",
    "diagnose": "All before → sweeps, losses, jitters: what holds fusion back.",
    "report": "All tables → one self-contained HTML page, with Markdown and CSV beside it.",
    "run": "All stages, from the dataset folder to the report.",
}


def stage_commands() -> list[click.Command]:
    """In the order in which they are called."""
    return [_stage_command(stage) for stage in STAGE_HELP]


def _stage_command(stage: str) -> click.Command:
    def command(plan: "Plan", workers: int, scheduler: str | None, overwrite: bool) -> None:
        from imodbatch.run import runner
        from imodbatch.run.lock import only_writer
        from imodbatch.run.steps import stages_of
        from imodbatch.run.workers import open_executor

        if stage in ("run", "index"):
            make_data(plan.manifest, workers)
        todo = stages_of(plan) if stage == "run" else (stage,)
        with only_writer(plan.run_dir), open_executor(workers, scheduler) as executor:
            if stage != "run":
                warn_of_stale_inputs(plan, stage)
            for name in todo:
                if name == "report":
                    from imodbatch.run.publishing import write_report

                    click.echo(f"report: {write_report(plan)}")
                    continue
                outcomes = runner.run_stage(plan, name, overwrite=overwrite, executor=executor)
                done = [_print_outcome(outcome) for outcome in outcomes]
                if not all(done):
                    sys.exit(1)

    command.__doc__ = f"{STAGE_HELP[stage]}\n\n\b\nExample:\n  imodbatch {stage} analytic"
    decorated: Callable[..., None] = command
    for decorate in (
        click.option("--overwrite", is_flag=True, help="Redo even what is up to date."),
        click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler to run sequences on."),
        click.option(
            "--workers",
            type=click.IntRange(min=1),
            default=1,
            show_default=True,
            help="Sequences at a time, in local processes.",
        ),
    ):
        decorated = decorate(decorated)
    if stage in ("detect", "run"):
        decorated = click.option(
            "--device", metavar="NAME", help="torch device of the detector, such as cuda."
        )(decorated)
    return click.command(stage)(with_plan(decorated))


def _print_outcome(outcome: "Outcome") -> bool:
    """Print what became of a step, and return whether it was done."""
    for warning in outcome.warnings[:5]:
        click.echo(f"imodbatch: warning: {warning}", err=True)
    if len(outcome.warnings) > 5:
        click.echo(f"imodbatch: warning: and {len(outcome.warnings) - 5} more like it", err=True)
    if outcome.state == "failed":
        click.echo(f"imodbatch: error: {outcome.message}", err=True)
        return False
    mark = " (up to date)" if outcome.state == "up to date" else ""
    click.echo(f"{outcome.title} {outcome.label}: {outcome.message}{mark}")
    return True
