"""Batches from a stream: colour augmentation, windows, targets, and object crops for phase 1.

Each sample's augmentation has a random generator of its own, seeded by the recipe's seed and the
number of the draw. So a batch does not depend on which worker makes it, or on how many there are.
Images are never mirrored: a mirrored object seen from the left is not that object from the right.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from imodbatch.core.boxes import area, clip
from imodbatch.lab.learning.recipes import CropsSection, DataSection
from imodbatch.lab.learning.samples import Sample, Stream
from imodbatch.lab.learning.targets import (
    ImageTargets,
    JointViewTargets,
    ViewTargets,
    image_targets,
)

SMALLEST_CROP_PX = 12.0  # an object of fewer pixels shows no side
GREY = (127, 127, 127)
BARELY_SHOWN = 0.05
MOSTLY_SHOWN = 0.75
"""Shares of a box that lie in a window."""


@dataclass(frozen=True)
class ImageBatch:
    """Whole images: (H, W, 3) uint8 each, and the truth of each."""

    images: list[Tensor]
    targets: list[ImageTargets]


@dataclass(frozen=True)
class CropBatch:
    """Object crops: (C, S, S, 3) uint8, boxes (C, 4), class ids (C,), views (C, M·N)."""

    crops: Tensor
    rois: Tensor
    class_ids: Tensor
    views: Tensor


class Draws(Dataset[ImageBatch | CropBatch]):
    """The draws of a stream, augmented, one sample each, as a batch of one."""

    def __init__(
        self,
        stream: Stream,
        view_targets: ViewTargets | JointViewTargets,
        data: DataSection,
        seed: int,
        crops: CropsSection | None = None,
    ) -> None:
        """Keep what is needed; `crops` makes crops in place of whole images."""
        self._stream, self._view_targets = stream, view_targets
        self._data, self._seed, self._crops = data, seed, crops

    def __getitem__(self, draw: int) -> ImageBatch | CropBatch:
        """Make draw number `draw`."""
        rng = np.random.default_rng((self._seed, draw))
        sample = self._stream[draw]
        if self._data.window_size is not None:
            scale = _log_uniform(self._data.scale_range, rng)
            sample = cut_window(sample, self._data.window_size, scale, rng)
        image = change_colors(sample.image, self._data.color_jitter, self._data.noise_sigma, rng)
        if self._crops is not None:
            return cut_crops(sample, image, self._view_targets, self._crops, rng)
        return ImageBatch([torch.from_numpy(image)], [image_targets(sample, self._view_targets)])


class _DrawNumbers:
    """The draws of the remaining steps, as a batch sampler."""

    def __init__(self, first_draw: int, first_step: int, end_step: int, batch_size: int) -> None:
        self._first, self._batch_size = first_draw, batch_size
        self._steps = range(first_step, end_step)

    def __iter__(self) -> Iterator[list[int]]:
        for step in self._steps:
            start = self._first + step * self._batch_size
            yield list(range(start, start + self._batch_size))

    def __len__(self) -> int:
        return len(self._steps)


def open_loader(
    draws: Draws, batch_size: int, n_workers: int, first_draw: int, first_step: int, end_step: int
) -> DataLoader[ImageBatch | CropBatch]:
    """Open a loader that yields the batches of some steps, in order.

    Args:
        draws: what to draw from.
        batch_size: draws per step.
        n_workers: processes; 0 = this one.
        first_draw: number of step 0's first draw.
        first_step: the first step wanted.
        end_step: the step after the last.
    """
    # Here, not in the workers: OpenCV's threads do not survive the fork, and a worker that used or
    # stopped them would wait forever. torch itself gives each worker one thread.
    cv2.setNumThreads(1)
    numbers = _DrawNumbers(first_draw, first_step, end_step, batch_size)
    return DataLoader(
        draws,
        batch_sampler=numbers,  # type: ignore[arg-type]
        num_workers=n_workers,
        collate_fn=join_batches,
        prefetch_factor=4 if n_workers else None,
    )


def join_batches(parts: Sequence[ImageBatch | CropBatch]) -> ImageBatch | CropBatch:
    """Join batches of one kind."""
    images = [part for part in parts if isinstance(part, ImageBatch)]
    if images:
        return ImageBatch(
            [image for part in images for image in part.images],
            [target for part in images for target in part.targets],
        )
    crops = [part for part in parts if isinstance(part, CropBatch)]
    return CropBatch(
        torch.cat([part.crops for part in crops]),
        torch.cat([part.rois for part in crops]),
        torch.cat([part.class_ids for part in crops]),
        torch.cat([part.views for part in crops]),
    )


def to_float(pixels: Tensor) -> Tensor:
    """Turn (..., H, W, 3) uint8 into (..., 3, H, W) float in 0 to 1."""
    return pixels.movedim(-1, -3).to(torch.float32) / 255


def change_colors(
    image: NDArray[np.uint8], jitter: float, noise_sigma: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Change brightness, contrast and the balance of R, G, B, and add noise.

    Args:
        image: (H, W, 3) RGB.
        jitter: largest relative change; of the balance, half of it.
        noise_sigma: largest standard deviation of the noise, of 255.
        rng: where chance comes from.

    Returns:
        A new image.
    """
    if jitter == 0 and noise_sigma == 0:
        return np.array(image, order="C")
    gain = (1 + rng.uniform(-jitter, jitter)) * (1 + rng.uniform(-jitter / 2, jitter / 2, 3))
    contrast = 1 + rng.uniform(-jitter, jitter)
    level = np.arange(256)[:, None] * gain  # (256, 3): a table is much faster than arithmetic
    middle = image[::8, ::8].reshape(-1, 3).mean(axis=0) * gain
    table = np.clip(middle + (level - middle) * contrast, 0, 255)
    changed = cv2.LUT(image, np.ascontiguousarray(table[None].round().astype(np.uint8)))
    sigma = rng.uniform(0, noise_sigma)
    if sigma > 0.5:
        noise = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(sigma)
        changed = cv2.add(changed, noise, dtype=cv2.CV_8U)
    return np.asarray(changed, dtype=np.uint8)


