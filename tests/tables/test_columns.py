"""Rows of one table found in another, by key and never by place."""

import numpy as np
import pyarrow as pa
import pytest

from imodbatch.core.errors import TableError
from imodbatch.tables.columns import codes, image_numbers, positions

FRAMES = pa.table(
    {"sequence_id": ["b", "a", "a"], "frame_index": pa.array([7, 7, 3], pa.int32()), "x": [0, 1, 2]}
)


def rows(*keys):
    sequences, frames = zip(*keys, strict=True) if keys else ((), ())
    columns = {"sequence_id": pa.array(sequences, pa.string())}
    return pa.table(columns | {"frame_index": pa.array(frames, pa.int32())})


def test_rows_are_found_in_the_order_asked_and_as_often():
    asked = rows(("a", 3), ("b", 7), ("a", 3), ("a", 7))
    assert positions(asked, FRAMES, ("sequence_id", "frame_index")).tolist() == [2, 0, 2, 1]
    assert image_numbers(FRAMES, asked).tolist() == [2, 0, 2, 1]
    assert image_numbers(FRAMES, rows()).tolist() == []
    assert image_numbers(FRAMES, rows()).dtype == np.int64


def test_a_key_that_is_not_there_is_an_error():
    with pytest.raises(TableError, match="1 rows have a sequence_id, frame_index that the other"):
        image_numbers(FRAMES, rows(("a", 7), ("b", 3)))


def test_many_rows_keep_their_order():
    """Enough for a join to work in parts."""
    rng = np.random.default_rng(0)
    frames = rows(*(("s", int(i)) for i in rng.permutation(100_000)))
    chosen = rng.integers(100_000, size=200_000)
    assert np.array_equal(image_numbers(frames, frames.take(chosen)), chosen)


def test_codes_are_positions_in_the_list():
    names = pa.chunked_array([["b", "a"], ["b"]])
    assert codes(names, ("a", "b")).tolist() == [1, 0, 1]
    assert codes(pa.chunked_array([], pa.string()), ("a",)).tolist() == []
