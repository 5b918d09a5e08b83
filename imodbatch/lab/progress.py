"""How far a long piece of work is: told as what is done and what there is."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[int, int], None]
"""Called with what is done and what there is."""


def silent(_n_done: int, _n_total: int) -> None:
    """Show nothing."""


@contextmanager
def bar(name: str) -> Iterator[Progress]:
    """A progress bar on stderr, moved by calling with what is done and what there is."""
    from tqdm import tqdm

    with tqdm(desc=name, leave=False, disable=None) as line:

        def advance(n_done: int, n_total: int) -> None:
            line.total = n_total
            line.update(n_done - line.n)

        yield advance
