"""Table 2: thresholds, counts and pixels worked out anew from the rows, and what cannot be made."""

import csv
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import Result

from imodbatch.core.errors import ConfigError, TableError
from imodbatch.reporting import paper
from imodbatch.reporting.comparing import table_2_of_folders
from imodbatch.reporting.table_2 import paper_table_2
from imodbatch.tables.parquet import TableInfo, empty, from_rows, read_info, table_path, write_table
from imodbatch.tables.schemas import TABLES

CLASSES = ("bowl", "cap", "flashlight")
BOWL, CAP, FLASHLIGHT = range(3)
SEQUENCES = ("a", "b", "c")
WIDTH, HEIGHT = 24, 16
FRAME = {"color_path": "c", "depth_scale_m": 0.001} | {
    f"{prefix}{name}": value
    for prefix in ("", "depth_")
    for name, value in {
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "fx_px": 20.0,
        "fy_px": 20.0,
    }.items()
}
FRAME |= {"cx_px": 12.0, "cy_px": 8.0, "depth_cx_px": 12.0, "depth_cy_px": 8.0}
METHODS = ("single", "naive", "naive_log", "imod", "imod_offline")
ON_TEST, HELD_OUT = "tuned on the test set", "held-out sequences"


def box(x0: float, y0: float, x1: float, y1: float) -> dict[str, float]:
    return {"x0_px": x0, "y0_px": y0, "x1_px": x1, "y1_px": y1}


TRUE_BOXES = {BOWL: box(1, 1, 9.5, 8), CAP: box(12, 3.5, 20, 12)}
IGNORED_BOX = box(0, 12, 5, 16)


def annotations_of(sequence: str) -> list[dict[str, Any]]:
    """A bowl and a cap in each of two frames; caps in the first sequence only; one ignored bowl."""
    rest = {"is_crowd": False, "instance_id": None, "own_azimuth_rad": None, "symmetry": None}
    rows = []
    for frame in (0, 1):
        shown = [(BOWL, TRUE_BOXES[BOWL], False)]
        shown += [(CAP, TRUE_BOXES[CAP], False)] if sequence == "a" else []
        shown += [(BOWL, IGNORED_BOX, True)] if frame else []
        rows += [
            {"sequence_id": sequence, "frame_index": frame, "annotation_index": i}
            | {"class_id": k, "is_ignored": is_ignored, **corners, **rest}
            for i, (k, corners, is_ignored) in enumerate(shown)
        ]
    return rows


