"""Table 1 from cups in two sequences: APs, differences, cells and files, on paper."""

import csv
import io

import pytest
from hand_runs import hand_run
from hand_tables import annotation, match

from imodbatch.core.resampling import Interval
from imodbatch.reporting.comparison import compare_runs
from imodbatch.reporting.names import DASH
from imodbatch.reporting.table_1 import (
    Estimate,
    estimates,
    estimates_csv,
    estimates_grid,
    interval_remark,
    table_1,
    table_1_csv,
)

CLASSES = ("teacup", "spoon")
CUP, SPOON = 0, 1
BOX = (0, 0, 1, 1)
ANNOTATIONS = [  # a cup in s, two in t, one of them ignored; no spoon
    annotation("s", 0, 0, CUP, BOX),
    annotation("t", 0, 0, CUP, BOX),
    annotation("t", 0, 1, CUP, BOX, is_ignored=True),
]
GOOD, FAIR, BAD = 1.0, (6 + 5 * 2 / 3) / 11, (6 * 1 / 2 + 5 * 1 / 2) / 11
ORDERS = {  # scores of s T, s F, t T, t F
    GOOD: (0.9, 0.2, 0.8, 0.1),  # T T F F of 2
    FAIR: (0.9, 0.2, 0.4, 0.8),  # T F T F
    BAD: (0.2, 0.9, 0.1, 0.8),  # F F T T
}


def run(name, grid, **order_of_method):
    rows = []
    for method, order in order_of_method.items():
        places = (("s", 0, "T"), ("s", 1, "F"), ("t", 0, "T"), ("t", 1, "F"))
        rows += [
            match(s, 0, i, CUP, score, outcome, method)
            for (s, i, outcome), score in zip(places, ORDERS[order], strict=True)
        ]
        rows += [match(s, 0, 2, SPOON, 0.5, "F", method) for s in ("s", "t")]
        rows.append(match("t", 0, 3, CUP, 0.99, "I", method, found=1))
    return hand_run(name, grid, CLASSES, ANNOTATIONS, rows)


@pytest.fixture
def comparison():
    return compare_runs(
        [
            run("eight", (3, 8), single=FAIR, imod=GOOD),
            run("plain", (1, 1), single=FAIR),
            run("sixteen", (3, 16), single=BAD, naive=FAIR, imod=FAIR, imod_offline=GOOD),
        ]
    )


def test_columns_and_what_counts(comparison):
    """More azimuths first; the ignored cup is not to be found, the box on it not wrong."""
    assert [*comparison.groups] == ["3×16", "3×8"]
    assert comparison.n_annotations.tolist() == [[1, 1], [0, 0]]
    found = {(c.group, c.name): c for c in comparison.columns}
    assert {key: column.aps[CUP] for key, column in found.items()} == {
        ("3×16", "w/o view"): pytest.approx(FAIR),
        ("3×16", "w/ view"): pytest.approx(BAD),
        ("3×16", "Naive"): pytest.approx(FAIR),
        ("3×16", "Ours"): pytest.approx(FAIR),
        ("3×16", "Ours, all frames"): GOOD,
        ("3×8", "w/o view"): pytest.approx(FAIR),
        ("3×8", "w/ view"): pytest.approx(FAIR),
        ("3×8", "Ours"): GOOD,
    }
    assert [column.n_false_positives(CUP) for column in found.values()] == [2] * 8


