"""Commands that make data and detectors: simulate, synth, train.

They join `imodbatch` by entry point. Heavy libraries load inside the commands.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import click


@contextmanager
def _bar(name: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on stderr, moved by calling with what is done and what there is."""
    from tqdm import tqdm

    with tqdm(desc=name, leave=False, disable=None) as bar:

        def advance(n_done: int, n_total: int) -> None:
            bar.total = n_total
            bar.update(n_done - bar.n)

        yield advance


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
    with _bar("simulate") as advance:
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


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--objects",
    metavar="NAMES",
    help="household17 (default) or some of its objects, separated by commas; or rgbd5.",
)
@click.option(
    "--instances",
    type=click.IntRange(min=1),
    help="Objects of each class of rgbd5. Default: 100.",
)
@click.option(
    "--distractors",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Objects of no class that are pasted too, without a label.",
)
@click.option(
    "--models",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Your own: Gazebo model folders, GLB, OBJ, DAE or PLY files; or a folder of them per "
    "class, of which 'distractor' gets no label.",
)
@click.option(
    "--turntable",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="UW RGB-D Object dataset: a folder per category.",
)
@click.option(
    "--backgrounds",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Pictures without target objects. Default: simulated rooms, rendered once.",
)
@click.option(
    "--rooms",
    "n_rooms",
    type=click.IntRange(min=1),
    metavar="N",
    help="Pictures of simulated rooms where --backgrounds names none. Default: 300.",
)
@click.option("--n", type=click.IntRange(min=1), default=18000, show_default=True, help="Pictures.")
@click.option(
    "--azimuths", type=click.IntRange(min=1), default=16, show_default=True, help="Azimuth bins."
)
@click.option(
    "--elevations", default="10,30,50", show_default=True, metavar="DEG,…", help="Elevation bins."
)
@click.option(
    "--variants",
    type=click.IntRange(min=1),
    default=8,
    show_default=True,
    help="Renders per object and viewpoint bin.",
)
@click.option(
    "--jitter-all",
    is_flag=True,
    help="Turn every render within its bin; else the first shows the bin's middle.",
)
@click.option(
    "--view-size",
    type=click.IntRange(min=16),
    default=224,
    show_default=True,
    help="Side of a render, pixels.",
)
@click.option(
    "--renderer",
    type=click.Choice(["embree", "blender"]),
    default="embree",
    show_default=True,
    help="blender: path traced as in the paper, much slower; needs the extra [blender].",
)
@click.option(
    "--size", default="480,360", show_default=True, metavar="W,H", help="Of pictures, pixels."
)
@click.option(
    "--scale",
    default="0.1,1.0",
    show_default=True,
    metavar="LOW,HIGH",
    help="Objects' longer side over the picture's shorter side.",
)
@click.option("--per-picture", default="1,5", show_default=True, metavar="MIN,MAX", help="Objects.")
@click.option(
    "--symmetry",
    "symmetries",
    multiple=True,
    metavar="NAME=full|N",
    help="A class that looks the same from all sides, or N times per turn; may be repeated.",
)
@click.option(
    "--without",
    multiple=True,
    metavar="INSTANCE",
    help="Turntable instance to keep for testing, such as bowl_1; may be repeated.",
)
@click.option(
    "--azimuth-sign",
    type=click.Choice(["1", "-1"]),
    default="1",
    show_default=True,
    help="-1: the turntable's angles grow clockwise seen from above.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of chance.")
