"""detect: which boxes stay, for which classes, in which order, and where the others went."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest

from imodbatch.datasets.detections import ImportedDetections
from imodbatch.datasets.images import UnreadableImageError
from imodbatch.detection import detect
from imodbatch.settings.config import DetectConfig
from imodbatch.tables.columns import boxes_of, view_scores_of
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import DETECTIONS, FRAMES

CAMERA = {"width_px": 64, "height_px": 48, "fx_px": 50, "fy_px": 50, "cx_px": 32, "cy_px": 24}
LEFT, RIGHT, LEFT_TOO = (2, 2, 22, 22), (40, 2, 60, 22), (3, 2, 23, 22)
GRID = (3, 16)


@dataclass
class Found:
    boxes: np.ndarray
    scores: np.ndarray
    background: np.ndarray


def found(boxes, scores):
    """Boxes with scores per class, or per class and view."""
    scores = np.array(scores, dtype=np.float32).reshape(len(boxes), -1)
    return Found(
        np.array(boxes, dtype=np.float32).reshape(-1, 4),
        scores,
        (1 - scores.sum(axis=1)).astype(np.float32),
    )


def nothing(n_scores=2):
    return Found(
        np.zeros((0, 4), np.float32), np.zeros((0, n_scores), np.float32), np.zeros(0, np.float32)
    )


def frames_table(n):
    return from_rows(
        FRAMES,
        [
            {
                "sequence_id": "s",
                "frame_index": 10 * i,
                "color_path": f"{i}.png",
                "depth_scale_m": 0.001,
                **CAMERA,
                **{f"depth_{name}": value for name, value in CAMERA.items()},
            }
            for i in range(n)
        ],
    )


def read_color(path):
    """An image whose pixels say which frame it is of."""
    return np.full((48, 64, 3), int(path.removesuffix(".png")), dtype=np.uint8)


def run(per_frame, n_classes=2, read=read_color, **config):
    """Run a fake detector that knows what is in each frame."""

    def detector(images):
        return [per_frame[image[0, 0, 0]] for image in images]

    config = DetectConfig(**{"score_threshold": 0.1, "nms_iou": 0.5, **config})
    return detect.run_detector(
        frames_table(len(per_frame)), read, detector, n_classes, GRID, config
    )


def rows(result):
    return result.tables["detections"].to_pylist()


def parts(result):
    """The summary's numbers: total, then each part by name."""
    total, terms = result.summary.split(";")[0].split(" boxes = ")
    pairs = (term.split(" ", 1) for term in terms.split(" + "))
    return int(total.replace(",", "")), {name: int(n.replace(",", "")) for n, name in pairs}


def test_boxes_keep_their_place_and_all_their_scores():
    result = run([found([LEFT, RIGHT], [[0.6, 0.05], [0.01, 0.8]]), nothing()])
    table = result.tables["detections"]
    assert table.schema.equals(DETECTIONS.schema)
    assert boxes_of(table).tolist() == [list(RIGHT), list(LEFT)]
    assert view_scores_of(table, 2)[..., 0] == pytest.approx(np.array([[0.01, 0.8], [0.6, 0.05]]))
    assert table["background_score"].to_pylist() == pytest.approx([0.19, 0.35])
    assert table["class_ids"].to_pylist() == [[1], [0]]
    assert table["frame_index"].to_pylist() == [0, 0]
    assert result.summary == "2 boxes = 2 kept"


def test_boxes_stand_by_falling_score_of_a_class_they_survive_for():
    scores = [[0.3, 0.0], [0.0, 0.9], [0.5, 0.4], [0.5, 0.0]]
    boxes = [(x, 0, x + 9, 9) for x in (0, 10, 20, 30)]
    table = run([found(boxes, scores)]).tables["detections"]
    assert table["x0_px"].to_pylist() == [10, 20, 30, 0]
    assert table["detection_index"].to_pylist() == [0, 1, 2, 3]


