"""The frames of one sequence as the engines that estimate poses take them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage

ColorImage = NDArray[np.uint8]


@dataclass(frozen=True)
class RgbdFrames:
    """F frames of one camera, in order.

    Attributes:
        sequence_id: names the sequence in errors.
        frame_index: (F,) the dataset's own numbers, rising.
        timestamp_ns: (F,) moments, None = unknown.
        camera: the colour camera; depth is registered into it.
        color_files: F files.
        read_color: position → (H, W, 3) RGB, None = missing or damaged.
        read_depth: position → (H, W) metres in the colour camera, NaN = unknown; None likewise.
    """

    sequence_id: str
    frame_index: NDArray[np.int64]
    timestamp_ns: NDArray[np.int64] | None
    camera: PinholeCamera
    color_files: tuple[Path, ...]
    read_color: Callable[[int], ColorImage | None]
    read_depth: Callable[[int], DepthImage | None]

    def __len__(self) -> int:
        return len(self.frame_index)
