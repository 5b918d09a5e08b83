"""Table 2 from seven boxes in two sequences: thresholds, counts, cells and files, on paper.

Of 4 mugs, 1 in s and 3 in t, and one box, in t. Boxes on mugs: in s a true and a false one and one
on an ignored mug, in t a false and two true ones; in t one true box on the box.
"""

import csv
import io

import numpy as np
import pytest
from hand_runs import hand_run
from hand_tables import annotation, match

from imodbatch.core.errors import ConfigError
from imodbatch.reporting.comparison import compare_runs
from imodbatch.reporting.csv_text import csv_of
from imodbatch.reporting.names import DASH
from imodbatch.reporting.operating_points import HELD_OUT, ON_TEST, table_2_columns
from imodbatch.reporting.paper import MARK
from imodbatch.reporting.table_2 import beside, paper_table_2, remarks, table_2
from imodbatch.reporting.table_2_files import figures_table, thresholds_table

CLASSES = ("coffee_mug", "box")
MUG, BOX = 0, 1
STEP = 0.125
CORNERS = (0, 0, 1, 1)
ANNOTATIONS = [
    annotation("s", 0, 0, MUG, CORNERS),
    annotation("s", 0, 1, MUG, CORNERS, is_ignored=True),
    *(annotation("t", 0, i, MUG, CORNERS) for i in range(3)),
    annotation("t", 0, 3, BOX, CORNERS),
]
KEYS = [  # sequence, box, class, outcome
    ("s", 0, MUG, "T"),
    ("s", 1, MUG, "F"),
    ("s", 2, MUG, "I"),
    ("t", 0, MUG, "F"),
    ("t", 1, MUG, "T"),
    ("t", 2, MUG, "T"),
    ("t", 3, BOX, "T"),
]
SCORES = {
    "single": (0.25, 0.5, 0.9375, 0.5, 0.25, 0.25, 0.5),  # F F T T T
    "imod": (0.75, 0.5, 0.9375, 0.875, 0.75, 0.5, 0.5),  # F T T (F T)
    "imod_offline": (0.75, 0.25, 0.9375, 0.125, 0.75, 0.75, 0.5),  # T T T F F
}


def run(name, grid, *methods, annotations=ANNOTATIONS):
    """A run of these methods; where no annotation is a box, the box on it is wrong."""
    classes = {row["class_id"] for row in annotations}
    rows = [
        match(s, 0, i, k, score, outcome if k in classes else "F", method)
        for method in methods
        for (s, i, k, outcome), score in zip(KEYS, SCORES[method], strict=True)
    ]
    return hand_run(name, grid, CLASSES, annotations, rows)


@pytest.fixture
def comparison():
    return compare_runs([run("plain", (1, 1), "single"), run("aware", (3, 12), *SCORES)])


@pytest.fixture
def kept():
    """How many boxes each operating point kept, in the order in which it was asked."""
    return []


@pytest.fixture
def columns(comparison, kept):
    def background(_, boxes):
        kept.append(boxes.num_rows)
        return 0.9, 0.8

    return table_2_columns(comparison, STEP, background)


def column_of(columns, method, group=None):
    return next(c for c in columns if c.method == method and group in (None, c.name))


def test_columns_stand_in_the_papers_order(columns):
    assert [(c.grid, c.group, c.name, c.method) for c in columns] == [
        ("3×12", "single view", "w/o viewpoint", "single"),
        ("3×12", "single view", "w/ viewpoint", "single"),
        ("3×12", "multi-view", "Ours", "imod"),
        ("3×12", "multi-view, all frames", "Ours", "imod_offline"),
    ]
    assert [c.run.folder.name for c in columns] == ["plain", "aware", "aware", "aware"]


def test_thresholds_tuned_on_the_test_set(columns, kept):
    """imod's mugs, F1 of 1, 3, 5 kept: 0, 4/7, 6/9, so all are kept: 3 right of 5, of 4 mugs."""
    point = column_of(columns, "imod").points[ON_TEST]
    assert point.thresholds.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert point.counts.n_kept.tolist() == [5, 1]
    assert point.counts.n_hits.tolist() == [3, 1]
    assert point.counts.precision == pytest.approx([3 / 5, 1])
    assert point.counts.recall == pytest.approx([3 / 4, 1])
    assert point.mean == (  # over mug, box and background
        pytest.approx((3 / 5 + 1 + 0.9) / 3),
        pytest.approx((3 / 4 + 1 + 0.8) / 3),
    )
    # imod_offline: 1 to 3 mugs, then 4 and 5: 6/7 is the best, above .25
    offline = column_of(columns, "imod_offline").points[ON_TEST]
    assert offline.thresholds[MUG].tolist() == [0.375, 0.375]
    assert offline.counts.precision[MUG] == 1
    # imod on the test set keeps the ignored one as well: it hides background, and counts nowhere
    assert kept[4] == 7


