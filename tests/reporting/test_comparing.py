"""Runs side by side: every figure by hand from a few rows, and what does not go together."""

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result

from imodbatch.core.errors import ConfigError, TableError
from imodbatch.reporting.azimuths import AzimuthAccuracy, azimuth_block
from imodbatch.reporting.comparing import compare_folders
from imodbatch.reporting.comparison import compare_runs
from imodbatch.reporting.run_folder import DetectorGrid, open_run
from imodbatch.reporting.table_1 import estimates
from imodbatch.tables.parquet import TableInfo, empty, from_rows, read_info, table_path, write_table
from imodbatch.tables.schemas import TABLES

CLASSES = ("cup", "ball", "spoon")
CUP, BALL, SPOON = range(3)
SEQUENCES = ("a", "b")
BOX = {"x0_px": 0, "y0_px": 0, "x1_px": 10, "y1_px": 10}
ANNOTATIONS = [  # one cup (azimuth, in bins of 16: 1.2) and one ball in each of two sequences
    {"sequence_id": s, "frame_index": 0, "annotation_index": k, "class_id": k, **BOX}
    | {"is_ignored": False, "is_crowd": False, "instance_id": None}
    | {"own_azimuth_rad": 1.2 * np.pi / 8, "symmetry": "full" if k == BALL else "none"}
    for s in SEQUENCES
    for k in (CUP, BALL)
]
# Cups: a right one and a wrong one in each sequence; a method's scores say which comes first.
RIGHT, WRONG, SPOONS = 0, 1, 2
GOOD = {"a": (0.9, 0.2), "b": (0.8, 0.1)}
FAIR = {"a": (0.9, 0.2), "b": (0.4, 0.8)}
BAD = {"a": (0.2, 0.9), "b": (0.1, 0.8)}
PERFECT = 1.0
FAIR_AP = (6 * 1.0 + 5 * 2 / 3) / 11  # right, wrong, right


def write(
    folder: Path, name: str, unit: str, rows: list[dict], provenance: dict, **attributes: object
) -> None:
    spec = TABLES[name]
    table = from_rows(spec, rows) if rows else empty(spec)
    info = TableInfo(name, spec.version, spec.key, provenance, "", attributes)
    write_table(table_path(folder, name, unit), table, info)


def make_run(
    folder: Path,
    n_azimuths: int | None,
    scores: dict[str, dict[str, tuple[float, float]]],
    azimuth_bin: int = 1,
    sequences: tuple[str, ...] = SEQUENCES,
    annotations: list[dict] = ANNOTATIONS,
) -> Path:
    """A run as `imodbatch run` leaves it, as far as a comparison looks.

    Args:
        n_azimuths: of a detector with three elevations; None = it knows no viewpoints.
        scores: method → sequence → score of the right and the wrong cup.
        azimuth_bin: that the detector names for every box.
    """
    n_views = 3 * n_azimuths if n_azimuths else 1
    for s in sequences:
        vector = np.zeros((len(CLASSES), n_views), dtype=np.float32)
        vector[:, azimuth_bin if n_azimuths else 0] = 0.3
        keys = [{"sequence_id": s, "frame_index": 0, "detection_index": i} for i in range(3)]
        boxes = [
            {**key, **BOX, "background_score": 0.1, "class_ids": [0], "view_scores": vector.ravel()}
            for key in keys
        ]
        grid = {"n_elevations": 3 if n_azimuths else 1, "n_azimuths": n_azimuths or 1}
        write(folder, "detections", s, boxes, {}, **grid)
        write(folder, "annotations", s, [a for a in annotations if a["sequence_id"] == s], {})
        matches = [
            {**keys[i], "method": method, "class_id": class_id, "iou_percent": 50}
            | {"score": score, "outcome": outcome, "annotation_index": index}
            for method, of_sequence in scores.items()
            for i, class_id, score, outcome, index in (
                (RIGHT, CUP, of_sequence[s][0], "true_positive", 0),
                (WRONG, CUP, of_sequence[s][1], "false_positive", None),
                (SPOONS, SPOON, 0.5, "false_positive", None),
            )
        ]
        write(folder, "matches", s, matches, {"of": folder.name})
    digests = {s: read_info(table_path(folder, "matches", s)).digest for s in sequences}
    provenance = {"inputs": {"matches": digests}}
    write(folder, "metrics", "run", [], provenance, classes=CLASSES, threshold_step=0.01)
    return folder


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """No viewpoints: fair; 3×8: good fusion; 3×16: bad naive, fair single, good fusion."""
    return [
        make_run(tmp_path / "none", None, {"single": FAIR, "imod": BAD}),
        make_run(tmp_path / "eight", 8, {"single": GOOD, "naive": GOOD, "imod": GOOD}),
        make_run(
            tmp_path / "sixteen",
            16,
            {"single": FAIR, "naive": BAD, "imod": GOOD, "imod_offline": GOOD},
            azimuth_bin=2,
        ),
    ]


