"""Matching: the VOC devkit's rule by hand, COCO's rule against faster-coco-eval."""

import numpy as np
import pytest
from faster_coco_eval import COCO, COCOeval_faster

from imodbatch.core.matching import OUTCOME_NAMES, Outcome, match_image
from imodbatch.core.precision import precision_recall, rank

FP, TP, IGNORED = Outcome.FALSE_POSITIVE, Outcome.TRUE_POSITIVE, Outcome.IGNORED


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def bar(start, length):
    """A box of height 10 on a common line, so that overlaps are read off by eye."""
    return [start, 0, start + length, 10]


def match(boxes, scores, annotations, rule, *, ignored=(), crowd=(), iou_threshold=0.5):
    flags = np.zeros((2, len(annotations)), dtype=bool)
    flags[0, list(ignored)] = True
    flags[1, list(crowd)] = True
    flags.setflags(write=False)
    boxes, annotations = (frozen(np.reshape(b, (-1, 4))) for b in (boxes, annotations))
    return match_image(boxes, frozen(scores), annotations, *flags, iou_threshold, rule)


def test_names_follow_the_values():
    assert OUTCOME_NAMES[FP] == "false_positive"
    assert OUTCOME_NAMES[TP] == "true_positive"
    assert OUTCOME_NAMES[IGNORED] == "ignored"


@pytest.mark.parametrize("rule", ["voc", "coco"])
def test_duplicates_are_false_positives_and_the_best_score_wins(rule):
    matches = match([bar(0, 10), bar(0, 9)], [0.3, 0.8], [bar(0, 10)], rule)
    assert matches.outcome.tolist() == [FP, TP]
    assert matches.annotation_index.tolist() == [-1, 0]
    assert matches.iou[1] == 0.9


@pytest.mark.parametrize("rule", ["voc", "coco"])
def test_equal_scores_go_by_position(rule):
    matches = match([bar(0, 9), bar(0, 10)], [0.5, 0.5], [bar(0, 10)], rule)
    assert matches.outcome.tolist() == [TP, FP]


def test_voc_looks_at_the_best_annotation_only_even_if_it_is_taken():
    # The second detection overlaps annotation 0 by 8/10 and the free annotation 1 by 8/12.
    boxes, annotations = [bar(0, 10), bar(0, 8)], [bar(0, 10), [0, 0, 8, 15]]
    voc = match(boxes, [0.9, 0.8], annotations, "voc")
    assert voc.outcome.tolist() == [TP, FP]
    assert voc.annotation_index.tolist() == [0, -1]
    np.testing.assert_allclose(voc.iou, [1.0, 0.8])  # the duplicate's best IoU is told
    coco = match(boxes, [0.9, 0.8], annotations, "coco")
    assert coco.outcome.tolist() == [TP, TP]
    assert coco.annotation_index.tolist() == [0, 1]


def test_voc_difficult_annotation_absorbs_any_number():
    matches = match([bar(0, 10), bar(0, 9), bar(0, 3)], [3, 2, 1], [bar(0, 10)], "voc", ignored=[0])
    assert matches.outcome.tolist() == [IGNORED, IGNORED, FP]
    assert matches.annotation_index.tolist() == [0, 0, -1]
    np.testing.assert_allclose(matches.iou, [1.0, 0.9, 0.3])


def test_voc_prefers_a_better_difficult_annotation_and_coco_does_not():
    # IoU 1 with the ignored annotation 0, 8/10 with the ordinary annotation 1.
    arguments = [bar(0, 10)], [1.0], [bar(0, 10), bar(0, 8)]
    voc, coco = (match(*arguments, rule, ignored=[0]) for rule in ("voc", "coco"))
    assert (voc.outcome.tolist(), voc.annotation_index.tolist()) == ([IGNORED], [0])
    assert (coco.outcome.tolist(), coco.annotation_index.tolist()) == ([TP], [1])


def test_equal_overlaps_go_to_the_first_under_voc_and_to_the_last_under_coco():
    arguments = [bar(0, 10)], [1.0], [bar(0, 8), bar(2, 8)]
    assert match(*arguments, "voc").annotation_index.tolist() == [0]
    assert match(*arguments, "coco").annotation_index.tolist() == [1]


@pytest.mark.parametrize("rule", ["voc", "coco"])
def test_an_overlap_at_the_threshold_matches(rule):
    assert match([bar(0, 5)], [1.0], [bar(0, 10)], rule).outcome.tolist() == [TP]
    above = match([bar(0, 5)], [1.0], [bar(0, 10)], rule, iou_threshold=np.nextafter(0.5, 1))
    assert above.outcome.tolist() == [FP]


