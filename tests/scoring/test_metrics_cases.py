"""Every metric of a run, worked out on paper from few boxes."""

import numpy as np
import pytest
from hand_tables import annotation, detection, frame, match, table

from imodbatch.scoring import metrics as metrics_stage
from imodbatch.settings.config import MatchingConfig, MetricsConfig

CLASSES = ("mug", "box", "pen")
MUG, BOX, PEN = range(3)
LEFT, RIGHT = (0, 0, 10, 10), (10, 0, 20, 10)  # halves of a frame of 20 × 10 pixels
RIGHT_TOP = (10, 0, 20, 5)


def config(**changes):
    """Thresholds in steps of 1/8, so that all scores below are exact."""
    usual = {"names": ("ap_voc07_11pt", "ap_area"), "threshold_step": 0.125}
    return MetricsConfig(**(usual | changes))


def no_coco(candidates, scores, truth, n_classes):  # noqa: ARG001
    return np.full(n_classes, np.nan)


# Metrics. Mugs, ranked: T .875, F .75, T .625, (ignored .5625), F .5, F .25 of 4 annotations;
# boxes: T .75, F .25 of 2; a pen that is none.

FRAMES = [frame("s", 0), frame("s", 1), frame("t", 0)]
ANNOTATIONS = [
    annotation("s", 0, 0, MUG, LEFT),
    annotation("s", 0, 1, MUG, (15, 0, 20, 10), is_ignored=True),
    annotation("s", 1, 0, MUG, (0, 0, 5, 10)),
    annotation("s", 1, 1, MUG, (5, 0, 10, 10)),
    annotation("s", 1, 2, BOX, RIGHT_TOP),
    annotation("t", 0, 0, MUG, LEFT),
    annotation("t", 0, 1, BOX, RIGHT),
]
ROWS = [  # sequence, frame, number, corners, class, score, outcome
    ("t", 0, 3, RIGHT, PEN, 0.5, "F"),
    ("s", 1, 0, (0, 0, 5, 10), MUG, 0.625, "T"),
    ("t", 0, 1, LEFT, MUG, 0.25, "F"),
    ("s", 0, 1, RIGHT_TOP, MUG, 0.75, "F"),
    ("s", 0, 2, (15, 0, 20, 10), MUG, 0.5625, "I"),
    ("t", 0, 2, RIGHT, BOX, 0.25, "F"),
    ("s", 0, 0, LEFT, MUG, 0.875, "T"),
    ("t", 0, 0, LEFT, MUG, 0.5, "F"),
    ("s", 1, 1, RIGHT_TOP, BOX, 0.75, "T"),
]


def metrics(rows=ROWS, annotations=ANNOTATIONS, frames=FRAMES, coco_ap=no_coco, **changes):
    """(metric, class id) → row, of a run with the one method and IoU."""
    boxes = {(s, f, i): detection(s, f, i, c, (1.0, 0.0, 0.0)) for s, f, i, c, *_ in rows}
    result = metrics_stage.run(
        table("frames", frames),
        table("annotations", annotations),
        table("detections", boxes.values()),
        table("matches", [match(s, f, i, *said) for s, f, i, _, *said in rows]),
        CLASSES,
        coco_ap,
        MatchingConfig(),
        config(**changes),
    )
    found = result.tables["metrics"].to_pylist()
    assert {row["method"] for row in found} <= {"imod"}
    return {(row["metric"], row["class_id"]): row for row in found}


def values(found, metric, *class_ids):
    return [found[metric, k]["value"] for k in class_ids]


def counts(found, metric, class_id):
    row = found[metric, class_id]
    return row["n_annotations"], row["n_detections"]


def test_average_precisions():
    found = metrics()
    # mugs: precision 1 up to recall 1/4 (t = 0 1 2), 2/3 up to 1/2 (t = 3 4 5); boxes: 1 up to 1/2
    assert values(found, "ap_voc07_11pt", MUG, BOX, PEN) == [
        pytest.approx((3 * 1 + 3 * 2 / 3) / 11),
        pytest.approx(6 / 11),
        None,
    ]
    assert values(found, "ap_area", MUG, BOX, PEN) == [pytest.approx(5 / 12), 0.5, None]
    # the mean is over the two classes that have an AP, the counts are of all three
    assert values(found, "ap_voc07_11pt", -1) == [pytest.approx((5 / 11 + 6 / 11) / 2)]
    assert values(found, "ap_area", -1) == [pytest.approx((5 / 12 + 1 / 2) / 2)]
    assert [counts(found, "ap_area", k) for k in (MUG, BOX, PEN, -1)] == [
        (4, 5),
        (2, 2),
        (0, 1),
        (6, 8),
    ]
    assert found["ap_area", -1]["class_name"] == "mean"
    assert found["ap_area", BOX]["class_name"] == "box"
    assert found["ap_area", BOX]["iou_percent"] == 50


