"""Stand-ins for display libraries that open3d is linked against but that we never call.

The open3d wheel names libGL, libEGL and libX11 as needed for its viewer. A server or a container
has none of them, and installing them takes root. The loader only asks that libraries of those names
are there and define the functions named: a shared object of one page in which every such function
returns 0 will do, since nothing here opens a window. It is built in memory and loaded first.
"""

import ctypes
import os
import platform
import struct
from pathlib import Path

import numpy as np

RETURN_ZERO = {
    "x86_64": (62, b"\x31\xc0\xc3"),  # xor eax, eax; ret
    "aarch64": (183, b"\x00\x00\x80\xd2\xc0\x03\x5f\xd6"),  # mov x0, #0; ret
}
PAGE = 0x10000
LOAD, DYNAMIC, GNU_STACK = 1, 2, 0x6474E551
READ_EXECUTE, READ_WRITE = 5, 6
DT_HASH, DT_STRTAB, DT_SYMTAB, DT_STRSZ, DT_SYMENT, DT_SONAME = 4, 5, 6, 10, 11, 14
SHT_DYNSYM = 11
SYMBOL = np.dtype(
    [
        ("name", "<u4"),
        ("info", "u1"),
        ("other", "u1"),
        ("section", "<u2"),
        ("value", "<u8"),
        ("size", "<u8"),
    ]
)
SECTION = np.dtype(
    [
        ("name", "<u4"),
        ("type", "<u4"),
        ("flags", "<u8"),
        ("addr", "<u8"),
        ("offset", "<u8"),
        ("size", "<u8"),
        ("link", "<u4"),
        ("info", "<u4"),
        ("align", "<u8"),
        ("entry", "<u8"),
    ]
)


def undefined_functions(library: Path, prefixes: tuple[str, ...]) -> list[str]:
    """Names that a 64-bit little-endian ELF library expects others to define, by prefix."""
    data = np.memmap(library, dtype=np.uint8, mode="r")
    header = data[:64].tobytes()
    (table_offset,) = struct.unpack_from("<Q", header, 0x28)
    (n_sections,) = struct.unpack_from("<H", header, 0x3C)
    sections = np.frombuffer(data, SECTION, n_sections, table_offset)
    symbols_at = sections[sections["type"] == SHT_DYNSYM][0]
    names_at = sections[symbols_at["link"]]
    n_symbols = int(symbols_at["size"]) // SYMBOL.itemsize
    symbols = np.frombuffer(data, SYMBOL, n_symbols, int(symbols_at["offset"]))
    start = int(names_at["offset"])
    strings = data[start : start + int(names_at["size"])].tobytes()
    offsets = symbols["name"][symbols["section"] == 0]
    names = (strings[o : strings.index(b"\0", o)].decode() for o in offsets.tolist())
    return sorted({name for name in names if name.startswith(prefixes)})


def build(soname: str, functions: list[str], machine: str) -> bytes:
    """A shared object of that name in which every function returns 0.

    Args:
        soname: what the loader will find it by, such as ``libGL.so.1``.
        functions: names it defines.
        machine: ``x86_64`` or ``aarch64``.

    Raises:
        KeyError: another machine.
    """
    elf_machine, code = RETURN_ZERO[machine]
    strings, offset_of = b"\0", {}
    for name in (soname, *functions):
        offset_of[name] = len(strings)
        strings += name.encode() + b"\0"
    n_symbols = len(functions) + 1
    chain = [*range(2, n_symbols), 0] if functions else []
    hashes = struct.pack(f"<{3 + n_symbols}I", 1, n_symbols, min(1, len(functions)), 0, *chain)
    hash_at = 64 + 4 * 56
    symbols_at = hash_at + len(hashes) + -len(hashes) % 8
    strings_at = symbols_at + SYMBOL.itemsize * n_symbols
    code_at = strings_at + len(strings) + -len(strings) % 16
    code_end = code_at + len(code)

    symbols = np.zeros(n_symbols, SYMBOL)
    symbols["name"][1:] = [offset_of[name] for name in functions]
    symbols["info"][1:] = 0x12  # global function
    symbols["section"][1:] = 1
    symbols["value"][1:] = code_at
    symbols["size"][1:] = len(code)
    dynamic = b"".join(
        struct.pack("<QQ", tag, value)
        for tag, value in (
            (DT_SONAME, offset_of[soname]),
            (DT_HASH, hash_at),
            (DT_STRTAB, strings_at),
            (DT_SYMTAB, symbols_at),
            (DT_STRSZ, len(strings)),
            (DT_SYMENT, SYMBOL.itemsize),
            (0, 0),
        )
    )
    identity = b"\x7fELF\x02\x01\x01" + bytes(9)
    header = identity + struct.pack(
        "<HHIQQQIHHHHHH", 3, elf_machine, 1, 0, 64, 0, 0, 64, 56, 4, 64, 0, 0
    )
    segments = b"".join(
        struct.pack("<IIQQQQQQ", kind, flags, at, at, at, size, size, align)
        for kind, flags, at, size, align in (
            (LOAD, READ_EXECUTE, 0, code_end, PAGE),
            (LOAD, READ_WRITE, PAGE, len(dynamic), PAGE),
            (DYNAMIC, READ_WRITE, PAGE, len(dynamic), 8),
            (GNU_STACK, READ_WRITE, 0, 0, 16),
        )
    )
    body = header + segments + hashes
    body = body.ljust(symbols_at, b"\0") + symbols.tobytes() + strings
    return (body.ljust(code_at, b"\0") + code).ljust(PAGE, b"\0") + dynamic


def load_or_stub(soname: str, functions: list[str]) -> bool:
    """Make a library of that name present in this process; True if a stand-in had to serve.

    Raises:
        OSError: it is missing and no stand-in can be built for this machine.
    """
    try:
        ctypes.CDLL(soname, mode=ctypes.RTLD_GLOBAL)
    except OSError:
        if platform.machine() not in RETURN_ZERO or not hasattr(os, "memfd_create"):
            raise
    else:
        return False
    file = os.memfd_create(soname)
    os.write(file, build(soname, functions, platform.machine()))
    ctypes.CDLL(f"/proc/self/fd/{file}", mode=ctypes.RTLD_GLOBAL)
    return True