def test_the_order_goes_by_survived_classes_alone():
    """A box suppressed for its best class stands by the class it survives for."""
    boxes = [LEFT, LEFT_TOO, RIGHT]
    scores = [[0.7, 0.0], [0.6, 0.2], [0.3, 0.0]]
    table = run([found(boxes, scores)]).tables["detections"]
    assert table["class_ids"].to_pylist() == [[0], [0], [1]]
    assert table["x0_px"].to_pylist() == [2, 40, 3]


def test_the_threshold_itself_is_enough():
    scores = [[0.02, 0.0], [np.nextafter(np.float32(0.02), np.float32(0)), 0.0]]
    result = run([found([LEFT, RIGHT], scores)], score_threshold=0.02)
    assert boxes_of(result.tables["detections"]).tolist() == [list(LEFT)]
    assert parts(result) == (2, {"kept": 1, "below 0.02": 1})


def test_the_threshold_is_held_against_the_sum_over_views():
    """Six views of 0.02 each make 0.12: above 0.1, though no view is."""
    scores = [[0.02] * 6 + [0.01] * 6]
    table = run([found([LEFT], scores)]).tables["detections"]
    assert table["class_ids"].to_pylist() == [[0]]
    assert view_scores_of(table, 2).shape == (1, 2, 6)
    assert view_scores_of(table, 2)[0].tolist() == np.float32([[0.02] * 6, [0.01] * 6]).tolist()


def test_suppression_is_per_class():
    boxes, scores = [LEFT, LEFT_TOO], [[0.6, 0.1], [0.5, 0.4]]
    table = run([found(boxes, scores)]).tables["detections"]
    assert table["class_ids"].to_pylist() == [[0], [1]]
    result = run([found(boxes, [[0.6, 0.3], [0.5, 0.2]])])
    assert [row["class_ids"] for row in rows(result)] == [[0, 1]]
    assert parts(result) == (2, {"kept": 1, "suppressed": 1})


def test_suppression_depends_on_the_overlap_allowed():
    pair = [found([LEFT, LEFT_TOO], [[0.6, 0], [0.5, 0]])]  # IoU 19 / 21 = 0.905
    assert len(rows(run(pair, nms_iou=0.90))) == 1
    assert len(rows(run(pair, nms_iou=0.91))) == 2


def test_frames_do_not_suppress_each_other():
    result = run([found([LEFT], [[0.6, 0]]), found([LEFT], [[0.5, 0]])])
    assert [(row["frame_index"], row["detection_index"]) for row in rows(result)] == [
        (0, 0),
        (10, 0),
    ]


def test_the_best_boxes_of_each_frame():
    many = found(
        [(5 * i, 0, 5 * i + 4, 9) for i in range(10)], [[0.1 + 0.05 * i, 0] for i in range(10)]
    )
    result = run([many, nothing(), many], max_per_frame=3)
    table = result.tables["detections"]
    assert table["x0_px"].to_pylist() == [45, 40, 35] * 2
    assert table["frame_index"].to_pylist() == [0] * 3 + [20] * 3
    assert parts(result) == (20, {"kept": 6, "beyond 3 a frame": 14})


def test_the_tally_adds_up_on_random_boxes():
    rng = np.random.default_rng(0)
    per_frame, n = [], 0
    for count in (40, 0, 1, 60):
        corners = rng.uniform(0, 40, (count, 2))
        boxes = np.concatenate([corners, corners + rng.uniform(4, 20, (count, 2))], axis=1)
        per_frame.append(
            found(boxes, rng.dirichlet([0.2] * 4, count)[:, :3]) if count else nothing(3)
        )
        n += count
    result = run(per_frame, n_classes=3, score_threshold=0.3, nms_iou=0.3, max_per_frame=5)
    total, terms = parts(result)
    assert total == n == sum(terms.values())
    assert set(terms) == {"kept", "below 0.3", "suppressed", "beyond 5 a frame"}
    low = sum(int((frame.scores < 0.3).all(axis=1).sum()) for frame in per_frame)
    assert terms["below 0.3"] == low
    assert terms["kept"] == len(rows(result))
    assert max(Counter(row["frame_index"] for row in rows(result)).values()) == 5


def test_nothing_found_anywhere():
    result = run([nothing(), nothing()])
    assert result.tables["detections"].num_rows == 0
    assert result.tables["detections"].schema.equals(DETECTIONS.schema)
    assert result.summary == "0 boxes = 0 kept"


