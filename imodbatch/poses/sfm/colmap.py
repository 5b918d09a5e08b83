"""The one place that loads pycolmap, silenced, and how it is to run."""

import os
from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ImodError

Progress = Callable[[Iterable[Any]], Iterable[Any]]
SEED = 0
OLDEST_VERSION = 4
ONLY_FATAL = 3


@cache
def pycolmap() -> ModuleType:
    """The pycolmap module; its log would drown our own lines, so it only says why it dies.

    Raises:
        ImodError: it does not load, or is too old.
    """
    _load_image_libraries()
    try:
        import pycolmap as module
    except (ImportError, OSError) as error:
        raise ImodError(
            f"pycolmap does not load: {error}. Install it again (pip install 'pycolmap>=4')."
        ) from None
    if int(module.__version__.split(".")[0]) < OLDEST_VERSION:
        raise ImodError(
            f"pycolmap {module.__version__} is too old, {OLDEST_VERSION}.0 is needed. "
            "Update it (pip install 'pycolmap>=4')."
        )
    module.logging.minloglevel = ONLY_FATAL
    return module  # type: ignore[no-any-return]


def _load_image_libraries() -> None:
    """Load opencv and Pillow before pycolmap.

    Its wheel brings a libpng of its own whose names opencv would take for those of its own, if
    opencv came later; the process then dies at the first PNG.
    """
    for name in ("cv2", "PIL.Image"):
        import_module(name)


def colmap_camera(camera: PinholeCamera) -> Any:
    """The camera as COLMAP knows it, with its focal length given; pixels are counted alike."""
    return pycolmap().Camera(
        camera_id=1,
        model="PINHOLE",
        width=camera.width_px,
        height=camera.height_px,
        params=[camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px],
        has_prior_focal_length=True,
    )


def n_threads() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
