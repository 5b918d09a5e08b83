"""The card of a detector: everything besides the weights that is needed to use and to trust it.

A checkpoint is two files, ``<name>.safetensors`` and ``<name>.json``. The card fixes the
architecture (so that the weights fit), the meaning of the outputs (classes and viewpoint grid) and
the record of how the weights came to be. Detectors of one training are a family: their cards name
one file, which holds what they share once. This module imports no torch: a run that is up to date
reads cards and digests only.

Column order, stated here and nowhere else: the network has K·M·N + 1 exclusive outputs; the first
K·M·N are in C order of [class, elevation, azimuth], so that
``scores.reshape(K, M, N)[k, e, b]`` is class k seen from elevation bin e and azimuth bin b; the
background is the LAST column.
"""

import difflib
import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from imodbatch.core.errors import ConfigError, one_line
from imodbatch.tables.atomic import write_text

FORMAT_VERSION = 1
WEIGHTS_SUFFIX, CARD_SUFFIX = ".safetensors", ".json"

Backbone = Literal[
    "resnet18",
    "resnet34",
    "resnet50",
    "resnet101",
    "mobilenet_v2",
    "mobilenet_v3_large",
    "efficientnet_lite0",
]
PositiveInt = Annotated[int, Field(gt=0)]
PositiveFloat = Annotated[float, Field(gt=0)]
Elevation = Annotated[float, Field(ge=-90, le=90)]


class Architecture(BaseModel):
    """The shape of the network; every value changes either a tensor or what is computed from it.

    Attributes:
        backbone: the network that makes the features, torchvision's but for efficientnet_lite0.
        fpn_channels: channels of every level of the feature pyramid.
        fpn_strides: pixels per cell of each level, each twice the one before, out of 4, 8, 16, 32
            and 64. 64 is the 32 level max-pooled; it makes proposals and is not pooled from.
        anchor_sizes_px: for each stride the square roots of the anchor areas, in pixels of the
            resized image; equally many at each stride.
        anchor_aspect_ratios: heights over widths of the anchors, the same at all strides.
        head_width: width of the two fully connected layers over a pooled RoI.
        roi_size: cells per side of a pooled RoI.
        n_rois: proposals kept per image at inference, so at most this many detections.
        head: "flat", one linear layer with an output per (class, viewpoint), or "factorised",
            p(class) · p(viewpoint | class).
        normalisation_mean: of R, G, B in the range 0 to 1, subtracted from the image.
        normalisation_std: of R, G, B, that the image is then divided by.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    backbone: Backbone
    fpn_channels: PositiveInt
    fpn_strides: Annotated[tuple[Literal[4, 8, 16, 32, 64], ...], Field(min_length=1)]
    anchor_sizes_px: tuple[Annotated[tuple[PositiveFloat, ...], Field(min_length=1)], ...]
    anchor_aspect_ratios: Annotated[tuple[PositiveFloat, ...], Field(min_length=1)]
    head_width: PositiveInt
    roi_size: PositiveInt
    n_rois: PositiveInt
    head: Literal["flat", "factorised"]
    normalisation_mean: tuple[float, float, float]
    normalisation_std: tuple[PositiveFloat, PositiveFloat, PositiveFloat]

    @model_validator(mode="after")
    def _levels_agree(self) -> "Architecture":
        pairs = zip(self.fpn_strides, self.fpn_strides[1:], strict=False)
        if self.fpn_strides[0] == 64 or any(fine * 2 != coarse for fine, coarse in pairs):
            raise ValueError("fpn_strides must double from one to the next, as in [8, 16, 32]")
        if len(self.anchor_sizes_px) != len(self.fpn_strides):
            raise ValueError("anchor_sizes_px must hold one list per entry of fpn_strides")
        if len({len(sizes) for sizes in self.anchor_sizes_px}) != 1:
            raise ValueError("anchor_sizes_px must hold equally many sizes at each stride")
        return self


IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)

LIGHT = Architecture(
    backbone="mobilenet_v2",
    fpn_channels=96,
    fpn_strides=(8, 16, 32),
    anchor_sizes_px=((24, 40), (64, 104), (160, 256)),
    anchor_aspect_ratios=(0.5, 1.0, 2.0),
    head_width=384,
    roi_size=7,
    n_rois=96,
    head="factorised",
    normalisation_mean=IMAGENET_MEAN,
    normalisation_std=IMAGENET_STD,
)
"""For a CPU: no stride 4, a narrow pyramid, few RoIs. Meant for images of about 480 by 360."""

PAPER = Architecture(
    backbone="resnet101",
    fpn_channels=256,
    fpn_strides=(4, 8, 16, 32, 64),
    anchor_sizes_px=((32,), (64,), (128,), (256,), (512,)),
    anchor_aspect_ratios=(0.5, 1.0, 2.0),
    head_width=1024,
    roi_size=7,
    n_rois=300,
    head="flat",
    normalisation_mean=IMAGENET_MEAN,
    normalisation_std=IMAGENET_STD,
)
"""ResNet-101 and one flat softmax (Konno et al. 2020, Sec. 3.2), pyramid as in Lin et al. 2017."""


class Family(BaseModel):
    """Where the weights of a detector lie that shares most of them with others.

    Attributes:
        file: of the family's weights, beside the card.
        member: which one this is. A tensor ``<member>/<name>`` is this detector's own; one without
            a slash is every member's.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    file: Annotated[str, Field(pattern=r"^[^/\\]+\.safetensors$")]
    member: Annotated[str, Field(pattern=r"^[^/]+$")]