def test_coco_forgives_rounding_at_a_threshold_of_one():
    arguments = [bar(0, 10 * (1 - 1e-11))], [1.0], [bar(0, 10)]
    assert match(*arguments, "coco", iou_threshold=1.0).outcome.tolist() == [TP]
    assert match(*arguments, "voc", iou_threshold=1.0).outcome.tolist() == [FP]


def test_coco_ignored_absorbs_one_and_a_crowd_any_number():
    boxes = [bar(0, 10), bar(0, 10), bar(100, 10), bar(130, 10), bar(195, 10), bar(196, 10)]
    matches = match(
        boxes, [6, 5, 4, 3, 2, 1], [bar(0, 10), bar(100, 100)], "coco", ignored=[0], crowd=[1]
    )
    assert matches.outcome.tolist() == [IGNORED, FP, IGNORED, IGNORED, IGNORED, FP]
    assert matches.annotation_index.tolist() == [0, -1, 1, 1, 1, -1]
    np.testing.assert_allclose(matches.iou, [1, np.nan, 1, 1, 0.5, np.nan])


def test_voc_takes_a_crowd_for_an_ignored_annotation():
    matches = match([bar(0, 100), bar(0, 10)], [2, 1], [bar(0, 100)], "voc", crowd=[0])
    assert matches.outcome.tolist() == [IGNORED, FP]


@pytest.mark.parametrize("rule", ["voc", "coco"])
def test_nothing_to_match(rule):
    lonely = match([bar(0, 10)], [1.0], [], rule)
    assert lonely.outcome.tolist() == [FP]
    assert lonely.annotation_index.tolist() == [-1]
    assert np.isnan(lonely.iou).all()
    assert match([], [], [bar(0, 10)], rule).outcome.shape == (0,)


def test_voc_stray_detection_has_no_iou():
    matches = match([bar(50, 10), bar(5, 10)], [2, 1], [bar(0, 10)], "voc")
    assert matches.outcome.tolist() == [FP, FP]
    np.testing.assert_allclose(matches.iou, [np.nan, 1 / 3])


def test_errors():
    with pytest.raises(ValueError, match='"voc" or "coco"'):
        match([bar(0, 1)], [1.0], [bar(0, 1)], "kitti")
    with pytest.raises(ValueError, match="one score per box, found 2 for 1"):
        match([bar(0, 1)], [1.0, 2.0], [bar(0, 1)], "voc")
    with pytest.raises(ValueError, match="expected 1 flags"):
        match_image(np.zeros((1, 4)), [1.0], np.zeros((1, 4)), [], [False], 0.5)


N_IMAGES, N_CLASSES = 60, 3


def random_scenes():
    """Annotations crowded on a small canvas, detections near them; whole pixels make many ties."""
    rng = np.random.default_rng(7)
    scenes = {}
    for key in np.ndindex(N_IMAGES, N_CLASSES):
        n_annotations = rng.integers(0, 7)
        corners = rng.integers(0, 16, (n_annotations, 2))
        annotations = np.concatenate(
            [corners, corners + rng.integers(4, 14, (n_annotations, 2))], 1
        )
        near = annotations[rng.integers(0, n_annotations, 12)] if n_annotations else []
        jitter = rng.integers(-2, 3, (len(near), 4))
        stray = rng.integers(0, 16, (rng.integers(0, 4), 2))
        stray = np.concatenate([stray, stray + 6], 1)
        boxes = np.concatenate([np.reshape(near, (-1, 4)) + jitter, stray])
        boxes = boxes[(boxes[:, 2:] > boxes[:, :2]).all(axis=1)]
        kind = rng.choice(["ordinary", "ignored", "crowd"], n_annotations, p=[0.6, 0.2, 0.2])
        scenes[key] = {
            "boxes": frozen(boxes),
            "scores": frozen(rng.integers(0, 20, len(boxes)) / 20),
            "annotation_boxes": frozen(annotations),
            "is_ignored": frozen(kind == "ignored", dtype=bool),
            "is_crowd": frozen(kind == "crowd", dtype=bool),
        }
    return scenes


