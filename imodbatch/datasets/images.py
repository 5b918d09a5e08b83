"""Image files: colour → (H, W, 3) uint8 RGB; depth → (H, W) float32 metres, NaN = none."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from imodbatch.core.depth import DepthImage
from imodbatch.core.errors import DataError

FORMATS = ("PNG", "JPEG", "TIFF", "PPM", "BMP", "WEBP")  # by content, not by name; PPM: PGM, too
DEPTH_MODES = ("I;16", "I;16B", "I")  # how Pillow names 16-bit grey; "I" when it widens to 32 bit
JPEG_SCAN, JPEG_END = b"\xff\xda", b"\xff\xd9"
DAMAGE = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


class UnreadableImageError(DataError):
    """An image file that is missing or damaged: a fault of one frame, not of the dataset."""


def read_color(path: Path) -> NDArray[np.uint8]:
    """A colour image, (H, W, 3) RGB; grey images are repeated, alpha is dropped.

    Raises:
        UnreadableImageError: the file is missing, damaged or no image.
        DataError: it has one channel of 16 bits or more, which 8 bits cannot show.
    """
    image = _decode(path)
    check_color_mode(path, image.mode)
    return np.asarray(image.convert("RGB"), dtype=np.uint8)


def read_depth(path: Path, scale_m: float, invalid: tuple[int, ...]) -> DepthImage:
    """A 16-bit depth image in metres, (H, W), NaN where its number is 0 or in `invalid`.

    Args:
        path: PNG or another lossless format with one 16-bit channel.
        scale_m: metres per unit.
        invalid: further numbers that mean "no depth".

    Raises:
        UnreadableImageError: the file is missing, damaged or no image.
        DataError: it has not one 16-bit channel.
    """
    image = _decode(path)
    check_depth_mode(path, image.mode)
    raw = np.asarray(image)
    depth_m = raw.astype(np.float32) * np.float32(scale_m)
    depth_m[(raw <= 0) | np.isin(raw, invalid)] = np.nan
    return depth_m


def check_depth_mode(path: Path, mode: str) -> None:
    """Refuse a depth image of 8 bits or several channels."""
    if mode not in DEPTH_MODES:
        raise DataError(
            f"{path}: expected a 16-bit single-channel depth image, found Pillow mode {mode!r} "
            "(8 bits or colour: a preview?). Point the manifest at the raw depth images."
        )


def check_color_mode(path: Path, mode: str) -> None:
    """Refuse a colour image of one wide channel: Pillow would cut it at 255, mostly to white."""
    if mode in (*DEPTH_MODES, "F"):
        raise DataError(
            f"{path}: expected a colour or 8-bit grey image, found Pillow mode {mode!r} (a depth "
            "image?). Point the manifest at the colour images."
        )


def open_image(path: Path) -> Image.Image:
    """Open a file of one of the `FORMATS`; for an EPS, Pillow would start another program.

    Raises:
        OSError: it is not there, or of no such format.
    """
    return Image.open(path, formats=FORMATS)


@contextmanager
def only_listed_formats(*more: str) -> Iterator[None]:
    """Within the block, who calls Pillow's ``Image.open`` gets `FORMATS` and these alone."""
    everything = Image.open
    Image.open = partial(everything, formats=(*FORMATS, *more))
    try:
        yield
    finally:
        Image.open = everything


def is_listed(path: Path) -> bool:
    """Whether a file is of one of the `FORMATS`, by its header."""
    try:
        with open_image(path):
            return True
    except DAMAGE:
        return False


def probe(path: Path) -> tuple[int, int, str]:
    """Width, height and Pillow mode from a file's header alone.

    Raises:
        UnreadableImageError: the file is missing or no image.
    """
    try:
        with open_image(path) as image:
            return image.width, image.height, image.mode
    except FileNotFoundError:
        raise UnreadableImageError(f"{path}: no such file.") from None
    except (UnidentifiedImageError, *DAMAGE):
        raise UnreadableImageError(
            f"{path}: not a readable image. Restore the file, or leave the frame out."
        ) from None


def _decode(path: Path) -> Image.Image:
    """The whole image. Pillow's decoders skip a PNG's checksums and the end mark of a JPEG."""
    probe(path)
    try:
        with open_image(path) as unchecked:
            unchecked.verify()
        image = open_image(path)
        image.load()
        if image.format == "JPEG" and not _has_end(path.read_bytes()):
            raise OSError("the end of the JPEG is missing")
    except DAMAGE as error:
        raise UnreadableImageError(
            f"{path}: damaged image ({error}). Restore the file, or leave the frame out."
        ) from None
    return image


def _has_end(jpeg: bytes) -> bool:
    """Whether the end mark follows the last scan; inside a scan the two bytes cannot stand."""
    return jpeg.rfind(JPEG_END) > jpeg.rfind(JPEG_SCAN)
