"""What a training learns from: images with boxes and viewpoints.

Every source is a `Stream`: an endless, numbered row of samples. Draw number n is the same sample in
every run, whichever worker process makes it, so a training that is resumed sees exactly the images
that it would have seen without the break, and two trainings with the same seed see the same ones.

A COCO folder is read as `imodbatch synth` writes it: one JSON file with "images", "annotations"
and "categories"; an annotation carries `bbox`, `category_id`, and, where the viewpoint is known,
`azimuth_deg` and `elevation_deg` in the object's own frame; `ignore` or `iscrowd` marks what counts
neither way; a category may carry `symmetry`: "none", "full", or the number of turns that map it
onto itself. Angles are kept continuous, so that one folder serves every viewpoint grid.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.core.symmetry import Symmetry
from imodbatch.datasets.coco import CocoBox, CocoFile, JsonId
from imodbatch.datasets.images import read_color

JSON_NAMES = ("annotations.json", "coco.json", "instances.json")


@dataclass(frozen=True)
class Sample:
    """One image and what is in it.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        boxes: (n, 4) float32 x0 y0 x1 y1, continuous pixels.
        class_ids: (n,) int64 in 0..K-1.
        azimuth_rad: (n,) float32 from where the object is seen, in its own frame; NaN = unknown.
        elevation_rad: (n,) float32 above the horizon; NaN = unknown.
        is_ignored: (n,) bool, boxes that are neither object nor background.
    """

    image: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    class_ids: NDArray[np.int64]
    azimuth_rad: NDArray[np.float32]
    elevation_rad: NDArray[np.float32]
    is_ignored: NDArray[np.bool_]


class Stream(Protocol):
    """An endless, numbered row of samples.

    Attributes:
        classes: the K category names.
        symmetries: the symmetry of each.
    """

    classes: tuple[str, ...]
    symmetries: tuple[Symmetry, ...]

    def __getitem__(self, draw: int) -> Sample:
        """Make sample number `draw`, always the same one."""
        ...

    def describe(self) -> dict[str, Any]:
        """What the card says of the data."""
        ...


class CocoStream:
    """The images of a COCO folder, shuffled anew in every round.

    Attributes:
        path: the folder, or the JSON file that was named.
        classes: category names, by ascending id.
        symmetries: the symmetry of each.
        n_images: images in the folder.
    """

    def __init__(self, folder: str | Path, seed: int | None = 0) -> None:
        """Read the folder's JSON.

        Args:
            folder: holds the images and one COCO JSON, or folders of that kind, such as the
                sequences of `imodbatch simulate --world house`; or is a JSON file's own path.
            seed: of the shuffling; None = the order of the files.

        Raises:
            DataError: there is no such file, it is not COCO's, or two name different classes.
        """
        self.path = Path(folder)
        self.classes: tuple[str, ...] = ()
        self.symmetries: tuple[Symmetry, ...] = ()
        self._files: list[Path] = []
        self._labels: list[_Labels] = []
        for path in _find_jsons(self.path):
            self._read(CocoFile(path, "--data"))
        if not self._files:
            raise DataError(f"{self.path}: lists no images. Run `imodbatch synth` again.")
        self._seed = seed
        self._round: tuple[int, NDArray[np.int64]] = (-1, np.zeros(0, dtype=np.int64))

    def _read(self, file: CocoFile) -> None:
        categories = sorted(
            file.categories.items(), key=lambda item: (isinstance(item[0], str), item[0])
        )
        classes = tuple(category.name for _, category in categories)
        symmetries = tuple(category.symmetry or "none" for _, category in categories)
        if self._files and (classes, symmetries) != (self.classes, self.symmetries):
            raise DataError(
                f"{file.path}: its classes are not those of the files beside it. Make them the "
                "same."
            )
        self.classes, self.symmetries = classes, symmetries
        class_of = {identifier: k for k, (identifier, _) in enumerate(categories)}
        boxes: dict[JsonId, list[CocoBox]] = {identifier: [] for identifier in file.images}
        for box in file.boxes():
            boxes[box.image_id].append(box)
        self._files += [file.path.parent / image.file_name for image in file.images.values()]
        self._labels += [_labels(own, class_of) for own in boxes.values()]

    @property
    def name(self) -> str:
        """The folder's own name."""
        return (self.path.parent if self.path.is_file() else self.path).resolve().name

    @property
    def n_images(self) -> int:
        """Images in the folder."""
        return len(self._files)

    def read(self, index: int) -> Sample:
        """Read the image at a position of the file."""
        return Sample(read_color(self._files[index]), *self._labels[index])

    def __getitem__(self, draw: int) -> Sample:
        """Read draw number `draw` of the shuffled, repeated folder."""
        number, position = divmod(draw, self.n_images)
        if self._seed is None:
            return self.read(position)
        if self._round[0] != number:
            order = np.random.default_rng((self._seed, number)).permutation(self.n_images)
            self._round = (number, order)
        return self.read(int(self._round[1][position]))

    def describe(self) -> dict[str, Any]:
        """What the card says of the data."""
        n_boxes = sum(len(labels[0]) for labels in self._labels)
        return {"folder": self.name, "n_images": self.n_images, "n_boxes": n_boxes}


