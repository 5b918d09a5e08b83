"""Tables on disk: whole or not at all, checked both ways, and they know what they come from."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imodbatch.core.errors import TableError
from imodbatch.tables import parquet as tables
from imodbatch.tables.parquet import (
    TableInfo,
    conform,
    digest,
    empty,
    from_columns,
    from_rows,
    read_info,
    read_table,
    table_path,
    write_table,
)
from imodbatch.tables.schemas import DETECTIONS, FUSED, POSES, SWEEPS, TABLES

INFO = TableInfo(
    "poses",
    POSES.version,
    POSES.key,
    {"package": "0.1", "inputs": {"frames": "abc"}, "größe": [1, 2.5, None]},
    "2 frames = 1 tracked + 1 lost",
    {"up": [0.0, 0.0, 1.0]},
)


def poses(n=2, sequence_id="s"):
    rows = [
        {
            "sequence_id": sequence_id,
            "frame_index": i,
            "tx_m": 0.1 * i,
            "ty_m": 1 / 3,
            "tz_m": -2.0,
            "qw": 1.0,
            "qx": 0.0,
            "qy": 0.0,
            "qz": 0.0,
            "status": "tracked",
        }
        for i in range(n - 1)
    ]
    rows.append({"sequence_id": sequence_id, "frame_index": n - 1, "status": "lost"})
    return from_rows(POSES, rows)


def fused(sequence_id, n=3):
    rows = [
        {
            "sequence_id": sequence_id,
            "frame_index": i,
            "detection_index": 0,
            "method": "imod",
            "class_id": 1,
            "score": 0.25 * i,
            "pose_bin": None if i == 0 else i,
            "n_cells": i,
        }
        for i in range(n)
    ]
    return from_rows(FUSED, rows)


def fault(action, *mentions):
    with pytest.raises(TableError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text
    return text


@pytest.fixture
def stored(tmp_path):
    path = table_path(tmp_path, "poses", "s")
    write_table(path, poses(), INFO)
    return path


def test_where_tables_lie(tmp_path):
    assert table_path(tmp_path, "poses", "a") == tmp_path / "poses" / "a.parquet"
    assert table_path(tmp_path, "metrics") == tmp_path / "metrics" / "run.parquet"


def test_round_trip(stored):
    table = read_table(stored, POSES)
    assert table.equals(poses())
    assert table.schema.equals(POSES.schema)
    assert table["tx_m"].to_pylist() == [0.0, None]


def test_lists_survive_the_round_trip(tmp_path):
    row = dict.fromkeys(("frame_index", "detection_index", "x0_px", "y0_px"), 0)
    row |= {"sequence_id": "s", "x1_px": 5.5, "y1_px": 6, "background_score": 0.5}
    row |= {"class_ids": [0, 2], "view_scores": np.float32([0.1, 0, 1 / 3])}
    table = from_rows(DETECTIONS, [row, {**row, "detection_index": 1, "class_ids": []}])
    path = tmp_path / "d.parquet"
    write_table(path, table, TableInfo("detections", DETECTIONS.version, DETECTIONS.key))
    assert read_table(path, DETECTIONS).equals(table)
    assert read_table(path, DETECTIONS)["class_ids"].to_pylist() == [[0, 2], []]


@pytest.mark.parametrize("spec", list(TABLES.values()), ids=lambda spec: spec.name)
def test_every_empty_table_makes_the_round_trip(tmp_path, spec):
    path = tmp_path / "a.parquet"
    write_table(path, empty(spec), TableInfo(spec.name, spec.version, spec.key))
    table = read_table(path, spec)
    assert table.num_rows == 0
    assert table.schema.equals(spec.schema)


def test_metadata_holds_the_past(stored):
    assert read_info(stored) == INFO
    metadata = pq.read_schema(stored).metadata[tables.METADATA_KEY]
    for word in ("poses", "sequence_id", "frame_index", "größe", "abc", INFO.summary, INFO.digest):
        assert word.encode() in metadata
    meaning = pq.read_schema(stored).field("status").metadata[b"meaning"]
    assert meaning.startswith(b"tracked; dense: ")


def test_the_digest_changes_with_the_past_alone():
    assert replace(INFO, summary="x", attributes={}).digest == INFO.digest
    assert replace(INFO, provenance=dict(reversed(INFO.provenance.items()))).digest == INFO.digest
    others = [
        replace(INFO, table="frames"),
        replace(INFO, version=INFO.version + 1),
        replace(INFO, provenance={**INFO.provenance, "package": "0.2"}),
    ]
    assert len({INFO.digest, *(other.digest for other in others)}) == 4
    assert digest([1, "a"]) != digest(["1", "a"])


def test_equal_input_gives_equal_bytes(tmp_path):
    paths = [tmp_path / name for name in ("a.parquet", "b.parquet")]
    for path in paths:
        write_table(path, poses(500), INFO)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_pandas_reads_a_run_of_several_sequences(tmp_path):
    info = TableInfo("fused", FUSED.version, FUSED.key)
    for name in ("a", "b"):
        write_table(table_path(tmp_path, "fused", name), fused(name), info)
    frame = pd.read_parquet(tmp_path / "fused")
    assert sorted(frame["sequence_id"]) == ["a"] * 3 + ["b"] * 3
    assert list(frame.columns) == FUSED.schema.names
    assert frame["pose_bin"].isna().sum() == 2
    assert frame["score"].sum() == pytest.approx(1.5)


def test_a_part_left_behind_is_invisible_to_pandas(tmp_path):
    info = TableInfo("fused", FUSED.version, FUSED.key)
    path = table_path(tmp_path, "fused", "a")
    write_table(path, fused("a"), info)
    part = path.with_name(".b.parquet.partial")
    part.write_bytes(path.read_bytes()[:100])
    assert len(pd.read_parquet(tmp_path / "fused")) == 3


def crash(*_args, **_kwargs):
    raise KeyboardInterrupt


@pytest.mark.parametrize(("owner", "name"), [(os, "fsync"), (Path, "replace"), (pq, "write_table")])
def test_a_crash_leaves_the_old_table_or_none(tmp_path, monkeypatch, owner, name):
    old, new = table_path(tmp_path, "poses", "s"), table_path(tmp_path, "poses", "t")
    write_table(old, poses(), INFO)
    before = old.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, crash)
        for path in (old, new):
            with pytest.raises(KeyboardInterrupt):
                write_table(path, poses(50), INFO)
    assert old.read_bytes() == before
    assert not new.exists()
    assert [path.name for path in old.parent.iterdir()] == ["s.parquet"]
    assert len(pd.read_parquet(tmp_path / "poses")) == 2
    for path in (old, new):
        write_table(path, poses(50), INFO)
    assert sorted(path.name for path in old.parent.iterdir()) == ["s.parquet", "t.parquet"]
    assert read_table(old, POSES).num_rows == 50


def test_a_reader_during_the_write_sees_the_old_table(stored, monkeypatch):
    seen = []
    real = os.fsync

    def look(descriptor):
        seen.append(read_table(stored, POSES).num_rows)
        real(descriptor)

    monkeypatch.setattr(os, "fsync", look)
    write_table(stored, poses(50), INFO)
    assert seen == [2]


def test_a_key_stands_once():
    table = poses()
    double = pa.concat_tables([table, table.slice(1)])
    text = fault(
        lambda: conform(double, POSES), "table poses", "'frame_index': 1", "more than once"
    )
    assert "count" not in text


def test_equal_frames_of_other_sequences_are_no_double():
    both = pa.concat_tables([poses(sequence_id="a"), poses(sequence_id="b")])
    assert conform(both, POSES).num_rows == 4


def test_nulls_where_none_may_be():
    row = {"sequence_id": "s", "frame_index": 0, "status": "lost"}
    assert from_rows(POSES, [row]).num_rows == 1
    for name in row:
        fault(lambda name=name: from_rows(POSES, [{**row, name: None}]), "table poses", name)
        absent = {key: value for key, value in row.items() if key != name}
        fault(lambda absent=absent: from_rows(POSES, [absent]), "table poses", name)


def test_missing_and_foreign_columns():
    table = poses()
    fault(lambda: conform(table.drop_columns("qw"), POSES), "missing ['qw']", "foreign []")
    foreign = table.append_column("speed", pa.array([1.0, 2.0]))
    fault(lambda: conform(foreign, POSES), "missing []", "foreign ['speed']")
    renamed = table.rename_columns(["seq" if n == "status" else n for n in table.column_names])
    fault(lambda: conform(renamed, POSES), "missing ['status']", "foreign ['seq']")
    fault(lambda: from_columns(SWEEPS, {"method": ["imod"]}), "missing ['voxel_mm', 'metric'")


def test_columns_are_put_in_order_and_cast():
    table = poses()
    shuffled = table.select(table.column_names[::-1])
    wide = shuffled.set_column(
        shuffled.column_names.index("frame_index"), "frame_index", pa.array([0, 1], pa.int64())
    )
    assert conform(wide, POSES).equals(table)


@pytest.mark.parametrize(
    "values",
    [
        pa.array([0.5, 1.0]),
        pa.array(["a", "b"]),
        pa.array([[0], [1]]),
        pa.array([0, 2**40]),
        pa.array([0, None]),
    ],
    ids=["fraction", "text", "list", "too big", "null"],
)
def test_wrong_types(values):
    table = poses()
    wrong = table.set_column(1, "frame_index", values)
    fault(lambda: conform(wrong, POSES), "table poses")


@pytest.mark.parametrize("value", ["a", 2**40, 2**80, [1]])
def test_wrong_values_in_rows_and_columns(value):
    row = {"method": "imod", "voxel_mm": value, "metric": "ap", "value": 0.5}
    fault(lambda: from_rows(SWEEPS, [row]), "table sweeps")
    fault(lambda: from_columns(SWEEPS, {name: [v] for name, v in row.items()}), "table sweeps")


def test_columns_of_other_lengths():
    columns = {"method": ["a", "b"], "voxel_mm": [1], "metric": ["m"], "value": [None]}
    fault(lambda: from_columns(SWEEPS, columns), "table sweeps")


def test_a_missing_table_names_the_cure(tmp_path):
    path = table_path(tmp_path, "poses", "s")
    fault(lambda: read_table(path, POSES), path, "no such table", "imodbatch run")
    assert read_info(path) is None


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.999])
def test_a_cut_table(stored, share):
    whole = stored.read_bytes()
    stored.write_bytes(whole[: int(share * len(whole))])
    fault(lambda: read_table(stored, POSES), stored, "Delete it and run again")
    assert read_info(stored) is None


def test_a_turned_byte_never_gives_other_numbers(tmp_path):
    path = tmp_path / "a.parquet"
    table = poses(2000)
    write_table(path, table, INFO)
    whole = path.read_bytes()
    refused = 0
    for place in range(4, len(whole) - 8, max(len(whole) // 60, 1)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        try:
            assert read_table(path, POSES).equals(table)
        except TableError:
            refused += 1
    assert refused > 30


@pytest.mark.parametrize("metadata", [b"[1]", b"{}", b"not json", b'{"table": "poses"}'])
def test_foreign_parquet_files_are_no_tables(tmp_path, metadata):
    path = tmp_path / "a.parquet"
    table = poses()
    pq.write_table(table.replace_schema_metadata({tables.METADATA_KEY: metadata}), path)
    assert read_info(path) is None
    fault(lambda: read_table(path, POSES), path, "not a readable imodbatch table")
    pq.write_table(table, path)
    assert read_info(path) is None


def test_other_tables_and_other_versions(stored):
    fault(lambda: read_table(stored, FUSED), "holds poses version 1, expected fused version 1")
    newer = replace(POSES, version=POSES.version + 1)
    fault(lambda: read_table(stored, newer), "expected poses version 2", "Delete the run folder")


def test_a_table_that_lost_its_rules_after_writing(tmp_path):
    path = tmp_path / "a.parquet"
    table = poses()
    write_table(path, pa.concat_tables([table, table]), INFO)
    fault(lambda: read_table(path, POSES), "more than once")
