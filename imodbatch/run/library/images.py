"""Images that a caller of the library gives → readers by position, checked as they are read."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.core.errors import DataError

Images = Sequence[Any] | Callable[[int], Any]
"""Arrays in order, or a function from a frame's number to its array; None = the frame has none."""
Read = Callable[[int], Any]


def frame_numbers(frame_index: ArrayLike | None, **in_order: Any) -> NDArray[np.int64]:
    """The numbers (F,) of the frames; 0, 1, 2, … where they are not given.

    Args:
        frame_index: (F,) rising; None = as many as there are images.
        in_order: by the names of arguments, what must hold one entry for each frame; functions
            and None may hold any number.

    Raises:
        DataError: the numbers of entries differ, there is none, or nothing tells how many.
    """
    counts = {}
    for name, given in in_order.items():
        if given is None or callable(given):
            continue
        if not hasattr(given, "__len__"):
            raise DataError(
                f"{name}: got a {type(given).__name__}, expected a list or array, one per frame."
            )
        counts[name] = len(given)
    numbers = None if frame_index is None else np.asarray(frame_index)
    if numbers is not None:
        is_rising = numbers.ndim == 1 and bool((np.diff(numbers) > 0).all())
        if not (is_rising and np.issubdtype(numbers.dtype, np.integer)):
            raise DataError("frame_index: expected whole numbers that rise, such as range(450).")
        counts["frame_index"] = len(numbers)
    found = ", ".join(f"{n} in {name}" for name, n in counts.items())
    if not counts:
        raise DataError(
            "how many frames are there? Functions do not say it: give frame_index=range(n)."
        )
    if len(set(counts.values())) > 1:
        raise DataError(f"{found}: expected as many of each, one per frame.")
    if 0 in counts.values():
        raise DataError(f"{found}: expected one frame at least.")
    n_frames = next(iter(counts.values()))
    return (np.arange(n_frames) if numbers is None else numbers).astype(np.int64)


def reader(images: Images | None, name: str, numbers: NDArray[np.int64]) -> Read:
    """Position → what the caller gives for that frame, not yet checked; None = nothing.

    Raises:
        DataError: there are no images at all.
    """
    if images is None:
        raise DataError(f"{name}: None, expected images: arrays in order, or a function.")
    if callable(images):
        return lambda position: images(int(numbers[position]))
    return lambda position: images[position]


def color_reader(
    images: Images | None, numbers: NDArray[np.int64], camera: PinholeCamera | None = None
) -> Callable[[int], NDArray[np.uint8] | None]:
    """Position → (H, W, 3) uint8 RGB, of the camera's size if there is a camera; None = no image.

    Reading raises `DataError` where an image has another shape or type.
    """
    read = reader(images, "colors", numbers)

    def color(position: int) -> NDArray[np.uint8] | None:
        given = read(position)
        if given is None:
            return None
        image = np.asarray(given)
        size = image.shape[:2] if camera is None else (camera.height_px, camera.width_px)
        if image.shape != (*size, 3) or image.dtype != np.uint8:
            expected = "(H, W, 3)" if camera is None else f"{(*size, 3)}, the camera's,"
            cure = "Give RGB in 0 to 255: (255 * image).astype(np.uint8) if it is 0 to 1."
            if image.dtype == np.uint8:
                cure = "Give RGB of the camera's size: repeat grey, drop alpha, correct camera."
            raise DataError(
                f"colors: frame {numbers[position]} is {image.shape} {image.dtype}, expected "
                f"{expected} uint8. {cure}"
            )
        return np.ascontiguousarray(image)

    return color


def depth_reader(
    images: Images | None, numbers: NDArray[np.int64], camera: PinholeCamera
) -> Callable[[int], DepthImage | None]:
    """Position → z-depth (H, W) in metres; what is not finite or not above 0 becomes NaN.

    Reading raises `DataError` where an image is not of the camera's size or not of floats.
    """
    read = reader(images, "depths", numbers)

    def depth(position: int) -> DepthImage | None:
        given = read(position)
        if given is None:
            return None
        image = np.asarray(given)
        size = (camera.height_px, camera.width_px)
        if image.shape != size:
            raise DataError(
                f"depths: frame {numbers[position]} is {image.shape}, expected {size}, the "
                "camera's. Register depth into the colour camera, or correct camera."
            )
        if not np.issubdtype(image.dtype, np.floating):
            raise DataError(
                f"depths: frame {numbers[position]} is {image.dtype}, expected metres as floats. "
                "Give 0.001 * image if it is millimetres."
            )
        usable = np.isfinite(image) & (image > 0)
        return np.where(usable, image, np.nan).astype(np.float32)

    return depth
