"""Frames drawn from a sequence: evenly over it, in groups so near in time that views overlap."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage, register
from imodbatch.core.errors import DataError
from imodbatch.datasets.base import CameraModel, FrameFile
from imodbatch.datasets.images import read_color, read_depth
from imodbatch.poses.rgbd.features import FeatureExtractor, Features
from imodbatch.poses.rgbd.gray import Gray, to_gray
from imodbatch.poses.rgbd.matching import mutual_matches
from imodbatch.settings.manifest import Manifest

Array = NDArray[np.float64]
Pairs = list[tuple[int, int]]
Item = TypeVar("Item")
N_FEATURES = 700
OFFSETS = ((0, 4, 12), (0, 2, 6), (0, 1, 3), (0, 1, 2))
"""Of the frames of a group; the closest are for robots that move far between frames."""
FEWEST_MATCHES = 60


@dataclass(frozen=True, eq=False)
class View:
    """A frame of the sample.

    Attributes:
        position: its place among the frames of the sequence.
        gray: (H, W) uint8.
        depth_m: (H_d, W_d) in the depth camera, NaN = unknown.
        camera: both cameras, as the manifest has them.
    """

    position: int
    gray: Gray
    depth_m: DepthImage
    camera: CameraModel

    @cached_property
    def features(self) -> Features:
        """ORB features, with the depth behind them as the manifest registers it."""
        extractor = FeatureExtractor(self.camera.color, N_FEATURES)
        return extractor.extract(self.gray, self.registered_m)

    @cached_property
    def registered_m(self) -> DepthImage:
        """(H, W) depth in the colour camera."""
        return registered(self.depth_m, self.camera)


def registered(depth_m: DepthImage, model: CameraModel) -> DepthImage:
    """Depth in the colour camera."""
    return register(depth_m, model.depth, model.color, model.color_from_depth)


@dataclass(frozen=True, eq=False)
class Sample:
    """The views of a sequence that could be read, and pairs of them that overlap.

    Attributes:
        views: by position.
        pairs: positions a < b.
    """

    views: dict[int, View]
    pairs: Pairs


def draw(
    n_frames: int,
    n_wanted: int,
    read: Callable[[int], View | None],
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Sample:
    """Draw a sample of about `n_wanted` of `n_frames` frames.

    Args:
        n_frames: of the sequence.
        n_wanted: how many to read.
        read: position → view, None = unreadable.
        progress: wraps the positions that are read.
    """
    cache: dict[int, View | None] = {}

    def view(position: int) -> View | None:
        if position not in cache:
            cache[position] = read(position)
        return cache[position]

    offsets = _offsets(n_frames, view)
    starts = _starts(n_frames, max(n_wanted // len(offsets), 1), offsets[-1])
    pairs: Pairs = []
    for start in progress(starts):
        group = [p for p in (start + o for o in offsets) if p < n_frames and view(p) is not None]
        pairs += [(a, b) for i, a in enumerate(group) for b in group[i + 1 :]]
    views = {p: v for p, v in sorted(cache.items()) if v is not None}
    return Sample(views, sorted(set(pairs)))


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """At most so many of the items, evenly spread, both ends included."""
    if not items:
        return []
    rows = np.unique(np.linspace(0, len(items) - 1, most).round().astype(int))
    return [items[row] for row in rows]


def _offsets(n_frames: int, view: Callable[[int], View | None]) -> tuple[int, ...]:
    """The widest group whose ends share enough features at three places of the sequence."""
    for offsets in OFFSETS:
        span = offsets[-1]
        if span >= n_frames:
            continue
        shared = []
        for start in _starts(n_frames, 3, span):
            first, last = view(start), view(start + span)
            if first is not None and last is not None:
                rows, _ = mutual_matches(first.features.descriptors, last.features.descriptors)
                shared.append(len(rows))
        if shared and np.median(shared) >= FEWEST_MATCHES:
            return offsets
    return OFFSETS[-1]


def _starts(n_frames: int, n_groups: int, span: int) -> list[int]:
    """First positions of groups, evenly spread."""
    return evenly(range(max(n_frames - span, 1)), n_groups)


def reader(
    manifest: Manifest, files: list[FrameFile], model: CameraModel
) -> Callable[[int], View | None]:
    """Position → view; None = no depth, an unreadable image or one of another size."""

    def read(position: int) -> View | None:
        file = files[position]
        if file.depth_path is None:
            return None
        root = manifest.root_path
        try:
            color = read_color(root / file.color_path)
            depth_m = read_depth(root / file.depth_path, model.depth_scale_m, model.depth_invalid)
        except DataError:  # the check of the files names them
            return None
        if not (_fits(color, model.color) and _fits(depth_m, model.depth)):
            return None
        return View(position, to_gray(color), depth_m, model)

    return read


def _fits(image: NDArray[np.generic], camera: PinholeCamera) -> bool:
    return image.shape[:2] == (camera.height_px, camera.width_px)
