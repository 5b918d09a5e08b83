"""The report's figures are those of the tables, its pictures show what was right and wrong."""

import base64
import csv
import io
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from imodbatch.core.errors import DataError
from imodbatch.reporting import paper, report
from imodbatch.reporting.camera_poses import pose_section
from imodbatch.reporting.figures import precision_recall_svg
from imodbatch.reporting.gallery import choose_frames
from imodbatch.reporting.names import DASH, in_order, method_style
from imodbatch.reporting.pictures import COLORS, DrawnBox, draw_boxes
from imodbatch.reporting.plots import maps
from imodbatch.reporting.results import Curve, Results, curve
from imodbatch.settings.config import ReportConfig
from imodbatch.tables.parquet import empty, from_rows
from imodbatch.tables.schemas import TABLES

CLASSES = ("bowl", "cup", "spoon")
METHODS = ("single", "imod")
WIDTH, HEIGHT = 320, 240
GREY = 90
AP = {
    ("single", 0): 0.51249,
    ("single", 1): 0.25,
    ("single", -1): 0.381245,
    ("imod", 0): 0.8125,
    ("imod", 1): 0.125,
    ("imod", -1): 0.46875,
}
THRESHOLD = {("single", 0): 0.4, ("single", 1): 0.4, ("imod", 0): 1.25, ("imod", 1): 1.25}
BOXES = {0: (40, 60, 120, 160), 1: (180, 70, 280, 170)}  # detection index → box
ANNOTATION_BOXES = {0: (42, 60, 122, 160), 1: (20, 185, 90, 225)}


def frame_row(sequence_id, frame_index):
    camera = {"fx_px": 300.0, "fy_px": 300.0, "cx_px": 160.0, "cy_px": 120.0}
    size = {"width_px": WIDTH, "height_px": HEIGHT}
    return {
        "sequence_id": sequence_id,
        "frame_index": frame_index,
        "color_path": f"{sequence_id}/{frame_index}.png",
        "depth_scale_m": 0.001,
        **size,
        **camera,
        **{f"depth_{name}": value for name, value in {**size, **camera}.items()},
    }


def box_columns(box):
    return dict(zip(("x0_px", "y0_px", "x1_px", "y1_px"), box, strict=True))


def metric_rows(method):
    def row(metric, class_id, value, iou_percent=50, n_annotations=2):
        names = {-1: "mean", -2: "background"}
        return {
            "method": method,
            "class_id": class_id,
            "iou_percent": iou_percent,
            "metric": metric,
            "class_name": names.get(class_id) or CLASSES[class_id],
            "value": value,
            "n_annotations": n_annotations,
            "n_detections": 4,
        }

    rows = [row("ap_voc07_11pt", k, AP[method, k]) for k in (0, 1, -1)]
    rows += [row("ap_voc07_11pt", 2, None, n_annotations=0)]
    rows += [row("ap_area", k, AP[method, k] / 2) for k in (0, 1, -1)]
    rows += [row("ap_coco", k, AP[method, k] / 4, iou_percent=0) for k in (0, 1, -1)]
    rows += [row("precision", k, 0.9375 - 0.1 * k) for k in (0, 1, -1)]
    rows += [row("recall", k, 0.625 - 0.1 * k) for k in (0, 1, -1)]
    rows += [row("precision", -2, 0.981), row("recall", -2, 0.972)]
    rows += [row("threshold", k, THRESHOLD[method, k]) for k in (0, 1)]
    rows += [row("n_false_positives", 2, 7.0 if method == "single" else 3.0, n_annotations=0)]
    rows += [row("threshold_tuned_on_test", -1, 1.0)]
    return rows