def test_thresholds_of_held_out_sequences(columns, kept):
    """imod's mugs: s by t (F1 0, 2/5, 4/6) from 0 on, t by s (1, 2/3) from .625 on.

    That keeps T F in s and F T in t. Boxes are in t only, so t has no threshold for them.
    """
    point = column_of(columns, "imod").points[HELD_OUT]
    assert point.thresholds[MUG].tolist() == [0.0, 0.625]
    assert point.thresholds[BOX, 0] == 0.0
    assert np.isnan(point.thresholds[BOX, 1])
    assert (point.counts.n_kept[MUG], point.counts.n_hits[MUG]) == (4, 2)
    assert point.counts.precision[MUG] == pytest.approx(2 / 4)
    assert point.counts.recall[MUG] == pytest.approx(2 / 4)
    assert np.isnan(point.counts.precision[BOX])
    assert np.isnan(point.counts.recall[BOX])
    assert point.mean == (pytest.approx((2 / 4 + 0.9) / 2), pytest.approx((2 / 4 + 0.8) / 2))
    n_annotations = np.array([[1, 3], [0, 1]])
    assert point.n_untuned(n_annotations).tolist() == [0, 1]
    assert kept[5] == 2 + 1 + 2  # with the ignored one of s


def test_average_precisions_and_false_positives(columns):
    """imod: F T T F T of 4: 2/3 up to recall 1/2 (t 0 to 5), 3/5 up to 3/4 (t 6, 7)."""
    assert column_of(columns, "imod").aps == pytest.approx([(6 * 2 / 3 + 2 * 3 / 5) / 11, 1])
    assert column_of(columns, "imod_offline").aps == pytest.approx([8 / 11, 1])
    assert column_of(columns, "single").aps == pytest.approx([8 * 3 / 5 / 11, 1])
    assert column_of(columns, "imod").mean == pytest.approx((5.2 / 11 + 1) / 2)
    assert [[c.n_false_positives(k) for k in (0, 1)] for c in columns] == [[2, 0]] * 4


def texts(grid):
    return {row.name: [cell.text for cell in row.cells] for row in grid.rows}


def test_cells_are_precision_recall_and_ap(comparison, columns):
    grid = table_2(comparison, columns, ON_TEST, with_thresholds=True)
    by_name = texts(grid)
    # single keeps all five as well
    assert by_name["coffee_mug"] == [
        *("4", "60.0/75.0 (0.436)", "60.0/75.0 (0.436)", "60.0/75.0 (0.473)", "100.0/75.0 (0.727)"),
    ]
    assert by_name["box"] == ["1", *["100.0/100.0 (1.000)"] * 4]
    assert by_name["background"] == ["", *[f"90.0/80.0 ({DASH})"] * 4]
    assert by_name["mean"][0] == "5"
    assert by_name["mean"][3] == "83.3/85.0 (0.736)"
    best = {row.name: [cell.is_best for cell in row.cells] for row in grid.rows}
    assert best["coffee_mug"] == [False, False, False, False, True]
    assert best["box"] == [False, True, True, True, True]
    assert best["mean"] == [False, False, False, False, True]
    assert [row.is_summary for row in grid.rows] == [False, False, False, True]
    assert [c.note for c in grid.rows[MUG].cells] == ["", "≥ 0.00", "≥ 0.00", "≥ 0.00", "≥ 0.38"]
    assert [(c.group, c.text) for c in grid.columns][::4] == [
        ("true", "boxes"),
        ("multi-view, all frames", "Ours"),
    ]


def test_held_out_cells_say_what_is_left_out(comparison, columns):
    grid = table_2(comparison, columns, HELD_OUT, beside(CLASSES), with_thresholds=True)
    mug, box = grid.rows[MUG].cells, grid.rows[BOX].cells
    assert (mug[3].text, mug[3].note) == ("50.0/50.0 (0.473)", "≥ 0.00 to 0.62")
    assert box[3].text == f"{DASH}/{DASH} (1.000)"
    note = "1 true box left out: no threshold"
    assert [cell.note for cell in box[1:5]] == [f"≥ 0.00, {note}"] * 2 + ["≥ 0.00"] * 2
    # the paper's columns stand behind ours, where it has such a class
    assert mug[5].text == "93.0/79.0 (0.721)"
    assert box[5].text == DASH
    assert beside(("pen",)) == ()
    assert texts(paper_table_2())["soda_can"][:2] == ["96.8/65.4 (0.631)", "96.0/66.5 (0.627)"]


