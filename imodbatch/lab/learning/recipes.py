"""What can be turned in a training: a TOML file, checked, one section per part.

Two recipes come with the package: `paper` (Konno et al. 2020, Sec. 3.3: ResNet-101, one flat
softmax, for a GPU) and `light` (for two CPU cores). Their comments give the reasons. A recipe of
one's own is a copy of one of them, or says ``base = "light"`` and what differs. No torch is
imported here.
"""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from imodbatch.core.errors import ConfigError
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.detection.card import Architecture, DetectorCard
from imodbatch.settings.toml import StrictModel, apply_settings, did_you_mean, read_toml, validate

FOLDER = Path(__file__).parent
SHIPPED = ("light", "paper")

Fraction = Annotated[float, Field(ge=0, le=1)]
NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]


class GridSection(StrictModel):
    """The detector's viewpoint classes; N = 1 without elevations is a detector without."""

    n_azimuths: Count = 16
    elevations_deg: tuple[Annotated[float, Field(ge=-90, le=90)], ...] = (10.0, 30.0, 50.0)

    def grid(self) -> ViewGrid:
        """The same in radians, for the core."""
        elevations = self.elevations_deg or (0.0,)
        return ViewGrid(self.n_azimuths, tuple(math.radians(e) for e in elevations))


class StartSection(StrictModel):
    """Where the weights come from, and which never change."""

    weights: Literal["imagenet", "random"] = "imagenet"
    frozen_layers: Annotated[int, Field(ge=0)] = 0
    freeze_batch_norm: bool = True


class DataSection(StrictModel):
    """How images are fed.

    With a window, a training sees a random part of each image at the scale of the image itself,
    while the finished detector sees whole images of `image_size`: small, crowded pictures teach the
    same objects for a fraction of the time. `scale_range` resizes an image before (log-uniform).
    `shares` says how often each of several data folders is drawn from; empty = equally often.
    """

    batch_size: Count = 4
    window_size: tuple[Count, Count] | None = None
    scale_range: tuple[Positive, Positive] = (1.0, 1.0)
    shares: tuple[Positive, ...] = ()
    n_workers: Annotated[int, Field(ge=0)] = 1
    color_jitter: Fraction = 0.0
    noise_sigma: Annotated[float, Field(ge=0, le=100)] = 0.0


class TargetsSection(StrictModel):
    """What the RoIs should answer, and how much each loss weighs."""

    azimuth_sigma_deg: NotNegative = 0.0
    elevation_sigma_deg: NotNegative = 0.0
    use_symmetry: bool = False
    view_weight: NotNegative = 1.0
    rois_per_image: Count = 128
    object_fraction: Fraction = 0.25
    proposals_per_image: Count = 1000


class OptimiserSection(StrictModel):
    """How the weights move; each phase has an optimiser of its own. `momentum` is SGD's."""

    optimiser: Literal["sgd", "adamw"] = "sgd"
    learning_rate: Positive = 0.02
    momentum: Annotated[float, Field(ge=0, lt=1)] = 0.9
    weight_decay: NotNegative = 1e-4
    max_gradient_norm: NotNegative = 0.0


class ScheduleSection(OptimiserSection):
    """The optimiser of phase 2, and how its learning rate goes.

    An epoch is `images_per_epoch` draws, whatever the number of files.
    """

    images_per_epoch: Count = 18000
    n_epochs: Positive = 1.0
    warmup_steps: Annotated[int, Field(ge=0)] = 0
    decay: Literal["cosine", "steps"] = "cosine"
    decay_after_epochs: tuple[Positive, ...] = ()
    average_decay: Annotated[float, Field(ge=0, lt=1)] = 0.0


class CropsSection(OptimiserSection):
    """Phase 1: practice of the score head on object crops; 0 images = none.

    A crop shows the object at its own scale, but for one larger than `largest_box_px`.
    """

    n_images: Annotated[int, Field(ge=0)] = 0
    batch_size: Count = 8
    size_px: Annotated[int, Field(ge=32, multiple_of=32)] = 128
    largest_box_px: Annotated[float, Field(gt=8)] = 96.0
    jitter: Annotated[float, Field(ge=0, le=0.5)] = 0.1
    view_weight: NotNegative = 1.0


class ValidationSection(StrictModel):
    """How often the detector is tried out, and on how many images."""

    every_steps: Count = 500
    max_images: Annotated[int, Field(ge=0)] = 200
    score_threshold: Fraction = 0.02
    nms_iou: Fraction = 0.7


class Sibling(StrictModel):
    """A detector with another viewpoint grid that is trained along.

    It shares everything with the main one but the score head, so both have learnt from the same
    images in the same steps.
    """

    name: Annotated[str, Field(min_length=1)]
    grid: GridSection


