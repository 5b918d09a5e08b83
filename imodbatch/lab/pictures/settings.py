"""What training pictures are like: size, objects, overlaps, light and blending."""

from dataclasses import dataclass

from imodbatch.core.errors import ConfigError
from imodbatch.lab.pictures.blending import BLENDINGS


@dataclass(frozen=True)
class ComposeSettings:
    """What a training picture is like; defaults are the paper's where it says (Sec. 3.3).

    Attributes:
        width_px: of the picture.
        height_px: of the picture.
        min_objects: in a picture that has any.
        max_objects: `min_objects` to this many objects, equally often.
        empty_share: share of pictures without any object.
        scale_range: of an object's longer side over the picture's shorter side; log-uniform.
        max_iou: largest overlap of two boxes.
        min_inside: share of an object's box that lies in the picture at least.
        ignore_below: an object of which less is visible is marked `ignore`.
        shadow_share: share of objects with a shadow where they stand.
        blendings: one of these for each picture.
        photometric: whether colours, noise and sharpness vary.
    """

    width_px: int = 480
    height_px: int = 360
    min_objects: int = 1
    max_objects: int = 5
    empty_share: float = 0.02
    scale_range: tuple[float, float] = (0.1, 1.0)
    max_iou: float = 0.75
    min_inside: float = 0.3
    ignore_below: float = 0.4
    shadow_share: float = 0.6
    blendings: tuple[str, ...] = tuple(BLENDINGS)
    photometric: bool = True

    def __post_init__(self) -> None:
        low, high = self.scale_range
        if not 0 < low <= high:
            raise ConfigError(f"scale_range: expected 0 < low ≤ high, found {self.scale_range}.")
        if not 1 <= self.min_objects <= self.max_objects:
            raise ConfigError(
                f"min_objects, max_objects: expected 1 ≤ min ≤ max, found {self.min_objects} and "
                f"{self.max_objects}."
            )
        if min(self.width_px, self.height_px) < 32:
            raise ConfigError(
                f"Pictures of {self.width_px} x {self.height_px} px are too small; "
                "32 px a side is the least."
            )
        if not self.blendings or set(self.blendings) - set(BLENDINGS):
            raise ConfigError(
                f"blendings: expected some of {', '.join(BLENDINGS)}, found {self.blendings}."
            )
