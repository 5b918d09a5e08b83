"""`imodbatch synth`: objects and backgrounds → training pictures."""

import time
from pathlib import Path
from typing import Literal

import click

from imodbatch.lab.progress import bar


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
    from imodbatch.lab.commands import options
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
    grid = options.grid_of(azimuths, elevations)
    how = options.compose_settings(size, scale, per_picture)
    symmetry = options.parse_symmetries(symmetries)
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
        with bar("views") as advance:
            views, line = sources.views_of(chosen, settings, cache, workers, advance)
        tables = [v for v, m in zip(views, chosen, strict=True) if m.name != DISTRACTOR_NAME]
        others = [v for v, m in zip(views, chosen, strict=True) if m.name == DISTRACTOR_NAME]
    click.echo(f"synth views: {line}")
    if backgrounds is None:
        with bar("rooms") as advance:
            pictures, line = sources.room_backgrounds(
                rooms_cache, n_rooms or sources.N_ROOMS, workers, advance
            )
        click.echo(f"synth rooms: {line}")
    recipe = Recipe(tuple(tables), tuple(pictures), grid, how, seed, tuple(others))
    begin = time.perf_counter()
    with bar("synth") as advance:
        summary = write_dataset(
            out, recipe, n, workers=workers, overwrite=overwrite, progress=advance
        )
    seconds = time.perf_counter() - begin
    pace = f"; {summary.n_made / seconds:.1f} made per second" if summary.n_made else ""
    click.echo(f"synth {out}: {summary}{pace}")
