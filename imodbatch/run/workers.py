"""Who works on a run's sequences: this process, local ones, or a Dask scheduler's workers."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from threading import Thread

from imodbatch.core.errors import ConfigError


@contextmanager
def open_executor(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """Local processes, a Dask scheduler's workers, or None = this process.

    Raises:
        ConfigError: the scheduler is not there, or `distributed` is not installed.
    """
    if scheduler is not None:
        try:
            from distributed import Client
        except ImportError:
            raise ConfigError(
                "--scheduler needs Dask: pip install 'imodbatch[dask]', or use --workers."
            ) from None
        try:
            with Client(scheduler, timeout="10s") as client:
                yield client.get_executor()
        except (OSError, TimeoutError):
            raise ConfigError(
                f"--scheduler {scheduler}: no Dask scheduler answers there. Start `dask scheduler`."
            ) from None
    elif workers > 1:
        spawn = get_context("spawn")
        with ProcessPoolExecutor(workers, spawn, initializer=_end_with_parent) as pool:
            yield pool
    else:
        yield None


def _end_with_parent() -> None:
    """Have this worker die with the process that holds the run folder's lock."""

    def wait_and_end() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=wait_and_end, daemon=True).start()
