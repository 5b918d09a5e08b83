"""Index → a training picture with labels: objects cut out of their renders, pasted on a background.

Picture i depends on the recipe's seed and on i alone, so pictures can be made in any order, by any
number of processes, on the fly or to disk.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.boxes import clip
from imodbatch.core.errors import ConfigError
from imodbatch.core.symmetry import Symmetry
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.masks import bounds_of
from imodbatch.lab.pictures.backgrounds import random_background
from imodbatch.lab.pictures.blending import BLENDINGS, SILHOUETTE, Patch, contact_shadow
from imodbatch.lab.pictures.cutouts import Cutouts, load_cutouts, resize_cutout
from imodbatch.lab.pictures.photometry import jitter_image, jitter_object
from imodbatch.lab.pictures.placing import random_corner, random_scale
from imodbatch.lab.pictures.settings import ComposeSettings

Pixels = NDArray[np.uint8]
NOBODY = -1
DISTRACTOR = -1
"""The class number of an object that is of no class."""
DISTRACTOR_SHARE = 0.4
"""Of the pasted objects, where there are distractors: pasted alone must not mean wanted."""


class Picture(NamedTuple):
    """A training picture and what is in it, one row per object.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        boxes: (n, 4) float32 x0 y0 x1 y1, continuous pixels: of the whole object, hidden parts
            too, clipped to the picture.
        class_ids: (n,) int64.
        elevation_bins: (n,) int64.
        azimuth_bins: (n,) int64, as rendered, also where symmetry makes them meaningless.
        ignore: (n,) bool: too little of it is visible.
        azimuth_rad: (n,) float32 in [0, 2π).
        elevation_rad: (n,) float32.
        visibility: (n,) float32: share of the object's pixels that is in the picture and not
            covered by another.
        instances: which object of its class.
        scales: (n,) float32: longer side over the picture's shorter side.
        blending: how they were pasted.
    """

    image: Pixels
    boxes: NDArray[np.float32]
    class_ids: NDArray[np.int64]
    elevation_bins: NDArray[np.int64]
    azimuth_bins: NDArray[np.int64]
    ignore: NDArray[np.bool_]
    azimuth_rad: NDArray[np.float32]
    elevation_rad: NDArray[np.float32]
    visibility: NDArray[np.float32]
    instances: tuple[str, ...]
    scales: NDArray[np.float32]
    blending: str


class Composer:
    """Pictures by index, and what their class numbers mean.

    Attributes:
        class_names: in the order of the class numbers.
        symmetries: of each class.
    """

    def __init__(
        self,
        cutouts: Sequence[Cutouts],
        backgrounds: Sequence[Path],
        grid: ViewGrid,
        settings: ComposeSettings | None = None,
        seed: int = 0,
        distractors: Sequence[Cutouts] = (),
    ) -> None:
        """Keep what pictures are made of.

        Args:
            cutouts: objects; classes are numbered as they first appear.
            backgrounds: picture files.
            grid: of the labels. It does not change the pictures: the same seed gives the same
                ones for every grid.
            settings: what pictures are like.
            seed: another seed, other pictures.
            distractors: objects that are pasted too, and have no label.

        Raises:
            ConfigError: there are no cutouts or no backgrounds.
        """
        if not cutouts or not backgrounds:
            raise ConfigError("Pictures need at least one object and one background; found none.")
        self.settings = settings or ComposeSettings()
        self.grid = grid
        self.seed = seed
        self.backgrounds = tuple(backgrounds)
        self.distractors = tuple(distractors)
        self.class_names = tuple(dict.fromkeys(c.class_name for c in cutouts))
        self.instances = tuple(
            tuple(c for c in cutouts if c.class_name == name) for name in self.class_names
        )
        self.symmetries: tuple[Symmetry, ...] = tuple(own[0].symmetry for own in self.instances)
        cv2.setNumThreads(1)  # one picture at a time per process; threads would only fight

    def __call__(self, index: int) -> Picture:
        """Same as `compose`."""
        return self.compose(index)

    def compose(self, index: int) -> Picture:
        """Picture number `index`."""
        how = self.settings
        rng = np.random.default_rng([self.seed, index])
        image = random_background(self.backgrounds, how.width_px, how.height_px, rng)
        blending = how.blendings[int(rng.integers(len(how.blendings)))]
        is_empty = rng.random() < how.empty_share
        n_some = how.min_objects + int(rng.integers(how.max_objects - how.min_objects + 1))
        n_wanted = 0 if is_empty else n_some
        owner = np.full(image.shape[:2], NOBODY, np.int8)
        placed: list[_Placed] = []
        for _ in range(n_wanted):
            new = self._place(placed, rng)
            if new is None:
                continue
            if rng.random() < how.shadow_share:
                contact_shadow(image, new.patch, new.elevation_rad, rng)
            BLENDINGS[blending](image, new.patch, rng)
            (rows, columns), own = new.patch.window(image)
            owner[rows, columns][new.silhouette[own]] = len(placed)
            placed.append(new)
        if how.photometric:
            image = jitter_image(image, rng)
        return self._labelled(image, placed, owner, blending)

    def random_cutout(self, rng: np.random.Generator) -> tuple[int, Cutouts, int]:
        """Class number, object and view; classes, a class's objects and their views evenly."""
        if self.distractors and rng.random() < DISTRACTOR_SHARE:
            cutouts = self.distractors[int(rng.integers(len(self.distractors)))]
            return DISTRACTOR, cutouts, int(rng.integers(len(cutouts)))
        class_id = int(rng.integers(len(self.instances)))
        own = self.instances[class_id]
        cutouts = own[int(rng.integers(len(own)))]
        return class_id, cutouts, int(rng.integers(len(cutouts)))

    def _place(self, placed: "list[_Placed]", rng: np.random.Generator) -> "_Placed | None":
        how = self.settings
        class_id, cutouts, view = self.random_cutout(rng)
        scale = random_scale(how.scale_range, rng)
        rgba = resize_cutout(cutouts.rgba(view), scale * min(how.width_px, how.height_px))
        if how.photometric:
            rgba = jitter_object(rgba, rng)
        silhouette = rgba[..., 3] >= SILHOUETTE
        bounds = bounds_of(silhouette)
        if bounds is None:
            return None
        taken = np.array([p.clipped_box for p in placed], np.float64).reshape(-1, 4)
        left, top, right, bottom = bounds
        corner = random_corner(
            right - left, bottom - top, how.width_px, how.height_px,
            taken, how.max_iou, how.min_inside, rng,
        )  # fmt: skip
        if corner is None:
            return None
        x, y = corner
        box = np.array([[x, y, x + right - left, y + bottom - top]], np.float64)
        return _Placed(
            Patch(rgba, x - left, y - top),
            silhouette,
            clip(box, how.width_px, how.height_px)[0],
            class_id,
            cutouts.instance,
            float(cutouts.azimuth_rad[view]),
            float(cutouts.elevation_rad[view]),
            max(right - left, bottom - top) / min(how.width_px, how.height_px),
        )

    def _labelled(
        self, image: Pixels, placed: "list[_Placed]", owner: NDArray[np.int8], blending: str
    ) -> Picture:
        visible = np.array([np.count_nonzero(owner == i) for i in range(len(placed))], np.float64)
        is_wanted = np.array([p.class_id != DISTRACTOR for p in placed], np.bool_)
        visible, placed = visible[is_wanted], [p for p in placed if p.class_id != DISTRACTOR]
        azimuth = np.array([p.azimuth_rad for p in placed], np.float64)
        elevation = np.array([p.elevation_rad for p in placed], np.float64)
        whole = np.array([np.count_nonzero(p.silhouette) for p in placed], np.float64)
        visibility = visible / whole
        return Picture(
            image=image,
            boxes=np.array([p.clipped_box for p in placed], np.float32).reshape(-1, 4),
            class_ids=np.array([p.class_id for p in placed], np.int64),
            elevation_bins=self.grid.elevation_bins(elevation),
            azimuth_bins=self.grid.azimuth_bins(azimuth),
            ignore=visibility < self.settings.ignore_below,
            azimuth_rad=azimuth.astype(np.float32),
            elevation_rad=elevation.astype(np.float32),
            visibility=visibility.astype(np.float32),
            instances=tuple(p.instance for p in placed),
            scales=np.array([p.scale for p in placed], np.float32),
            blending=blending,
        )


@dataclass(frozen=True)
class Recipe:
    """All that pictures depend on, small enough to send to another process.

    Attributes:
        cutouts: JSON files of `write_cutouts`.
        backgrounds: picture files.
        grid: of the labels.
        settings: what pictures are like.
        seed: another seed, other pictures.
        distractors: JSON files of objects that have no label.
    """

    cutouts: tuple[Path, ...]
    backgrounds: tuple[Path, ...]
    grid: ViewGrid
    settings: ComposeSettings = field(default_factory=ComposeSettings)
    seed: int = 0
    distractors: tuple[Path, ...] = ()

    def composer(self) -> Composer:
        """Open the cutouts; the PNGs stay on disk and are shared between processes."""
        cutouts = [load_cutouts(path) for path in self.cutouts]
        others = [load_cutouts(path) for path in self.distractors]
        return Composer(cutouts, self.backgrounds, self.grid, self.settings, self.seed, others)


@dataclass(frozen=True, eq=False)
class _Placed:
    """An object in a picture; `clipped_box` (4,) is that of its silhouette."""

    patch: Patch
    silhouette: NDArray[np.bool_]
    clipped_box: NDArray[np.float64]
    class_id: int
    instance: str
    azimuth_rad: float
    elevation_rad: float
    scale: float
