"""The command that sets finished runs side by side. Heavy libraries load inside."""

from pathlib import Path

import click

from imodbatch.cli.options import warn_of_stale_inputs


@click.command()
@click.argument(
    "sources",
    nargs=-1,
    required=True,
    metavar="[MANIFEST] RUN...",
    type=click.Path(path_type=Path),
)
@click.option(
    "--table",
    type=click.Choice(["1", "2"]),
    default="1",
    show_default=True,
    help="Of the paper: AP, or precision/recall at tuned thresholds.",
)
@click.option(
    "--resamples",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Of the sequences, for the intervals of Table 1.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write files there, too: Markdown or HTML, and CSV.",
)
def compare(sources: tuple[Path, ...], table: str, resamples: int, out: Path | None) -> None:
    """Finished runs of the same data → the paper's Table 1 with intervals, or its Table 2.

    \b
    Example:
      imodbatch compare house_test robot17_noview robot17_3x16

    A RUN is a run folder, or, after a MANIFEST, a pipeline.
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.reporting.comparing import compare_folders, table_2_of_folders

    folders = _run_folders(sources)
    document = table_2_of_folders(folders) if table == "2" else compare_folders(folders, resamples)
    click.echo(document.text(), nl=False)
    if out is not None:
        click.echo(f"\ncompare: {document.write(out)}")


def _run_folders(sources: tuple[Path, ...]) -> list[Path]:
    """The run folders meant: as named, or where `run` puts those of a manifest and a pipeline."""
    from imodbatch.core.errors import ConfigError
    from imodbatch.run.plan import default_run_dir, make_plan
    from imodbatch.settings.manifest import load_manifest

    if sources[0].is_dir():
        files = [source for source in sources if not source.is_dir()]
        if files:
            raise ConfigError(
                f"{files[0]}: no run folder. Name a manifest first to name runs by pipeline files."
            )
        return list(sources)
    manifest = load_manifest(sources[0])
    folders = []
    for source in sources[1:]:
        if source.is_dir():
            folders.append(source)
            continue
        folder = default_run_dir(manifest.name, manifest.pipeline_file(source))
        plan = make_plan(manifest, source, folder)
        if not folder.is_dir():
            raise ConfigError(
                f"{folder}: no such run. Make it with `imodbatch run {sources[0]} "
                f"--pipeline {source}`."
            )
        warn_of_stale_inputs(plan, "report", where=f"{folder}: ")
        folders.append(folder)
    if not folders:
        raise ConfigError(f"{sources[0]}: names no run. Add pipeline files or run folders.")
    return folders
