"""Make the pictures of docs/gallery.md from folders that imodbatch has written.

Example:
    python docs/make_gallery.py --views ~/.cache/imodbatch/views --houses data/house_test \
        --synth data/synth --train data/house_train --variants --tables data/scenes_test
"""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from imodbatch.datasets.images import read_color
from imodbatch.lab.objects import OBJECTS
from imodbatch.lab.pictures.cutouts import Cutouts, load_cutouts
from imodbatch.lab.scene import render_view
from imodbatch.lab.tabletop.world import POOL
from imodbatch.lab.variants import RGBD5, make_instance

Rgb = tuple[int, int, int]
Box = tuple[float, float, float, float]

QUALITY = 72
GAP_PX = 4
WHITE: Rgb = (255, 255, 255)
BACKDROP: Rgb = (158, 166, 174)
INK: Rgb = (30, 30, 30)
BOX_COLORS: tuple[Rgb, ...] = ((255, 214, 10), (60, 230, 110), (90, 210, 255), (255, 130, 210))

AZIMUTHS_DEG = (0, 90, 180, 270)
ELEVATION_DEG = 30
OBJECT_COLUMNS = 2
OBJECT_SIZE_PX = (144, 104)

VARIANT_COLUMNS, VARIANT_SIZE_PX = 9, 100
TABLE_SIZE_PX = (304, 228)
WORLD_SIZE_PX = (304, 228)
TRAINING_SIZE_PX = (312, 234)
WINDOW_SIZE_PX = (384, 288)  # of the training's windows, and of its composed pictures
LEAST_SHARE = 0.4  # of a box inside a window, for it to be shown


@dataclass(frozen=True)
class Truth:
    """A true box of a frame, (x0, y0, x1, y1) in continuous pixels, and its label."""

    box: Box
    label: str


@dataclass(frozen=True)
class Frame:
    """A colour image's file and its true boxes, without the ignored ones."""

    path: Path
    truths: tuple[Truth, ...]


def main() -> None:
    """Write the pictures and print their sizes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", type=Path, help="renders of `imodbatch synth` (its --cache)")
    parser.add_argument("--houses", type=Path, help="houses of `imodbatch simulate`")
    parser.add_argument("--synth", type=Path, help="composed pictures of `imodbatch synth`")
    parser.add_argument("--train", type=Path, help="houses that a detector is trained on")
    parser.add_argument("--variants", action="store_true", help="objects of the five classes")
    parser.add_argument("--tables", type=Path, help="tables of `imodbatch simulate --layout`")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "images")
    options = parser.parse_args()
    if (options.synth is None) != (options.train is None):
        parser.error("--synth and --train make one picture: give both.")
    options.out.mkdir(parents=True, exist_ok=True)
    if options.views:
        save(objects_picture(options.views), options.out / "objects.jpg")
    if options.houses:
        save(worlds_picture(options.houses, n_frames=3), options.out / "worlds.jpg")
    if options.synth:
        picture = training_picture(options.synth, options.train, n_composed=8, n_windows=4)
        save(picture, options.out / "training.jpg")
    if options.variants:
        save(variants_picture(), options.out / "variants.jpg")
    if options.tables:
        save(tables_picture(options.tables), options.out / "tables.jpg")


def objects_picture(views: Path) -> Image.Image:
    """Each procedural object, in the catalogue's order, from four azimuths."""
    tables = [load_cutouts(table) for table in sorted(views.glob("*.json"))]
    cutouts = {table.class_name: table for table in tables}
    return tiled([object_tile(cutouts[name]) for name in OBJECTS], OBJECT_COLUMNS)


