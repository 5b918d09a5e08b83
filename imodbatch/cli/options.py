"""What several commands ask for: a manifest, and by it a whole run."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from imodbatch.run.plan import Plan

MANIFEST = click.argument("manifest", type=click.Path(path_type=Path))
SEQUENCES = click.option(
    "--sequence", "sequences", multiple=True, metavar="ID", help="Only this sequence."
)
PLAN_OPTIONS = (
    click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="STAGE.KEY=VALUE",
        help="Override one pipeline setting; may be repeated.",
    ),
    SEQUENCES,
    click.option(
        "--out",
        type=click.Path(path_type=Path),
        metavar="RUN_DIR",
        help="Where tables go. Default: runs/<manifest>--<pipeline>.",
    ),
    click.option(
        "--pipeline",
        type=click.Path(path_type=Path),
        metavar="PIPELINE",
        help="A shipped pipeline's name, or a TOML file. Default: the manifest's, or every "
        "setting's default.",
    ),
    MANIFEST,
)


def with_plan(command: Callable[..., None]) -> Callable[..., None]:
    """A command that is given the run meant as its first argument, and options of its own after."""

    @wraps(command)
    def make_plan_first(
        manifest: Path,
        pipeline: Path | None,
        out: Path | None,
        sequences: tuple[str, ...],
        settings: tuple[str, ...],
        device: str | None = None,
        **others: Any,
    ) -> None:
        from imodbatch.run.plan import make_plan
        from imodbatch.settings.manifest import load_manifest

        if device is not None:
            settings = (*settings, f"detect.device={device}")
        command(make_plan(load_manifest(manifest), pipeline, out, sequences, settings), **others)

    decorated: Callable[..., None] = make_plan_first
    for decorate in PLAN_OPTIONS:
        decorated = decorate(decorated)
    return decorated


def warn_of_stale_inputs(
    plan: "Plan", stage: str, with_itself: bool = False, where: str = ""
) -> None:
    """Say what a command is about to read that an older setting or file went into."""
    from imodbatch.run.states import stale_inputs

    stale = stale_inputs(plan, stage, with_itself)
    if stale:
        click.echo(
            f"imodbatch: warning: {where}{', '.join(stale)} no longer fit the settings or files; "
            "`imodbatch run` brings all up to date.",
            err=True,
        )