def evaluate_with_library(scenes):
    """Matches at IoU 0.5 as {detection id: (annotation id, overlap)}, AP per class, and the ids."""
    annotation_records, detection_records, ids = [], [], {}
    for (image, class_id), scene in scenes.items():
        common = {"image_id": image, "category_id": class_id + 1}
        first_ids = len(detection_records) + 1, len(annotation_records) + 1
        ids[image, class_id] = first_ids
        for box, score in zip(scene["boxes"], scene["scores"], strict=True):
            bbox = [*box[:2], *(box[2:] - box[:2])]
            number = len(detection_records) + 1
            detection_records.append(
                {**common, "id": number, "bbox": bbox, "area": 1.0, "score": score}
            )
        for box, ignored, crowd in zip(
            scene["annotation_boxes"], scene["is_ignored"], scene["is_crowd"], strict=True
        ):
            bbox = [*box[:2], *(box[2:] - box[:2])]
            number = len(annotation_records) + 1
            # The library knows "ignored, not a crowd" only as an area out of range.
            area = -1.0 if ignored else 1.0
            annotation_records.append(
                {**common, "id": number, "bbox": bbox, "area": area, "iscrowd": int(crowd)}
            )
    truth, found = (
        COCO(
            {
                "images": [{"id": image} for image in range(N_IMAGES)],
                "categories": [{"id": k + 1, "name": str(k)} for k in range(N_CLASSES)],
                "annotations": records,
            }
        )
        for records in (annotation_records, detection_records)
    )
    evaluator = COCOeval_faster(truth, found, "bbox", print_function=lambda *_: None)
    evaluator.params.iouThrs = np.array([0.5])
    evaluator.params.areaRng, evaluator.params.areaRngLbl = [[0.0, 1e10]], ["all"]
    evaluator.evaluate()
    evaluator.accumulate()
    matched = {}
    for pair, overlap in evaluator.eval["matched"].items():
        detection_id, annotation_id = map(int, pair.split("_"))
        matched[detection_id] = annotation_id, overlap
    return matched, evaluator.eval["precision"][0, :, :, 0, -1].mean(axis=0), ids


def test_coco_rule_agrees_with_the_library():
    scenes = random_scenes()
    library_matched, library_ap, ids = evaluate_with_library(scenes)
    matches = {key: match_image(**s, iou_threshold=0.5, rule="coco") for key, s in scenes.items()}

    own_matched, n_ignored_by_crowd, n_ignored_by_plain, n_outcomes = {}, 0, 0, np.zeros(3)
    for key, result in matches.items():
        first_detection_id, first_annotation_id = ids[key]
        for d in np.flatnonzero(result.outcome != FP):
            own_matched[first_detection_id + d] = (
                first_annotation_id + result.annotation_index[d],
                pytest.approx(result.iou[d]),
            )
        by = result.annotation_index[result.outcome == IGNORED]
        n_ignored_by_crowd += scenes[key]["is_crowd"][by].sum()
        n_ignored_by_plain += scenes[key]["is_ignored"][by].sum()
        n_outcomes += np.bincount(result.outcome, minlength=3)
    assert library_matched == own_matched
    # The data reach every branch.
    assert n_outcomes.min() > 100
    assert min(n_ignored_by_crowd, n_ignored_by_plain) > 50

    for class_id in range(N_CLASSES):
        ap = ap_101pt(
            [(image, matches[image, class_id]) for image in range(N_IMAGES)], scenes, class_id
        )
        assert ap == pytest.approx(library_ap[class_id], abs=1e-12)
        assert 0.1 < ap < 0.9


def ap_101pt(image_matches, scenes, class_id):
    """COCO's AP at one IoU, from our ranking and our precision and recall."""
    outcomes = np.concatenate([result.outcome for _, result in image_matches])
    images = np.concatenate([np.full(len(r.outcome), image) for image, r in image_matches])
    scores = np.concatenate([scenes[image, class_id]["scores"] for image, _ in image_matches])
    n_annotations = sum(
        int((~scenes[image, class_id]["is_ignored"] & ~scenes[image, class_id]["is_crowd"]).sum())
        for image, _ in image_matches
    )
    ranked = outcomes[rank(scores, images)]
    precision, recall = precision_recall(ranked[ranked != IGNORED] == TP, n_annotations)
    best_from_here = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return best_from_here[np.searchsorted(recall, np.linspace(0, 1, 101))].mean()


def test_the_two_rules_differ_on_these_data():
    differ = 0
    for scene in random_scenes().values():
        voc, coco = (match_image(**scene, iou_threshold=0.5, rule=r) for r in ("voc", "coco"))
        differ += int((voc.outcome != coco.outcome).sum())
    assert differ > 50
