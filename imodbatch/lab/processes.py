"""Work shared out among processes."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, TypeVar

Result = TypeVar("Result")


def results(
    work: Callable[..., Result], calls: Sequence[tuple[Any, ...]], n_processes: int
) -> Iterator[Result]:
    """What `work` returns for each call's arguments, in the order in which they are done.

    When one fails, what has not begun is dropped.
    """
    if n_processes == 1 or len(calls) < 2:
        yield from (work(*arguments) for arguments in calls)
        return
    # Processes that use threads (open3d's do) must not be forked.
    executor = ProcessPoolExecutor(min(n_processes, len(calls)), get_context("spawn"))
    try:
        jobs = [executor.submit(work, *arguments) for arguments in calls]
        for job in as_completed(jobs):
            yield job.result()
    finally:
        executor.shutdown(cancel_futures=True)
