"""The one place that loads open3d, with the system libraries that its wheel expects."""

import ctypes
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from imodbatch.engines.stub_library import load_or_stub, undefined_functions
from imodbatch.errors import ImodError

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