def object_tile(cutouts: Cutouts) -> Image.Image:
    """An object's name and, below, its views side by side, at one scale."""
    width, height = OBJECT_SIZE_PX
    font = ImageFont.load_default(15)
    tile = Image.new("RGB", (width * len(AZIMUTHS_DEG), height + 22), BACKDROP)
    draw = ImageDraw.Draw(tile)
    draw.rectangle((0, 0, tile.width, 21), fill=WHITE)
    draw.text((4, 2), cutouts.class_name, fill=INK, font=font)
    views = [Image.fromarray(cutouts.rgba(index)) for index in indices_of_views(cutouts)]
    scale = min(
        (width - 12) / max(view.width for view in views),
        (height - 8) / max(view.height for view in views),
    )
    for number, view in enumerate(views):
        small = view.resize(
            (round(view.width * scale), round(view.height * scale)), Image.Resampling.LANCZOS
        )
        left = width * number + (width - small.width) // 2
        tile.paste(small, (left, 22 + (height - small.height) // 2), small)
    return tile


def indices_of_views(cutouts: Cutouts) -> list[int]:
    """Of the cutouts nearest the shown azimuths and elevation."""
    above = np.abs(cutouts.elevation_rad - math.radians(ELEVATION_DEG))
    around = [np.angle(np.exp(1j * (cutouts.azimuth_rad - math.radians(a)))) for a in AZIMUTHS_DEG]
    return [int(np.argmin(np.hypot(angle, above))) for angle in around]


def worlds_picture(houses: Path, n_frames: int) -> Image.Image:
    """A row per house: frames spread over its drive, with the true boxes."""
    tiles = []
    for house in house_folders(houses):
        for frame in spread(frames_of(house), n_frames):
            image = Image.fromarray(read_color(frame.path))
            unlabelled = [Truth(truth.box, "") for truth in frame.truths]
            tiles.append(drawn(image, unlabelled, WORLD_SIZE_PX))
    return tiled(tiles, n_frames)


def training_picture(synth: Path, train: Path, n_composed: int, n_windows: int) -> Image.Image:
    """Composed pictures and, below, windows of house frames, with class names and azimuths."""
    tiles = []
    for frame in spread(frames_of(synth), n_composed):
        image = Image.fromarray(read_color(frame.path))
        tiles.append(drawn(image, frame.truths, TRAINING_SIZE_PX))
    houses = house_folders(train)
    for number in range(n_windows):
        frame = spread(frames_of(houses[number * len(houses) // n_windows]), 1)[0]
        image, truths = window(frame)
        tiles.append(drawn(image, truths, TRAINING_SIZE_PX))
    return tiled(tiles, 4)


def variants_picture() -> Image.Image:
    """A row per class: some of its test objects, each from another side."""
    tiles = []
    for class_name in RGBD5:
        for number in range(VARIANT_COLUMNS):
            model = make_instance(class_name, POOL["test"][0] + number)
            azimuth_rad = math.tau * number * 0.382
            rgba = render_view(model, azimuth_rad, math.radians(ELEVATION_DEG), VARIANT_SIZE_PX)
            tile = Image.new("RGB", (VARIANT_SIZE_PX, VARIANT_SIZE_PX), BACKDROP)
            tile.paste(Image.fromarray(rgba[..., :3]), mask=Image.fromarray(rgba[..., 3]))
            tiles.append(tile)
    return tiled(tiles, VARIANT_COLUMNS)


def tables_picture(tables: Path) -> Image.Image:
    """A frame of each of the first six walks about tables, with the true boxes and azimuths."""
    tiles = []
    for path in sorted(tables.glob("truth/*/*/annotations.json"))[:6]:
        frame = spread(frames_of(path.parent), 1)[0]
        tiles.append(drawn(Image.fromarray(read_color(frame.path)), frame.truths, TABLE_SIZE_PX))
    return tiled(tiles, 3)


def house_folders(houses: Path) -> list[Path]:
    """The houses of a folder, in the order of their numbers."""
    folders = [path.parent for path in houses.glob("house_*/annotations.json")]
    return sorted(folders, key=lambda folder: (len(folder.name), folder.name))


def frames_of(folder: Path) -> list[Frame]:
    """The frames of a folder that show at least one object."""
    document = json.loads((folder / "annotations.json").read_text(encoding="utf-8"))
    names = {category["id"]: category["name"] for category in document["categories"]}
    truths: dict[int, list[Truth]] = {}
    for entry in document["annotations"]:
        if entry.get("ignore") or entry.get("iscrowd"):
            continue
        left, top, width, height = entry["bbox"]
        label = f"{names[entry['category_id']]} {round(entry['azimuth_deg']) % 360}°"
        truth = Truth((left, top, left + width, top + height), label)
        truths.setdefault(entry["image_id"], []).append(truth)
    return [
        Frame(folder / image["file_name"], tuple(truths[image["id"]]))
        for image in document["images"]
        if image["id"] in truths
    ]


def spread(frames: Sequence[Frame], n_frames: int) -> list[Frame]:
    """From near the middle of each of `n_frames` equal runs, the one whose boxes are largest."""
    edges = [number * len(frames) // n_frames for number in range(n_frames + 1)]
    runs = []
    for start, stop in pairwise(edges):
        middle, reach = (start + stop) // 2, max(1, min(12, (stop - start) // 4))
        runs.append(frames[max(0, middle - reach) : middle + reach])
    return [max(run, key=lambda frame: sum(map(size_of, frame.truths))) for run in runs]


def size_of(truth: Truth) -> float:
    """The square root of the box's area, so that one large object does not outdo many."""
    x0, y0, x1, y1 = truth.box
    return math.sqrt((x1 - x0) * (y1 - y0))


def window(frame: Frame) -> tuple[Image.Image, list[Truth]]:
    """A part of a frame about the middle of its boxes, and the boxes that are mostly inside."""
    pixels: NDArray[np.uint8] = read_color(frame.path)
    width, height = WINDOW_SIZE_PX
    x0, y0, x1, y1 = np.mean([truth.box for truth in frame.truths], axis=0)
    left = int(np.clip((x0 + x1 - width) / 2, 0, pixels.shape[1] - width))
    top = int(np.clip((y0 + y1 - height) / 2, 0, pixels.shape[0] - height))
    moved = [moved_into(truth, left, top) for truth in frame.truths]
    inside = [
        after
        for before, after in zip(frame.truths, moved, strict=True)
        if size_of(after) ** 2 >= LEAST_SHARE * size_of(before) ** 2
    ]
    return Image.fromarray(pixels[top : top + height, left : left + width]), inside


def moved_into(truth: Truth, left: int, top: int) -> Truth:
    """The box in a window's pixels, clipped to it."""
    width, height = WINDOW_SIZE_PX
    shifted = np.subtract(truth.box, (left, top, left, top))
    x0, y0, x1, y1 = np.clip(shifted, 0, (width, height, width, height)).tolist()
    return Truth((x0, y0, x1, y1), truth.label)


def drawn(image: Image.Image, truths: Sequence[Truth], size_px: tuple[int, int]) -> Image.Image:
    """The image at another size with boxes one pixel wide and their labels."""
    scale = size_px[0] / image.width
    canvas = image.resize(size_px, Image.Resampling.LANCZOS)
    draw = ImageDraw.Draw(canvas)
    boxes = []
    for number, truth in enumerate(sorted(truths, key=size_of, reverse=True)):
        color = BOX_COLORS[number % len(BOX_COLORS)]
        x0, y0, x1, y1 = (scale * edge for edge in truth.box)
        draw.rectangle((x0, y0, min(x1, canvas.width) - 1, min(y1, canvas.height) - 1), None, color)
        boxes.append((truth.label, (x0, y0, x1, y1), color))
    taken: list[Box] = []
    for label, box, color in boxes:
        if label:
            taken.append(write_label(draw, label, box, color, taken))
    return canvas


def write_label(
    draw: ImageDraw.ImageDraw, label: str, box: Box, color: Rgb, taken: Sequence[Box]
) -> Box:
    """Write a label by its box, where no other label stands if there is such a place."""
    font = ImageFont.load_default(11)
    width, height = draw.textlength(label, font=font) + 3, 13
    picture_width, picture_height = draw.im.size
    x0, y0, x1, y1 = box
    places = [
        (x, y) for y in (y0 - height, y1, y0, y1 - height) for x in (x0, x1 - width, x0 - width, x1)
    ]
    kept = [
        (min(max(x, 0), picture_width - width), min(max(y, 0), picture_height - height))
        for x, y in places
    ]
    rectangles: list[Box] = [(x, y, x + width, y + height) for x, y in kept]
    chosen = min(rectangles, key=lambda place: sum(shared_area(place, other) for other in taken))
    draw.rectangle((chosen[0], chosen[1], chosen[2] - 1, chosen[3] - 1), fill=color)
    draw.text((chosen[0] + 1, chosen[1] - 1), label, fill=INK, font=font)
    return chosen


def shared_area(first: Box, second: Box) -> float:
    """Area of the intersection of two boxes."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    return max(width, 0.0) * max(height, 0.0)


def tiled(tiles: Sequence[Image.Image], n_columns: int) -> Image.Image:
    """Equal pictures in rows on white."""
    width, height = (side + GAP_PX for side in tiles[0].size)
    n_rows = math.ceil(len(tiles) / n_columns)
    sheet = Image.new("RGB", (width * n_columns - GAP_PX, height * n_rows - GAP_PX), WHITE)
    for number, tile in enumerate(tiles):
        row, column = divmod(number, n_columns)
        sheet.paste(tile, (column * width, row * height))
    return sheet


def save(picture: Image.Image, path: Path) -> None:
    """Write a JPEG and say how large it is."""
    settings: dict[str, Any] = {"quality": QUALITY, "optimize": True, "progressive": True}
    picture.save(path, **settings)
    print(f"{path}: {picture.width} x {picture.height}, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
