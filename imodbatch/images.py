"""Image files: colour → (H, W, 3) uint8 RGB; depth → (H, W) float32 metres, NaN = none."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from imodbatch.core.depth import DepthImage
from imodbatch.errors import DataError

DEPTH_MODES = ("I;16", "I;16B", "I")  # how Pillow names 16-bit grey; "I" when it widens to 32 bit


class UnreadableImageError(DataError):
    """An image file that is missing or damaged: a fault of one frame, not of the dataset."""


def read_color(path: Path) -> NDArray[np.uint8]:
    """A colour image, (H, W, 3) RGB; grey images are repeated, alpha is dropped.

    Raises:
        UnreadableImageError: the file is missing, truncated or no image.
    """
    return np.asarray(_decode(path).convert("RGB"), dtype=np.uint8)


def read_depth(path: Path, scale_m: float, invalid: tuple[int, ...]) -> DepthImage:
    """A 16-bit depth image in metres, (H, W), NaN where its number is one of `invalid`.

    Args:
        path: PNG or another lossless format with one 16-bit channel.
        scale_m: metres per unit.
        invalid: numbers that mean "no depth".

    Raises:
        UnreadableImageError: the file is missing, truncated or no image.
        DataError: it has not one 16-bit channel.
    """
    image = _decode(path)
    check_depth_mode(path, image.mode)
    raw = np.asarray(image)
    depth_m = raw.astype(np.float32) * np.float32(scale_m)
    depth_m[np.isin(raw, invalid)] = np.nan
    return depth_m


def check_depth_mode(path: Path, mode: str) -> None:
    """Refuse a depth image of 8 bits or several channels."""
    if mode not in DEPTH_MODES:
        raise DataError(
            f"{path}: expected a 16-bit single-channel depth image, found Pillow mode {mode!r} "
            "(8 bits or colour: a preview?). Point the manifest at the raw depth images."
        )


def probe(path: Path) -> tuple[int, int, str]:
    """Width, height and Pillow mode from a file's header alone.

    Raises:
        UnreadableImageError: the file is missing or no image.
    """
    try:
        with Image.open(path) as image:
            return image.width, image.height, image.mode
    except FileNotFoundError:
        raise UnreadableImageError(f"{path}: no such file.") from None
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError):
        raise UnreadableImageError(
            f"{path}: not a readable image. Restore the file, or leave the frame out."
        ) from None


def _decode(path: Path) -> Image.Image:
    probe(path)
    try:
        image = Image.open(path)
        image.load()
    except (OSError, SyntaxError, ValueError) as error:
        raise UnreadableImageError(
            f"{path}: damaged image ({error}). Restore the file, or leave the frame out."
        ) from None
    return image