def make_tables():
    """Two sequences of three frames; in each a bowl is found, a bowl missed, a cup wrong."""
    keys = [(sequence_id, frame) for sequence_id in ("desk", "shelf") for frame in range(3)]
    rows = {name: [] for name in TABLES}
    for sequence_id, frame in keys:
        key = {"sequence_id": sequence_id, "frame_index": frame}
        rows["frames"].append(frame_row(sequence_id, frame))
        is_lost = (sequence_id, frame) == ("shelf", 1)
        place = {"tx_m": float(frame), "ty_m": 0.5, "tz_m": 1.0}
        turn = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
        status = "lost" if is_lost else "tracked"
        rows["poses"].append({**key, "status": status, **({} if is_lost else place | turn)})
        for index, box in ANNOTATION_BOXES.items():
            flags = {"annotation_index": index, "class_id": 0, "is_crowd": False}
            rows["annotations"].append({**key, **flags, "is_ignored": False, **box_columns(box)})
        for index, box in BOXES.items():
            place = {**key, "detection_index": index}
            scores = {"background_score": 0.1, "class_ids": [index], "view_scores": [0.5]}
            rows["detections"].append({**place, **box_columns(box), **scores})
            rows["observations"].append({**place, "status": "no_pose" if is_lost else "placed"})
            for method in METHODS:
                # single keeps the wrong cup, imod does not; both keep the right bowl
                score = {"single": (0.75, 0.5), "imod": (1.5, 0.75)}[method][index]
                is_right = index == 0
                rows["fused"].append(
                    {**place, "method": method, "class_id": index, "score": score, "n_cells": 1}
                )
                rows["matches"].append(
                    {
                        **place,
                        "method": method,
                        "class_id": index,
                        "iou_percent": 50,
                        "score": score,
                        "outcome": "true_positive" if is_right else "false_positive",
                        "annotation_index": 0 if is_right else None,
                    }
                )
    for sequence_id in ("desk", "shelf"):
        for index, score in enumerate((1.5, 0.5, 0.25)):
            rows["objects"].append(
                {
                    "sequence_id": sequence_id,
                    "method": "imod",
                    "object_index": index,
                    "class_id": 0,
                    "score": score,
                    **{
                        "x_m": 0.5,
                        "y_m": 1.0 + index,
                        "z_m": 0.75,
                        "yaw_rad": 0.5 if index else None,
                    },
                    **{"extent_x_m": 0.1, "extent_z_m": 0.1, "n_detections": 3, "n_cells": 2},
                    **{"first_frame_index": 0, "last_frame_index": 2},
                }
            )
    rows["metrics"] = [row for method in METHODS for row in metric_rows(method)]
    for voxel_mm, value in ((100, 0.5), (200, 0.625), (400, None)):
        sweep = {"method": "imod", "voxel_mm": voxel_mm, "metric": "ap_voc07_11pt"}
        rows["sweeps"].append({**sweep, "value": value})
    for sequence_id, metric, value, n in (
        ("desk", "frames", 3.0, 3),
        ("desk", "path_length_m", 2.0, 3),
        ("desk", "depth_consistency_share", 0.985, 500),
        ("desk", "loop_error_median_m", 0.0625, 7),
        ("desk", "ate_se3_rmse_m", 0.03125, 3),
        ("desk", "loop_closures", 4.0, 3),
        ("shelf", "frames", 3.0, 3),
        ("shelf", "path_length_m", 1.0, 2),
        ("shelf", "depth_consistency_share", None, 0),
    ):
        rows["pose_quality"].append(
            {"sequence_id": sequence_id, "metric": metric, "value": value, "n": n}
        )
    rows["reference_poses"] = [
        {**{name: x for name, x in row.items() if name != "status"}, "ty_m": 0.75}
        for row in rows["poses"]
        if row["sequence_id"] == "desk"
    ]
    for kind, level, value in (("jitter", 0, 0.5), ("jitter", 50, 0.375), ("drift", 0, None)):
        rows["jitters"].append(
            {
                **{"method": "imod", "kind": kind, "translation_mm": level, "rotation_mdeg": 0},
                **{"metric": "ap_voc07_11pt", "value": value, "n_repeats": 3},
                "spread": 0.125 if level else None,
            }
        )
    rows["losses"] = [
        {"class_id": 0, "cause": "no_box", "value": 0.375, "n": 12},
        {"class_id": 0, "cause": "made_up", "value": None, "n": 0},
    ]
    tables = {name: from_rows(TABLES[name], of_table) for name, of_table in rows.items()}
    return {**tables, "detections": tables["detections"].drop_columns(["view_scores"])}