@pytest.mark.parametrize("batch_size", [1, 2, 3, 10])
def test_batches_change_nothing_but_their_size(batch_size):
    per_frame = [found([LEFT], [[0.1 + 0.1 * i, 0]]) for i in range(5)]
    sizes = []

    def detector(images):
        sizes.append(len(images))
        return [per_frame[image[0, 0, 0]] for image in images]

    config = DetectConfig(batch_size=batch_size)
    result = detect.run_detector(frames_table(5), read_color, detector, 2, GRID, config)
    assert [row["frame_index"] for row in rows(result)] == [0, 10, 20, 30, 40]
    scores = [row["view_scores"][0] for row in rows(result)]
    assert scores == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert sum(sizes) == 5
    assert max(sizes) == min(batch_size, 5)


def damaged(path):
    if path == "1.png":
        raise UnreadableImageError("1.png: damaged image.")
    return read_color(path)


def test_an_unreadable_image_stops_by_default():
    per_frame = [found([LEFT], [[0.5, 0]])] * 3
    with pytest.raises(UnreadableImageError) as caught:
        run(per_frame, read=damaged)
    text = str(caught.value)
    assert text.startswith("1.png: damaged image.")
    assert "detect.unreadable_color = 'skip'" in text
    assert len(text.splitlines()) == 1


@pytest.mark.parametrize("batch_size", [1, 2, 4])
def test_an_unreadable_image_can_be_skipped_and_is_told(batch_size):
    per_frame = [found([LEFT], [[0.2 + 0.1 * i, 0]]) for i in range(3)]
    result = run(per_frame, read=damaged, unreadable_color="skip", batch_size=batch_size)
    assert [row["frame_index"] for row in rows(result)] == [0, 20]
    assert [row["view_scores"][0] for row in rows(result)] == pytest.approx([0.2, 0.4])
    assert result.warnings == ["1.png: damaged image."]
    assert result.summary == "2 boxes = 2 kept; 1 frames skipped (unreadable)"


def test_other_faults_of_reading_are_not_skipped():
    def broken(_path):
        raise ValueError("a bug")

    with pytest.raises(ValueError, match="a bug"):
        run([nothing()], read=broken, unreadable_color="skip")


def test_a_detector_that_forgets_an_image_is_noticed():
    with pytest.raises(ValueError, match="shorter"):
        detect.run_detector(
            frames_table(2), read_color, lambda _images: [nothing()], 2, GRID, DetectConfig()
        )


def imported(frame_index, boxes, scores, **left_out):
    scores = np.array(scores, dtype=np.float32).reshape(len(boxes), -1)
    return ImportedDetections(
        np.array(boxes, dtype=np.float64).reshape(-1, 4),
        scores,
        (1 - scores.sum(axis=1)).astype(np.float32),
        np.array(frame_index, dtype=np.int64),
        Counter(left_out),
    )


def test_imported_boxes_follow_the_same_rule_and_count_what_was_left_out():
    boxes = [LEFT, LEFT, RIGHT, LEFT_TOO]
    given = imported([7, 3, 7, 7], boxes, [[0.6, 0], [0.5, 0], [0.01, 0], [0.5, 0]], other=4)
    config = DetectConfig(score_threshold=0.1, nms_iou=0.5)
    result = detect.run_imported("s", given, 2, GRID, config)
    assert [(row["frame_index"], row["x0_px"]) for row in rows(result)] == [(3, 2), (7, 2)]
    assert parts(result) == (
        8,
        {"kept": 2, "below 0.1": 1, "suppressed": 1, "left out (other)": 4},
    )


def test_no_imported_boxes_at_all():
    none = nothing()
    numbers = np.zeros(0, dtype=np.int64)
    left_out = Counter({"other": 2})
    given = ImportedDetections(none.boxes, none.scores, none.background, numbers, left_out)
    result = detect.run_imported("s", given, 2, GRID, DetectConfig())
    assert result.tables["detections"].num_rows == 0
    assert result.summary == "2 boxes = 2 left out (other)"
