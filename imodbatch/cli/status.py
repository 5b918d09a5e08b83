"""The command that says where a run stands."""

from typing import TYPE_CHECKING

import click

from imodbatch.cli.options import with_plan

if TYPE_CHECKING:
    from imodbatch.run.plan import Plan


@click.command()
@with_plan
def status(plan: "Plan") -> None:
    """Say of every stage and sequence whether it is up to date, stale or missing.

    \b
    Example:
      imodbatch status analytic
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.run.states import states

    click.echo(f"{plan.run_dir}")
    for outcome in states(plan):
        line = f"  {outcome.title:12} {outcome.label:16} {outcome.state:11} {outcome.message}"
        click.echo(line.rstrip())
