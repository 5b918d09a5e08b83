"""score on cases small enough to be worked out by hand."""

import numpy as np
import pandas as pd
import pytest

from imodbatch.core.errors import ConfigError
from imodbatch.scoring import match
from imodbatch.scoring import metrics as metrics_stage
from imodbatch.scoring.background import background_per_pixel
from imodbatch.settings.config import MatchingConfig, MetricsConfig
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import ANNOTATIONS, DETECTIONS, FRAMES, FUSED

CLASSES = ["mug", "box"]
SIZE = {"width_px": 20, "height_px": 10, "fx_px": 10.0, "fy_px": 10.0, "cx_px": 10.0, "cy_px": 5.0}


def frames(*keys):
    return from_rows(
        FRAMES,
        [
            {"sequence_id": s, "frame_index": f, "color_path": "c", "depth_scale_m": 0.001}
            | SIZE
            | {f"depth_{name}": value for name, value in SIZE.items()}
            for s, f in keys
        ],
    )


def box(x0, y0, x1, y1):
    return {"x0_px": x0, "y0_px": y0, "x1_px": x1, "y1_px": y1}


def annotation(s, f, i, class_id, corners, is_ignored=False):
    return {
        "sequence_id": s, "frame_index": f, "annotation_index": i, "class_id": class_id,
        "is_ignored": is_ignored, "is_crowd": False, "instance_id": None, **box(*corners),
    }  # fmt: skip


def detection(s, f, i, corners):
    return {
        "sequence_id": s, "frame_index": f, "detection_index": i, "background_score": 0.0,
        "class_ids": [0, 1], "view_scores": [0.5, 0.5], **box(*corners),
    }  # fmt: skip


def fused(s, f, i, class_id, value, method="imod"):
    return {
        "sequence_id": s, "frame_index": f, "detection_index": i, "method": method,
        "class_id": class_id, "score": value, "pose_bin": None, "n_cells": 1,
    }  # fmt: skip


A, B = (0, 0, 10, 10), (10, 0, 20, 10)
FRAME_TABLE = frames(("s", 0), ("s", 1), ("t", 0))
TRUTH = from_rows(
    ANNOTATIONS,
    [
        annotation("s", 0, 0, 0, A),
        annotation("s", 1, 0, 0, A),
        annotation("s", 1, 1, 0, B, is_ignored=True),
        annotation("t", 0, 0, 0, B),
    ],
)
BOXES = from_rows(
    DETECTIONS,
    [
        detection("s", 0, 0, A),
        detection("s", 0, 1, B),
        detection("s", 1, 0, B),
        detection("t", 0, 0, B),
    ],
)
FUSED_ROWS = from_rows(
    FUSED,
    [
        fused("s", 0, 0, 0, 2.0),
        fused("s", 0, 1, 0, 3.0),
        fused("s", 0, 1, 1, 0.4),
        fused("s", 1, 0, 0, 9.0),
        fused("t", 0, 0, 0, 1.0),
    ],
)


def no_coco(candidates, scores, truth, n_classes):
    del candidates, scores, truth
    return np.full(n_classes, np.nan)


AT_HALF = MatchingConfig()


def matched():
    parts = []
    for sequence in ("s", "t"):
        chosen = [
            t.filter(np.array(t["sequence_id"].to_pylist()) == sequence)
            for t in (FUSED_ROWS, BOXES, TRUTH)
        ]
        parts.append(match.run(*chosen, AT_HALF).tables["matches"])
    import pyarrow as pa

    return pa.concat_tables(parts)


def metrics(config=None):
    config = config or MetricsConfig(names=("ap_voc07_11pt", "ap_area"))
    result = metrics_stage.run(
        FRAME_TABLE, TRUTH, BOXES, matched(), CLASSES, no_coco, AT_HALF, config
    )
    table = result.tables["metrics"].to_pandas()
    return table.set_index(["metric", "class_name"])


def test_every_fused_row_gets_its_outcome():
    rows = matched().to_pandas().set_index(["sequence_id", "frame_index", "detection_index"])
    mugs = rows[rows.class_id == 0]
    assert mugs.outcome["s", 0, 0] == "true_positive"
    assert mugs.outcome["s", 0, 1] == "false_positive"
    assert mugs.outcome["s", 1, 0] == "ignored"
    assert mugs.outcome["t", 0, 0] == "true_positive"
    assert mugs.annotation_index["s", 0, 0] == 0
    assert mugs.annotation_index["s", 1, 0] == 1
    assert pd.isna(mugs.annotation_index["s", 0, 1])
    assert rows[rows.class_id == 1].outcome.tolist() == ["false_positive"]