def test_precision_recall_and_f1_where_f1_is_largest():
    """F1 of 1 to 5 mugs: 2/5 2/6 4/7 4/8 4/9, so three; of 1 or 2 boxes: 2/3 2/4, so one."""
    found = metrics()
    assert values(found, "threshold", MUG, BOX, PEN) == [0.625, 0.375, None]  # next above .5, .25
    assert values(found, "precision", MUG, BOX, PEN) == [pytest.approx(2 / 3), 1.0, None]
    assert values(found, "recall", MUG, BOX, PEN) == [2 / 4, 1 / 2, None]
    assert values(found, "f1", MUG, BOX, PEN) == [pytest.approx(4 / 7), pytest.approx(2 / 3), None]
    means = [(2 / 3 + 1) / 2, 1 / 2, (4 / 7 + 2 / 3) / 2]
    assert [found[name, -1]["value"] for name in ("precision", "recall", "f1")] == (
        pytest.approx(means)
    )
    assert counts(found, "recall", -1) == (6, 8)
    assert counts(found, "threshold", MUG) == (4, 5)
    assert found["threshold_tuned_on_test", -1]["value"] == 1.0


def test_false_positives_at_any_score():
    found = metrics()
    assert values(found, "n_false_positives", MUG, BOX, PEN) == [3.0, 1.0, 1.0]
    assert counts(found, "n_false_positives", PEN) == (0, 1)


def test_background_of_the_boxes_kept():
    """Pixels, of 200 a frame; in the first the 50 of the ignored mug are left out.

    s 0: kept the left half and the right top: 25 predicted, 50 true, 25 both.
    s 1: kept a quarter and the right top: 100 predicted; true is the right bottom: 50, both 50.
    t 0: nothing is kept: 200 predicted; all is annotated: 0 true.
    """
    found = metrics()
    assert values(found, "precision", -2) == [pytest.approx(75 / 325)]
    assert values(found, "recall", -2) == [75 / 100]
    assert found["recall", -2]["class_name"] == "background"
    assert counts(found, "recall", -2) == (6, 4)  # the ignored annotation does not count


@pytest.mark.parametrize(
    ("false_one", "true_one", "ap"),
    [  # equal scores: the earlier sequence, then frame, then box stands first
        (("s", 1, 1), ("t", 0, 0), 1 / 2),
        (("t", 0, 0), ("s", 1, 1), 1.0),
        (("s", 0, 1), ("s", 1, 0), 1 / 2),
        (("s", 0, 0), ("s", 0, 1), 1 / 2),
        (("s", 0, 1), ("s", 0, 0), 1.0),
    ],
)
def test_equal_scores_are_ranked_by_sequence_frame_and_box(false_one, true_one, ap):
    rows = [
        (*true_one, LEFT, MUG, 0.5, "T"),
        (*false_one, RIGHT, MUG, 0.5, "F"),
    ]
    found = metrics(rows, [annotation(*true_one[:2], 0, MUG, LEFT)])
    assert values(found, "ap_voc07_11pt", MUG) == [ap]


