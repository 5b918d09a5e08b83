"""The one place that loads open3d, with the system libraries that its wheel expects."""

import ctypes
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ImodError
from imodbatch.libraries.stub_library import load_or_stub, undefined_functions

DISPLAY_LIBRARIES = {
    "libX11.so.6": ("X",),
    "libGL.so.1": ("gl",),
    "libEGL.so.1": ("egl",),
}


@cache
def open3d() -> ModuleType:
    """The open3d module.

    Its wheel is linked against libusb-1.0 and display libraries, which a bare system lacks. The
    libusb of PyPI serves, and stand-ins for the display (see `stub_library`).

    Raises:
        ImodError: open3d does not load; the message names the library that is missing.
    """
    import libusb_package

    try:
        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        _provide_display_libraries()
        import open3d as module
    except (ImportError, OSError) as error:
        raise ImodError(
            f"open3d does not load: {error}. Install that library "
            "(Debian: apt install libegl1 libgl1 libx11-6 libgomp1 libudev1 libidn2-0)."
        ) from None
    module.utility.set_verbosity_level(module.utility.VerbosityLevel.Error)
    return module  # type: ignore[no-any-return]


def intrinsics(camera: PinholeCamera) -> Any:
    """The camera as open3d knows it, which counts pixels from the middle of the first one."""
    return open3d().camera.PinholeCameraIntrinsic(
        *(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px),
        *(camera.cx_px - 0.5, camera.cy_px - 0.5),
    )


def rgbd_image(color: NDArray[np.uint8], depth_m: NDArray[np.float32], max_depth_m: float) -> Any:
    """A colour or grey image with its depth (H, W), NaN = unknown, for open3d's odometry."""
    geometry = open3d().geometry
    return geometry.RGBDImage.create_from_color_and_depth(
        geometry.Image(np.ascontiguousarray(color)),
        geometry.Image(np.nan_to_num(depth_m, nan=0.0).astype(np.float32)),
        depth_scale=1.0,
        depth_trunc=max_depth_m,
        convert_rgb_to_intensity=True,
    )


def _provide_display_libraries() -> None:
    """Load display libraries, or stand-ins that define what open3d's library asks of them."""
    missing = []
    for soname in DISPLAY_LIBRARIES:
        try:
            ctypes.CDLL(soname, mode=ctypes.RTLD_GLOBAL)
        except OSError:
            missing.append(soname)
    if not missing:
        return
    spec = find_spec("open3d")
    folder = Path(spec.origin).parent if spec is not None and spec.origin else Path()
    for library in sorted(folder.rglob("libOpen3D.so*")):
        for soname in missing:
            load_or_stub(soname, undefined_functions(library, DISPLAY_LIBRARIES[soname]))
