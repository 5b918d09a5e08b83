"""Answers to questions about metrics and matches, and what the plots draw of them, by hand."""

import numpy as np
import pytest
from hand_tables import annotation, match, metric, pose, table

from imodbatch.core.matching import Outcome
from imodbatch.reporting import plots
from imodbatch.reporting.results import Results, curve
from imodbatch.reporting.run_info import RunInfo
from imodbatch.tables.schemas import TABLES

BOWL, CUP = 0, 1
BOX = (0, 0, 10, 10)
INFO = RunInfo("run", "", "", ("bowl", "cup"), settings={"lift": {"voxel_size_m": 0.2}})

ANNOTATIONS = [
    annotation("s", 0, 0, BOWL, BOX),
    annotation("s", 0, 1, BOWL, BOX),
    annotation("t", 0, 0, BOWL, BOX),
    annotation("t", 0, 1, BOWL, BOX, is_ignored=True),
    annotation("t", 0, 2, BOWL, BOX, is_ignored=True, is_crowd=True),
    annotation("t", 0, 3, CUP, BOX),
]
# bowls, ranked: T .75, F .5 (s), I .5 (t), T .5 (t, later), F .25 of 3 annotations
MATCHES = [
    match("t", 0, 1, BOWL, 0.5, "T"),
    match("t", 0, 0, BOWL, 0.5, "I", found=1),
    match("s", 0, 1, BOWL, 0.5, "F"),
    match("s", 0, 0, BOWL, 0.75, "T"),
    match("s", 0, 2, BOWL, 0.25, "F"),
    match("s", 0, 2, CUP, 0.25, "F"),
    match("s", 0, 0, BOWL, 0.75, "F", iou_percent=75),
]


def results(metrics=(), matches=MATCHES, **others):
    tables = {name: spec.schema.empty_table() for name, spec in TABLES.items()}
    tables |= {"metrics": table("metrics", metrics), "matches": table("matches", matches)}
    tables |= {"annotations": table("annotations", ANNOTATIONS)}
    tables |= {name: table(name, rows) for name, rows in others.items()}
    return Results(tables, ("s", "t"))


def test_the_main_iou_is_50_or_the_smallest():
    rows = [metric("ap_area", BOWL, 0.5, iou_percent=p) for p in (75, 50, 25, 0)]
    found = results(rows, [])
    assert found.iou_percents == (50, 25, 75)  # 0 stands for several
    assert found.main_iou == 50
    assert results(rows[::2], []).iou_percents == (25, 75)


def test_a_figure_is_that_of_its_method_class_metric_and_iou():
    rows = [
        metric("recall", BOWL, 0.5),
        metric("recall", CUP, 0.25),
        metric("recall", BOWL, 0.125, "single"),
        metric("recall", BOWL, 0.75, iou_percent=75),
        metric("precision", BOWL, None),
    ]
    found = results(rows)
    assert found.value("imod", BOWL, "recall") == 0.5
    assert found.value("imod", CUP, "recall") == 0.25
    assert found.value("single", BOWL, "recall") == 0.125
    assert found.value("imod", BOWL, "recall", 75) == 0.75
    assert found.value("imod", BOWL, "precision") is None
    assert found.has("precision", 50)
    assert not found.has("precision", 75)


def test_annotations_that_count_and_those_behind_the_metrics():
    """Of 5 bowls one is ignored and one a crowd; the metrics may stand on fewer sequences."""
    found = results()
    assert [found.n_annotations(k) for k in (BOWL, CUP, 7)] == [3, 1, 0]
    assert found.n_evaluated(BOWL) == 3
    held_out = results(
        [
            metric("ap_area", BOWL, 0.5, n_annotations=3),
            metric("recall", BOWL, 0.5, n_annotations=1),
        ]
    )
    assert held_out.n_evaluated(BOWL) == 3  # AP is of all sequences


def test_false_positives_are_those_of_the_metrics_else_counted():
    assert results().n_false_positives("imod", BOWL) == 2  # at 50 %; at 75 % there is another
    assert results().n_false_positives("imod", CUP) == 1
    assert results([metric("n_false_positives", BOWL, 9.0)]).n_false_positives("imod", BOWL) == 9


@pytest.mark.parametrize(("said", "told"), [(1.0, True), (0.0, False)])
def test_whether_thresholds_were_tuned_on_the_test_set(said, told):
    found = results([metric("threshold_tuned_on_test", -1, said), metric("recall", -1, 0.5)])
    assert found.is_tuned_on_test() is told
    assert results().is_tuned_on_test() is None


def test_matches_as_columns():
    rows = results().matches("imod")
    assert rows.sequence.tolist() == [1, 1, 0, 0, 0, 0]
    assert rows.detection.tolist() == [1, 0, 1, 0, 2, 2]
    assert rows.score.tolist() == [0.5, 0.5, 0.5, 0.75, 0.25, 0.25]
    assert rows.outcome.tolist() == [
        *(Outcome.TRUE_POSITIVE, Outcome.IGNORED, Outcome.FALSE_POSITIVE),
        *(Outcome.TRUE_POSITIVE, Outcome.FALSE_POSITIVE, Outcome.FALSE_POSITIVE),
    ]
    assert rows.annotation.tolist() == [0, 1, -1, 0, -1, -1]


