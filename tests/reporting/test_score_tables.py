"""The tables of scores show the metrics under the right headings, in the right units."""

import csv
import io

import pytest
from hand_tables import annotation, match, metric, table

from imodbatch.reporting.grids import Cell, Column, Grid, Row, marked_best
from imodbatch.reporting.names import DASH, in_order, number, percent, plural
from imodbatch.reporting.paper import TABLE_2
from imodbatch.reporting.results import Results
from imodbatch.reporting.scores import (
    ap_csv,
    ap_grid,
    ap_metrics,
    ap_title,
    paper_precision_recall_grid,
    precision_recall_csv,
    precision_recall_grid,
)

CLASSES = ("bowl", "cup", "pen")
BOWL, CUP, PEN, MEAN, BACKGROUND = 0, 1, 2, -1, -2
HEADLINE = "ap_voc07_11pt"

METRICS = [  # bowls 4, cups 3, no pen; every figure differs
    *(metric(HEADLINE, k, v, "single") for k, v in ((BOWL, 0.5), (CUP, 0.25), (MEAN, 0.375))),
    *(metric(HEADLINE, k, v) for k, v in ((BOWL, 0.625), (CUP, 0.125), (MEAN, 0.4375))),
    *(metric(HEADLINE, PEN, None, m, n_annotations=0) for m in ("single", "imod")),
    *(metric("n_false_positives", PEN, 2.0, m, n_annotations=0) for m in ("single", "imod")),
    *(metric("precision", k, v, "single") for k, v in ((BOWL, 0.9), (CUP, 0.8), (MEAN, 0.85))),
    *(metric("recall", k, v, "single") for k, v in ((BOWL, 0.7), (CUP, 0.6), (MEAN, 0.65))),
    *(metric("precision", k, v) for k, v in ((BOWL, 0.55), (CUP, 0.45), (MEAN, 0.5))),
    *(metric("recall", k, v) for k, v in ((BOWL, 0.35), (CUP, 0.15), (MEAN, 0.25))),
    metric("threshold", BOWL, 0.4, "single"),
    metric("threshold", CUP, 0.3, "single"),
    metric("threshold", BOWL, 1.25),
    metric("threshold", CUP, 1.5),
    *(metric("precision", BACKGROUND, 0.99, m) for m in ("single", "imod")),
    *(metric("recall", BACKGROUND, 0.98, m) for m in ("single", "imod")),
    metric("ap_area", BOWL, 0.75),
    metric("ap_area", BOWL, 0.0625, iou_percent=75),
    metric("ap_coco", BOWL, 0.1875, iou_percent=0),
]


def results():
    rows = [row | {"n_annotations": 3} if row["class_id"] == CUP else row for row in METRICS]
    tables = {
        "metrics": table("metrics", rows),
        "annotations": table("annotations", [annotation("s", 0, 0, BOWL, (0, 0, 1, 1))]),
        "matches": table("matches", [match("s", 0, 0, BOWL, 0.5, "T", "imod_offline")]),
    }
    return Results(tables, ("s",))


def texts(grid):
    return {row.name: [cell.text for cell in row.cells] for row in grid.rows}


def headings(grid):
    return [column.text for column in grid.columns]


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_methods_stand_in_order():
    """Baselines first, all methods of some frames before those of all frames, then the unknown."""
    names = ["x", "imod_offline", "imod", "naive_log_offline", "single", "naive_log", "naive"]
    assert in_order(names) == (
        *("single", "naive", "naive_log", "imod", "x"),
        *("naive_log_offline", "imod_offline"),
    )
    assert results().methods == ("single", "imod", "imod_offline")


def test_the_headline_shows_aps_and_counts_annotations():
    grid = ap_grid(results(), CLASSES, HEADLINE, 50)
    assert headings(grid) == [
        *("annotations", "single view", "imod (Konno 2020)"),
        "imod (Konno 2020), all frames",
    ]
    assert texts(grid) == {
        "bowl": ["4", "0.500", "0.625", DASH],
        "cup": ["3", "0.250", "0.125", DASH],
        "pen": ["0", DASH, DASH, DASH],
        "mean": ["7", "0.375", "0.438", DASH],
    }
    best = {row.name: [cell.is_best for cell in row.cells] for row in grid.rows}
    assert best["bowl"] == [False, False, True, False]
    assert best["cup"] == [False, True, False, False]
    assert not any(best["pen"])
    assert [row.is_summary for row in grid.rows] == [False, False, False, True]
    pen = grid.rows[PEN]
    assert [cell.note for cell in pen.cells] == [
        *("", "2 false positives", "2 false positives", "0 false positives"),
    ]


def test_every_ap_has_a_table_of_its_own():
    found = results()
    assert ap_metrics(found) == [(HEADLINE, 50), ("ap_area", 50), ("ap_coco", 0), ("ap_area", 75)]
    assert texts(ap_grid(found, CLASSES, "ap_area", 75))["bowl"] == [DASH, "0.062", DASH]
    assert ap_title("ap_area", 75) == "AP, area under the curve, IoU ≥ 0.75"
    assert ap_title("ap_coco", 0) == "AP@[.50:.95] (COCO)"