class MixedStream:
    """Several streams of the same classes, drawn from by chance.

    Attributes:
        classes: the K category names.
        symmetries: the symmetry of each.
    """

    def __init__(
        self, streams: Sequence[Stream], shares: Sequence[float] = (), seed: int = 0
    ) -> None:
        """Keep the streams.

        Args:
            streams: at least one.
            shares: how often each is drawn from, of any sum; empty = equally often.
            seed: of the choice.

        Raises:
            ConfigError: the streams' classes differ, or there are not as many shares as streams.
        """
        first = streams[0]
        for other in streams[1:]:
            if (other.classes, other.symmetries) != (first.classes, first.symmetries):
                raise ConfigError(
                    f"--data: {first.describe()['folder']} and {other.describe()['folder']} name "
                    f"different classes or symmetries. Make them the same, in the same order."
                )
        if shares and len(shares) != len(streams):
            raise ConfigError(
                f"data.shares: expected one per --data, {len(streams)} in all, found {len(shares)}."
            )
        self.classes, self.symmetries = first.classes, first.symmetries
        self._streams = tuple(streams)
        weights = np.array(shares or np.ones(len(streams)), dtype=np.float64)
        self._shares = weights / weights.sum()
        self._seed = seed

    def __getitem__(self, draw: int) -> Sample:
        """Make sample number `draw` of the stream that its number falls on."""
        chosen = np.random.default_rng((self._seed, draw)).choice(
            len(self._streams), p=self._shares
        )
        return self._streams[int(chosen)][draw]

    def describe(self) -> dict[str, Any]:
        """What the card says of the data."""
        parts = zip(self._streams, self._shares.tolist(), strict=True)
        return {"mixture": [{**s.describe(), "share": round(share, 4)} for s, share in parts]}


_Labels = tuple[
    NDArray[np.float32],
    NDArray[np.int64],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.bool_],
]


def _labels(found: list[CocoBox], class_of: dict[JsonId, int]) -> _Labels:
    """Turn the annotations of an image into arrays; a box without area is left out."""
    kept = [box for box in found if min(box.bbox[2:]) > 0]
    boxes = np.array([box.bbox for box in kept], dtype=np.float32).reshape(-1, 4)
    boxes[:, 2:] += boxes[:, :2]
    # An angle that is not given is None, which becomes NaN.
    azimuth_deg = np.array([box.azimuth_deg for box in kept], dtype=np.float64)
    elevation_deg = np.array([box.elevation_deg for box in kept], dtype=np.float64)
    return (
        boxes,
        np.array([class_of[box.category_id] for box in kept], dtype=np.int64),
        np.radians(azimuth_deg).astype(np.float32),
        np.radians(elevation_deg).astype(np.float32),
        np.array([box.ignore or box.iscrowd for box in kept], dtype=np.bool_),
    )


def _find_jsons(path: Path) -> list[Path]:
    """The file itself, the one of a folder, or the ones of the folders in it, two levels deep."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise DataError(f"{path}: no such folder. Write one with `imodbatch synth`.")
    inner = sorted(
        file
        for name in JSON_NAMES
        for depth in ("*", "*/*")
        for file in path.glob(f"{depth}/{name}")
    )
    has_own = any((path / name).is_file() for name in JSON_NAMES)
    return inner if inner and not has_own else [_find_json(path)]


def _find_json(path: Path) -> Path:
    named = [path / name for name in JSON_NAMES if (path / name).is_file()]
    found = named or sorted(path.glob("*.json"))
    if len(found) != 1:
        raise DataError(
            f"{path}: expected one COCO file ({', '.join(JSON_NAMES)}), found "
            f"{', '.join(file.name for file in found) or 'none'}. Name the JSON file itself."
        )
    return found[0]