def test_the_grid(comparison):
    grid = table_1(comparison)
    by_name = {row.name: row for row in grid.rows}
    heads = [(column.group, column.text) for column in grid.columns]
    cup = dict(zip(heads, by_name["teacup"].cells, strict=True))
    assert cup["true", "boxes"].text == "2"
    assert cup["3×16", "w/o view"].text == f"{FAIR:.3f}" == "0.848"
    assert cup["3×16", "w/ view"].text == "0.500"
    assert cup["3×16", "Ours, all frames"].text == "1.000"
    assert [k for k, cell in cup.items() if cell.is_best] == [
        ("3×16", "Ours, all frames"),
        ("3×8", "Ours"),
    ]
    # what the paper prints for teacups with 16 and with 8 azimuths
    assert cup["3×16, paper: other data, simulation", "w/ view"].text == "0.801"
    assert cup["3×8, paper: other data, simulation", "w/ view"].text == "0.886"
    spoon = dict(zip(heads, by_name["spoon"].cells, strict=True))
    assert spoon["true", "boxes"].text == "0"
    assert spoon["3×16", "w/ view"].text == DASH
    assert spoon["3×16", "w/ view"].note == "2 false positives"
    assert spoon["3×16", "Ours"].note == ""  # said once per detector
    mean = dict(zip(heads, by_name["mean"].cells, strict=True))
    assert mean["true", "boxes"].text == "2"
    assert mean["3×16", "w/ view"].text == "0.500"  # the spoon has no AP
    assert mean["3×16, paper: other data, simulation", "Ours"].text == "0.822"
    assert by_name["mean"].is_summary


def test_the_csv(comparison):
    rows = {r["class_name"]: r for r in csv.DictReader(io.StringIO(table_1_csv(comparison)))}
    assert [rows[n]["n_annotations"] for n in ("teacup", "spoon", "mean")] == ["2", "0", "2"]
    assert float(rows["teacup"]["3×16 w/ view"]) == pytest.approx(BAD)
    assert float(rows["teacup"]["3×16 Ours, all frames"]) == GOOD
    assert float(rows["teacup"]["3×8 Ours"]) == GOOD
    assert rows["spoon"]["3×16 Ours"] == ""
    assert rows["spoon"]["3×16 Ours, false positives"] == "2"
    assert rows["mean"]["3×16 Ours, false positives"] == "4"
    assert rows["teacup"]["3×8 Ours (paper: other data, simulation)"] == "0.909"


def test_differences_are_gains(comparison):
    """Ours over w/ view is FAIR − BAD; nothing is lost or gained between equal columns."""
    found = {(e.group, e.name): e for e in estimates(comparison, 50)}
    assert found["3×16", "Ours − w/ view"].value == pytest.approx(FAIR - BAD)
    assert found["3×16", "Ours − Naive"].value == 0
    assert found["3×16", "w/ view − w/o view"].value == pytest.approx(BAD - FAIR)
    assert found["3×8", "Ours − w/ view"].value == pytest.approx(GOOD - FAIR)
    assert ("3×8", "Ours − Naive") not in found
    assert found["3×16", "Ours, all frames"].value == GOOD
    assert not found["3×16", "Ours"].is_difference
    # resamples are s s, s t, t t: FAIR is perfect on s and 1/2 on t, BAD 1/2 on each
    gain = found["3×16", "Ours − w/ view"].interval
    assert (gain.low, gain.high) == pytest.approx((0.0, 0.5))


def test_estimates_as_they_are_shown():
    found = [
        Estimate("3×16", "Ours", 0.5, Interval(0.25, 0.75), False),
        Estimate("3×16", "Ours − Naive", 0.125, Interval(-0.0625, 0.1875), True),
        Estimate("3×8", "Ours", float("nan"), None, False),
    ]
    rows = {row.name: [cell.text for cell in row.cells] for row in estimates_grid(found).rows}
    assert rows == {
        "3×16 Ours": ["0.500", "0.250", "0.750"],
        "3×16 Ours − Naive": ["+0.125", "-0.062", "+0.188"],
        "3×8 Ours": [DASH] * 3,
    }
    assert estimates_csv(found).splitlines() == [
        "grid,column,mean_ap,low,high",
        "3×16,Ours,0.5,0.25,0.75",
        "3×16,Ours − Naive,0.125,-0.0625,0.1875",
        "3×8,Ours,,,",
    ]


def test_few_sequences_have_few_resamples(comparison):
    """Of two sequences: s s, s t, t t."""
    assert "there are only 3 different resamples" in interval_remark(comparison, 50)
