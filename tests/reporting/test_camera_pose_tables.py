"""Camera poses: figures in the units of their headings, paths seen from above."""

import csv
import io

import numpy as np
import pytest
from hand_tables import pose, table

from imodbatch.reporting import camera_poses
from imodbatch.reporting.csv_text import csv_of
from imodbatch.reporting.names import DASH


def figure(sequence_id, name, value, n=7):
    return {"sequence_id": sequence_id, "metric": name, "value": value, "n": n}


QUALITY = [
    figure("s", "frames", 3.0),
    figure("s", "path_length_m", 12.34),
    figure("s", "duration_s", 60.0),
    figure("s", "reprojection_median_px", 0.75),
    figure("s", "reprojection_p90_px", 2.5),
    figure("s", "depth_consistency_median_m", 0.015),
    figure("s", "depth_consistency_share", 0.875),
    figure("s", "depth_overlap_share", 0.5),
    figure("s", "loop_error_median_m", 0.25, n=1),
    figure("s", "loop_error_median_deg", 1.25),
    figure("s", "ate_se3_rmse_m", 0.5),
    figure("s", "ate_se3_max_m", 0.75),
    figure("s", "ate_sim3_rmse_m", 0.375),
    figure("s", "sim3_scale", 1.0125),
    figure("s", "rpe_translation_rmse_m", 0.0625),
    figure("s", "rpe_rotation_rmse_deg", 0.125),
    figure("s", "up_error_deg", 0.25),
    figure("s", "loop_closures", 1400.0),
    figure("s", "scale_spread", 0.0625),
    figure("t", "path_length_m", 1.0),
    figure("t", "duration_s", None, n=0),
]
POSES = [
    pose("s", 2, (5.0, 6.0, -9.0), "interpolated"),
    pose("s", 0, (1.0, 2.0, -9.0)),
    pose("s", 1, (), "lost"),
    pose("t", 0, (7.0, 8.0, -9.0), "dense"),
]


@pytest.fixture
def drawn(monkeypatch):
    """The views drawn, by sequence."""
    views = {}
    monkeypatch.setattr(
        camera_poses, "path_svg", lambda name, view: views.update({name: view}) or "svg"
    )
    return views


@pytest.fixture
def section(drawn):  # noqa: ARG001
    true = {n: v for n, v in pose("s", 0, (1.5, 2.5, -8.0)).items() if n != "status"}
    return camera_poses.pose_section(
        table("pose_quality", QUALITY), table("poses", POSES), table("reference_poses", [true])
    )


def test_figures_stand_in_the_units_of_their_headings(section):
    grid, _ = section.grids
    s, t = grid.rows
    shown = {c.text: cell.text for c, cell in zip(grid.columns, s.cells, strict=True)}
    assert shown == {
        "length (m)": "12.3",
        "time (s)": "60.0",
        "features off (px)": "0.8",
        "features off, 90 % (px)": "2.5",
        "depth apart (cm)": "1.5",
        "depth agrees (%)": "87.5",
        "on return (cm)": "25.0",
        "on return (°)": "1.2",
        "ATE (cm)": "50.0",
        "ATE, largest (cm)": "75.0",
        "ATE, scaled (cm)": "37.5",
        "scale to truth": "1.012",
        "RPE (cm)": "6.2",
        "RPE (°)": "0.12",
        "up off by (°)": "0.25",
    }
    assert [cell.text for cell in t.cells] == ["1.0", *[DASH] * 14]
    notes = {c.text: cell.note for c, cell in zip(grid.columns, s.cells, strict=True) if cell.note}
    assert notes == {"on return (cm)": "1 pair"}


def test_the_sources_own_figures_stand_apart(section):
    _, grid = section.grids
    assert [column.text for column in grid.columns] == ["s", "t"]
    assert [(row.name, *(cell.text for cell in row.cells)) for row in grid.rows] == [
        ("loop closures", "1,400", DASH),
        ("scale spread", "0.062", DASH),
    ]


def test_paths_from_above_in_order_of_frames(section, drawn):
    view = drawn["s"]
    np.testing.assert_array_equal(view.path, [[1.0, 2.0], [np.nan, np.nan], [5.0, 6.0]])
    np.testing.assert_array_equal(view.reference, [[1.5, 2.5]])
    assert len(drawn["t"].reference) == 0
    places = {color: marked.tolist() for marked, color in view.marks}
    dense, interpolated = camera_poses.MARKS["dense"], camera_poses.MARKS["interpolated"]
    assert places == {dense: [], interpolated: [[5.0, 6.0]]}
    assert {color: marked.tolist() for marked, color in drawn["t"].marks}[dense] == [[7.0, 8.0]]
    assert [(name, remark) for name, remark, _ in section.paths] == [
        ("s", "3 frames, 1 interpolated, 1 lost"),
        ("t", "1 frame, 1 dense"),
    ]
    assert section.marks == [("dense", dense), ("interpolated", interpolated)]
    assert section.has_truth


def test_the_csv_has_every_figure():
    rows = list(csv.reader(io.StringIO(csv_of(table("pose_quality", QUALITY)))))
    assert rows[0] == ["sequence_id", "metric", "value", "n"]
    assert rows[9] == ["s", "loop_error_median_m", "0.25", "1"]
    assert rows[-1] == ["t", "duration_s", "", "0"]


def test_nothing_judged_has_no_section():
    nothing = (table(name, []) for name in ("pose_quality", "poses", "reference_poses"))
    assert camera_poses.pose_section(*nothing) is None
