"""The figures that Konno et al. (2020) print: Table 1 (AP) and Table 2 (precision/recall, AP).

They were measured on other data than ours. A report shows them beside its own as "paper: other
data", never as a target met.
"""

from dataclasses import dataclass
from typing import Literal

PaperTable = Literal["none", "table1", "table2"]
MARK = "paper: other data"

_SIMULATION_16 = """
ball_pink            0.907 0.909 0.909 0.909
building_block_house 0.909 0.723 0.906 0.778
cellphone            0.872 0.740 0.996 0.870
gorilla_doll         0.909 0.894 0.906 0.909
kidney_beans_doll    0.495 0.724 0.859 0.958
lego_green           0.887 0.622 0.412 0.761
lego_red             0.808 0.755 0.909 0.878
mouse_doll           0.456 0.689 0.434 0.805
plastic_cup_yellow   0.727 0.725 0.727 0.751
rail_bridge          0.818 0.818 0.818 0.831
rice_bowl            0.883 0.896 0.764 0.882
spoon_iron           0.622 0.671 0.625 0.741
square_bowl          0.907 0.863 0.816 0.900
square_dish          0.902 0.849 0.771 0.830
steel_juice          0.720 0.695 0.455 0.723
teacup               0.906 0.801 0.894 0.909
wood_coaster         0.273 0.329 0.358 0.541
mean                 0.765 0.747 0.739 0.822
"""
_SIMULATION_8 = """
ball_pink            0.909 0.909 0.909 0.909
building_block_house 0.906 0.862 0.906 0.903
cellphone            0.996 0.894 0.961 1.000
gorilla_doll         0.961 0.877 0.727 0.903
kidney_beans_doll    0.424 0.621 0.602 0.909
lego_green           0.818 0.812 0.633 0.808
lego_red             0.818 0.804 0.904 0.876
mouse_doll           0.425 0.651 0.264 0.821
plastic_cup_yellow   0.687 0.722 0.630 0.781
rail_bridge          0.871 0.889 0.909 0.909
rice_bowl            0.810 0.892 0.674 0.850
spoon_iron           0.687 0.623 0.701 0.681
square_bowl          0.904 0.857 0.693 0.904
square_dish          0.868 0.904 0.859 0.863
steel_juice          0.818 0.811 0.273 0.834
teacup               0.909 0.886 0.909 0.909
wood_coaster         0.482 0.501 0.273 0.545
mean                 0.782 0.795 0.696 0.847
"""
_REAL_16 = """
ball_pink            0.631 0.711 0.459 0.592
building_block_house 0.907 0.900 0.696 0.843
cellphone            0.522 0.393 0.414 0.640
gorilla_doll         0.499 0.487 0.744 0.716
kidney_beans_doll    0.534 0.515 0.456 0.699
lego_green           0.628 0.536 0.541 0.726
lego_red             0.813 0.795 0.664 0.863
mouse_doll           0.369 0.451 0.374 0.579
plastic_cup_yellow   0.907 0.892 0.651 0.778
rail_bridge          0.816 0.800 0.834 0.852
rice_bowl            0.909 0.893 0.835 0.991
spoon_iron               -     -     -     -
square_bowl          0.908 0.889 0.845 0.889
square_dish          0.538 0.444 0.652 0.787
steel_juice          0.387 0.383 0.459 0.630
teacup               0.904 0.756 0.452 0.695
wood_coaster         0.635 0.486 0.754 0.871
mean                 0.682 0.646 0.614 0.759
"""
_REAL_8 = """
ball_pink            0.718 0.499 0.526 0.548
building_block_house 0.816 0.815 0.759 0.926
cellphone            0.540 0.417 0.545 0.652
gorilla_doll         0.373 0.485 0.622 0.729
kidney_beans_doll    0.442 0.409 0.555 0.627
lego_green           0.527 0.528 0.544 0.585
lego_red             0.815 0.696 0.651 0.817
mouse_doll           0.346 0.480 0.476 0.596
plastic_cup_yellow   0.907 0.782 0.544 0.676
rail_bridge          0.726 0.708 0.741 0.789
rice_bowl            0.908 0.906 0.754 0.923
spoon_iron               -     -     -     -
square_bowl          0.907 0.895 0.736 0.836
square_dish          0.263 0.196 0.566 0.477
steel_juice          0.368 0.302 0.518 0.642
teacup               0.906 0.691 0.587 0.632
wood_coaster         0.545 0.530 0.755 0.830
mean                 0.632 0.584 0.617 0.705
"""
_TABLE_2_SINGLE = """
bowl         96.3/65.8/0.631   92.5/61.0/0.606       46.9/90.7/-       88.6/71.6/-
cap          84.4/69.1/0.626   88.0/61.9/0.599       54.1/90.5/-       85.2/62.0/-
cereal_box   94.3/74.4/0.724   93.3/71.3/0.709       76.1/90.7/-       83.8/75.4/-
coffee_mug   93.0/79.0/0.721   83.2/80.6/0.719       42.7/74.1/-       70.8/50.8/-
soda_can     96.8/65.4/0.631   96.0/66.5/0.627       51.6/87.4/-       78.3/42.0/-
background       90.8/96.5/-       90.4/95.2/-       98.8/93.9/-       95.0/90.0/-
mean         92.6/75.0/0.667   90.6/72.8/0.652       61.7/87.9/-       81.5/59.4/-
"""
_TABLE_2_MULTI = """
bowl         94.6/66.0/0.613   97.0/68.1/0.709       91.5/85.1/-       97.0/89.1/-       88.7/70.2/-
cap          82.2/69.2/0.564   90.1/69.2/0.689       90.5/91.4/-       82.7/99.0/-       99.4/72.0/-
cereal_box   92.4/76.0/0.711   94.9/76.1/0.802       93.6/94.9/-       96.2/99.3/-       95.6/84.3/-
coffee_mug   91.1/79.4/0.775   93.9/79.4/0.795       90.0/75.1/-       81.0/92.6/-       80.1/64.1/-
soda_can     93.4/66.7/0.612   97.8/72.3/0.723       81.5/87.4/-       97.7/98.0/-       89.1/75.6/-
background       89.6/96.8/-       91.6/97.1/-       99.0/99.1/-       95.8/95.0/-       96.6/96.8/-
mean       90.55/75.68/0.655   94.2/77.0/0.744       91.0/88.8/-       90.9/95.6/-       89.8/72.0/-
"""


