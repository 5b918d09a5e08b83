"""How often a detector names the azimuth: seven boxes of four classes, counted by hand."""

import csv
import io
import math

import numpy as np
import pytest
from hand_runs import hand_run
from hand_tables import annotation, detection, match

from imodbatch.reporting.azimuths import azimuth_block, azimuth_csv, azimuth_grid, azimuth_remark
from imodbatch.reporting.comparison import compare_runs
from imodbatch.reporting.names import DASH

CLASSES = ("cup", "ball", "can", "pen")
CUP, BALL, CAN, PEN = range(4)
SYMMETRY = {CUP: "none", BALL: "full", CAN: "2"}
N_AZIMUTHS, N_ELEVATIONS = 8, 3
BOX = (0, 0, 1, 1)
BIN_RAD = 2 * math.pi / N_AZIMUTHS


def says(class_id, *cells):
    """A score vector; each cell is (elevation, azimuth, score)."""
    vector = np.zeros((len(CLASSES), N_ELEVATIONS, N_AZIMUTHS), dtype=np.float32)
    for elevation, azimuth, score in cells:
        vector[class_id, elevation, azimuth] = score
    return vector.ravel()


CASES = [  # class, azimuth of the truth in bins, what the detector says, outcome
    (CUP, 0.0, ((0, 0, 0.2), (1, 0, 0.2), (2, 3, 0.3)), "T"),  # .4 at bin 0, more than .3: exact
    (CUP, 0.0, ((0, 7, 0.5),), "T"),  # one bin off, round the turn
    (CUP, 0.4, ((0, 2, 0.5),), "T"),  # bin 0: two off
    (CUP, None, ((0, 0, 0.5),), "T"),  # the truth is not known
    (CUP, 0.0, ((0, 0, 0.5),), "F"),  # not right
    (CAN, 1.0, ((0, 5, 0.5),), "T"),  # half a turn off, which looks the same: exact
    (BALL, 0.0, ((0, 0, 0.5),), "T"),  # has no azimuth
]


@pytest.fixture
def comparison():
    annotations, detections, matches = [], [], []
    for i, (class_id, bins, cells, outcome) in enumerate(CASES):
        azimuth = None if bins is None else bins * BIN_RAD
        annotations.append(
            annotation(
                "s", 0, i, class_id, BOX, own_azimuth_rad=azimuth, symmetry=SYMMETRY[class_id]
            )
        )
        detections.append(detection("s", 0, i, BOX, says(class_id, *cells), (class_id,)))
        matches.append(match("s", 0, i, class_id, 0.5, outcome, "single", found=i))
        other = "F" if outcome == "T" else "T"
        matches.append(match("s", 0, i, class_id, 0.5, other, "imod", found=i))  # not asked
        matches.append(match("s", 0, i, class_id, 0.5, "T", "single", 75, found=i))  # nor is this
    run = hand_run("run", (3, 8), CLASSES, annotations, matches, detections, sequence_ids=("s",))
    return compare_runs([run])


def test_accuracies_per_class(comparison):
    block = azimuth_block(comparison)
    assert block.symmetries == ("none", "full", 2, None)
    cup, ball, can, pen = block.by_group["3×8"]
    assert (cup.n, cup.n_exact, cup.n_near) == (3, 1, 2)
    assert cup.shares == (pytest.approx(1 / 3), pytest.approx(2 / 3))
    assert ball is None
    assert (can.n, can.n_exact, can.n_near) == (1, 1, 1)
    assert pen.n == 0
    assert np.isnan(pen.shares).all()


def test_the_grid_and_its_mean_without_symmetric_classes(comparison):
    grid = azimuth_grid(azimuth_block(comparison))
    assert [(c.group, c.text) for c in grid.columns] == [
        ("3×8", "boxes"),
        ("3×8", "exact"),
        ("3×8", "±1 bin"),
    ]
    assert {row.name: [cell.text for cell in row.cells] for row in grid.rows} == {
        "cup": ["3", "33.3", "66.7"],
        "ball ◯": [DASH] * 3,
        "can ×2": ["1", "100.0", "100.0"],
        "pen": ["0", DASH, DASH],
        "mean without symmetric": ["3", "33.3", "66.7"],
    }


def test_the_csv_and_the_remark(comparison):
    block = azimuth_block(comparison)
    rows = {row["class_name"]: row for row in csv.DictReader(io.StringIO(azimuth_csv(block)))}
    names = ("3×8 n", "3×8 n_exact", "3×8 n_near")
    assert [rows["cup"][name] for name in names] == ["3", "1", "2"]
    assert [rows["ball"][name] for name in names] == ["", "", ""]
    assert (rows["can"]["symmetry"], rows["pen"]["symmetry"]) == ("2", "")
    text = azimuth_remark(block)
    assert "◯: looks the same from all sides" in text
    assert "×n: looks the same n times" in text
    assert "Symmetry is not known" in text