@click.option(
    "--workers", type=click.IntRange(min=1), default=1, show_default=True, help="Processes."
)
@click.option(
    "--cache",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Where renders are kept. Default: views and rooms in ~/.cache/imodbatch.",
)
@click.option("--overwrite", is_flag=True, help="Make all pictures anew.")
def synth(
    out: Path,
    objects: str | None,
    instances: int | None,
    distractors: int,
    models: Path | None,
    turntable: Path | None,
    backgrounds: Path | None,
    n_rooms: int | None,
    n: int,
    azimuths: int,
    elevations: str,
    variants: int,
    jitter_all: bool,
    view_size: int,
    renderer: Literal["embree", "blender"],
    size: str,
    scale: str,
    per_picture: str,
    symmetries: tuple[str, ...],
    without: tuple[str, ...],
    azimuth_sign: Literal["1", "-1"],
    seed: int,
    workers: int,
    cache: Path | None,
    overwrite: bool,
) -> None:
    """Objects + backgrounds → training pictures with COCO boxes, azimuth and elevation bins.

    \b
    Example:
      imodbatch synth data/synth --models MY_MODELS --workers 2
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.core.errors import ConfigError
    from imodbatch.lab.pictures import Recipe, ViewSettings, sources, write_dataset
    from imodbatch.lab.pictures.backgrounds import list_backgrounds
    from imodbatch.lab.pictures.sources import DISTRACTOR_NAME

    if sum(source is not None for source in (objects, models, turntable)) > 1:
        raise ConfigError("Name one of --objects, --models and --turntable, not several.")
    if without and turntable is None:
        raise ConfigError("--without: names turntable instances; it needs --turntable.")
    if azimuth_sign != "1" and turntable is None:
        raise ConfigError("--azimuth-sign: is of turntable angles; it needs --turntable.")
    if turntable is not None and (renderer != "embree" or distractors):
        raise ConfigError(
            "--renderer: turntable pictures are photographs; nothing is rendered. --distractors "
            "go without, too."
        )
    if backgrounds is not None and n_rooms is not None:
        raise ConfigError("Name one of --backgrounds and --rooms, not both.")
    grid = sources.grid_of(azimuths, elevations)
    how = sources.compose_settings(size, scale, per_picture)
    symmetry = sources.parse_symmetries(symmetries)
    pictures = [] if backgrounds is None else list_backgrounds(backgrounds)
    rooms_cache = sources.rooms_cache(cache)
    cache = cache or sources.default_cache()
    others: list[Path] = []
    if turntable is not None:
        tables, line = sources.turntable_views(
            turntable,
            cache,
            without=without,
            symmetries=symmetry,
            azimuth_sign=int(azimuth_sign),
        )
    else:
        chosen = sources.chosen_models(objects, models, instances, distractors, symmetry)
        settings = ViewSettings(
            grid=grid,
            n_variants=variants,
            first_is_center=not jitter_all,
            size_px=view_size,
            renderer=renderer,
        )
        with _bar("views") as advance:
            views, line = sources.views_of(chosen, settings, cache, workers, advance)
        tables = [v for v, m in zip(views, chosen, strict=True) if m.name != DISTRACTOR_NAME]
        others = [v for v, m in zip(views, chosen, strict=True) if m.name == DISTRACTOR_NAME]
    click.echo(f"synth views: {line}")
    if backgrounds is None:
        with _bar("rooms") as advance:
            pictures, line = sources.room_backgrounds(
                rooms_cache, n_rooms or sources.N_ROOMS, workers, advance
            )
        click.echo(f"synth rooms: {line}")
    recipe = Recipe(tuple(tables), tuple(pictures), grid, how, seed, tuple(others))
    begin = time.perf_counter()
    with _bar("synth") as advance:
        summary = write_dataset(
            out, recipe, n, workers=workers, overwrite=overwrite, progress=advance
        )
    seconds = time.perf_counter() - begin
    pace = f"; {summary.n_made / seconds:.1f} made per second" if summary.n_made else ""
    click.echo(f"synth {out}: {summary}{pace}")


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
    with _bar("train") as advance:
        outcome = run_training(recipe, stream, out, validation, minutes, resume, advance)
    figures = outcome.figures
    found = f", mean AP {figures['mean_ap_voc07_11pt']}" if figures else ""
    state = "done" if outcome.is_done else "stopped, go on with --resume"
    click.echo(
        f"train: {outcome.step} of {outcome.n_steps} steps{found}: {outcome.weights}, {state}"
    )