@dataclass(frozen=True)
class PaperColumn:
    """One column of the paper.

    Attributes:
        group: which data and viewpoint setting.
        name: the method, as the paper names it.
        ap: AP per class name, and under "mean" the printed mean; None = not given.
        precision_recall: the same for (precision, recall) in percent, with "background".
    """

    group: str
    name: str
    ap: dict[str, float | None]
    precision_recall: dict[str, tuple[float, float]]


def columns(table: PaperTable, n_azimuths: int = 16) -> tuple[PaperColumn, ...]:
    """The columns of a table that belong beside ours.

    Args:
        table: "table1", "table2" or "none".
        n_azimuths: 8 picks the 3-by-8 half of Table 1, anything else the 3-by-16 half.
    """
    if table == "table1":
        return TABLE_1[8 if n_azimuths == 8 else 16]
    return TABLE_2 if table == "table2" else ()


def _rows(block: str) -> list[list[str]]:
    return [line.split() for line in block.strip().splitlines()]


def _number(text: str) -> float | None:
    return None if text == "-" else float(text)


def _ap_columns(block: str, group: str) -> tuple[PaperColumn, ...]:
    names = ("w/o view", "w/ view", "Naive", "Ours")
    return tuple(
        PaperColumn(group, name, {row[0]: _number(row[i]) for row in _rows(block)}, {})
        for i, name in enumerate(names, start=1)
    )


def _triple_columns(block: str, group: str, names: tuple[str, ...]) -> tuple[PaperColumn, ...]:
    cells = [(row[0], [cell.split("/") for cell in row[1:]]) for row in _rows(block)]
    return tuple(
        PaperColumn(
            group,
            name,
            {key: _number(row[i][2]) for key, row in cells},
            {key: (float(row[i][0]), float(row[i][1])) for key, row in cells},
        )
        for i, name in enumerate(names)
    )


TABLE_1 = {
    16: (*_ap_columns(_SIMULATION_16, "simulation"), *_ap_columns(_REAL_16, "real")),
    8: (*_ap_columns(_SIMULATION_8, "simulation"), *_ap_columns(_REAL_8, "real")),
}
"""By number of azimuths."""
TABLE_2 = (
    *_triple_columns(
        _TABLE_2_SINGLE,
        "single view",
        ("w/o viewpoint", "w/ viewpoint", "DetOnly [29]", "SLAM-aware [34]"),
    ),
    *_triple_columns(
        _TABLE_2_MULTI,
        "multi-view",
        ("Naive", "Ours", "Det3DMRF [29]", "HMP2D+3D [26]", "SLAM-aware [34]"),
    ),
)