def cut_window(
    sample: Sample, size: tuple[int, int], scale: float, rng: np.random.Generator
) -> Sample:
    """Resize an image and cut a window out that shows one of its objects, if it has any.

    Args:
        sample: image and truth.
        size: (width, height) of the window, pixels.
        scale: by which the image is resized before; more if it would not fill the window.
        rng: where chance comes from.

    Returns:
        The window. Boxes are clipped to it; one that lies outside by more than a quarter is
        ignored, one that barely shows is left out.
    """
    height, width = sample.image.shape[:2]
    scale = max(scale, size[0] / width, size[1] / height)
    boxes = sample.boxes.astype(np.float64) * scale
    corner = _window_corner(sample, boxes, size, scale, rng)
    matrix = np.array([[scale, 0, 0.5 * scale - 0.5], [0, scale, 0.5 * scale - 0.5]])
    matrix[:, 2] -= corner
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    image = cv2.warpAffine(sample.image, matrix, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
    moved = boxes - np.tile(corner, 2)
    clipped = clip(moved, *size)
    shown = area(clipped) / np.maximum(area(moved), 1e-9)
    kept = shown > BARELY_SHOWN
    return Sample(
        image.astype(np.uint8),
        clipped[kept].astype(np.float32),
        sample.class_ids[kept],
        sample.azimuth_rad[kept],
        sample.elevation_rad[kept],
        (sample.is_ignored | (shown < MOSTLY_SHOWN))[kept],
    )


def _window_corner(
    sample: Sample,
    boxes: NDArray[np.float64],
    size: tuple[int, int],
    scale: float,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Where a window begins: somewhere around an object, within the image."""
    room = np.array(sample.image.shape[1::-1]) * scale - np.array(size)
    counted = np.flatnonzero(~sample.is_ignored)
    if not len(counted):
        return np.floor(rng.random(2) * np.maximum(room, 0)).astype(np.int64)
    box = boxes[int(rng.choice(counted))]
    first = box[2:] - np.array(size)  # the window ends where the object does
    corner = first + rng.random(2) * (box[:2] - first)
    return np.floor(np.clip(corner, 0, np.maximum(room, 0))).astype(np.int64)


def _log_uniform(limits: tuple[float, float], rng: np.random.Generator) -> float:
    low, high = np.log(limits)
    return float(np.exp(rng.uniform(low, high)))


def cut_crops(
    sample: Sample,
    image: NDArray[np.uint8],
    view_targets: ViewTargets | JointViewTargets,
    config: CropsSection,
    rng: np.random.Generator,
) -> CropBatch:
    """Cut the objects of an image out.

    The object does not fill its crop: the network sees its surroundings, as it will in an image.
    It keeps its scale, so that it is as sharp as in an image, unless it is larger than wanted.
    The box handed on is the true one moved and scaled by up to `jitter`, as proposals are.
    """
    views = view_targets(sample)
    size = config.size_px
    crops, rois, kept = [], [], []
    for i, box in enumerate(sample.boxes.astype(np.float64)):
        side = float((box[2:] - box[:2]).max())
        if sample.is_ignored[i] or side < SMALLEST_CROP_PX:
            continue
        scale = min(1.0, config.largest_box_px / side)
        centre = (box[:2] + box[2:]) / 2
        room = size - config.largest_box_px
        shift = size / 2 - centre * scale + rng.uniform(-0.25, 0.25, 2) * room
        # OpenCV counts pixel centres from 0, ours are at +0.5.
        moved = shift + 0.5 * scale - 0.5
        matrix = np.array([[scale, 0, moved[0]], [0, scale, moved[1]]])
        crops.append(
            cv2.warpAffine(image, matrix, (size, size), flags=cv2.INTER_LINEAR, borderValue=GREY)
        )
        sides = np.tile((box[2:] - box[:2]) * scale, 2)
        error = rng.uniform(-config.jitter, config.jitter, 4) * sides / 2
        rois.append(np.clip(np.tile(shift, 2) + box * scale + error, 0, size))
        kept.append(i)
    pixels = np.stack(crops) if crops else np.zeros((0, size, size, 3), dtype=np.uint8)
    return CropBatch(
        torch.from_numpy(pixels.astype(np.uint8)),
        torch.from_numpy(np.array(rois, dtype=np.float32).reshape(-1, 4)),
        torch.from_numpy(sample.class_ids[kept].astype(np.int64)),
        views[kept],
    )
