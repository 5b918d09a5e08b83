"""That it works: a small dataset goes in, tables and a report come out, and every figure in them
can be had again by a few plain lines.
"""

import os
import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result

from imodbatch.tables.schemas import TABLES

REPOSITORY = Path(__file__).parents[1]
SEQUENCES = ["walk_1", "walk_2"]
STEPS = ["index", "poses", "pose_quality", "detect", "lift", "fuse", "score"]
CLASSES = ["ball", "can", "carton", "bottle", "mug"]
METHODS = ["single"] + [n + o for n in ("naive", "naive_log", "imod") for o in ("", "_offline")]
IOUS = [50, 75]
FRAME = ["sequence_id", "frame_index"]
DETECTION = [*FRAME, "detection_index"]
FUSED = [*DETECTION, "method", "class_id"]


@dataclass(frozen=True)
class Run:
    """A finished run: where its tables lie, and what was printed."""

    folder: Path
    lines: list[str]

    def table(self, name: str) -> pd.DataFrame:
        return pd.read_parquet(self.folder / name)


@pytest.fixture(scope="module")
def run(
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    cli: Callable[..., Result],
    tmp_path_factory: pytest.TempPathFactory,
) -> Run:
    """`imodbatch run` on two walks; boxes beyond 5 m stay unplaced, to have some of those too."""
    folder = tmp_path_factory.mktemp("run")
    manifest = folder / "small.toml"
    manifest.write_text(analytic_manifest(analytic_data, *SEQUENCES), encoding="utf-8")
    settings = ["--set", "lift.max_depth_m=5.0", "--set", f"matching.iou_percents={IOUS}"]
    settings += ["--set", "jitter.shifts_m=[0.5]", "--set", "jitter.repeats=1"]
    result = cli("run", manifest, "--out", folder / "tables", *settings)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return Run(folder / "tables", result.stdout.splitlines())


def test_every_stage_prints_one_line_per_sequence(run: Run) -> None:
    expected = [f"{step} {sequence}" for step in STEPS for sequence in SEQUENCES]
    expected += ["score all", *["diagnose all"] * 3, "report"]
    assert [line.split(": ")[0] for line in run.lines] == expected


def test_every_line_adds_up(run: Run) -> None:
    n_sums = 0
    for line in run.lines:
        for clause in re.split("[:;] ", line):
            if " = " in clause:
                total, parts = clause.split(" = ")
                assert leading_number(total) == sum(map(leading_number, parts.split(" + "))), line
                n_sums += 1
    assert n_sums == len(STEPS) * len(SEQUENCES)  # index says two, pose_quality none


def leading_number(text: str) -> int:
    return int(text.split(maxsplit=1)[0].replace(",", ""))


@pytest.mark.parametrize("name", TABLES)
def test_every_table_is_read_by_pandas(run: Run, name: str) -> None:
    spec, table = TABLES[name], run.table(name)
    assert list(table.columns) == spec.schema.names
    assert (len(table) > 0) == (name != "reference_poses")  # the poses are the reference itself
    assert not table.duplicated(list(spec.key)).any()
    if not spec.per_run and len(table):
        assert sorted(table.sequence_id.unique()) == SEQUENCES


def test_no_detection_vanishes(run: Run) -> None:
    """Each detection has one observation; its status is what the stage's line counted."""
    detections, observations = run.table("detections"), run.table("observations")
    assert keys(detections, DETECTION) == keys(observations, DETECTION)
    for sequence, of_sequence in observations.groupby("sequence_id"):
        (line,) = [line for line in run.lines if line.startswith(f"lift {sequence}: ")]
        counts = of_sequence.status.value_counts()
        assert {"placed", "out_of_range"} == set(counts.index)
        printed = dict(part.split()[::-1] for part in line.split(" = ")[1].split(" + "))
        assert {name: int(n) for name, n in printed.items()} == counts.to_dict()


def test_every_class_of_a_detection_is_fused_and_matched_once(run: Run) -> None:
    """One fused row per detection, surviving class and method; one match per fused row and IoU."""
    per_class = (
        run.table("detections").explode("class_ids").rename(columns={"class_ids": "class_id"})
    )
    expected = pd.concat([per_class.assign(method=method) for method in METHODS])
    fused, matches = run.table("fused"), run.table("matches")
    assert keys(fused, FUSED) == keys(expected, FUSED)
    for iou in IOUS:
        assert keys(matches[matches.iou_percent == iou], FUSED) == keys(fused, FUSED)
    assert len(matches) == len(fused) * len(IOUS)


def keys(table: pd.DataFrame, names: list[str]) -> list[tuple[object, ...]]:
    return sorted(table[names].itertuples(index=False, name=None))


def test_ap_follows_from_the_rows_of_matches(run: Run) -> None:
    """11-point AP: for t = 0..10 the best precision at recall >= t/10, averaged."""
    matches, metrics, true = run.table("matches"), run.table("metrics"), run.table("annotations")
    n_true = true[~true.is_ignored].class_id.value_counts()
    counts = matches[matches.outcome != "ignored"]
    counts = counts.sort_values(["score", *DETECTION], ascending=[False, True, True, True])
    stated = metrics[metrics.metric == "ap_voc07_11pt"]
    for (method, iou), rows in stated.groupby(["method", "iou_percent"]):
        values = {}
        for k in range(len(CLASSES)):
            found = counts[(counts.method == method) & (counts.iou_percent == iou)]
            hits = (found[found.class_id == k].outcome == "true_positive").to_numpy()
            n_hits = np.cumsum(hits)
            precision = n_hits / np.arange(1, len(hits) + 1)
            best = [precision[10 * n_hits >= t * n_true[k]].max(initial=0) for t in range(11)]
            values[k] = np.mean(best)
        values[-1] = np.mean(list(values.values()))  # the mean over classes
        assert rows.set_index("class_id").value.to_dict() == pytest.approx(values)
    assert len(stated) == len(METHODS) * len(IOUS) * (len(CLASSES) + 1)