def test_average_precision_by_hand():
    # ranked: false (3.0), true (2.0), true (1.0); three annotations count, one is never found
    found = metrics()
    precision = [0, 1 / 2, 2 / 3]
    at_recall = [precision[2]] * 7 + [0] * 4  # 10·2 ≥ t·3 holds up to t = 6
    assert found.value["ap_voc07_11pt", "mug"] == pytest.approx(np.mean(at_recall))
    assert found.value["ap_area", "mug"] == pytest.approx(2 / 3 * 2 / 3)
    assert found.n_annotations["ap_area", "mug"] == 3
    assert found.n_detections["ap_area", "mug"] == 3


def test_a_class_without_annotations_has_no_ap_but_false_positives():
    found = metrics()
    assert np.isnan(found.value["ap_voc07_11pt", "box"])
    assert found.value["ap_voc07_11pt", "mean"] == found.value["ap_voc07_11pt", "mug"]
    assert found.value["n_false_positives", "box"] == 1
    assert found.value["n_false_positives", "mug"] == 1


def test_threshold_maximises_f1_where_it_is_evaluated():
    found = metrics()
    # all three kept: precision 2/3, recall 2/3; only 3.0: 0; 3.0 and 2.0: 1/2, 1/3
    assert found.value["threshold", "mug"] == 0.0
    assert found.value["precision", "mug"] == pytest.approx(2 / 3)
    assert found.value["recall", "mug"] == pytest.approx(2 / 3)
    assert found.value["f1", "mug"] == pytest.approx(2 / 3)
    assert found.value["threshold_tuned_on_test", "mean"] == 1.0


def test_threshold_tuned_on_other_sequences():
    config = MetricsConfig(names=("ap_area",), threshold_sequences=("t",))
    found = metrics(config)
    assert found.value["threshold", "mug"] == 0.0  # t holds one right box alone
    assert found.value["precision", "mug"] == pytest.approx(1 / 2)  # on s: 3.0 wrong, 2.0 right
    assert found.value["recall", "mug"] == pytest.approx(1 / 2)
    assert found.value["threshold_tuned_on_test", "mean"] == 0.0
    assert found.n_annotations["recall", "mug"] == 2


@pytest.mark.parametrize("names", [("u",), ("s", "t")])
def test_tuning_needs_some_but_not_all_sequences(names):
    with pytest.raises(ConfigError, match="threshold_sequences") as caught:
        metrics(MetricsConfig(threshold_sequences=names))
    assert "\n" not in str(caught.value)


def test_background_counts_pixels_outside_the_boxes():
    # s 0: truth left half, kept right half; s 1: truth left, right ignored, nothing kept;
    # t 0: truth right, kept right
    keys = pd.DataFrame(
        {"sequence_id": ["s", "t"], "frame_index": [0, 0], "detection_index": [1, 0]}
    )
    import pyarrow as pa

    kept = pa.Table.from_pandas(keys, preserve_index=False).cast(
        pa.schema([DETECTIONS.schema.field(name) for name in keys.columns])
    )
    precision, recall = background_per_pixel(FRAME_TABLE, TRUTH, BOXES, kept)
    predicted = 100 + 100 + 100  # left of s 0, left of s 1 (its right is ignored), left of t 0
    true = 100 + 0 + 100  # right of s 0, nothing of s 1, left of t 0
    both = 0 + 0 + 100
    assert precision == pytest.approx(both / predicted)
    assert recall == pytest.approx(both / true)


def test_no_annotations_is_a_warning_not_an_error():
    empty = ANNOTATIONS.schema.empty_table()
    table = match.run(FUSED_ROWS.slice(0, 4), BOXES.slice(0, 3), empty, AT_HALF)
    result = metrics_stage.run(
        frames(("s", 0), ("s", 1)), empty, BOXES.slice(0, 3), table.tables["matches"],
        CLASSES, no_coco, AT_HALF, MetricsConfig(),
    )  # fmt: skip
    assert len(result.warnings) == 1
    values = result.tables["metrics"].to_pandas()
    assert values[values.metric == "ap_area"].value.isna().all()