def detections_of(sequence: str, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Per frame and class a box on the truth and two stray ones; one on the ignored bowl."""
    rows = []
    for frame in (0, 1):
        found = []
        for class_id in range(len(CLASSES)):
            if class_id == BOWL or (class_id == CAP and sequence == "a"):
                corners = {
                    key: v + rng.uniform(-0.4, 0.4) for key, v in TRUE_BOXES[class_id].items()
                }
                found.append((class_id, corners, "true_positive"))
            for _ in range(2):
                x, y = rng.uniform(0, 14), rng.uniform(0, 8)
                stray = box(x, y, x + rng.uniform(1, 10), y + rng.uniform(1, 8))
                found.append((class_id, stray, "false_positive"))
        if frame:
            found.append((BOWL, IGNORED_BOX, "ignored"))
        rows += [
            {"sequence_id": sequence, "frame_index": frame, "detection_index": i}
            | {"class_id": k, "outcome": outcome, **corners}
            for i, (k, corners, outcome) in enumerate(found)
        ]
    return rows


def write(
    folder: Path, name: str, unit: str, rows: list[dict], provenance: dict, **attributes: object
) -> None:
    spec = TABLES[name]
    table = from_rows(spec, rows) if rows else empty(spec)
    write_table(
        table_path(folder, name, unit),
        table,
        TableInfo(name, spec.version, spec.key, provenance, "", attributes),
    )


@dataclass
class Run:
    """A run as `imodbatch run` leaves it, as far as Table 2 looks, with the rows behind it."""

    folder: Path
    has_viewpoints: bool = True
    seed: int = 0
    methods: tuple[str, ...] = METHODS
    sequences: tuple[str, ...] = SEQUENCES
    classes: tuple[str, ...] = CLASSES
    threshold_step: float = 0.01
    rows: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        n_elevations, n_azimuths = (3, 12) if self.has_viewpoints else (1, 1)
        grid = {"n_elevations": n_elevations, "n_azimuths": n_azimuths}
        vector = [0.1] * (len(CLASSES) * (36 if self.has_viewpoints else 1))
        for s in self.sequences:
            found = detections_of(s, rng)
            key = ("sequence_id", "frame_index", "detection_index")
            for row in found:
                scale = {"true_positive": 1.2, "false_positive": 0.9, "ignored": 2.0}[
                    row["outcome"]
                ]
                row["scores"] = {
                    m: float(np.float32(scale * rng.uniform(0.2, 2.0) - (m == "naive_log")))
                    for m in self.methods
                }
            self.rows += found
            frames = [{"sequence_id": s, "frame_index": f, **FRAME} for f in (0, 1)]
            write(self.folder, "frames", s, frames, {})
            write(self.folder, "annotations", s, annotations_of(s), {})
            boxes = [
                {name: row[name] for name in (*key, *box(0, 0, 0, 0))}
                | {"background_score": 0.1, "class_ids": [row["class_id"]], "view_scores": vector}
                for row in found
            ]
            write(self.folder, "detections", s, boxes, {}, **grid)
            matches = [
                {name: row[name] for name in (*key, "class_id", "outcome")}
                | {"method": m, "iou_percent": 50, "score": row["scores"][m]}
                | {"annotation_index": 0 if row["outcome"] == "true_positive" else None}
                for row in found
                for m in self.methods
            ]
            write(self.folder, "matches", s, matches, {"of": str(self.folder)})
        digests = {
            s: read_info(table_path(self.folder, "matches", s)).digest for s in self.sequences
        }
        provenance = {"inputs": {"matches": digests}}
        said = {"classes": self.classes, "threshold_step": self.threshold_step}
        write(self.folder, "metrics", "run", [], provenance, **said)


@pytest.fixture
def runs(tmp_path: Path) -> list[Run]:
    """Of a detector without viewpoints, and of one with 3×12."""
    return [
        Run(tmp_path / "plain", False, 1, ("single", "naive", "naive_log", "imod")),
        Run(tmp_path / "aware", True, 2),
    ]


COLUMNS = [  # group, column, which run, method
    ("single view", "w/o viewpoint", 0, "single"),
    ("single view", "w/ viewpoint", 1, "single"),
    ("multi-view", "Naive", 1, "naive"),
    ("multi-view", "SLAM-aware rule", 1, "naive_log"),
    ("multi-view", "Ours", 1, "imod"),
    ("multi-view, all frames", "Ours", 1, "imod_offline"),
]


def folders(runs: list[Run]) -> list[Path]:
    return [run.folder for run in runs]


def figures(runs: list[Run]) -> pd.DataFrame:
    return table_2_of_folders(folders(runs)).files["table2.parquet"].to_pandas()


# The same figures another way: plain loops over the rows of a run


def brute_threshold(rows: list[dict], method: str, n: int) -> float:
    """Best F1 over all multiples of 0.01 there could be; the lowest among equals."""
    if n == 0:
        return float("nan")
    lowest = min([0.0, *(row["scores"][method] for row in rows)])
    steps = range(int(np.floor(lowest * 100)) - 1, 500)
    best, chosen = -1.0, float("nan")
    for threshold in (step * 0.01 for step in steps if step >= 0 or lowest < 0):
        kept = [row for row in rows if row["scores"][method] >= threshold]
        f1 = 2 * sum(row["outcome"] == "true_positive" for row in kept) / (len(kept) + n)
        if f1 > best:
            best, chosen = f1, threshold
    return chosen


def brute_point(run: Run, method: str, tuning: str) -> dict[str, tuple[float, float]]:
    """Precision and recall by class name, and of the background pixel by pixel."""
    counted = [a for s in run.sequences for a in annotations_of(s) if not a["is_ignored"]]
    kept: list[dict] = []
    found = {}
    for k, name in enumerate(CLASSES):
        boxes = [row for row in run.rows if row["class_id"] == k]
        n_kept = n_hits = n_true = 0
        for s in run.sequences:
            seen = [t for t in run.sequences if tuning == ON_TEST or t != s]
            threshold = brute_threshold(
                [r for r in boxes if r["sequence_id"] in seen and r["outcome"] != "ignored"],
                method,
                sum(a["class_id"] == k and a["sequence_id"] in seen for a in counted),
            )
            mine = [r for r in boxes if r["sequence_id"] == s and r["scores"][method] >= threshold]
            kept += mine
            n_kept += sum(r["outcome"] != "ignored" for r in mine)
            n_hits += sum(r["outcome"] == "true_positive" for r in mine)
            if not np.isnan(threshold):
                n_true += sum(a["class_id"] == k and a["sequence_id"] == s for a in counted)
        found[name] = (
            n_hits / n_kept if n_kept and n_true else np.nan,
            n_hits / n_true if n_true else np.nan,
        )
    found["background"] = brute_background(run, kept)
    found["mean"] = tuple(np.nanmean([pair[i] for pair in found.values()]) for i in (0, 1))
    return found


def inside(corners: dict[str, float], x: int, y: int) -> bool:
    """Whether the centre of pixel (x, y) lies in the box."""
    return (
        corners["x0_px"] <= x + 0.5 < corners["x1_px"]
        and corners["y0_px"] <= y + 0.5 < corners["y1_px"]
    )


def brute_background(run: Run, kept: list[dict]) -> tuple[float, float]:
    both = predicted = true = 0
    for s in run.sequences:
        for frame in (0, 1):
            shown = [a for a in annotations_of(s) if a["frame_index"] == frame]
            mine = [r for r in kept if (r["sequence_id"], r["frame_index"]) == (s, frame)]
            for y in range(HEIGHT):
                for x in range(WIDTH):
                    if any(a["is_ignored"] and inside(a, x, y) for a in shown):
                        continue
                    is_predicted = not any(inside(r, x, y) for r in mine)
                    is_true = not any(inside(a, x, y) for a in shown)
                    both += is_predicted and is_true
                    predicted += is_predicted
                    true += is_true
    return both / predicted, both / true


@pytest.mark.parametrize("tuning", [ON_TEST, HELD_OUT])
def test_every_figure_by_brute_force(runs: list[Run], tuning: str) -> None:
    table = figures(runs)
    ours = table[(table.source == "ours") & (table.tuning == tuning)]
    assert len(ours) == len(COLUMNS) * 5
    for group, name, which, method in COLUMNS:
        rows = ours[(ours.group == group) & (ours.column == name)].set_index("class_name")
        assert set(rows.method) == {method}
        expected = brute_point(runs[which], method, tuning)
        for class_name, pair in expected.items():
            got = rows.loc[class_name, ["precision", "recall"]].to_numpy(float)
            np.testing.assert_allclose(got, pair, rtol=1e-12, err_msg=f"{name} {class_name}")


def test_the_two_tunings_differ_and_the_test_set_flatters(runs: list[Run]) -> None:
    table = figures(runs)
    f1 = {}
    for tuning in (ON_TEST, HELD_OUT):
        rows = table[(table.tuning == tuning) & (table.class_id == BOWL)]
        f1[tuning] = (2 * rows.n_true_positives / (rows.n_kept + rows.n_annotations)).to_numpy()
    assert (f1[ON_TEST] >= f1[HELD_OUT]).all()
    assert (f1[ON_TEST] > f1[HELD_OUT]).any()


def test_the_order_of_the_columns_is_the_papers(runs: list[Run]) -> None:
    for given in (runs, runs[::-1]):
        test, held_out, _, _ = table_2_of_folders(folders(given)).parts
        heads = [(c.group, c.text) for c in test.columns[1:]]
        assert heads == [(group, name) for group, name, _, _ in COLUMNS]
        assert [c.text for c in held_out.columns] == [c.text for c in test.columns]


def test_rows_are_classes_background_and_mean(runs: list[Run]) -> None:
    for grid in table_2_of_folders(folders(runs)).parts[:2]:
        assert [row.name for row in grid.rows] == [*CLASSES, "background", "mean"]
        assert [row.cells[0].text for row in grid.rows] == ["6", "2", "0", "", "8"]


def test_a_class_without_annotations_is_dashed_and_its_false_positives_counted(
    runs: list[Run],
) -> None:
    document = table_2_of_folders(folders(runs))
    for grid in document.parts[:2]:
        flashlight = grid.rows[FLASHLIGHT]
        assert {cell.text for cell in flashlight.cells[1:]} == {"–/– (–)"}
        assert [cell.note for cell in flashlight.cells[1:4]] == ["12 false positives"] * 2 + [""]
    assert "false positives, at any score, are counted" in flat(document.text())


def test_a_class_of_one_sequence_has_no_held_out_figures_and_says_so(runs: list[Run]) -> None:
    document = table_2_of_folders(folders(runs))
    test, held_out, *_ = document.parts
    assert all(not cell.text.startswith("–") for cell in test.rows[CAP].cells[1:])
    aps = [cell.text.split()[1] for cell in test.rows[CAP].cells[1:]]
    assert [cell.text for cell in held_out.rows[CAP].cells[1:]] == [f"–/– {ap}" for ap in aps]
    assert held_out.rows[CAP].cells[1].note == "2 true boxes left out: no threshold"
    assert "there is no threshold" in flat(document.text())


def test_one_sequence_has_no_held_out_figures_and_says_why(tmp_path: Path) -> None:
    runs = [
        Run(tmp_path / "plain", False, 1, sequences=("a",)),
        Run(tmp_path / "aware", True, 2, sequences=("a",)),
    ]
    document = table_2_of_folders(folders(runs))
    held_out = document.parts[1]
    texts = [cell.text for row in held_out.rows for cell in row.cells[1:]]
    assert all(text.startswith("–/– ") for text in texts)
    assert "there is one sequence only, so there is no other to choose a threshold on" in (
        flat(document.text())
    )
    table = document.files["table2.parquet"].to_pandas()
    assert table[table.tuning == HELD_OUT][["precision", "recall", "n_kept"]].isna().all(axis=None)
    assert set(document.files["table2_thresholds.parquet"]["tuning"].to_pylist()) == {ON_TEST}


def test_thresholds_are_all_there_and_those_that_were_used(runs: list[Run]) -> None:
    table = table_2_of_folders(folders(runs)).files["table2_thresholds.parquet"].to_pandas()
    assert len(table) == len(COLUMNS) * 2 * len(CLASSES) * len(SEQUENCES)
    ours = table[(table.method == "imod") & (table.class_id == BOWL)]
    on_test = ours[ours.tuning == ON_TEST].threshold
    counted = [r for r in runs[1].rows if r["class_id"] == BOWL and r["outcome"] != "ignored"]
    assert on_test.to_numpy() == pytest.approx([brute_threshold(counted, "imod", 6)] * 3)
    held_out = ours[ours.tuning == HELD_OUT].set_index("sequence_id").threshold
    for s in SEQUENCES:
        others = [r for r in counted if r["sequence_id"] != s]
        assert held_out[s] == pytest.approx(brute_threshold(others, "imod", 4))


def test_a_missing_method_is_named(tmp_path: Path) -> None:
    runs = [Run(tmp_path / "plain", False, 1), Run(tmp_path / "aware", methods=("single", "imod"))]
    text = flat(table_2_of_folders(folders(runs)).text())
    assert "Not among the methods of the run of 3×12: Naive, SLAM-aware rule." in text


def test_a_method_of_its_own_name_gets_a_column(tmp_path: Path) -> None:
    runs = [Run(tmp_path / "plain", False, 1), Run(tmp_path / "aware", methods=("single", "new"))]
    (grid, *_) = table_2_of_folders(folders(runs)).parts
    assert [(c.group, c.text) for c in grid.columns[3:]] == [("multi-view", "new")]


def test_two_detectors_stand_side_by_side(runs: list[Run], tmp_path: Path) -> None:
    other = Run(tmp_path / "other", seed=3, methods=("single", "imod"))
    grid, *_ = table_2_of_folders([*folders(runs), other.folder]).parts
    groups = {c.group for c in grid.columns[1:]}
    assert {"3×12 aware, single view", "3×12 other, multi-view"} <= groups


# The paper's figures

PRINTED = """
bowl 96.3/65.8 (0.631) 92.5/61.0 (0.606) 46.9/90.7 (-) 88.6/71.6 (-) 94.6/66.0 (0.613) \
97.0/68.1 (0.709) 91.5/85.1 (-) 97.0/89.1 (-) 88.7/70.2 (-)
cap 84.4/69.1 (0.626) 88.0/61.9 (0.599) 54.1/90.5 (-) 85.2/62.0 (-) 82.2/69.2 (0.564) \
90.1/69.2 (0.689) 90.5/91.4 (-) 82.7/99.0 (-) 99.4/72.0 (-)
cereal_box 94.3/74.4 (0.724) 93.3/71.3 (0.709) 76.1/90.7 (-) 83.8/75.4 (-) 92.4/76.0 (0.711) \
94.9/76.1 (0.802) 93.6/94.9 (-) 96.2/99.3 (-) 95.6/84.3 (-)
coffee_mug 93.0/79.0 (0.721) 83.2/80.6 (0.719) 42.7/74.1 (-) 70.8/50.8 (-) 91.1/79.4 (0.775) \
93.9/79.4 (0.795) 90.0/75.1 (-) 81.0/92.6 (-) 80.1/64.1 (-)
soda_can 96.8/65.4 (0.631) 96.0/66.5 (0.627) 51.6/87.4 (-) 78.3/42.0 (-) 93.4/66.7 (0.612) \
97.8/72.3 (0.723) 81.5/87.4 (-) 97.7/98.0 (-) 89.1/75.6 (-)
background 90.8/96.5 (-) 90.4/95.2 (-) 98.8/93.9 (-) 95.0/90.0 (-) 89.6/96.8 (-) 91.6/97.1 (-) \
99.0/99.1 (-) 95.8/95.0 (-) 96.6/96.8 (-)
mean 92.6/75.0 (0.667) 90.6/72.8 (0.652) 61.7/87.9 (-) 81.5/59.4 (-) 90.55/75.68 (0.655) \
94.2/77.0 (0.744) 91.0/88.8 (-) 90.9/95.6 (-) 89.8/72.0 (-)
"""
"""Table 2 as the paper's text has it."""
PRINTED_HEADS = [
    "w/o viewpoint", "w/ viewpoint", "DetOnly [29]", "SLAM-aware [34]", "Naive", "Ours",
    "Det3DMRF [29]", "HMP2D+3D [26]", "SLAM-aware [34]",
]  # fmt: skip


def test_the_papers_table_is_as_printed() -> None:
    grid = paper_table_2()
    assert [c.text for c in grid.columns] == PRINTED_HEADS
    assert all(c.group.startswith("paper: other data") for c in grid.columns)
    lines = [" ".join([row.name, *(cell.text for cell in row.cells)]) for row in grid.rows]
    assert lines == PRINTED.replace("(-)", "(–)").strip().splitlines()


def test_the_papers_means_are_over_six_rows() -> None:
    """METHOD.md: AP .667 .652 .655 .744; precision/recall of Ours 94.2/77.0."""
    own = [c for c in paper.TABLE_2 if c.ap["mean"] is not None]
    assert [c.ap["mean"] for c in own] == [0.667, 0.652, 0.655, 0.744]
    assert own[-1].precision_recall["mean"] == (94.2, 77.0)
    assert {len(c.precision_recall.keys() - {"mean"}) for c in own} == {6}


def test_the_papers_columns_stand_beside_ours_and_are_marked(runs: list[Run]) -> None:
    """Bowls and caps have a row there, flashlights none."""
    wide = table_2_of_folders(folders(runs)).page_grids[0]
    beside = [i for i, c in enumerate(wide.columns) if c.group.startswith("paper: other data")]
    assert [wide.columns[i].text for i in beside] == PRINTED_HEADS
    rows = {row.name: [row.cells[i].text for i in beside] for row in wide.rows}
    assert rows["bowl"][5] == "97.0/68.1 (0.709)"
    assert rows["mean"][5] == "94.2/77.0 (0.744)"
    assert rows["flashlight"] == ["–"] * 9


def test_where_no_class_is_the_papers_its_table_stands_alone(tmp_path: Path) -> None:
    classes = ("ladle", "hat", "torch")
    runs = [
        Run(tmp_path / "plain", False, 1, classes=classes),
        Run(tmp_path / "aware", True, 2, classes=classes),
    ]
    test, held_out, printed = table_2_of_folders(folders(runs)).page_grids
    assert printed == paper_table_2()
    assert not any("paper" in c.group for c in (*test.columns, *held_out.columns))


# Files, and the command line


class Cells(HTMLParser):
    """The text of each row's cells, notes included; raises on tags that do not close."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        del attrs
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in ("meta",):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data


def test_from_the_command_line(cli: Callable[..., Result], runs: list[Run], tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = cli("compare", *folders(runs), "--table", "2", "--out", out)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("Compared: plain, aware\n")
    assert f"IoU ≥ 0.50: {ON_TEST}\n" in result.stdout
    assert f"IoU ≥ 0.50: {HELD_OUT}\n" in result.stdout
    assert result.stdout.endswith(f"\ncompare: {out / 'table2.html'}\n")
    names = [f"table2{rest}" for rest in (".csv", ".html", ".parquet")]
    names += [f"table2_thresholds{rest}" for rest in (".csv", ".parquet")]
    assert sorted(path.name for path in out.iterdir()) == names
    page = Cells()
    page.feed((out / "table2.html").read_text(encoding="utf-8"))
    assert page.open == []
    document = table_2_of_folders(folders(runs))
    drawn = [row for row in page.rows if row and row[0] in (*CLASSES, "background", "mean")]
    expected = [
        [row.name, *(cell.text + cell.note for cell in row.cells)]
        for grid in document.page_grids
        for row in grid.rows
    ]
    assert drawn == expected
    assert any("≥ " in cell for cell in drawn[BOWL])


def test_csv_and_parquet_hold_the_same(runs: list[Run], tmp_path: Path) -> None:
    table_2_of_folders(folders(runs)).write(tmp_path / "out")
    for name in ("table2", "table2_thresholds"):
        table = pq.read_table(tmp_path / f"out/{name}.parquet")
        with (tmp_path / f"out/{name}.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert table.num_rows == len(rows) > 0
        for stored, read in zip(table.to_pylist(), rows, strict=True):
            assert read == {k: "" if v is None else str(v) for k, v in stored.items()}


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ((1,), "aware: Table 2 compares with a detector without viewpoints, and no run of one"),
        ((0,), "plain: its detector tells no viewpoints apart."),
        ((0, 0, 1), "are both of detectors without viewpoints."),
    ],
)
def test_runs_that_make_no_table_2(
    cli: Callable[..., Result], runs: list[Run], named: tuple[int, ...], message: str
) -> None:
    result = cli("compare", *(runs[i].folder for i in named), "--table", "2")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: ")
    assert message in line


@pytest.mark.parametrize(
    ("other", "what"),
    [
        ({"sequences": ("a", "b")}, "sequences"),
        ({"classes": ("cup", "hat", "torch")}, "classes"),
    ],
)
def test_runs_of_other_manifests(
    runs: list[Run], tmp_path: Path, other: dict[str, Any], what: str
) -> None:
    foreign = Run(tmp_path / "foreign", False, 1, **other)
    with pytest.raises(ConfigError, match=f"differ in {what}"):
        table_2_of_folders([foreign.folder, runs[1].folder])


@pytest.mark.parametrize("table", ["frames", "annotations", "detections", "matches", "metrics"])
def test_a_missing_table_is_one_line(
    cli: Callable[..., Result], runs: list[Run], table: str
) -> None:
    shutil.rmtree(runs[1].folder / table)
    with pytest.raises(TableError, match=f"{table}.*imodbatch run"):
        table_2_of_folders(folders(runs))
    result = cli("compare", *folders(runs), "--table", "2")
    assert result.exit_code == 1
    assert len(result.stderr.splitlines()) == 1


def test_there_is_no_table_3(cli: Callable[..., Result], runs: list[Run]) -> None:
    assert cli("compare", *folders(runs), "--table", "3").exit_code == 2


# A real run


def test_the_figures_tuned_on_the_test_set_are_those_of_the_metrics(
    cli: Callable[..., Result],
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    tmp_path: Path,
) -> None:
    """Two whole runs, the detector without viewpoints being the other one summed over them."""
    text = analytic_manifest(analytic_data, "walk_1", "walk_2")
    boxes = pd.read_parquet(analytic_data / "detections.parquet")
    sums = [np.reshape(v, (5, -1)).sum(axis=1).astype(np.float32) for v in boxes.view_scores]
    boxes.assign(view_scores=sums).to_parquet(tmp_path / "sums.parquet")
    plain = text.replace('path = "detections.parquet"', f'path = "{tmp_path / "sums.parquet"}"')
    plain = plain.replace("n_azimuths = 16\n", "").replace(
        "elevations_deg = [10.0, 30.0, 50.0]\n", ""
    )
    assert plain.count("sums.parquet") == 1
    (tmp_path / "quick.toml").write_text("[sweep]\nvoxel_sizes_m = [0.2]\n[report]\nn_frames = 0\n")
    for name, manifest in (("plain", plain), ("aware", text)):
        (tmp_path / f"{name}.toml").write_text(manifest)
        arguments = (tmp_path / f"{name}.toml", "--pipeline", tmp_path / "quick.toml")
        result = cli("run", *arguments, "--out", tmp_path / name)
        assert result.exit_code == 0, result.stderr
    document = table_2_of_folders([tmp_path / "plain", tmp_path / "aware"])
    table = document.files["table2.parquet"].to_pandas()
    ours = table[(table.tuning == ON_TEST) & (table.class_name != "mean")]
    assert len(ours) == 8 * 6
    for run, rows in ours.groupby("run"):
        metrics = pd.read_parquet(tmp_path / str(run) / "metrics")
        metrics = metrics[metrics.iou_percent == 50]
        metrics = metrics.set_index(["method", "class_id", "metric"]).value
        for row in rows.itertuples():
            for metric in ("precision", "recall"):
                expected = metrics[row.method, row.class_id, metric]
                assert getattr(row, metric) == pytest.approx(expected, nan_ok=True)
            if row.class_id >= 0:
                expected = metrics[row.method, row.class_id, "ap_voc07_11pt"]
                assert row.ap_voc07_11pt == pytest.approx(expected, nan_ok=True)
    held_out = table[table.tuning == HELD_OUT]
    assert held_out.recall.notna().any()


def flat(text: str) -> str:
    """Text on one line, however it was wrapped."""
    return " ".join(text.split())


def test_runs_of_different_threshold_steps_do_not_go_together(tmp_path: Path) -> None:
    coarse = Run(tmp_path / "coarse", has_viewpoints=False, threshold_step=0.1).folder
    fine = Run(tmp_path / "fine").folder
    with pytest.raises(ConfigError, match=r"metrics.threshold_step: 0.1 and 0.01"):
        table_2_of_folders([coarse, fine])


def test_thresholds_are_sought_in_the_steps_of_the_runs(tmp_path: Path) -> None:
    """Every threshold is 0 or a multiple of the step beyond the largest score."""
    step = 0.25
    runs = [
        Run(tmp_path / name, has_viewpoints=views, threshold_step=step).folder
        for name, views in (("none", False), ("aware", True))
    ]
    table = table_2_of_folders(runs).files["table2_thresholds.parquet"].to_pandas()
    steps = table.threshold.dropna() / step
    assert len(steps) > 0
    np.testing.assert_allclose(steps, steps.round(), atol=1e-6)