RUN_INFO = report.RunInfo(
    title="two <desks>",
    description="Made by hand.",
    pipeline_name="imod-3x16",
    classes=CLASSES,
    versions={"imodbatch": "1.2.3"},
    settings={
        "viewpoint": {"n_azimuths": 16},
        "lift": {"voxel_size_m": 0.2},
        "metrics": {"threshold_step": 0.01, "threshold_sequences": ()},
    },
    summaries=(("lift", "desk", "6 detections = 6 placed"),),
    created="2026-01-05",
)


def grey_image(color_path):
    assert re.fullmatch(r"(desk|shelf)/\d\.png", color_path)
    return np.full((HEIGHT, WIDTH, 3), GREY, dtype=np.uint8)


def build(out_dir, tables=None, read_color=grey_image, info=RUN_INFO, **config):
    tables = make_tables() if tables is None else tables
    config = {"n_frames": 2, **config}
    return report.run(info, tables, read_color, ReportConfig(**config), out_dir).read_text("utf-8")


class Tables(HTMLParser):
    """Tables by id: rows of cell texts; a cell is (text, remark, classes)."""

    def __init__(self, text):
        super().__init__()
        self.tables, self.rows, self.in_small = {}, None, False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag == "table":
            self.rows = self.tables[attrs.get("id")] = []
        elif tag == "tr":
            self.rows.append([])
        elif tag in {"th", "td"}:
            self.rows[-1].append(["", "", (attrs.get("class") or "").split()])
        self.in_small = tag == "small"

    def handle_endtag(self, tag):
        self.in_small = self.in_small and tag != "small"
        if tag == "table":
            self.rows = None

    def handle_data(self, data):
        if self.rows and self.rows[-1]:
            self.rows[-1][-1][1 if self.in_small else 0] += data.strip()


def table_of(page, name):
    """Row name → cells of a table in the page."""
    return {row[0][0]: row[1:] for row in Tables(page).tables[name]}


def texts(cells):
    return [text for text, _, _ in cells]


def markdown_rows(text):
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    return {line[0].strip(): [cell.strip() for cell in line[1:]] for line in lines}


def csv_rows(path):
    return list(csv.DictReader(io.StringIO(path.read_text("utf-8"))))


@pytest.fixture(scope="module")
def out_dir(tmp_path_factory):
    path = tmp_path_factory.mktemp("report")
    build(path)
    return path


@pytest.fixture(scope="module")
def page(out_dir):
    return (out_dir / report.PAGE).read_text("utf-8")


@pytest.mark.parametrize(
    ("table", "divisor", "skip"),
    [("ap_voc07_11pt-50", 1, 1), ("ap_area-50", 2, 0), ("ap_coco-0", 4, 0)],
)
def test_the_page_shows_the_metrics_of_each_class_and_method(page, table, divisor, skip):
    rows = table_of(page, table)
    for class_id, name in ((0, "bowl"), (1, "cup"), (-1, "mean")):
        expected = [f"{AP[method, class_id] / divisor:.3f}" for method in METHODS]
        assert texts(rows[name])[skip:] == expected


def test_the_best_of_each_row_is_bold_and_no_other(page):
    rows = table_of(page, "ap_voc07_11pt-50")
    is_best = {name: ["best" in cell[2] for cell in cells] for name, cells in rows.items()}
    assert is_best["bowl"] == [False, False, True]
    assert is_best["cup"] == [False, True, False]
    assert is_best["mean"] == [False, False, True]
    assert is_best["spoon"] == [False, False, False]


def test_a_class_without_annotations_has_a_dash_and_its_false_positives(page, out_dir):
    cells = table_of(page, "ap_voc07_11pt-50")["spoon"]
    assert texts(cells) == ["0", DASH, DASH]
    assert [note for _, note, _ in cells[1:]] == ["7 false positives", "3 false positives"]
    markdown = markdown_rows((out_dir / "ap.md").read_text("utf-8").split("###")[1])
    assert markdown["spoon"] == ["0", f"{DASH}, 7 false positives", f"{DASH}, 3 false positives"]


