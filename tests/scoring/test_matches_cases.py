"""What becomes of each box, and which pixels a box holds, worked out on paper."""

import pyarrow as pa
import pytest
from hand_tables import annotation, detection, frame, fused, table

from imodbatch.scoring import match
from imodbatch.scoring.background import background_per_pixel
from imodbatch.settings.config import MatchingConfig

MUG, BOX = 0, 1
LEFT, RIGHT = (0, 0, 10, 10), (10, 0, 20, 10)  # halves of a frame of 20 × 10 pixels


# Matches


def matches(boxes, truth, **changes):
    """Of (number, corners, class, score) in frame 4 of s."""
    rows = match.run(
        table("fused", [fused("s", 4, i, k, value) for i, _, k, value in boxes]),
        table("detections", [detection("s", 4, i, c, (1.0, 0.0, 0.0)) for i, c, _, _ in boxes]),
        table("annotations", truth),
        MatchingConfig(**changes),
    )
    return rows, {
        (row["iou_percent"], row["detection_index"]): (
            row["outcome"],
            row["annotation_index"],
            row["iou"] and round(row["iou"], 6),
        )
        for row in rows.tables["matches"].to_pylist()
    }


TRUTH = [
    annotation("s", 4, 3, MUG, LEFT),
    annotation("s", 4, 5, MUG, RIGHT, is_ignored=True),
    annotation("s", 4, 7, BOX, RIGHT),
]


def test_what_becomes_of_each_box():
    """The index is the annotation's own, and the IoU that with the best one there."""
    boxes = [
        (0, (0, 0, 10, 6), MUG, 0.9),  # .6 of the mug: right, though not the best there
        (1, LEFT, MUG, 0.8),  # all of it, but it is taken
        (2, RIGHT, MUG, 0.7),  # on the ignored one
        (3, (0, 0, 10, 4), MUG, 0.95),  # .4: loose
        (4, RIGHT, BOX, 0.1),
        (5, LEFT, BOX, 0.2),  # on a mug: no box there
    ]
    result, found = matches(boxes, TRUTH)
    assert found == {
        (50, 0): ("true_positive", 3, 0.6),
        (50, 1): ("false_positive", None, 1.0),
        (50, 2): ("ignored", 5, 1.0),
        (50, 3): ("false_positive", None, 0.4),
        (50, 4): ("true_positive", 7, 1.0),
        (50, 5): ("false_positive", None, None),
    }
    assert result.summary == "6 matches = 3 false_positive + 2 true_positive + 1 ignored"
    first = result.tables["matches"].to_pylist()[0]
    assert (first["sequence_id"], first["frame_index"], first["method"]) == ("s", 4, "imod")
    assert first["score"] == pytest.approx(0.9)


def test_every_iou_and_rule_for_itself():
    """IoU .6 is right at 50 % and not at 75 %, where the tight box is not a duplicate."""
    boxes = [(0, (0, 0, 10, 6), MUG, 0.9), (1, LEFT, MUG, 0.8)]
    _, found = matches(boxes, TRUTH, iou_percents=(50, 75))
    assert [found[50, i][0] for i in (0, 1)] == ["true_positive", "false_positive"]
    assert [found[75, i][0] for i in (0, 1)] == ["false_positive", "true_positive"]
    # two overlapping mugs; the second box prefers the taken one, and fits the other by 8/12
    pair = [annotation("s", 4, 0, MUG, LEFT), annotation("s", 4, 1, MUG, (4, 0, 14, 10))]
    boxes = [(0, LEFT, MUG, 0.9), (1, (1, 0, 11, 10), MUG, 0.8)]
    assert matches(boxes, pair)[1][50, 1][:2] == ("false_positive", None)
    coco = matches(boxes, pair, rule="coco")[1][50, 1]
    assert coco[:2] == ("true_positive", 1)
    assert coco[2] == pytest.approx(7 / 13, abs=1e-6)


# Pixels


def test_a_box_holds_the_pixels_whose_centre_is_in_it():
    """x from 1.5 to 3.5 holds the centres 1.5 and 2.5, y from .6 to 2 the centre 1.5: 2 pixels."""
    kept = (1.5, 0.6, 3.5, 2.0)
    true = (2.0, 1.0, 3.0, 3.0)  # 2 pixels, one of them kept
    key = {"sequence_id": ["s"], "frame_index": [0], "detection_index": [0]}
    precision, recall = background_per_pixel(
        table("frames", [frame("s", 0, width=5, height=4)]),
        table("annotations", [annotation("s", 0, 0, MUG, true)]),
        table("detections", [detection("s", 0, 0, kept, (1.0, 0.0, 0.0))]),
        pa.table(key).cast(table("detections", []).select(list(key)).schema),
    )
    # 20 pixels: 18 predicted background, 18 true, 17 both
    assert (precision, recall) == (17 / 18, 17 / 18)


def test_pixels_beside_the_image_do_not_count():
    """A box of 6 × 2 that begins 2 pixels left of the image and 1 above it holds 4 × 1."""
    key = {"sequence_id": ["s"], "frame_index": [0], "detection_index": [0]}
    precision, recall = background_per_pixel(
        table("frames", [frame("s", 0, width=5, height=4)]),
        table("annotations", []),
        table("detections", [detection("s", 0, 0, (-2, -1, 4, 1), (1.0, 0.0, 0.0))]),
        pa.table(key).cast(table("detections", []).select(list(key)).schema),
    )
    assert (precision, recall) == (1.0, 16 / 20)
