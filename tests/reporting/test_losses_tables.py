"""What was lost where, and what holds fusion back: each figure under its own heading."""

import csv
import io

from hand_tables import annotation, detection, frame, observation, pose, table

from imodbatch.reporting.csv_text import to_csv
from imodbatch.reporting.losses import (
    CAUSES,
    TOTAL,
    StatusCount,
    losses_grid,
    status_counts,
    status_grid,
)
from imodbatch.reporting.names import DASH
from imodbatch.reporting.run_info import RunInfo

INFO = RunInfo("run", "", "", ("bowl", "cup"))
BOX = (0, 0, 1, 1)


def loss(class_id, cause, value, n):
    return {"class_id": class_id, "cause": cause, "value": value, "n": n}


def test_every_cause_has_its_heading_and_figure():
    """Rows stand in the order of causes however they come; a cause unknown here keeps its name."""
    rows = [loss(0, cause, i / 16, i) for i, cause in enumerate(CAUSES)]
    rows = [loss(1, "own_cause", 0.5, 1200), *reversed(rows), loss(0, "own_cause", None, 0)]
    grid = losses_grid(table("losses", rows), INFO)
    assert [column.text for column in grid.columns] == [*CAUSES.values(), "own cause"]
    bowl, cup = grid.rows
    assert (bowl.name, cup.name) == ("bowl", "cup")
    assert [cell.text for cell in bowl.cells] == [*(f"{i / 16:.3f}" for i in range(12)), DASH]
    assert [cell.note for cell in bowl.cells] == [*(f"n = {i}" for i in range(12)), "n = 0"]
    assert [cell.text for cell in cup.cells] == [DASH] * 12 + ["0.500"]
    assert cup.cells[-1].note == "n = 1,200"


def test_all_classes_stand_last_and_nothing_has_no_table():
    rows = [loss(-1, "no_box", 0.5, 3), loss(1, "no_box", 0.25, 2)]
    grid = losses_grid(table("losses", rows), INFO)
    assert [(row.name, row.is_summary) for row in grid.rows] == [
        ("cup", False),
        ("all classes", True),
    ]
    assert losses_grid(table("losses", []), INFO) is None


TABLES = {  # s: 3 frames, one lost; t: 1 frame. Boxes of s: 2 placed, 1 without depth; of t: 1
    "frames": [frame("s", 0), frame("s", 1), frame("s", 2), frame("t", 0)],
    "annotations": [annotation("s", 0, i, 0, BOX) for i in range(5)],
    "poses": [
        *(pose("s", i, (0, 0, 0)) for i in (0, 1)),
        pose("s", 2, (), "lost"),
        pose("t", 0, (0, 0, 0)),
    ],
    "detections": [
        *(detection("s", 0, i, BOX, (1.0,)) for i in range(3)),
        detection("t", 0, 0, BOX, (1.0,)),
    ],
    "observations": [
        observation("s", 0, 0, (0, 0, 0)),
        observation("s", 0, 1),
        observation("s", 0, 2, (0, 0, 0)),
        observation("t", 0, 0, (0, 0, 0)),
    ],
}


def counts():
    return status_counts({name: table(name, rows) for name, rows in TABLES.items()})


def test_rows_by_stage_sequence_and_status():
    assert list(csv.reader(io.StringIO(to_csv(StatusCount._fields, counts()))))[1:] == [
        ["index", "s", "frames", "3"],
        ["index", "t", "frames", "1"],
        ["index", "s", "annotations", "5"],
        ["poses", "s", "tracked", "2"],
        ["poses", "s", "lost", "1"],
        ["poses", "t", "tracked", "1"],
        ["detect", "s", "detections", "3"],
        ["detect", "t", "detections", "1"],
        ["lift", "s", "placed", "2"],
        ["lift", "s", "no_depth", "1"],
        ["lift", "t", "placed", "1"],
    ]


def test_the_status_table_adds_up():
    grid = status_grid(counts(), ("s", "t"))
    assert [(column.group, column.text) for column in grid.columns] == [
        *(("index", "frames"), ("index", "annotations"), ("poses", "tracked"), ("poses", "lost")),
        *(("detect", "detections"), ("lift", "placed"), ("lift", "no depth")),
    ]
    assert {row.name: [int(cell.text) for cell in row.cells] for row in grid.rows} == {
        "s": [3, 5, 2, 1, 3, 2, 1],
        "t": [1, 0, 1, 0, 1, 1, 0],
        TOTAL: [4, 5, 3, 1, 4, 3, 1],
    }