def test_false_positives_are_counted_where_the_metrics_do_not_tell(tmp_path):
    tables = make_tables()
    metrics = [row for row in tables["metrics"].to_pylist() if row["class_id"] != 2]
    matches = [dict(row, class_id=2 * row["class_id"]) for row in tables["matches"].to_pylist()]
    tables["metrics"] = from_rows(TABLES["metrics"], metrics)
    tables["matches"] = from_rows(TABLES["matches"], matches)  # the cups are spoons now
    cells = table_of(build(tmp_path, tables), "ap_voc07_11pt-50")["spoon"]
    assert [note for _, note, _ in cells[1:]] == ["6 false positives", "6 false positives"]


def test_precision_and_recall_stand_with_ap_and_threshold(page):
    rows = table_of(page, "precision-recall")
    assert texts(rows["bowl"]) == ["93.8/62.5 (0.512)", "93.8/62.5 (0.812)"]
    assert [note for _, note, _ in rows["bowl"]] == ["≥ 0.40", "≥ 1.25"]
    assert texts(rows["background"]) == [f"98.1/97.2 ({DASH})"] * 2
    assert texts(rows["spoon"]) == [f"{DASH}/{DASH} ({DASH})"] * 2
    assert "tuned on the very sequences evaluated here" in page


@pytest.mark.parametrize(
    ("tuned_on_test", "words"), [(0.0, "on other sequences"), (None, "do not name")]
)
def test_the_page_says_where_thresholds_were_tuned(tmp_path, tuned_on_test, words):
    tables = make_tables()
    rows = tables["metrics"].to_pylist()
    for row in rows:
        if row["metric"] == "threshold_tuned_on_test":
            row["value"] = tuned_on_test
    tables["metrics"] = from_rows(TABLES["metrics"], rows)
    text = build(tmp_path, tables)
    assert words in text
    assert "the very sequences" not in text


def test_markdown_agrees_with_the_page(out_dir, page):
    ap, area, coco = (out_dir / "ap.md").read_text("utf-8").split("###")[1:]
    for section, table in ((ap, "ap_voc07_11pt-50"), (area, "ap_area-50"), (coco, "ap_coco-0")):
        shown = table_of(page, table)
        written = markdown_rows(section)
        for name in ("bowl", "cup", "mean"):
            assert [cell.strip("*") for cell in written[name]] == texts(shown[name])
    written = markdown_rows((out_dir / "precision_recall.md").read_text("utf-8"))
    assert written["bowl"] == ["93.8/62.5 (0.512), ≥ 0.40", "93.8/62.5 (0.812), ≥ 1.25"]


def test_csv_holds_the_metrics_in_full_precision(out_dir):
    found = {
        (row["metric"], int(row["class_id"]), method): row[method]
        for row in csv_rows(out_dir / "ap.csv")
        for method in METHODS
    }
    for (method, class_id), value in AP.items():
        assert float(found["ap_voc07_11pt", class_id, method]) == value
        assert float(found["ap_area", class_id, method]) == value / 2
        assert float(found["ap_coco", class_id, method]) == value / 4
    assert found["ap_voc07_11pt", 2, "single"] == ""
    rows = {row["class_name"]: row for row in csv_rows(out_dir / "precision_recall.csv")}
    assert float(rows["cup"]["imod_precision"]) == 0.9375 - 0.1
    assert float(rows["cup"]["imod_threshold"]) == 1.25
    assert float(rows["background"]["single_recall"]) == 0.972
    assert rows["spoon"]["single_ap_voc07_11pt"] == ""


def test_status_counts_add_up_in_csv_and_page(out_dir, page):
    counts = {
        (row["stage"], row["sequence_id"], row["status"]): int(row["n"])
        for row in csv_rows(out_dir / "status_counts.csv")
    }
    assert counts["poses", "desk", "tracked"] == 3
    assert counts["poses", "shelf", "lost"] == 1
    assert ("poses", "desk", "lost") not in counts
    assert counts["lift", "shelf", "no_pose"] == 2
    for stage, total in (("poses", 6), ("lift", 12), ("detect", 12)):
        assert sum(n for key, n in counts.items() if key[0] == stage) == total
    rows = table_of(page, "status")
    columns = dict(zip(texts(rows["sequence"]), range(99), strict=False))
    assert texts(rows["shelf"])[columns["lost"]] == "1"
    assert texts(rows["desk"])[columns["lost"]] == "0"
    assert texts(rows["all sequences"])[columns["placed"]] == "10"


