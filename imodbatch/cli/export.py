"""The command that hands finished poses to other tools."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from imodbatch.cli.options import warn_of_stale_inputs, with_plan

if TYPE_CHECKING:
    from imodbatch.run.plan import Plan


@click.command()
@with_plan
@click.option(
    "--format",
    "file_format",
    type=click.Choice(["tum"]),
    default="tum",
    show_default=True,
    help="Of the files: tum = stamp tx ty tz qx qy qz qw.",
)
@click.option(
    "--to",
    "folder",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    metavar="DIR",
    help="Where <sequence>.txt go.",
)
def export(plan: "Plan", file_format: str, folder: Path) -> None:
    """Finished poses → a trajectory file per sequence, for other tools to read.

    \b
    Example:
      imodbatch export analytic --to trajectories
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.run.exporting import export_tum

    del file_format  # there is one
    warn_of_stale_inputs(plan, "poses", with_itself=True)
    for line in export_tum(plan, folder):
        click.echo(f"export {line}")
