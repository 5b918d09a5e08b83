"""The command that checks a dataset before hours are spent on it. Heavy libraries load inside."""

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from imodbatch.cli.options import MANIFEST, SEQUENCES

if TYPE_CHECKING:
    from imodbatch.checkup.examine import Examined
    from imodbatch.checkup.finding import Outcome


@click.command()
@MANIFEST
@SEQUENCES
@click.option(
    "--frames",
    "n_frames",
    type=click.IntRange(min=6),
    default=40,
    show_default=True,
    help="How many frames of each sequence to sample.",
)
@click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the findings there, too.",
)
def doctor(
    manifest: Path, sequences: tuple[str, ...], n_frames: int, json_file: Path | None
) -> None:
    """Dataset folder → what is wrong with it, and the manifest lines that mend it.

    \b
    Example:
      imodbatch doctor analytic

    Exit code 1 with errors, 0 with warnings only.
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.checkup.examine import examine
    from imodbatch.settings.manifest import load_manifest
    from imodbatch.tables.atomic import write_text

    checked = load_manifest(manifest)
    examined = examine(checked, checked.choose(sequences), n_frames, _progress)
    for part in examined:
        _print_part(part)
    outcomes = [outcome for part in examined for outcome in part.outcomes]
    click.echo(f"doctor {checked.name}: {_sum(outcomes, sum(p.n_frames for p in examined))}")
    if json_file is not None:
        document = {p.sequence_id: [o.as_json() for o in p.outcomes] for p in examined}
        write_text(json_file, json.dumps(document, indent=1, allow_nan=False))
    if any(outcome.has_error for outcome in outcomes):
        sys.exit(1)


def _progress(items: Iterable[Any], name: str) -> Iterable[Any]:
    from tqdm import tqdm

    return tqdm(items, desc=name, leave=False, disable=None)


def _print_part(part: "Examined") -> None:
    click.echo(f"{part.sequence_id}:")
    for outcome in part.outcomes:
        if not outcome.findings:
            mark = "skipped" if outcome.is_skipped else "ok"
            click.echo(f"  {mark:7}  {outcome.check}: {outcome.summary}")
    for outcome in part.outcomes:
        for finding in outcome.findings:
            click.echo(f"  {finding.severity:7}  {outcome.check}: {finding.seen}")
            for line in finding.mend:
                click.echo(f"           mend: {line}")


def _sum(outcomes: "list[Outcome]", n_frames: int) -> str:
    """``2 errors + 1 warning in 14 checks of 40 frames``."""
    found = [finding.severity for outcome in outcomes for finding in outcome.findings]
    counts = [(found.count("error"), "error"), (found.count("warning"), "warning")]
    named = " + ".join(f"{n} {what}{'s' if n > 1 else ''}" for n, what in counts if n)
    n_made = sum(not outcome.is_skipped for outcome in outcomes)
    skipped = len(outcomes) - n_made
    return (
        f"{named or 'nothing wrong'} in {n_made} checks of {n_frames} frames"
        f"{f'; {skipped} skipped' if skipped else ''}"
    )