def test_losses_and_summaries_are_shown(page):
    cells = table_of(page, "losses")["bowl"]
    assert [cell[:2] for cell in cells] == [["0.375", "n = 12"], [DASH, "n = 0"]]
    assert "lift desk: 6 detections = 6 placed" in page


def test_the_page_stands_alone_and_escapes_what_it_is_told(page):
    for outside in ('src="http', 'href="http', "<script", "@import", "<link", "url(http"):
        assert outside not in page
    assert all(s.startswith("data:image/jpeg;base64,") for s in re.findall(r'src="([^"]*)', page))
    assert "two &lt;desks&gt;" in page
    assert "<desks>" not in page


def test_svg_references_resolve_and_ids_do_not_repeat(page):
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    references = set(re.findall(r"url\(#([^)]+)\)", page)) | set(re.findall(r'href="#(\w+)', page))
    assert references
    assert references <= set(ids)


def test_equal_input_makes_equal_bytes_also_in_another_process(out_dir, tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_report, pathlib; "
        "test_report.build(pathlib.Path(sys.argv[2]))"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parent), str(tmp_path)],
        check=True,
        env={**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    names = sorted(path.name for path in out_dir.iterdir())
    assert len(names) == 9
    assert names == sorted(path.name for path in tmp_path.iterdir())  # and no partial is left
    for name in names:
        assert (tmp_path / name).read_bytes() == (out_dir / name).read_bytes()


def test_drawn_boxes_have_their_colours_where_they_are():
    image = np.full((HEIGHT, WIDTH, 3), GREY, dtype=np.uint8)
    image.flags.writeable = False
    drawn = draw_boxes(
        image,
        [
            DrawnBox(BOXES[0], "true_positive", "bowl 0.75"),
            DrawnBox(BOXES[1], "false_positive"),
            DrawnBox(ANNOTATION_BOXES[1], "missed"),
        ],
        WIDTH,
    )
    assert tuple(drawn[110, 40]) == tuple(drawn[159, 80]) == COLORS["true_positive"]
    assert tuple(drawn[120, 180]) == tuple(drawn[70, 230]) == COLORS["false_positive"]
    assert tuple(drawn[185, 20]) == COLORS["missed"]
    assert tuple(drawn[110, 80]) == tuple(drawn[5, 5]) == (GREY,) * 3
    above = drawn[46:56, 40:80].reshape(-1, 3)  # the label: coloured ground, white letters
    assert (above == COLORS["true_positive"]).all(axis=1).any()
    assert (above.min(axis=1) > 200).any()


def test_boxes_shrink_with_the_picture():
    image = np.full((HEIGHT, WIDTH, 3), GREY, dtype=np.uint8)
    drawn = draw_boxes(image, [DrawnBox(BOXES[0], "true_positive")], WIDTH // 2)
    assert drawn.shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert tuple(drawn[55, 20]) == COLORS["true_positive"]
    assert tuple(drawn[110, 40]) == (GREY,) * 3


def test_a_label_at_the_upper_edge_stays_in_the_picture():
    image = np.full((HEIGHT, WIDTH, 3), GREY, dtype=np.uint8)
    drawn = draw_boxes(image, [DrawnBox((300, 0, 320, 60), "false_positive", "cup 0.50")], WIDTH)
    assert (drawn[:14, 270:].min(axis=2) > 200).any()


def decoded_pictures(page):
    """Caption → RGB image of every picture in the page."""
    found = re.findall(r'src="data:image/jpeg;base64,([^"]+)" alt="([^"]+)"', page)
    raw = {alt: np.frombuffer(base64.b64decode(code), np.uint8) for code, alt in found}
    return {alt: cv2.imdecode(data, cv2.IMREAD_COLOR)[:, :, ::-1] for alt, data in raw.items()}


def close(pixel, color):
    return np.abs(pixel.astype(int) - color).max() < 40


def test_the_page_shows_single_beside_the_method_each_at_its_own_threshold(page):
    pictures = decoded_pictures(page)
    assert list(pictures) == [
        "desk, frame 1, single view",
        "desk, frame 1, imod (Konno 2020)",
        "shelf, frame 1, single view",
        "shelf, frame 1, imod (Konno 2020)",
    ]
    for alt, picture in pictures.items():
        assert close(picture[110, 40], COLORS["true_positive"])
        assert close(picture[185, 23], COLORS["missed"])
        wrong = COLORS["false_positive"] if "single" in alt else (GREY,) * 3
        assert close(picture[120, 180], wrong)
    assert page.count("1 right, 1 wrong, 1 missed") == 2
    assert page.count("1 right, 0 wrong, 1 missed") == 2


def test_ignored_annotations_are_not_missed(tmp_path):
    tables = make_tables()
    rows = tables["annotations"].to_pylist()
    for row in rows:
        row["is_ignored"] = row["annotation_index"] == 1
    tables["annotations"] = from_rows(TABLES["annotations"], rows)
    text = build(tmp_path, tables)
    assert text.count("1 right, 1 wrong, 0 missed") == 2
    assert "12 annotations (6 of them ignored)" in text


def test_an_unreadable_image_is_noted_and_the_rest_is_shown(tmp_path):
    def read_color(color_path):
        if color_path.startswith("desk"):
            raise DataError("desk/1.png: damaged <image>.")
        return grey_image(color_path)

    text = build(tmp_path, read_color=read_color)
    assert "Picture left out: desk/1.png: damaged &lt;image&gt;." in text
    assert [alt.split(",")[0] for alt in decoded_pictures(text)] == ["shelf", "shelf"]


def test_frames_are_spread_evenly_and_differing_ones_preferred():
    frames = [("a", i) for i in range(9)]
    assert choose_frames(frames, set(), 3) == [("a", 1), ("a", 4), ("a", 7)]
    assert choose_frames(frames, {("a", 5), ("a", 3)}, 3) == [("a", 1), ("a", 3), ("a", 7)]
    assert choose_frames(frames, {("a", 8)}, 1) == [("a", 8)]
    assert choose_frames(frames[:2], set(), 5) == frames[:2]
    assert choose_frames([], set(), 5) == []
    assert choose_frames(frames, set(), 0) == []


def results_of(tables):
    return Results(tables, ("desk", "shelf"))


def test_curves_leave_out_ignored_detections_and_break_ties_by_key():
    keys = [("shelf", 0, 0), ("desk", 1, 0), ("desk", 0, 1), ("desk", 0, 0)]
    outcomes = ["true_positive", "ignored", "true_positive", "false_positive"]
    names = ("sequence_id", "frame_index", "detection_index")
    common = {"method": "single", "class_id": 0, "iou_percent": 50, "score": 0.5}
    matches = [
        {**dict(zip(names, key, strict=True)), **common, "outcome": outcome}
        for key, outcome in zip(keys, outcomes, strict=True)
    ]
    tables = {**make_tables(), "matches": from_rows(TABLES["matches"], matches)}
    found = curve(results_of(tables).matches("single"), 0, 4)
    np.testing.assert_allclose(found.precision, [1 / 2, 2 / 3])  # wrong, right, (ignored), right
    np.testing.assert_allclose(found.recall, [1 / 4, 2 / 4])


def test_a_curve_is_drawn_in_its_methods_colour():
    line = Curve(np.array([0.5, 1.0]), np.array([1.0, 0.5]))
    drawn = precision_recall_svg('a "bowl"', [("imod", line)], [])
    assert method_style("imod").color in drawn
    assert method_style("single").color not in drawn
    assert "a &#34;bowl&#34;" in drawn
    assert "<metadata" not in drawn


def test_only_classes_with_annotations_get_a_curve(page):
    assert 'aria-label="Precision over recall, bowl"' in page
    assert 'aria-label="Precision over recall, spoon"' not in page


def test_the_map_tells_objects_that_reach_the_threshold():
    views, legend, n_left = maps(results_of(make_tables()), RUN_INFO, "imod")
    assert [view[:2] for view in views] == [
        ("desk", "3 objects, 1 at or above threshold"),
        ("shelf", "3 objects, 1 at or above threshold"),
    ]
    assert [name for name, _ in legend] == ["bowl"]
    assert n_left == 0


def test_the_sweep_is_drawn_or_its_absence_told(page, tmp_path):
    assert "Mean AP over the voxel" in page
    text = build(tmp_path, {**make_tables(), "sweeps": empty(TABLES["sweeps"])})
    assert "Mean AP over the voxel" not in text
    assert "No sweep over voxel sizes was run." in text


def test_poses_are_judged_in_a_table_and_beside_the_page(out_dir, page):
    rows = table_of(page, "poses")
    assert texts(rows["desk"]) == ["2.0", "98.5", "6.2", "3.1"]
    assert texts(rows["shelf"]) == ["1.0", DASH, DASH, DASH]
    assert texts(table_of(page, "poses-source")["loop closures"]) == ["4", DASH]
    assert "7 pairs" in page
    assert "ATE (cm)" in page
    markdown = (out_dir / "poses.md").read_text("utf-8")
    assert "| shelf | 1.0 | –" in markdown
    found = csv_rows(out_dir / "poses.csv")
    assert len(found) == 9
    assert {row["metric"]: row["value"] for row in found}["depth_consistency_share"] == ""


def test_paths_are_drawn_beside_the_true_ones(page):
    section = page.split("<h2>Camera poses</h2>")[1].split("<h2>")[0]
    assert section.count("<svg") == 2
    assert "Camera path from above, desk" in section
    assert "true, aligned" in section
    assert "3 frames, 1 lost" in section
    assert "dashed #111827" in section  # the true path's swatch


def test_frames_that_are_not_simply_tracked_are_marked():
    tables = make_tables()
    poses = tables["poses"].to_pylist()
    poses[1]["status"] = "interpolated"
    section = pose_section(
        tables["pose_quality"], from_rows(TABLES["poses"], poses), empty(TABLES["reference_poses"])
    )
    assert section.marks == [("interpolated", "#9d4edd")]
    assert not section.has_truth
    (name, remark, svg), _ = section.paths
    assert (name, remark) == ("desk", "3 frames, 1 interpolated")
    assert "#9d4edd" in svg


def test_poses_that_nobody_judged(tmp_path):
    page = build(tmp_path, {**make_tables(), "pose_quality": empty(TABLES["pose_quality"])})
    assert "The poses were not judged." in page
    assert not list(tmp_path.glob("poses.*"))
    assert "poses.csv" not in page


def test_disturbed_poses_are_drawn_and_listed_or_not_mentioned(out_dir, page, tmp_path):
    assert "Poses disturbed on purpose" in page
    assert "under jitter of poses" in page
    rows = table_of(page, "jitters")
    names = ("jitter, none", "jitter, 50 mm", "drift, none")
    assert [texts(rows[name]) for name in names] == [["0.500"], ["0.375"], [DASH]]
    found = csv_rows(out_dir / "jitters.csv")
    assert [row["spread"] for row in found] == ["", "0.125", ""]
    text = build(tmp_path, {**make_tables(), "jitters": empty(TABLES["jitters"])})
    assert "isturbed" not in text
    assert not list(tmp_path.rglob("jitters.csv"))


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        (("annotations", "metrics", "matches"), "There are no annotations"),
        (("detections", "observations", "fused", "matches", "objects"), "There are no detections"),
        (("poses", "objects"), "There are no poses"),
        (("metrics",), "The metrics table holds no average precision."),
        (("frames",), "the frames table has no such frame"),
        (tuple(TABLES), "There are no frames."),
    ],
)
def test_empty_tables_still_give_a_report_that_says_so(tmp_path, missing, words):
    tables = {**make_tables(), **{name: empty(TABLES[name]) for name in missing}}
    assert words in build(tmp_path, tables)


