"""Which program runs the script, and what is said when it cannot."""

import os
import subprocess
import sys
from pathlib import Path

from imodbatch.core.errors import ConfigError

PROGRAM_VARIABLE = "IMODBATCH_BLENDER_PYTHON"
"""Names a Python interpreter that has bpy, or a ``blender`` program."""
SCRIPT = Path(__file__).with_name("cycles_script.py")
NO_BPY = 3
"""The script's exit status where there is no bpy."""


def run_blender(request: Path) -> None:
    """Render all views of a request, in one process.

    Raises:
        ConfigError: the program is not there, has no bpy, or failed.
    """
    program = os.environ.get(PROGRAM_VARIABLE) or sys.executable
    try:
        done = subprocess.run(
            command_of(program, request),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
    except OSError as error:
        raise ConfigError(_absent(f"{program} does not start ({error.strerror})")) from None
    if done.returncode == NO_BPY:
        raise ConfigError(_absent(f"{program} has no module bpy"))
    if done.returncode:
        said = done.stdout.decode(errors="replace").strip().splitlines() or ["it said nothing"]
        raise ConfigError(f"Blender failed with status {done.returncode}: {said[-1]}")


def command_of(program: str, request: Path) -> list[str]:
    """The command line that runs the script by an interpreter or by Blender itself."""
    if Path(program).name.lower().startswith("blender"):
        options = ["--background", "--factory-startup", "--python-exit-code", "1", "--python"]
        return [program, *options, str(SCRIPT), "--", str(request)]
    return [program, str(SCRIPT), str(request)]


def _absent(found: str) -> str:
    return (
        f"Blender: {found}. pip install 'imodbatch[blender]' (Python 3.11), or name an interpreter "
        f"that has bpy, or a blender program, in {PROGRAM_VARIABLE}."
    )
