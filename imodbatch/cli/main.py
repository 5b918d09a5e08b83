"""The command line: parse, run stages, print one line per stage and sequence.

Heavy libraries load inside the commands, so that ``imodbatch --help`` answers at once.
"""

import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from imodbatch import __version__
from imodbatch.cli.compare import compare
from imodbatch.cli.doctor import doctor
from imodbatch.cli.plugins import PluggedGroup, make_data
from imodbatch.core.errors import ImodError

if TYPE_CHECKING:
    from imodbatch.run.runner import Outcome, Plan

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
MANIFEST = click.argument("manifest", type=click.Path(path_type=Path))


def _common_options(command: Callable[..., None]) -> Callable[..., None]:
    for decorate in (
        click.option(
            "--set",
            "settings",
            multiple=True,
            metavar="STAGE.KEY=VALUE",
            help="Override one pipeline setting; may be repeated.",
        ),
        click.option(
            "--sequence", "sequences", multiple=True, metavar="ID", help="Only this sequence."
        ),
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
    ):
        command = decorate(command)
    return command


class _OneLineErrors(PluggedGroup):
    """Errors a user can cure are one line on stderr and exit code 1."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run; what the terminal's encoding lacks (→ in Latin-1) is printed as a question mark."""
        if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
            sys.stdout.reconfigure(errors="replace")
        return super().main(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; the only place where errors are caught."""
        try:
            return super().invoke(ctx)
        except ImodError as error:
            _fail(str(error))
        except BrokenPipeError:  # the reader of our output has seen enough; click ends quietly
            raise
        except (PermissionError, FileNotFoundError, FileExistsError, NotADirectoryError) as error:
            _fail(f"{error.filename}: {error.strerror}. Check the path and its permissions.")
        except OSError as error:
            _fail(f"{error.filename or 'disk'}: {error.strerror or error}.")


def _fail(message: str) -> NoReturn:
    click.echo(f"imodbatch: error: {message}", err=True)
    sys.exit(1)


@click.group(
    cls=_OneLineErrors,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Start with: imodbatch run analytic",
)
@click.version_option(__version__, prog_name="imodbatch")
def main() -> None:
    """Many RGB-D frames made to agree: detect, lift, fuse and score objects over camera views."""


def _stage_command(stage: str) -> click.Command:
    def command(
        manifest: Path,
        pipeline: Path | None,
        out: Path | None,
        sequences: tuple[str, ...],
        settings: tuple[str, ...],
        workers: int,
        scheduler: str | None,
        overwrite: bool,
        device: str | None = None,
    ) -> None:
        from imodbatch.run import runner
        from imodbatch.run.lock import only_writer
        from imodbatch.run.steps import stages_of

        if device is not None:
            settings = (*settings, f"detect.device={device}")
        plan = _plan(manifest, pipeline, out, sequences, settings)
        if stage in ("run", "index"):
            make_data(main, plan.context.manifest, workers)
        todo = stages_of(plan.context) if stage == "run" else (stage,)
        with only_writer(plan.run_dir), runner.open_executor(workers, scheduler) as executor:
            if stage != "run":
                _warn_of_stale_inputs(plan, stage)
            for name in todo:
                if name == "report":
                    _write_report(plan, pipeline)
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
    return click.command(stage)(MANIFEST(_common_options(decorated)))


def _plan(
    manifest: Path,
    pipeline: Path | None,
    out: Path | None,
    sequences: tuple[str, ...],
    settings: tuple[str, ...],
) -> "Plan":
    from imodbatch.core.errors import ConfigError
    from imodbatch.run.context import Context
    from imodbatch.run.runner import Plan, default_run_dir
    from imodbatch.settings.config import load_pipeline
    from imodbatch.settings.manifest import load_manifest

    checked = load_manifest(manifest)
    pipeline = checked.pipeline_file(pipeline)
    run_dir = (out or default_run_dir(checked.name, pipeline)).absolute()
    if run_dir.exists() and not run_dir.is_dir():
        raise ConfigError(f"{run_dir}: is a file, expected a folder. Name another --out.")
    context = Context(checked, load_pipeline(pipeline, settings), run_dir)
    return Plan(context, checked.sequences).choose(sequences)


def _warn_of_stale_inputs(plan: "Plan", stage: str, with_itself: bool = False) -> None:
    from imodbatch.run.runner import stale_inputs

    stale = stale_inputs(plan, stage, with_itself)
    if stale:
        click.echo(
            f"imodbatch: warning: {', '.join(stale)} no longer fit these settings or files; "
            "`imodbatch run` brings all up to date.",
            err=True,
        )


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


def _write_report(plan: "Plan", pipeline: Path | None) -> None:
    from imodbatch.run.publishing import write_report
    from imodbatch.run.runner import pipeline_name

    name = pipeline_name(plan.context.manifest.pipeline_file(pipeline))
    click.echo(f"report: {write_report(plan, name)}")


for _stage in STAGE_HELP:
    main.add_command(_stage_command(_stage))


@main.command()
@MANIFEST
@_common_options
def status(
    manifest: Path,
    pipeline: Path | None,
    out: Path | None,
    sequences: tuple[str, ...],
    settings: tuple[str, ...],
) -> None:
    """Say of every stage and sequence whether it is up to date, stale or missing.

    \b
    Example:
      imodbatch status analytic
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.run.runner import states

    plan = _plan(manifest, pipeline, out, sequences, settings)
    click.echo(f"{plan.run_dir}")
    for outcome in states(plan):
        line = f"  {outcome.title:12} {outcome.label:16} {outcome.state:11} {outcome.message}"
        click.echo(line.rstrip())


@main.command()
@MANIFEST
@_common_options
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
def export(
    manifest: Path,
    pipeline: Path | None,
    out: Path | None,
    sequences: tuple[str, ...],
    settings: tuple[str, ...],
    file_format: str,
    folder: Path,
) -> None:
    """Finished poses → a trajectory file per sequence, for other tools to read.

    \b
    Example:
      imodbatch export analytic --to trajectories
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.run.exporting import export_tum

    del file_format  # there is one
    plan = _plan(manifest, pipeline, out, sequences, settings)
    _warn_of_stale_inputs(plan, "poses", with_itself=True)
    for line in export_tum(plan, folder):
        click.echo(f"export {line}")


@main.command()
@click.argument("table", required=False)
def schema(table: str | None) -> None:
    """Print the data dictionary: every table (or one), its columns, types and meaning.

    \b
    Example:
      imodbatch schema fused
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.core.errors import TableError
    from imodbatch.settings.config import did_you_mean
    from imodbatch.tables.schemas import TABLES

    if table is not None and table not in TABLES:
        raise TableError(f"{table}: no such table.{did_you_mean(table, list(TABLES))}")
    for spec in TABLES.values() if table is None else (TABLES[table],):
        place = "run" if spec.per_run else "<sequence_id>"
        click.echo(f"{spec.name}/{place}.parquet (version {spec.version})")
        for column in spec.columns:
            name = column.name.upper() if column.name in spec.key else column.name
            nullable = "?" if column.nullable else ""
            click.echo(f"  {name:20} {str(column.dtype) + nullable:16} {column.meaning}")


for _command in (doctor, compare):
    main.add_command(_command)


if __name__ == "__main__":
    main()