def test_absent_tables_count_as_empty(tmp_path):
    tables = {name: empty(spec) for name, spec in TABLES.items()}
    expected = build(tmp_path / "empty", tables)
    assert build(tmp_path / "absent", {}) == expected
    assert "There are neither objects nor poses to draw." in expected


def test_without_thresholds_no_box_is_drawn_and_the_page_says_so(tmp_path):
    tables = make_tables()
    rows = [row for row in tables["metrics"].to_pylist() if row["metric"] != "threshold"]
    tables["metrics"] = from_rows(TABLES["metrics"], rows)
    text = build(tmp_path, tables)
    assert "Without a tuned threshold, and so not drawn: bowl, cup, spoon." in text
    assert text.count("0 right, 0 wrong, 2 missed") == 4


def test_a_method_that_was_not_scored_is_named(tmp_path):
    text = build(tmp_path, frame_method="naive_offline")
    assert "Not scored in this run: naive_offline." in text
    assert all("single view" in alt for alt in decoded_pictures(text))


def test_the_papers_columns_stand_beside_and_are_marked(tmp_path):
    info = report.RunInfo("t", "", "p", ("teacup", "cup", "spoon"))
    rows = table_of(build(tmp_path, info=info, paper="table1"), "ap_voc07_11pt-50")
    assert texts(rows["teacup"])[3:] == [
        "0.906",
        "0.801",
        "0.894",
        "0.909",
        "0.904",
        "0.756",
        "0.452",
        "0.695",
    ]
    assert texts(rows["cup"])[3:] == [DASH] * 8
    assert all("paper" in classes for _, _, classes in rows["teacup"][3:])
    assert not any("paper" in classes for _, _, classes in rows["teacup"][:3])
    assert any(text == "paper: other data, real" for text, _, _ in rows[""])


