"""How symmetric a thing is: what may be written, and what it means."""

import pytest

from imodbatch.core.symmetry import n_fold, parse_symmetry


@pytest.mark.parametrize(
    ("value", "expected"),
    [("none", "none"), ("full", "full"), (3, 3), ("4", 4), (1, "none"), ("1", "none")],
)
def test_what_may_be_written(value, expected):
    assert parse_symmetry(value) == expected


@pytest.mark.parametrize("value", ["half", "", "-2", 0, True, 2.0, None, []])
def test_what_cannot_be_meant(value):
    with pytest.raises(ValueError, match='"symmetry" is'):
        parse_symmetry(value)


def test_how_often_a_thing_looks_the_same():
    assert [n_fold(value) for value in (None, "none", 4, "full")] == [1, 1, 4, None]
