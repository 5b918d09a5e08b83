"""COCO's AP through faster-coco-eval: small cases by hand, random ones against our own matching."""

import numpy as np
import pytest

from imodbatch.core.matching import Outcome, match_image
from imodbatch.core.precision import precision_recall, rank
from imodbatch.core.scoring import Candidates, Truth
from imodbatch.scoring.coco import coco_ap


def frozen(values, dtype):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def detections(*rows):
    """Rows of image, class, box, score."""
    images, classes, boxes, scores = zip(*rows, strict=True) if rows else ((), (), (), ())
    boxes = np.reshape(boxes, (-1, 4))
    found = Candidates(
        frozen(images, np.int64), frozen(classes, np.int16), frozen(boxes, np.float32)
    )
    return found, frozen(scores, np.float32)


def annotations(*rows):
    """Rows of image, class, box, kind."""
    images, classes, boxes, kinds = zip(*rows, strict=True) if rows else ((), (), (), ())
    boxes = np.reshape(boxes, (-1, 4))
    return Truth(
        frozen(images, np.int64), frozen(classes, np.int16), frozen(boxes, np.float32),
        frozen([kind == "ignored" for kind in kinds], bool),
        frozen([kind == "crowd" for kind in kinds], bool),
    )  # fmt: skip


BOX, FAR = (0, 0, 10, 10), (50, 50, 60, 60)


def test_classes_by_hand(capfd):
    ap = coco_ap(
        *detections((7, 0, BOX, 0.9), (7, 2, BOX, 0.9), (8, 3, (0, 0, 10, 7.7), 0.4)),
        annotations(
            (7, 0, BOX, "ordinary"),
            (7, 1, BOX, "ordinary"),
            (8, 3, BOX, "ordinary"),
            (8, 4, BOX, "ignored"),
        ),
        5,
    )
    # Found; not found; not there; IoU 0.77 passes 6 of 10 thresholds; only an ignored one there.
    np.testing.assert_allclose(ap, [1.0, 0.0, np.nan, 0.6, np.nan])
    assert capfd.readouterr() == ("", "")


def test_nothing_at_all():
    np.testing.assert_array_equal(coco_ap(*detections(), annotations(), 3), [np.nan] * 3)
    np.testing.assert_array_equal(
        coco_ap(*detections(), annotations((1, 1, BOX, "ordinary")), 2), [np.nan, 0.0]
    )
    none = coco_ap(*detections((1, 0, BOX, 0.5)), annotations(), 1)
    np.testing.assert_array_equal(none, [np.nan])


@pytest.mark.parametrize(
    ("kind", "n_absorbed"), [("ignored", 1), ("crowd", 2), ("ordinary of another image", 0)]
)
def test_ignored_annotations_absorb_one_and_crowds_any_number(kind, n_absorbed):
    other_image = kind == "ordinary of another image"
    truth = annotations(
        (1, 0, BOX, "ordinary"),
        (1, 0, FAR, "ignored") if other_image else (1, 0, FAR, kind),
    )
    far_image = 2 if other_image else 1
    ap = coco_ap(
        *detections((far_image, 0, FAR, 0.9), (far_image, 0, FAR, 0.8), (1, 0, BOX, 0.7)), truth, 1
    )
    assert ap[0] == pytest.approx(1 / (3 - n_absorbed))


@pytest.mark.parametrize("empty", [(5, 5, 5, 5), (9, 5, 5, 8), (0, 0, 1e6, 1e6)])
def test_a_detection_of_any_size_counts(empty):
    ap = coco_ap(
        *detections((1, 0, empty, 0.9), (1, 0, BOX, 0.5)), annotations((1, 0, BOX, "ordinary")), 1
    )
    assert ap[0] == pytest.approx(0.5)


def test_more_than_a_hundred_detections_of_an_image_count():
    boxes = [(20 * i, 0, 20 * i + 10, 10) for i in range(150)]
    ap = coco_ap(
        *detections(*[(1, 0, box, 0.5) for box in boxes]),
        annotations(*[(1, 0, box, "ordinary") for box in boxes]),
        1,
    )
    assert ap[0] == 1.0


def test_agrees_with_our_own_matching():
    rng = np.random.default_rng(11)
    n_classes, found_rows, true_rows = 2, [], []
    for image in range(30):
        for _ in range(rng.integers(0, 8)):
            x, y = rng.integers(0, 40, 2)
            box = np.array([x, y, x + rng.integers(8, 20), y + rng.integers(8, 20)])
            class_id = int(rng.integers(0, n_classes))
            kind = rng.choice(["ordinary", "ignored", "crowd"], p=[0.7, 0.15, 0.15])
            true_rows.append((image, class_id, box, kind))
            for _ in range(rng.integers(0, 4)):
                jittered = box + rng.integers(-2, 3, 4)
                found_rows.append((image, class_id, jittered, rng.integers(0, 16) / 16))
    (found, scores), truth = detections(*found_rows), annotations(*true_rows)

    expected = [
        np.mean([own_ap(found, scores, truth, k, t) for t in np.linspace(0.5, 0.95, 10)])
        for k in range(n_classes)
    ]
    np.testing.assert_allclose(coco_ap(found, scores, truth, n_classes), expected, atol=1e-12)
    assert 0.1 < min(expected) < max(expected) < 0.9


def own_ap(found, scores_of, truth, class_id, iou_threshold):
    """COCO's AP of one class at one IoU by our own matching and ranking."""
    outcomes, scores, images = [], [], []
    for image in np.unique(np.concatenate([found.image, truth.image])):
        d = (found.image == image) & (found.class_id == class_id)
        a = (truth.image == image) & (truth.class_id == class_id)
        matches = match_image(
            found.boxes[d], scores_of[d], truth.boxes[a], truth.is_ignored[a],
            truth.is_crowd[a], iou_threshold, "coco",
        )  # fmt: skip
        outcomes.extend(matches.outcome)
        scores.extend(scores_of[d])
        images.extend([image] * int(d.sum()))
    ranked = np.array(outcomes)[rank(np.array(scores), np.array(images))]
    counts = (truth.class_id == class_id) & ~truth.is_ignored & ~truth.is_crowd
    precision, recall = precision_recall(
        ranked[ranked != Outcome.IGNORED] == Outcome.TRUE_POSITIVE, int(counts.sum())
    )
    best_from_here = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return best_from_here[np.searchsorted(recall, np.linspace(0, 1, 101))].mean()


def test_errors():
    with pytest.raises(ValueError, match=r"detections: expected class ids in 0\.\.1, found 2\.\.2"):
        coco_ap(*detections((1, 2, BOX, 0.5)), annotations(), 2)
    good = annotations((1, 0, BOX, "ordinary"))
    bad = Truth(good.image, good.class_id, good.boxes, good.is_ignored, np.zeros(2, dtype=bool))
    with pytest.raises(ValueError, match="annotations: expected arrays of one length"):
        coco_ap(*detections(), bad, 1)