def test_poses_left_as_they_are_give_the_metrics_themselves(run: Run) -> None:
    jitters, metrics = run.table("jitters"), run.table("metrics")
    stated = metrics[(metrics.metric == "ap_voc07_11pt") & (metrics.class_id == -1)]
    stated = stated[stated.iou_percent == IOUS[0]].set_index("method").value.to_dict()
    assert set(stated) == set(METHODS)
    undisturbed = jitters[(jitters.translation_mm == 0) & (jitters.rotation_mdeg == 0)]
    for _, rows in undisturbed.groupby("kind"):
        assert rows.set_index("method").value.to_dict() == stated
    assert len(jitters) == 2 * len(undisturbed) == 4 * len(METHODS)


def test_imod_is_its_formula(run: Run) -> None:
    """h[k] = max over d of the sum over observed cells (a, e) of P[a, e][k, e, (a + d) mod N].

    Frames 1..t of the voxel count, the box's own included. Per frame and class the box of the best
    marginal enters its cell, and a cell's visits are averaged. Of a frame's candidates for a class
    in one voxel, the best takes h; the others score 0. A box without place keeps the marginal.
    """
    boxes = run.table("detections").merge(run.table("observations"), on=DETECTION)
    boxes = boxes[boxes.sequence_id == "walk_1"].reset_index(drop=True)
    scores = np.stack(boxes.view_scores).reshape(len(boxes), len(CLASSES), 3, 16).astype(float)
    fused = run.table("fused").set_index(["method", *DETECTION, "class_id"])
    n_aside = 0
    for i, box in boxes.iterrows():
        same_voxel = (
            boxes[["voxel_i", "voxel_j", "voxel_k"]] == box[["voxel_i", "voxel_j", "voxel_k"]]
        ).all(axis=1)
        seen = boxes[same_voxel & (boxes.frame_index <= box.frame_index)]
        for k in box.class_ids:
            row = fused.loc[("imod", *box[DETECTION], k)]
            if box.status != "placed":
                assert (row.score, row.n_cells) == (pytest.approx(scores[i, k].sum(), abs=1e-5), 0)
                continue
            visits = defaultdict(list)
            for _, of_frame in seen.groupby("frame_index"):
                best = max(of_frame.index, key=lambda j: scores[j, k].sum())
                a, e = int(boxes.azimuth_bin[best]), int(boxes.elevation_bin[best])
                visits[a, e].append([scores[best, k, e, (a + d) % 16] for d in range(16)])
            h = sum(np.mean(votes, axis=0) for votes in visits.values())
            beside = seen[seen.frame_index == box.frame_index]
            rivals = [j for j in beside.index if k in beside.class_ids[j]]
            takes = i == max(rivals, key=lambda j: scores[j, k].sum())
            n_aside += not takes
            assert row.score == pytest.approx(h.max() if takes else 0.0, abs=1e-5)
            assert (row.pose_bin, row.n_cells) == (h.argmax(), len(visits))
    assert boxes.status.nunique() == 2
    assert n_aside > 0


def test_the_report_stands_alone(run: Run) -> None:
    """No script, style, font or picture comes from another file or from the network."""
    path = run.folder / "report" / "report.html"
    assert run.lines[-1] == f"report: {path}"
    page = path.read_text(encoding="utf-8")
    fetched = re.findall(r"""(?:src|href|srcset|data)\s*=\s*["']([^"']*)""", page)
    fetched += re.findall(r"url\(([^)]*)\)", page) + re.findall(r"@import\s+(\S+)", page)
    assert [address for address in fetched if not address.startswith(("data:", "#"))] == []
    assert any(address.startswith("data:image") for address in fetched)
    assert not re.search(r"<(script|link|iframe|object|embed)\b", page)
    mean = run.table("metrics").query("metric == 'ap_voc07_11pt' and class_name == 'mean'")
    for value in mean[mean.iou_percent == IOUS[0]].value:
        assert f"{value:.3f}".removeprefix("0") in page
    assert all(name in page for name in (*CLASSES, *SEQUENCES))


@pytest.mark.skipif("IMODBATCH_DATA" not in os.environ, reason="IMODBATCH_DATA is not set")
def test_real_frames_of_redkitchen(tmp_path: Path, cli: Callable[..., Result]) -> None:
    """60 real frames with a public detector's boxes: mugs on a table, up found by itself."""
    text = (REPOSITORY / "manifests/redkitchen.toml").read_text(encoding="utf-8")
    manifest = tmp_path / "redkitchen.toml"
    manifest.write_text(text.replace('frames = "0:450"', 'frames = "0:60"'), encoding="utf-8")
    result = cli("run", manifest, "--out", tmp_path / "run")
    assert result.exit_code == 0, result.output
    run = Run(tmp_path / "run", result.stdout.splitlines())
    assert len(run.table("frames")) == 60
    metrics = run.table("metrics").set_index(["metric", "method", "class_name"]).value
    assert metrics["ap_voc07_11pt", "single", "coffee_mug"] > 0.5
    assert (run.folder / "report" / "report.html").exists()