def test_thresholds_of_other_sequences():
    """Tuned on s (T .75, F .5 of 1): .625. That keeps F .875, T .75 of the three in t, not T .5.

    Tuned on t it would be 0: F1 of 1 to 3 boxes is 0, 2/5, 4/6.
    """
    annotations = [annotation("s", 0, 0, MUG, LEFT)]
    annotations += [annotation("t", 0, i, MUG, LEFT) for i in range(3)]
    annotations.append(annotation("t", 0, 3, BOX, RIGHT))
    rows = [
        ("s", 0, 0, LEFT, MUG, 0.75, "T"),
        ("s", 0, 1, LEFT, MUG, 0.5, "F"),
        ("t", 0, 0, LEFT, MUG, 0.875, "F"),
        ("t", 0, 1, RIGHT_TOP, MUG, 0.75, "T"),
        ("t", 0, 2, RIGHT, MUG, 0.5, "T"),
        ("t", 0, 3, RIGHT, BOX, 0.5, "T"),
    ]
    found = metrics(rows, annotations, threshold_sequences=("s",))
    assert values(found, "threshold", MUG) == [0.625]
    assert [found[name, MUG]["value"] for name in ("precision", "recall", "f1")] == (
        pytest.approx([1 / 2, 1 / 3, 2 / 5])
    )
    assert counts(found, "precision", MUG) == (3, 3)  # those of t
    assert counts(found, "ap_area", MUG) == (4, 5)  # AP needs no threshold: all sequences
    assert found["threshold_tuned_on_test", -1]["value"] == 0.0
    # in t the right bottom alone is predicted, and all of it is annotated
    assert values(found, "precision", -2) == [0.0]
    # s holds no box, so there is no threshold for boxes and nothing to be read at one
    assert [found[name, BOX]["value"] for name in ("threshold", "precision", "recall", "f1")] == (
        [None] * 4
    )
    assert values(found, "recall", -1) == [pytest.approx(1 / 3)]


def test_every_iou_and_method_has_rows_of_its_own():
    """Right at 50 %, wrong at 75 %; a method whose only box is wrong. COCO's counts: at 50 %."""
    rows = [
        match("s", 0, 0, MUG, 0.5, "T"),
        match("s", 0, 0, MUG, 0.5, "F", iou_percent=75),
        match("s", 0, 0, MUG, 0.5, "F", "single"),
        match("s", 0, 0, MUG, 0.5, "F", "single", iou_percent=75),
        match("s", 0, 1, MUG, 0.25, "I"),
        match("s", 0, 1, MUG, 0.25, "F", iou_percent=75),
    ]
    found = metrics_stage.run(
        table("frames", FRAMES),
        table("annotations", [annotation("s", 0, 0, MUG, LEFT)]),
        table("detections", [detection("s", 0, i, LEFT, (1.0, 0.0, 0.0)) for i in (0, 1)]),
        table("matches", rows),
        CLASSES,
        no_coco,
        MatchingConfig(iou_percents=(50, 75)),
        config(names=("ap_area", "ap_coco")),
    ).tables["metrics"]
    aps = {
        (row["method"], row["iou_percent"]): row["value"]
        for row in found.to_pylist()
        if (row["metric"], row["class_id"]) == ("ap_area", MUG)
    }
    counted = {
        (row["method"], row["metric"], row["iou_percent"]): row["n_detections"]
        for row in found.to_pylist()
        if row["class_id"] == MUG and row["method"] == "imod"
    }
    assert counted["imod", "ap_area", 50] == counted["imod", "ap_coco", 0] == 1
    assert counted["imod", "ap_area", 75] == 2
    assert aps == {("imod", 50): 1, ("imod", 75): 0, ("single", 50): 0, ("single", 75): 0}
    assert "ap_voc07_11pt" not in found["metric"].to_pylist()  # was not asked


def test_coco_gets_the_boxes_and_its_figures_become_rows():
    """The tool itself is tested elsewhere: here, what it is given and what comes of its answer."""
    asked = {}

    def coco_ap(candidates, scores, truth, n_classes):
        asked.update(candidates=candidates, scores=scores, truth=truth, n_classes=n_classes)
        return np.array([0.5, 0.25, np.nan])

    found = metrics(coco_ap=coco_ap, names=("ap_coco",))
    assert values(found, "ap_coco", MUG, BOX, PEN, -1) == [0.5, 0.25, None, 0.375]
    assert found["ap_coco", MUG]["iou_percent"] == 0
    assert counts(found, "ap_coco", MUG) == (4, 5)
    assert counts(found, "ap_coco", -1) == (6, 8)
    assert asked["n_classes"] == 3
    # best first, images numbered s 0, s 1, t 0
    ranked = sorted(ROWS, key=lambda row: (-row[5], row[:3]))
    assert asked["scores"].tolist() == [row[5] for row in ranked]
    images = {("s", 0): 0, ("s", 1): 1, ("t", 0): 2}
    assert asked["candidates"].image.tolist() == [images[row[:2]] for row in ranked]
    assert asked["candidates"].boxes.tolist() == [list(row[3]) for row in ranked]
    assert asked["candidates"].class_id.tolist() == [row[4] for row in ranked]
    assert asked["truth"].image.tolist() == [0, 0, 1, 1, 1, 2, 2]
    assert asked["truth"].is_ignored.tolist() == [False, True] + [False] * 5