def test_the_columns_stand_in_the_papers_order(runs: list[Path]) -> None:
    """w/o view is `single` of the run without viewpoints, in every grid; more azimuths first."""
    columns = compare_runs([open_run(run) for run in runs]).columns
    assert [(c.group, c.name) for c in columns] == [
        ("3×16", "w/o view"),
        ("3×16", "w/ view"),
        ("3×16", "Naive"),
        ("3×16", "Ours"),
        ("3×16", "Ours, all frames"),
        ("3×8", "w/o view"),
        ("3×8", "w/ view"),
        ("3×8", "Naive"),
        ("3×8", "Ours"),
    ]
    bad_ap = 0.5  # wrong, wrong, right, right
    expected = [FAIR_AP, FAIR_AP, bad_ap, PERFECT, PERFECT, FAIR_AP, PERFECT, PERFECT, PERFECT]
    assert [c.aps[CUP] for c in columns] == pytest.approx(expected)
    assert [c.aps[BALL] for c in columns] == [0.0] * 9  # never found
    assert np.isnan([c.aps[SPOON] for c in columns]).all()
    assert [c.mean for c in columns] == pytest.approx(np.array(expected) / 2)
    assert [c.n_false_positives(SPOON) for c in columns] == [2] * 9


def test_intervals_by_hand(runs: list[Path]) -> None:
    """Fair is perfect on `a` alone and 1/2 on `b` alone: half of that with the unfound balls."""
    found = estimates(compare_runs([open_run(run) for run in runs]), 400)
    by_name = {(e.group, e.name): e for e in found}
    fair = by_name["3×16", "w/ view"]
    assert fair.value == pytest.approx(FAIR_AP / 2)
    assert (fair.interval.low, fair.interval.high) == pytest.approx((0.25, 0.5))
    gain = by_name["3×16", "Ours − w/ view"]
    assert gain.value == pytest.approx((PERFECT - FAIR_AP) / 2)
    assert (gain.interval.low, gain.interval.high) == pytest.approx((0.0, 0.25))
    same = by_name["3×8", "Ours − Naive"]
    assert (same.value, same.interval.low, same.interval.high) == (0.0, 0.0, 0.0)
    equal = by_name["3×16", "w/ view − w/o view"]
    assert (equal.value, equal.interval.low, equal.interval.high) == (0.0, 0.0, 0.0)
    assert [e.is_difference for e in found] == [False] * 9 + [True] * 6


def test_one_sequence_gives_no_interval_and_says_so(tmp_path: Path) -> None:
    annotations = [a for a in ANNOTATIONS if a["sequence_id"] == "a"]
    run = make_run(tmp_path / "run", 16, {"single": GOOD}, 1, ("a",), annotations)
    found = estimates(compare_runs([open_run(run)]), 100)
    assert [e.interval for e in found] == [None]
    text = compare_folders([run], 100).text()
    assert "one sequence only" in text
    assert "no interval" in text


def test_few_sequences_are_called_rough(runs: list[Path]) -> None:
    text = " ".join(compare_folders(runs, 100).text().split())
    assert "With 2 sequences an interval is rough" in text
    assert "only 3 different resamples" in text


def test_azimuths_by_hand(runs: list[Path]) -> None:
    """The truth is bin 1 of 16 and bin 1 of 8; the detectors say 2 and 1. A ball has none."""
    block = azimuth_block(compare_runs([open_run(run) for run in runs]))
    assert block.symmetries == ("none", "full", None)
    assert block.by_group == {
        "3×16": (AzimuthAccuracy(2, 0, 2), None, AzimuthAccuracy(0, 0, 0)),
        "3×8": (AzimuthAccuracy(2, 2, 2), None, AzimuthAccuracy(0, 0, 0)),
    }
    text = compare_folders(runs, 10).text()
    assert has_line(text, "cup | 2 0.0 100.0 | 2 100.0 100.0")
    assert has_line(text, "ball ◯ | – – – | – – –")