def test_remarks_count_classes_not_sequences():
    """One of two classes has annotations, in both of two sequences."""
    mugs = [row for row in ANNOTATIONS if row["class_id"] == MUG]
    comparison = compare_runs(
        [
            run("plain", (1, 1), "single", annotations=mugs),
            run("aware", (3, 12), "single", annotations=mugs),
        ]
    )
    found = table_2_columns(comparison, STEP, lambda *_: (0.9, 0.8))
    text = " ".join(remarks(comparison, found, STEP))
    assert "that of AP is over 1 classes with annotations" in text
    assert "A class without annotations has no figures" in text
    assert "Not among the methods of the run of 3×12: Naive, SLAM-aware rule, Ours." in text
    cells = table_2(comparison, found, ON_TEST).rows[BOX].cells
    assert [cell.note for cell in cells] == ["", "1 false positive", "1 false positive"]


def test_table_2_needs_a_detector_without_viewpoints():
    with pytest.raises(ConfigError, match="without viewpoints"):
        table_2_columns(compare_runs([run("aware", (3, 12), "imod")]), STEP, lambda *_: (0, 0))


def test_the_files_hold_every_figure(comparison, columns):
    rows = figures_table(comparison, columns).to_pylist()
    ours = {
        (r["method"], r["column"], r["tuning"], r["class_name"]): r
        for r in rows
        if r["source"] == "ours"
    }
    mug = ours["imod", "Ours", ON_TEST, "coffee_mug"]
    assert (mug["run"], mug["grid"], mug["group"]) == ("aware", "3×12", "multi-view")
    assert (mug["precision"], mug["recall"]) == (pytest.approx(3 / 5), pytest.approx(3 / 4))
    assert mug["ap_voc07_11pt"] == pytest.approx(5.2 / 11)
    assert (mug["n_annotations"], mug["n_kept"], mug["n_true_positives"]) == (4, 5, 3)
    assert mug["n_false_positives_any_score"] == 2
    background = ours["imod", "Ours", HELD_OUT, "background"]
    assert (background["precision"], background["recall"], background["class_id"]) == (0.9, 0.8, -2)
    assert background["ap_voc07_11pt"] is None
    mean = ours["imod", "Ours", HELD_OUT, "mean"]
    assert mean["precision"] == pytest.approx(0.7)
    assert mean["ap_voc07_11pt"] == pytest.approx((5.2 / 11 + 1) / 2)
    assert ours["imod", "Ours", HELD_OUT, "box"]["precision"] is None
    printed = {(r["group"], r["column"], r["class_name"]): r for r in rows if r["source"] == MARK}
    bowl = printed["multi-view", "Ours", "bowl"]  # 97.0/68.1/0.709
    assert (bowl["precision"], bowl["recall"], bowl["ap_voc07_11pt"]) == (
        *(pytest.approx(0.97), pytest.approx(0.681), 0.709),
    )
    assert bowl["class_id"] is None  # none of ours
    assert printed["multi-view", "Ours", "coffee_mug"]["class_id"] == MUG


def test_the_thresholds_file(comparison, columns):
    table = thresholds_table(comparison, columns)
    found = {
        (r["method"], r["tuning"], r["class_name"], r["sequence_id"]): r["threshold"]
        for r in table.to_pylist()
        if r["run"] == "aware"
    }
    assert found["imod", HELD_OUT, "coffee_mug", "s"] == 0.0
    assert found["imod", HELD_OUT, "coffee_mug", "t"] == 0.625
    assert found["imod", HELD_OUT, "box", "t"] is None
    assert found["imod_offline", ON_TEST, "coffee_mug", "t"] == 0.375
    lines = list(csv.DictReader(io.StringIO(csv_of(table))))
    assert len(lines) == table.num_rows == 4 * 2 * 2 * 2  # columns, tunings, classes, sequences
    assert {row["threshold"] for row in lines if row["class_name"] == "box"} == {"0.0", ""}


def test_one_sequence_alone_has_no_held_out_figures():
    alone = [row for row in ANNOTATIONS if row["sequence_id"] == "t"]
    rows = [match("t", 0, 0, MUG, 0.5, "T", "single")]
    runs = [
        hand_run(n, g, CLASSES, alone, rows, sequence_ids=("t",))
        for n, g in (("plain", (1, 1)), ("aware", (3, 12)))
    ]
    comparison = compare_runs(runs)
    found = table_2_columns(comparison, STEP, lambda *_: (0.9, 0.8))
    assert [set(c.points) for c in found] == [{ON_TEST}] * 2
    assert table_2(comparison, found, HELD_OUT).rows[MUG].cells[1].text == f"{DASH}/{DASH} (0.364)"
    assert any(
        text.startswith("Held-out sequences: there is one")
        for text in remarks(comparison, found, STEP)
    )
