"""`imodbatch synth` end to end, small."""

import json

import pytest
from click.testing import CliRunner

from imodbatch.cli import main


@pytest.fixture
def synth(recipe, tmp_path):
    def run(*arguments):
        common = [
            "--backgrounds",
            str(recipe.backgrounds[0].parent),
            "--cache",
            str(tmp_path / "c"),
        ]
        grid = ["--azimuths", "2", "--elevations", "20", "--variants", "1", "--n", "3"]
        return CliRunner().invoke(
            main, ["synth", str(tmp_path / "out"), *common, *grid, *arguments]
        )

    return run


def test_objects_in_two_lines(synth, tmp_path):
    result = synth("--objects", "lego_red,teacup", "--symmetry", "teacup=full")
    assert result.exit_code == 0, result.output
    views, pictures = result.stdout.strip().splitlines()
    assert views.startswith("synth views: 2 objects × 2 views = 4 = 4 rendered (")
    assert views.endswith(" per second) + 0 from cache")
    assert "3 pictures = 3 made + 0 there already" in pictures
    coco = json.loads((tmp_path / "out" / "annotations.json").read_text())
    assert [(c["name"], c["symmetry"]) for c in coco["categories"]] == [
        ("lego_red", 2), ("teacup", "full"),
    ]  # fmt: skip
    assert coco["info"]["n_azimuths"] == 2
    again = synth("--objects", "lego_red,teacup", "--symmetry", "teacup=full")
    assert "4 = 0 rendered + 4 from cache" in again.stdout
    assert "3 pictures = 0 made + 3 there already" in again.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--objects", "teapot"), "No object is called 'teapot'"),
        (("--objects", "teacup", "--models", "somewhere"), "not several"),
        (("--objects", "teacup", "--without", "bowl_1"), "needs --turntable"),
        (("--objects", "teacup", "--symmetry", "ball=full"), "--symmetry ball: no such class"),
        (("--models", "nowhere"), "nowhere: no such folder"),
        (("--turntable", "nowhere"), "nowhere: no such folder"),
        (("--objects", "teacup", "--elevations", "x"), "--elevations x: expected"),
    ],
)
def test_errors_are_one_line(synth, arguments, said):
    result = synth(*arguments)
    assert result.exit_code == 1
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