class Recipe(StrictModel):
    """A whole training."""

    name: Annotated[str, Field(min_length=1)]
    seed: Annotated[int, Field(ge=0)] = 0
    licence: str = "Apache-2.0"
    image_size: tuple[Count, Count]
    checkpoint_every_steps: Count = 200
    architecture: Architecture
    grid: GridSection = GridSection()
    siblings: tuple[Sibling, ...] = ()
    start: StartSection = StartSection()
    data: DataSection = DataSection()
    targets: TargetsSection = TargetsSection()
    schedule: ScheduleSection = ScheduleSection()
    crops: CropsSection = CropsSection()
    validation: ValidationSection = ValidationSection()

    @model_validator(mode="after")
    def _fits_together(self) -> "Recipe":
        schedule = self.schedule
        if (schedule.decay == "steps") != bool(schedule.decay_after_epochs):
            raise ValueError('schedule.decay_after_epochs goes with schedule.decay = "steps"')
        if self.crops.largest_box_px >= self.crops.size_px:
            raise ValueError("crops.largest_box_px must be smaller than crops.size_px")
        smallest, largest = self.data.scale_range
        if smallest > largest:
            raise ValueError("data.scale_range must name the smaller factor first")
        if self.grid.n_azimuths > 1 and not self.grid.elevations_deg:
            raise ValueError("grid.elevations_deg must list an angle when n_azimuths is not 1")
        names = [variant.name for variant in self.variants()]
        if len(set(names)) < len(names):
            raise ValueError("siblings must have names of their own")
        return self

    def variants(self) -> "list[Recipe]":
        """This recipe, then one per sibling with its name and grid."""
        siblings = [
            self.model_copy(update={"name": s.name, "grid": s.grid, "siblings": ()})
            for s in self.siblings
        ]
        return [self, *siblings]

    @property
    def n_crop_steps(self) -> int:
        """Optimiser steps of phase 1."""
        return math.ceil(self.crops.n_images / self.crops.batch_size)

    @property
    def n_image_steps(self) -> int:
        """Optimiser steps of phase 2."""
        return math.ceil(self.steps_per_epoch * self.schedule.n_epochs)

    @property
    def n_steps(self) -> int:
        """Optimiser steps of both phases."""
        return self.n_crop_steps + self.n_image_steps

    @property
    def steps_per_epoch(self) -> float:
        """Optimiser steps of an epoch of phase 2, not rounded."""
        return self.schedule.images_per_epoch / self.data.batch_size

    def learning_rate(self, step: int) -> float:
        """Give the learning rate of a step, phase 1 first; each phase warms up and decays."""
        if step < self.n_crop_steps:
            share = self._warmup(step) * _cosine(step / self.n_crop_steps)
            return self.crops.learning_rate * share
        step -= self.n_crop_steps
        if self.schedule.decay == "cosine":
            share = _cosine(step / self.n_image_steps)
        else:
            limits = self.schedule.decay_after_epochs
            share = 0.1 ** sum(step >= limit * self.steps_per_epoch for limit in limits)
        return self.schedule.learning_rate * self._warmup(step) * share

    def _warmup(self, step: int) -> float:
        return min(1.0, (step + 1) / (self.schedule.warmup_steps + 1))

    def card(
        self, classes: tuple[str, ...], data: dict[str, Any], figures: dict[str, Any]
    ) -> DetectorCard:
        """Make the card of the network that this recipe trains."""
        return DetectorCard(
            format_version=1,
            name=self.name,
            architecture=self.architecture,
            classes=classes,
            n_azimuths=self.grid.n_azimuths,
            elevations_deg=self.grid.elevations_deg,
            image_size=self.image_size,
            licence=self.licence,
            data=data,
            seed=self.seed,
            figures=figures,
        )


def load_recipe(name_or_path: str | Path, settings: tuple[str, ...] = ()) -> Recipe:
    """Read a recipe by the name of a shipped one or by its path.

    Args:
        name_or_path: "light", "paper" or a TOML file.
        settings: ``section.key=value`` each, laid over the file.

    Raises:
        ConfigError: there is no such recipe, or it says something that cannot be meant.
    """
    name = str(name_or_path)
    if name in SHIPPED:
        path = FOLDER / f"training_{name}.toml"
    else:
        path = Path(name_or_path)
        if not path.suffix and not path.exists():
            raise ConfigError(f"{name}: no such recipe.{did_you_mean(name, SHIPPED)}")
    return validate(Recipe, apply_settings(_read(path), settings), str(path))


def _read(path: Path) -> dict[str, Any]:
    """A recipe's content, laid over that of its base if it names one."""
    own = read_toml(path)
    base = own.pop("base", None)
    if base is None:
        return own
    if base not in SHIPPED:
        raise ConfigError(f"{path}: base: no such recipe.{did_you_mean(str(base), SHIPPED)}")
    content = read_toml(FOLDER / f"training_{base}.toml")
    for key, value in own.items():
        inherited = content.get(key)
        if isinstance(value, dict) and isinstance(inherited, dict):
            content[key] = {**inherited, **value}
        else:
            content[key] = value
    return content


def first_difference(ours: dict[str, Any], theirs: dict[str, Any], prefix: str = "") -> str:
    """Name the first key in which two recipes differ, with both values; "" if none does."""
    for key in sorted({*ours, *theirs}):
        mine, other = ours.get(key), theirs.get(key)
        if isinstance(mine, dict) and isinstance(other, dict):
            inner = first_difference(mine, other, f"{prefix}{key}.")
            if inner:
                return inner
        elif mine != other:
            return f"{prefix}{key} is {mine!r}, was {other!r}"
    return ""


def _cosine(progress: float) -> float:
    """Fall from 1 to 0 over half a wave."""
    return (1 + math.cos(math.pi * min(progress, 1.0))) / 2
