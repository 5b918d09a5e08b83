"""How often a thing looks the same in a turn about its upright axis."""

from typing import Literal

Symmetry = Literal["none", "full"] | int
"""``none``, ``full`` = looks the same from every azimuth, or an n of at least 2 = n-fold."""


def parse_symmetry(value: object) -> Symmetry:
    """``none``, ``full``, or a number of turns, be it a number or its digits; 1 is ``none``.

    Raises:
        ValueError: it is none of them.
    """
    if value in ("none", "full"):
        return value  # type: ignore[return-value]
    n_turns = int(value) if isinstance(value, str) and value.isdecimal() else value
    if isinstance(n_turns, int) and not isinstance(n_turns, bool) and n_turns >= 1:
        return n_turns if n_turns > 1 else "none"
    raise ValueError(
        f'"symmetry" is {value!r}. Expected "none", "full", or how often it looks the same in a '
        "turn"
    )


def n_fold(symmetry: Symmetry | None) -> int | None:
    """In how many azimuths of a turn a thing looks the same; None = in all. Unknown counts as 1."""
    if symmetry == "full":
        return None
    return 1 if symmetry is None or symmetry == "none" else symmetry
