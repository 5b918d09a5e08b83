"""Which objects and backgrounds a user asks for → files, and a line that says what came of it."""

import os
import time
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

from imodbatch.core.errors import ConfigError
from imodbatch.core.symmetry import Symmetry
from imodbatch.lab.houses.backgrounds import N_PICTURES, backgrounds_digest, write_backgrounds
from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.models import load_models
from imodbatch.lab.objects import OBJECTS, load_object
from imodbatch.lab.pictures.turntable import class_names_of, read_turntable
from imodbatch.lab.pictures.views import ViewSettings, prepare_views
from imodbatch.lab.progress import Progress, silent
from imodbatch.lab.tabletop.world import CLASSES, POOL, class_symmetry
from imodbatch.lab.variants import make_distractor, make_instance

CATALOGUES = {"household17": tuple(OBJECTS)}
"""Sets of objects that come with the package."""
N_INSTANCES = 100
"""Objects of each class where a user names no number."""
RGBD5_NAME, DISTRACTOR_NAME = "rgbd5", "distractor"
"""A set of classes with any number of objects; and the name of what is of no class."""
N_ROOMS = N_PICTURES
"""Pictures of simulated rooms where a user names no backgrounds."""


def default_cache() -> Path:
    """Where cutouts are kept between runs unless the user names a place."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "imodbatch" / "views"


def rooms_cache(named: Path | None) -> Path:
    """Where rooms are kept: beside the cutouts, or within the place that the user names."""
    return default_cache().with_name("rooms") if named is None else named / "rooms"


def catalogue_models(
    names: str, symmetries: Mapping[str, Symmetry] | None = None
) -> list[ObjectModel]:
    """Objects of a catalogue, or those named, separated by commas."""
    chosen = CATALOGUES.get(names) or tuple(name.strip() for name in names.split(","))
    return _with_symmetries([load_object(name) for name in chosen], symmetries or {})


def chosen_models(
    objects: str | None,
    folder: Path | None,
    n_instances: int | None,
    n_distractors: int,
    symmetries: Mapping[str, Symmetry],
) -> list[ObjectModel]:
    """The models that a user names, by catalogue or folder, and distractors after them.

    Raises:
        ConfigError: a name or a number that cannot be meant.
    """
    if n_instances is not None and objects != RGBD5_NAME:
        raise ConfigError(f"--instances: needs --objects {RGBD5_NAME}; the others are one each.")
    if folder is not None:
        models = folder_models(folder, symmetries)
    elif objects == RGBD5_NAME:
        models = rgbd5_models(n_instances or N_INSTANCES, symmetries)
    else:
        models = catalogue_models(objects or "household17", symmetries)
    return models + distractor_models(n_distractors)


def rgbd5_models(
    n_instances: int, symmetries: Mapping[str, Symmetry] | None = None
) -> list[ObjectModel]:
    """Training objects of bowl, cap, cereal_box, coffee_mug and soda_can: so many of each."""
    models = [
        _numbered(replace(make_instance(name, k), symmetry=class_symmetry(name)), k)
        for name in CLASSES
        for k in _training_numbers(n_instances)
    ]
    return _with_symmetries(models, symmetries or {})


def distractor_models(n: int) -> list[ObjectModel]:
    """Training objects that are of none of those classes."""
    return [
        _numbered(replace(make_distractor(k), name=DISTRACTOR_NAME, symmetry="none"), k)
        for k in _training_numbers(n)
    ]


def _numbered(model: ObjectModel, number: int) -> ObjectModel:
    return replace(model, instance=f"{model.name}_{number}")


def _training_numbers(n: int) -> range:
    first, last = POOL["train"]
    if n > last - first:
        raise ConfigError(f"At most {last - first} objects of a class are for training, not {n}.")
    return range(first, first + n)


def folder_models(
    folder: Path, symmetries: Mapping[str, Symmetry] | None = None
) -> list[ObjectModel]:
    """A user's own models; files do not say how symmetric they are, so the user may."""
    return _with_symmetries(load_models(folder), symmetries or {})


def views_of(
    models: list[ObjectModel],
    settings: ViewSettings,
    cache: Path,
    workers: int = 1,
    progress: Progress = silent,
) -> tuple[list[Path], str]:
    """Cutouts of models, and a line."""
    rendered = _Rendered(progress)
    tables = prepare_views(models, cache, settings, workers=workers, progress=rendered)
    return tables, (
        f"{len(models)} objects × {settings.n_views} views = {rendered.n_total:,} = {rendered}"
    )


def room_backgrounds(
    cache: Path, n: int = N_ROOMS, workers: int = 1, progress: Progress = silent
) -> tuple[list[Path], str]:
    """Pictures of simulated training rooms in which no target stands, and a line."""
    rendered = _Rendered(progress)
    folder = cache / backgrounds_digest("train", n)
    paths = write_backgrounds(folder, "train", n, progress=rendered, n_processes=workers)
    return paths, f"{n:,} pictures without objects = {rendered}"


class _Rendered:
    """Progress that tells what is made from what was there at the first call; `str` says both."""

    def __init__(self, progress: Progress) -> None:
        self.progress, self.begin = progress, time.perf_counter()
        self.n_found: int | None = None
        self.n_total = 0

    def __call__(self, done: int, total: int) -> None:
        self.n_found = done if self.n_found is None else self.n_found
        self.n_total = total
        self.progress(done, total)

    def __str__(self) -> str:
        found = self.n_found or 0
        made = self.n_total - found
        seconds = time.perf_counter() - self.begin
        pace = f" ({made / seconds:.1f} per second)" if made else ""
        return f"{made:,} rendered{pace} + {found:,} from cache"


def turntable_views(
    folder: Path,
    cache: Path,
    instances: Collection[str] | None = None,
    without: Collection[str] = (),
    symmetries: Mapping[str, Symmetry] | None = None,
    azimuth_sign: int = 1,
) -> tuple[list[Path], str]:
    """Cutouts of turntable pictures, and a line."""
    tables, counts = read_turntable(
        folder,
        cache,
        instances=instances,
        without=without,
        symmetries=symmetries,
        azimuth_sign=azimuth_sign,
    )
    _check_names(symmetries or {}, class_names_of(tables))
    return tables, f"{len(tables)} instances, {counts}"


def _with_symmetries(
    models: list[ObjectModel], symmetries: Mapping[str, Symmetry]
) -> list[ObjectModel]:
    _check_names(symmetries, [model.name for model in models])
    return [replace(m, symmetry=symmetries.get(m.name, m.symmetry)) for m in models]


def _check_names(symmetries: Mapping[str, Symmetry], known: list[str]) -> None:
    for name in symmetries:
        if name not in known:
            raise ConfigError(f"--symmetry {name}: no such class. There are: {', '.join(known)}.")