def test_annotations_of_unknown_azimuth_leave_the_block_out(tmp_path: Path) -> None:
    unknown = [{**a, "own_azimuth_rad": None, "symmetry": None} for a in ANNOTATIONS]
    run = make_run(tmp_path / "run", 16, {"single": GOOD}, annotations=unknown)
    document = compare_folders([run], 10)
    assert [grid.name for grid in document.page_grids] == ["ap", "intervals"]
    assert "No annotation says from which azimuth" in document.text()


def test_a_class_without_annotations_is_dashed_and_its_false_positives_counted(
    runs: list[Path],
) -> None:
    document = compare_folders(runs, 10)
    text = document.text()
    assert has_line(text, "spoon | 0 | – – – – – | – – – – | – – – – | – – – –")
    assert (
        "spoon: 3×16 w/o view: 2 false positives; 3×16 w/ view: 2 false positives; "
        "3×8 w/o view: 2 false positives; 3×8 w/ view: 2 false positives.\n" in text
    )
    assert "left out of the mean" in document.files["compare.md"]


def test_the_papers_columns_stand_beside_and_are_marked(runs: list[Path]) -> None:
    """Only their mean has a row here: the classes are others."""
    ap = compare_folders(runs, 10).page_grids[0]
    paper = [i for i, c in enumerate(ap.columns) if "paper: other data, simulation" in c.group]
    assert [ap.columns[i].text for i in paper] == ["w/o view", "w/ view", "Naive", "Ours"] * 2
    assert [ap.rows[-1].cells[i].text for i in paper] == (
        ["0.765", "0.747", "0.739", "0.822", "0.782", "0.795", "0.696", "0.847"]
    )
    assert {ap.rows[0].cells[i].text for i in paper} == {"–"}


def test_the_columns_of_the_text_are_aligned(runs: list[Path]) -> None:
    for grid in compare_folders(runs, 10).page_grids:
        lines = [line for line in grid.text().splitlines() if " | " in line]
        bars = {tuple(i for i, c in enumerate(line) if c == "|") for line in lines}
        assert len({b for b in bars if len(b) == max(map(len, bars))}) == 1


def test_files_hold_the_same_in_full_precision(runs: list[Path], tmp_path: Path) -> None:
    document = compare_folders(runs, 10)
    document.write(tmp_path / "out")
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["ap.csv", "azimuth.csv", "compare.md", "intervals.csv"]
    with (tmp_path / "out/ap.csv").open(encoding="utf-8") as file:
        cup, ball, spoon, mean = csv.DictReader(file)
    assert float(cup["3×16 w/ view"]) == pytest.approx(FAIR_AP, abs=1e-15)
    assert (ball["3×16 w/ view"], spoon["3×16 w/ view"]) == ("0.0", "")
    assert spoon["3×16 w/ view, false positives"] == "2"
    assert float(mean["3×16 w/ view"]) == pytest.approx(FAIR_AP / 2, abs=1e-15)
    assert (tmp_path / "out/compare.md").read_text(encoding="utf-8") == document.files["compare.md"]


def test_without_a_run_of_no_viewpoints_its_column_is_left_out(runs: list[Path]) -> None:
    document = compare_folders(runs[1:], 10)
    assert "w/o view is left out" in " ".join(document.text().split())
    ours = [c.text for c in document.page_grids[0].columns if c.group == "3×16"]
    assert ours == ["w/ view", "Naive", "Ours", "Ours, all frames"]


def has_line(text: str, words: str) -> bool:
    """Whether a line holds these words, however they are spaced."""
    return any(line.split() == words.split() for line in text.splitlines())


# What does not go together


def test_the_grid_of_a_detector_is_that_of_its_scores(runs: list[Path]) -> None:
    grids = [open_run(run).grid for run in runs]
    assert grids == [DetectorGrid(1, 1), DetectorGrid(3, 8), DetectorGrid(3, 16)]


def test_no_run_with_viewpoints(runs: list[Path]) -> None:
    with pytest.raises(ConfigError, match="tells no viewpoints apart"):
        compare_folders(runs[:1], 10)


def test_two_runs_without_viewpoints(runs: list[Path], tmp_path: Path) -> None:
    other = make_run(tmp_path / "other", None, {"single": GOOD})
    with pytest.raises(ConfigError, match="both of detectors without viewpoints"):
        compare_folders([*runs, other], 10)


def test_the_same_run_twice(runs: list[Path]) -> None:
    with pytest.raises(ConfigError, match="Name each once"):
        compare_folders([runs[2], runs[2]], 10)


def test_two_runs_of_one_grid_bear_their_names(runs: list[Path], tmp_path: Path) -> None:
    other = make_run(tmp_path / "other", 16, {"single": GOOD})
    comparison = compare_runs([open_run(run) for run in (*runs, other)])
    assert list(comparison.groups) == ["3×16 sixteen", "3×16 other", "3×8"]


