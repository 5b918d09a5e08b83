import ctypes
import os
import subprocess
import sys

import pytest

from imodbatch.libraries.stub_library import build, load_or_stub, undefined_functions

NAMES = ["imodFirst", "imodSecond", "imodThird"]


def test_every_function_of_a_stand_in_is_found_and_returns_zero():
    stubbed = load_or_stub("libimod-test-absent.so.7", NAMES)
    assert stubbed
    everything = ctypes.CDLL(None)
    for name in NAMES:
        assert getattr(everything, name)(3, 4) == 0
    with pytest.raises(AttributeError):
        everything.imodFourth  # noqa: B018


def test_a_stand_in_answers_to_its_name_from_then_on():
    load_or_stub("libimod-test-named.so.2", [])
    ctypes.CDLL("libimod-test-named.so.2")  # raises if the loader does not know it


def test_a_library_that_is_there_is_not_replaced():
    assert not load_or_stub("libc.so.6", NAMES)


def test_undefined_functions_are_read_back(tmp_path):
    library = tmp_path / "libself.so"
    library.write_bytes(build("libself.so", NAMES, os.uname().machine))
    with pytest.raises(IndexError):  # a stand-in has no section table, and needs nothing
        undefined_functions(library, ("imod",))


def test_open3d_asks_for_functions_of_the_display():
    from imodbatch.libraries.open3d_library import DISPLAY_LIBRARIES, open3d

    folder = os.path.dirname(open3d().__file__)
    library = next(
        os.path.join(folder, name) for name in os.listdir(folder) if name.startswith("libOpen3D.so")
    )
    names = undefined_functions(library, DISPLAY_LIBRARIES["libX11.so.6"])
    assert "XFlush" in names
    assert all(name.startswith("X") for name in names)


def test_open3d_loads_and_computes_with_stand_ins_only():
    code = """
import ctypes
import imodbatch.libraries.stub_library as stub
real = ctypes.CDLL
def absent(name, *args, **kwargs):
    if name in ("libX11.so.6", "libGL.so.1", "libEGL.so.1"):
        raise OSError(name)
    return real(name, *args, **kwargs)
ctypes.CDLL = absent
from imodbatch.libraries.open3d_library import open3d
o3d = open3d()
maps = open("/proc/self/maps").read()
assert "memfd:libGL.so.1" in maps and "libGL.so.1.7" not in maps, maps
cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]))
print(cloud.segment_plane(0.01, 3, 10)[0][2])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert abs(abs(float(done.stdout)) - 1) < 1e-6
