"""The one place that loads open3d, with the system library that its wheel expects."""

import ctypes
from functools import cache
from types import ModuleType


@cache
def open3d() -> ModuleType:
    """The open3d module.

    Its wheel is linked against libusb-1.0, which a bare system lacks; the one from PyPI serves.
    """
    import libusb_package

    path = libusb_package.get_library_path()
    if path is not None:
        ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    import open3d as module

    module.utility.set_verbosity_level(module.utility.VerbosityLevel.Error)
    return module  # type: ignore[no-any-return]
