"""What a layout gives: the frames of a sequence as files, its cameras, and poses as read."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.settings.manifest import Manifest, SequenceSection

NS_PER_S, NS_PER_MS = 1_000_000_000, 1_000_000


@dataclass(frozen=True)
class FrameFile:
    """One frame on disk.

    Attributes:
        frame_index: the dataset's own frame number.
        timestamp_ns: moment of the colour image, None = unknown.
        color_path: relative to the manifest's root, with forward slashes.
        depth_path: likewise, None = no depth image.
    """

    frame_index: int
    timestamp_ns: int | None
    color_path: str
    depth_path: str | None


@dataclass(frozen=True)
class Footage:
    """What boxes of a sequence are drawn in.

    Attributes:
        manifest: the split.
        sequence: one of its sequences.
        frames: the frames of the sequence's slice.
        size_px: width and height of the colour images.
    """

    manifest: Manifest
    sequence: SequenceSection
    frames: Sequence[FrameFile]
    size_px: tuple[int, int]


@dataclass(frozen=True)
class CameraModel:
    """Both cameras of a dataset and what the numbers of its depth images mean."""

    color: PinholeCamera
    depth: PinholeCamera
    depth_scale_m: float
    depth_invalid: tuple[int, ...]
    color_from_depth: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Odometry:
    """Poses as a dataset gives them, in its own order.

    Attributes:
        world_from_color: (P, 4, 4) of the colour camera, as read: not yet checked.
        timestamp_ns: (P,) moments, or None when poses belong to frames by number.
        frame_index: (P,) frame numbers, or None when poses belong to frames by moment.
    """

    world_from_color: NDArray[np.float64]
    timestamp_ns: NDArray[np.int64] | None = None
    frame_index: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Reading:
    """Rows read from a file, and what was left out of it and why.

    Attributes:
        rows: dictionaries of a table's columns, without `sequence_id`.
        left_out: reason → number of entries of the file that gave no row.
    """

    rows: list[dict[str, Any]]
    left_out: Counter[str] = field(default_factory=Counter)


def nanoseconds(text: str, unit_ns: int = NS_PER_S) -> int:
    """A moment as printed → nanoseconds; a float would be 100 ns off today's clock in seconds.

    Raises:
        ValueError: it is no finite number, or lies more than 146 years from 0.
    """
    try:
        moment = Decimal(text)
    except InvalidOperation:
        raise ValueError(f"{text[:30]!r} is no number") from None
    if not moment.is_finite() or abs(moment) > 2**62 // unit_ns:
        unit = "seconds" if unit_ns == NS_PER_S else "nanoseconds"
        raise ValueError(f"{text[:30]!r} is no moment in {unit}")
    return int((moment * unit_ns).to_integral_value())
