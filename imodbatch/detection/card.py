"""The card of a detector: everything besides the weights that is needed to use and to trust it.

The card fixes the architecture (so that the weights fit), the meaning of the outputs (classes and
viewpoint grid) and the record of how the weights came to be. Detectors of one training are a
family: their cards name one file, which holds what they share once.

Column order, stated here and nowhere else: the network has K·M·N + 1 exclusive outputs; the first
K·M·N are in C order of [class, elevation, azimuth], so that
``scores.reshape(K, M, N)[k, e, b]`` is class k seen from elevation bin e and azimuth bin b; the
background is the LAST column.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from imodbatch.settings.toml import StrictModel

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


class Architecture(StrictModel):
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


class Family(StrictModel):
    """Where the weights of a detector lie that shares most of them with others.

    Attributes:
        file: of the family's weights, beside the card.
        member: which one this is. A tensor ``<member>/<name>`` is this detector's own; one without
            a slash is every member's.
    """

    file: Annotated[str, Field(pattern=r"^[^/\\]+\.safetensors$")]
    member: Annotated[str, Field(pattern=r"^[^/]+$")]


class DetectorCard(StrictModel):
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