def test_runs_of_other_annotations(runs: list[Path], tmp_path: Path) -> None:
    fewer = [{**a, "is_ignored": a["class_id"] == BALL} for a in ANNOTATIONS]
    other = make_run(tmp_path / "other", None, {"single": GOOD}, annotations=fewer)
    with pytest.raises(ConfigError, match="differ in annotations"):
        compare_folders([runs[2], other], 10)


def test_runs_of_other_sequences(runs: list[Path], tmp_path: Path) -> None:
    other = make_run(tmp_path / "other", None, {"single": GOOD}, sequences=("a",))
    with pytest.raises(ConfigError, match="differ in sequences"):
        compare_folders([runs[2], other], 10)


def test_metrics_of_other_matches(runs: list[Path]) -> None:
    write(runs[2], "matches", "a", [], {"of": "another run"})
    with pytest.raises(TableError, match=r"of other matches than those of a\. .*imodbatch run"):
        open_run(runs[2])


@pytest.mark.parametrize("table", ["metrics", "matches", "annotations", "detections"])
def test_an_unfinished_run(runs: list[Path], table: str) -> None:
    shutil.rmtree(runs[2] / table)
    with pytest.raises(TableError, match=f"{table}.*imodbatch run"):
        compare_folders(runs, 10)


# From the command line


def test_run_folders_alone(cli: Callable[..., Result], runs: list[Path], tmp_path: Path) -> None:
    result = cli("compare", *runs, "--resamples", 20, "--out", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("Compared: none, sixteen, eight\n")
    assert "\n20 resamples of 2 sequences" in result.stdout
    assert result.stdout.endswith(f"\ncompare: {tmp_path / 'out/compare.md'}\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{runs}/sixteen", "some.toml"], "some.toml: no run folder. Name a manifest first"),
        (["nowhere.toml", "{runs}/sixteen"], "nowhere.toml: no such file."),
        (["{manifest}"], "{manifest}: names no run. Add pipeline files or run folders."),
        (["{manifest}", "nothing.toml"], "nothing.toml: no such file."),
        (["{manifest}", "{pipeline}"], "runs/tiny--quick: no such run. Make it with `imodbatch"),
    ],
)
def test_mistakes_are_one_line(
    cli: Callable[..., Result],
    runs: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    manifest, pipeline = tmp_path / "tiny.toml", tmp_path / "quick.toml"
    manifest.write_text(
        'name = "tiny"\nadapter = "seven_scenes"\nclasses = ["cup"]\n[[sequences]]\nid = "a"\n'
    )
    pipeline.write_text("")
    places = {"runs": runs[0].parent, "manifest": manifest, "pipeline": pipeline}
    result = cli("compare", *(argument.format(**places) for argument in arguments))
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"imodbatch: error: {message.format(**places)}")


def test_the_figures_are_those_of_the_metrics_of_a_real_run(
    cli: Callable[..., Result],
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    manifest, pipeline = tmp_path / "small.toml", tmp_path / "quick.toml"
    manifest.write_text(analytic_manifest(analytic_data, "walk_1", "walk_2"))
    pipeline.write_text("[sweep]\nvoxel_sizes_m = [0.2]\n[report]\nn_frames = 0\n")
    assert cli("run", manifest, "--pipeline", pipeline).exit_code == 0
    result = cli("compare", manifest, pipeline)
    assert (result.exit_code, result.stderr) == (0, "")
    metrics = pd.read_parquet(f"runs/{_name(manifest)}--quick/metrics")
    metrics = metrics[(metrics.metric == "ap_voc07_11pt") & (metrics.iou_percent == 50)]
    (comparison,) = [compare_runs([open_run(Path(f"runs/{_name(manifest)}--quick"))])]
    for column in comparison.columns:
        method = {"w/ view": "single", "Naive": "naive", "Ours": "imod"}.get(column.name)
        method = method or "imod_offline"
        of_method = metrics[metrics.method == method].set_index("class_id").value
        assert column.aps == pytest.approx([of_method[k] for k in range(len(column.aps))])
        assert column.mean == pytest.approx(of_method[-1])
    (pipeline).write_text("[lift]\nvoxel_size_m = 0.3\n")
    assert "no longer fit the settings" in cli("compare", manifest, pipeline).stderr


def _name(manifest: Path) -> str:
    line = next(row for row in manifest.read_text().splitlines() if row.startswith("name"))
    return line.split('"')[1]