def test_kept_are_boxes_that_reach_their_classs_threshold():
    """Exactly .5 is enough; a class without a threshold keeps none."""
    found = results([metric("threshold", BOWL, 0.5)]).kept("imod")
    assert sorted(found.score.tolist()) == [0.5, 0.5, 0.5, 0.75]
    assert set(found.class_id.tolist()) == {BOWL}
    other = results([metric("threshold", CUP, 0.125), metric("threshold", BOWL, 0.75)])
    assert sorted(
        zip(*(getattr(other.kept("imod"), n).tolist() for n in ("class_id", "score")), strict=True)
    ) == [
        (BOWL, 0.75),
        (CUP, 0.25),
    ]


def test_the_curve_has_a_point_per_annotation_found():
    """T F T F of 3: (1/3, 1) and (2/3, 2/3); the ignored box between them is not counted."""
    points = curve(results().matches("imod"), BOWL, 3)
    assert points.recall == pytest.approx([1 / 3, 2 / 3])
    assert points.precision == pytest.approx([1, 2 / 3])


# What the plots are given to draw


@pytest.fixture
def drawn(monkeypatch):
    """The arguments with which each figure was drawn."""
    calls = {}
    for name in ("precision_recall_svg", "sweep_svg", "top_view_svg"):
        monkeypatch.setattr(
            plots, name, lambda *args, name=name: calls.setdefault(name, []).append(args) or name
        )
    return calls


def test_a_dot_lies_at_recall_and_precision(drawn):
    found = results([metric("recall", BOWL, 0.25), metric("precision", BOWL, 0.875)])
    shown = plots.precision_recall_plots(found, INFO.classes)
    assert [(name, remark) for name, remark, _ in shown] == [
        ("bowl", "3 annotations"),
        ("cup", "1 annotation"),
    ]
    (name, curves, points), (_, _, cup_points) = drawn["precision_recall_svg"]
    assert name == "bowl"
    assert points == [("imod", 0.25, 0.875)]
    assert cup_points == []
    assert [method for method, _ in curves] == ["imod"]
    assert curves[0][1].precision == pytest.approx([1, 2 / 3])


def test_the_sweep_goes_from_small_to_large_voxels(drawn):
    values = [
        ("imod", 400, 0.5),
        ("imod", 100, 0.25),
        ("single", 100, 0.125),
        ("single", 400, None),
    ]
    rows = [
        {"method": m, "voxel_mm": mm, "metric": "ap_voc07_11pt", "value": v} for m, mm, v in values
    ]
    plots.sweep_plot(table("sweeps", rows), INFO)
    lines, used_mm, label = drawn["sweep_svg"][0]
    assert lines == [("single", [100], [0.125]), ("imod", [100, 400], [0.25, 0.5])]
    assert used_mm == 200
    assert label == "mean AP, 11 points (VOC 2007)"


def found_object(index, score, class_id=BOWL, method="imod", yaw_rad=None):
    return {
        **{"sequence_id": "s", "method": method, "object_index": index, "class_id": class_id},
        **{"score": score, "x_m": 1.0 + index, "y_m": -2.0, "z_m": 5.0, "yaw_rad": yaw_rad},
        **{"extent_x_m": 0.1, "extent_z_m": 0.1, "n_detections": 1, "n_cells": 1},
        **{"first_frame_index": 0, "last_frame_index": 0},
    }


def test_a_map_shows_objects_of_all_frames_against_the_threshold_of_all_frames(drawn):
    """2.0 for all frames, 1.0 online: of 2.5, 2.0 and 1.5 two are strong."""
    found = results(
        [metric("threshold", BOWL, 2.0, "imod_offline"), metric("threshold", BOWL, 1.0)],
        objects=[
            found_object(0, 2.5, yaw_rad=0.5),
            found_object(1, 2.0),
            found_object(2, 1.5),
            found_object(0, 9.0, method="naive"),
        ],
        poses=[
            pose("s", 1, (3.0, 4.0, 9.0)),
            pose("s", 0, (1.0, 2.0, 9.0)),
            pose("s", 2, (), "lost"),
        ],
    )
    views, legend, n_left = plots.maps(found, INFO, "imod")
    ((sequence_id, remark, _),) = views
    assert (sequence_id, remark, n_left) == ("s", "3 objects, 2 at or above threshold", 0)
    assert [name for name, _ in legend] == ["bowl"]
    _, view = drawn["top_view_svg"][0]
    assert view.is_strong.tolist() == [True, True, False]
    assert view.xy.tolist() == [[1.0, -2.0], [2.0, -2.0], [3.0, -2.0]]
    assert view.yaw_rad[0] == pytest.approx(0.5)
    assert np.isnan(view.yaw_rad[1])
    assert view.path[:2].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert np.isnan(view.path[2]).all()
