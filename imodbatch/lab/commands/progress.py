"""The progress bar of a command."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def bar(name: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on stderr, moved by calling with what is done and what there is."""
    from tqdm import tqdm

    with tqdm(desc=name, leave=False, disable=None) as line:

        def advance(n_done: int, n_total: int) -> None:
            line.total = n_total
            line.update(n_done - line.n)

        yield advance
