"""`imodbatch simulate`: a world that is made → a dataset."""

from pathlib import Path
from typing import Any

import click

from imodbatch.lab.progress import bar


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--world",
    type=click.Choice(["analytic", "house", "rooms"]),
    help="analytic (default): with simulated detections; house (default with --models): for a real "
    "detector; rooms: backgrounds.",
)
@click.option(
    "--layout",
    type=click.Choice(["rgbd_scenes_v1"]),
    help="Tables and desks with a hand-held camera, written as the UW RGB-D Scenes lie.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Other seed, other data.")
@click.option(
    "--split",
    type=click.Choice(["train", "val", "test"]),
    default="test",
    show_default=True,
    help="Worlds of which objects, furniture, textures and light; none is shared.",
)
@click.option("--worlds", type=click.IntRange(min=1), help="Sequences. Default: house 4, tables 8.")
@click.option(
    "--frames",
    type=click.IntRange(min=4),
    help="Per sequence (house 75, tables 98 to 234), or of rooms in all (300).",
)
@click.option(
    "--models",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Your own objects in place of the seventeen (house).",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Worlds at a time, in processes (house, rooms, tables).",
)
def simulate(
    folder: Path,
    world: str | None,
    layout: str | None,
    seed: int,
    split: str,
    worlds: int | None,
    frames: int | None,
    models: Path | None,
    workers: int,
) -> None:
    """Seed → a dataset folder with colour, depth, poses, true boxes and a manifest.

    \b
    Example:
      imodbatch simulate data/house_test --world house --split test
    """  # noqa: D301 (click wants the character, not a backslash)
    if layout is not None and (world is not None or models is not None):
        raise click.UsageError("--layout has a world of its own; --world and --models go without.")
    world = layout or world or ("analytic" if models is None else "house")
    if models is not None and world != "house":
        raise click.UsageError(f"--models needs --world house; --world {world} takes no models.")
    if workers > 1 and world == "analytic":
        raise click.UsageError(
            "--workers needs --world house or rooms, or --layout; analytic is quick."
        )
    sizes: dict[str, Any] = {"n_frames": frames} if frames is not None else {}
    with bar("simulate") as advance:
        if world == "house":
            from imodbatch.lab.houses import write_house_dataset
            from imodbatch.lab.models import load_models

            own = None if models is None else load_models(models)
            if worlds is not None:
                sizes["n_worlds"] = worlds
            write_house_dataset(
                folder, split, seed, models=own, progress=advance, n_processes=workers, **sizes
            )
        elif world == "rgbd_scenes_v1":
            from imodbatch.lab.tabletop import write_scenes

            if worlds is not None:
                sizes["n_worlds"] = worlds
            write_scenes(folder, split, seed, progress=advance, n_processes=workers, **sizes)
        elif world == "rooms":
            from imodbatch.lab.houses import write_backgrounds

            if frames is not None:
                sizes = {"n": frames}
            write_backgrounds(
                folder, split, seed=seed, progress=advance, n_processes=workers, **sizes
            )
        else:
            from imodbatch.lab.analytic import write_dataset

            if worlds is not None:
                sizes["n_sequences"] = worlds
            write_dataset(folder, seed=seed, progress=advance, **sizes)
    manifest = (
        f", described by {folder / 'manifest.toml'}" if world in ("house", "rgbd_scenes_v1") else ""
    )
    click.echo(f"simulate: {folder}{manifest}")