def test_the_csv_of_aps():
    rows = rows_of(ap_csv(results(), CLASSES))
    by_key = {(r["metric"], r["iou_percent"], r["class_name"]): r for r in rows}
    assert len(rows) == 4 * 4  # metrics × classes and mean
    bowl = by_key[HEADLINE, "50", "bowl"]
    assert (bowl["class_id"], bowl["n_annotations"]) == ("0", "4")
    assert (bowl["single"], bowl["imod"], bowl["imod_offline"]) == ("0.5", "0.625", "")
    assert by_key[HEADLINE, "50", "mean"]["n_annotations"] == "7"
    assert by_key["ap_area", "75", "bowl"]["imod"] == "0.0625"
    assert by_key["ap_coco", "0", "bowl"]["imod"] == "0.1875"


def test_precision_and_recall_in_percent_with_ap_and_threshold():
    grid = precision_recall_grid(results(), CLASSES)
    assert texts(grid) == {
        "bowl": ["90.0/70.0 (0.500)", "55.0/35.0 (0.625)", f"{DASH}/{DASH} ({DASH})"],
        "cup": ["80.0/60.0 (0.250)", "45.0/15.0 (0.125)", f"{DASH}/{DASH} ({DASH})"],
        "pen": [f"{DASH}/{DASH} ({DASH})"] * 3,
        "background": [f"99.0/98.0 ({DASH})"] * 2 + [f"{DASH}/{DASH} ({DASH})"],
        "mean": ["85.0/65.0 (0.375)", "50.0/25.0 (0.438)", f"{DASH}/{DASH} ({DASH})"],
    }
    notes = {row.name: [cell.note for cell in row.cells] for row in grid.rows}
    assert notes["bowl"] == ["≥ 0.40", "≥ 1.25", ""]
    assert notes["cup"] == ["≥ 0.30", "≥ 1.50", ""]
    assert notes["mean"] == ["", "", ""]


def test_the_csv_of_precision_and_recall():
    by_name = {row["class_name"]: row for row in rows_of(precision_recall_csv(results(), CLASSES))}
    names = ("precision", "recall", HEADLINE, "threshold")
    assert [by_name["bowl"][f"single_{n}"] for n in names] == ["0.9", "0.7", "0.5", "0.4"]
    assert [by_name["bowl"][f"imod_{n}"] for n in names] == ["0.55", "0.35", "0.625", "1.25"]
    assert [by_name["cup"][f"imod_{n}"] for n in names] == ["0.45", "0.15", "0.125", "1.5"]
    assert [by_name["background"][f"imod_{n}"] for n in names] == ["0.99", "0.98", "", ""]
    assert by_name["mean"]["class_id"] == "-1"
    assert by_name["background"]["class_id"] == "-2"
    assert by_name["bowl"]["iou_percent"] == "50"


def test_the_papers_cells_are_as_printed():
    grid = paper_precision_recall_grid(("bowl", "pen"), TABLE_2)
    assert grid is not None
    by_name = texts(grid)
    assert by_name["bowl"][:3] == ["96.3/65.8 (0.631)", "92.5/61.0 (0.606)", f"46.9/90.7 ({DASH})"]
    assert by_name["mean"][4] == "90.55/75.68 (0.655)"  # Naive, with two decimals
    assert by_name["pen"] == [DASH] * 9
    assert paper_precision_recall_grid(("bowl",), ()) is None


# Grids and numbers


def test_the_best_is_the_largest_and_what_looks_equal_is_equal():
    cells = marked_best([0.1, 0.50001, None, 0.50004], [""] * 4)
    assert [cell.is_best for cell in cells] == [False, True, False, True]
    assert not marked_best([0.1, None], ["", ""])[0].is_best  # the only one


def test_numbers_as_they_are_shown():
    assert [number(v) for v in (0.12345, None, float("nan"))] == ["0.123", DASH, DASH]
    assert [percent(v) for v in (0.5, 0.1234, None)] == ["50.0", "12.3", DASH]
    assert [plural(*pair) for pair in ((1, "box"), (2, "box"), (1200, "frame"))] == [
        *("1 box", "2 boxes", "1,200 frames"),
    ]


def test_a_grid_as_markdown_and_in_a_terminal():
    columns = (Column("boxes"), Column("a", "first"), Column("b", "first"), Column("a", "second"))
    cells = (Cell("7"), Cell("0.5", "1 box", is_best=True), Cell("0.25"), Cell("a|b"))
    grid = Grid("g", "Title", "class", columns, (Row("cup", cells),))
    assert grid.groups == [("", 1), ("first", 2), ("second", 1)]
    assert grid.markdown() == (
        "### Title\n\n"
        "| class | boxes | first: a | first: b | second: a |\n"
        "| --- | ---: | ---: | ---: | ---: |\n"
        "| cup | 7 | **0.5**, 1 box | 0.25 | a\\|b |\n"
    )
    assert grid.text().splitlines() == [
        "Title",
        "",
        "      |       | first     | sec",  # wrapped to the width of its columns
        "      |       |           | ond",
        "class | boxes |   a     b |   a",
        "-------------------------------",
        "cup   |     7 | 0.5  0.25 | a|b",
        "cup: first a: 1 box.",
    ]


def test_a_grid_without_groups_has_none():
    assert Grid("g", "t", "c", (Column("a"), Column("b")), ()).groups == []


@pytest.mark.parametrize("n_columns", [0, 1])
def test_markdown_has_a_rule_under_every_heading(n_columns):
    grid = Grid("g", "t", "c", (Column("a"),) * n_columns, ())
    assert grid.markdown().splitlines()[3].count("-:") == n_columns
