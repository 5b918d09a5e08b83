"""`imodbatch train`: training pictures → a detector."""

from pathlib import Path

import click

from imodbatch.lab.progress import bar


@click.command()
@click.argument("config")
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    required=True,
    multiple=True,
    help="COCO folder, as `imodbatch synth` or `simulate` writes it; may be repeated.",
)
@click.option("--val", type=click.Path(path_type=Path), help="COCO folder to try the detector on.")
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Results."
)
@click.option(
    "--minutes", type=click.FloatRange(min=0), help="Stop after so long, to resume later."
)
@click.option("--resume", is_flag=True, help="Go on from the checkpoint in --out.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="SECTION.KEY=VALUE",
    help="Override one setting of the recipe; may be repeated.",
)
def train(
    config: str,
    data: tuple[Path, ...],
    val: Path | None,
    out: Path,
    minutes: float | None,
    resume: bool,
    settings: tuple[str, ...],
) -> None:
    """Images with boxes and viewpoints → a detector; CONFIG is light, paper, or a TOML file.

    \b
    Example:
      imodbatch train light --data data/synth --val data/synth_val --out runs/light --minutes 60
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.lab.learning.loop import train as run_training
    from imodbatch.lab.learning.recipes import load_recipe
    from imodbatch.lab.learning.samples import CocoStream, MixedStream

    recipe = load_recipe(config, settings)
    folders = [CocoStream(folder, recipe.seed) for folder in data]
    stream = MixedStream(folders, recipe.data.shares, recipe.seed) if data[1:] else folders[0]
    validation = None if val is None else CocoStream(val, seed=None)
    with bar("train") as advance:
        outcome = run_training(recipe, stream, out, validation, minutes, resume, advance)
    figures = outcome.figures
    found = f", mean AP {figures['mean_ap_voc07_11pt']}" if figures else ""
    state = "done" if outcome.is_done else "stopped, go on with --resume"
    click.echo(
        f"train: {outcome.step} of {outcome.n_steps} steps{found}: {outcome.weights}, {state}"
    )
