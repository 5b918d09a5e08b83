"""One run folder, one command that writes in it.

The lock is the operating system's (flock), so it ends with the process that holds it, however that
ends. Who holds it stands in a file beside it: the library empties the lock file itself.
"""

import json
import os
import shlex
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock, Timeout

from imodbatch.core.errors import RunLockedError
from imodbatch.tables.atomic import sweep, write_text

LOCK, OWNER = ".lock", ".lock.json"
FACTS = ("host", "pid", "command", "since")


@contextmanager
def only_writer(run_dir: Path) -> Iterator[None]:
    """Have a run folder for oneself; it is made if need be, and rid of what killed runs left.

    Raises:
        RunLockedError: another command writes there.
    """
    run_dir.mkdir(parents=True, exist_ok=True)
    lock, owner = FileLock(run_dir / LOCK), run_dir / OWNER
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise RunLockedError(
            f"{run_dir}: {_said_by(owner)} is writing there. Wait until it is done, stop it, or "
            "name another --out."
        ) from None
    try:
        owner.unlink(missing_ok=True)  # of one that was killed
        write_text(owner, json.dumps(_own_facts()) + "\n")
        sweep(run_dir)
        yield
    finally:
        owner.unlink(missing_ok=True)
        lock.release()


def _own_facts() -> dict[str, str | int]:
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    since = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    return dict(zip(FACTS, (socket.gethostname(), os.getpid(), command, since), strict=True))


def _said_by(owner: Path) -> str:
    """Who holds the lock, by its own word; that may come a moment after the lock."""
    for _ in range(10):
        try:
            facts = json.loads(owner.read_text(encoding="utf-8"))
            host, pid, command, since = (facts[name] for name in FACTS)
        except (OSError, ValueError, KeyError, TypeError):
            time.sleep(0.05)
            continue
        return f"`{command}` (process {pid} on {host}, since {since})"
    return "another command"