def test_table_2_of_the_paper_stands_below_precision_and_recall(tmp_path):
    rows = table_of(build(tmp_path, paper="table2"), "precision-recall-paper")
    assert texts(rows["bowl"])[5] == "97.0/68.1 (0.709)"
    assert texts(rows["mean"])[4] == "90.55/75.68 (0.655)"
    assert texts(rows["cup"]) == [DASH] * 9


def test_the_papers_printed_means_follow_from_its_rows():
    for column in (*paper.TABLE_1[16], *paper.TABLE_1[8], *paper.TABLE_2):
        values = [v for name, v in column.ap.items() if name != "mean" and v is not None]
        if column.ap["mean"] is not None:
            assert column.ap["mean"] == pytest.approx(np.mean(values), abs=0.0015)
        pairs = [pair for name, pair in column.precision_recall.items() if name != "mean"]
        if column.ap["mean"] is not None and pairs:  # columns quoted from others do not add up
            printed = column.precision_recall["mean"]
            np.testing.assert_allclose(np.mean(pairs, axis=0), printed, atol=0.06)


def test_the_half_of_table_1_follows_the_number_of_azimuths():
    assert paper.columns("table1", 8)[3].ap["mean"] == 0.847
    assert paper.columns("table1", 16)[3].ap["mean"] == 0.822
    assert paper.columns("none") == ()


def test_methods_have_one_order_name_and_look():
    shuffled = ["zeta", "imod_offline", "imod", "naive_log", "single", "naive_offline", "naive"]
    order = ("single", "naive", "naive_log", "imod", "zeta", "naive_offline", "imod_offline")
    assert in_order(shuffled) == order
    assert method_style("naive_log_offline").name == "log-odds sum (SLAM-aware rule), all frames"
    assert method_style("imod").color == method_style("imod_offline").color
    assert [method_style(m).is_dashed for m in ("imod", "imod_offline")] == [False, True]


def test_curves_on_more_sequences_than_the_metrics_are_marked(tmp_path, page):
    assert "The curves stand on" in page  # 12 bowls annotated, metrics of 2 bowls and 2 cups
    tables = make_tables()
    rows = [
        dict(row, n_annotations=12 * (row["class_id"] == 0))
        for row in tables["metrics"].to_pylist()
    ]
    tables["metrics"] = from_rows(TABLES["metrics"], rows)
    assert "The curves stand on" not in build(tmp_path, tables)