class DetectorCard(BaseModel):
    """What a checkpoint is: the JSON file beside the weights.

    Attributes:
        format_version: of this file; 1.
        name: of the detector, free text without a meaning to the program.
        architecture: the shape of the network.
        classes: the K category names, in the order of the scores.
        n_azimuths: N; bin b is centred at 2πb/N.
        elevations_deg: the M bin centres above the horizon, ascending. Empty (or one elevation
            with N = 1) is a detector without viewpoint classes, M = N = 1.
        image_size: (width, height) in pixels. An image is resized, its aspect kept, until its
            short side is the smaller or its long side the larger of the two, whichever is first.
        licence: of the weights.
        data: what it was trained on.
        seed: of the training, or one per random part of it.
        figures: what it measured, with the names of the sets.
        family: None where the weights lie in ``<name>.safetensors`` beside ``<name>.json``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format_version: Literal[1]
    name: Annotated[str, Field(min_length=1)]
    architecture: Architecture
    classes: Annotated[tuple[str, ...], Field(min_length=1)]
    n_azimuths: PositiveInt
    elevations_deg: tuple[Elevation, ...]
    image_size: tuple[PositiveInt, PositiveInt]
    licence: str
    data: dict[str, Any]
    seed: int | dict[str, Any]
    figures: dict[str, Any]
    family: Family | None = None

    @model_validator(mode="after")
    def _grid_is_a_grid(self) -> "DetectorCard":
        if len(set(self.classes)) != len(self.classes):
            raise ValueError("classes must not name a class twice")
        if list(self.elevations_deg) != sorted(set(self.elevations_deg)):
            raise ValueError("elevations_deg must ascend, each angle once")
        if self.n_azimuths > 1 and not self.elevations_deg:
            raise ValueError("elevations_deg must list at least one angle when n_azimuths is not 1")
        return self

    @property
    def n_classes(self) -> int:
        """K."""
        return len(self.classes)

    @property
    def n_elevations(self) -> int:
        """M, which is 1 for a detector without viewpoint classes."""
        return max(1, len(self.elevations_deg))

    @property
    def n_scores(self) -> int:
        """K·M·N, the outputs besides the background."""
        return self.n_classes * self.n_elevations * self.n_azimuths

    @property
    def has_viewpoints(self) -> bool:
        """Whether the detector tells viewpoints apart (M·N > 1)."""
        return self.n_elevations * self.n_azimuths > 1


def card_path(path: str | Path) -> Path:
    """Give the path of a checkpoint's card.

    Args:
        path: of the card, or of ``<name>.safetensors``.

    Returns:
        The path of ``<name>.json`` in the same folder.

    Raises:
        ConfigError: the path has another suffix.
    """
    path = Path(path)
    if path.suffix not in (WEIGHTS_SUFFIX, CARD_SUFFIX):
        raise ConfigError(
            f"{path}: a checkpoint is a {WEIGHTS_SUFFIX} file with its card beside it. "
            f"Set detect.weights to such a file."
        )
    return path.with_suffix(CARD_SUFFIX)


def checkpoint_files(path: str | Path) -> tuple[Path, Path]:
    """Find the weights and the card of a checkpoint, both of which are there.

    Args:
        path: of the card, or of ``<name>.safetensors``.

    Returns:
        The paths of the weights (a family's, if the card names one) and of the card.

    Raises:
        ConfigError: one of the two files is missing, or the card is damaged.
    """
    card, weights = card_path(path), Path(path).with_suffix(WEIGHTS_SUFFIX)
    if card.is_file():
        family = read_card(card).family
        weights = weights if family is None else card.with_name(family.file)
    if not weights.is_file():
        raise ConfigError(
            f"{weights}: there is no such weights file. Set detect.weights to an existing one."
        )
    if not card.is_file():
        raise ConfigError(
            f"{card}: the card of {weights.name} is missing. Copy it beside the weights."
        )
    return weights, card


def read_card(path: str | Path) -> DetectorCard:
    """Read and validate a card.

    Args:
        path: of the JSON file.

    Returns:
        The card.

    Raises:
        ConfigError: the file cannot be read, is not JSON, or has an unknown key, a missing key or
            a value that cannot be meant. One line with the file, the key and the cure.
    """
    return _parse_card(_read_bytes(Path(path)), Path(path))


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be read ({error.strerror}). Restore the file, or its permissions."
        ) from error


def _parse_card(content: bytes, path: Path) -> DetectorCard:
    try:
        values = json.loads(content.decode("utf-8"))
    except ValueError as error:
        reason = one_line(error)
        raise ConfigError(
            f"{path}: not a readable JSON card ({reason}). Restore the file that came with the "
            f"weights."
        ) from error
    try:
        return DetectorCard.model_validate(values)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_first_complaint(error)}") from error


def write_card(card: DetectorCard, path: str | Path) -> None:
    """Write a card as indented JSON, whole or not at all."""
    alone = {"family"} if card.family is None else None
    write_text(Path(path), card.model_dump_json(indent=2, exclude=alone) + "\n")


@dataclass(frozen=True)
class Checkpoint:
    """Weights and card as they were read; equal = of the same bytes.

    Attributes:
        digest: 64 hexadecimal digits, SHA-256 over the SHA-256 digests of weights and card.
        path: of the weights; a family's file serves several cards.
        weights: that file's bytes.
        card_path: of the card.
        card: what it says.
    """

    digest: str
    path: Path = field(compare=False)
    weights: bytes = field(compare=False, repr=False)
    card_path: Path = field(compare=False)
    card: DetectorCard = field(compare=False)


def read_checkpoint(path: str | Path) -> Checkpoint:
    """Read a checkpoint's two files, each once.

    A family's file counts as a whole: another member's new head is another digest, too.

    Args:
        path: of ``<name>.safetensors``, with ``<name>.json`` beside it.

    Raises:
        ConfigError: the weights or the card are missing, or the card is damaged.
    """
    weights_path, beside = checkpoint_files(path)
    weights, card = _read_bytes(weights_path), _read_bytes(beside)
    parts = (hashlib.sha256(part).digest() for part in (weights, card))
    digest = hashlib.sha256(b"".join(parts)).hexdigest()
    return Checkpoint(digest, weights_path, weights, beside, _parse_card(card, beside))


def _first_complaint(error: ValidationError) -> str:
    """Say the first thing that is wrong in one line: key, what is wrong, cure."""
    first = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return f"the key {key} is missing. Add it to the card."
    if first["type"] == "extra_forbidden":
        return f"unknown key {key}. {_unknown_key_cure(first['loc'])}"
    reason = " ".join(first["msg"].removeprefix("Value error, ").split())
    if not key or key == "architecture":
        return f"{reason}. Correct the card."
    if key == "format_version":
        return (
            f"format_version is {first['input']!r}, this version reads {FORMAT_VERSION}. "
            f"Use the version of imodbatch that wrote the card."
        )
    return f"{key} is {str(first['input'])[:60]!r}: {reason}. Correct it in the card."


def _unknown_key_cure(location: tuple[int | str, ...]) -> str:
    """Suggest the key that was probably meant."""
    model = Architecture if location[0] == "architecture" else DetectorCard
    near = difflib.get_close_matches(str(location[-1]), model.model_fields, n=1)
    return f"Did you mean {near[0]}?" if near else "Remove it, or put it under data or figures."
