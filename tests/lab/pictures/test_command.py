"""`imodbatch synth` end to end, small."""

import json
from functools import partial
from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image

from imodbatch.cli.main import main
from imodbatch.core.camera import PinholeCamera
from imodbatch.lab.houses import write_backgrounds
from imodbatch.lab.pictures import sources

SMALL = PinholeCamera(160, 120, 131.25, 131.25, 80.0, 60.0)


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
    assert pictures.endswith(" made per second")
    coco = json.loads((tmp_path / "out" / "annotations.json").read_text())
    assert [(c["name"], c["symmetry"]) for c in coco["categories"]] == [
        ("lego_red", 2), ("teacup", "full"),
    ]  # fmt: skip
    assert coco["info"]["n_azimuths"] == 2
    again = synth("--objects", "lego_red,teacup", "--symmetry", "teacup=full")
    assert "4 = 0 rendered + 4 from cache" in again.stdout
    assert "3 pictures = 0 made + 3 there already" in again.stdout


@pytest.fixture
def bare(tmp_path, monkeypatch):
    """`synth` without --backgrounds; its rooms are photographed by a small camera."""
    small = partial(write_backgrounds, camera=SMALL)
    monkeypatch.setattr(sources, "write_backgrounds", small)

    def run(out, *arguments):
        objects = ["--objects", "ball_pink", "--cache", str(tmp_path / "c"), "--n", "2"]
        grid = ["--azimuths", "2", "--elevations", "20", "--variants", "1", "--size", "64,48"]
        return CliRunner().invoke(main, ["synth", str(tmp_path / out), *objects, *grid, *arguments])

    return run


def test_rooms_are_rendered_once_where_no_backgrounds_are_named(bare, tmp_path):
    result = bare("out", "--rooms", "2")
    assert result.exit_code == 0, result.output
    _, rooms, pictures = result.stdout.strip().splitlines()
    assert rooms.startswith("synth rooms: 2 pictures without objects = 2 rendered (")
    assert rooms.endswith(" per second) + 0 from cache")
    assert "2 pictures = 2 made" in pictures
    (done,) = (tmp_path / "c" / "rooms").glob("*/DONE")
    assert done.parent.name == sources.backgrounds_digest("train", 2)
    assert len(list(done.parent.glob("*.jpg"))) == 2
    again = bare("out", "--rooms", "2")
    assert "2 pictures without objects = 0 rendered + 2 from cache" in again.stdout
    assert "2 pictures = 0 made + 2 there already" in again.stdout


def test_rooms_lie_beside_the_cutouts(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    assert sources.default_cache() == Path("/cache/imodbatch/views")
    assert sources.rooms_cache(None) == Path("/cache/imodbatch/rooms")
    assert sources.rooms_cache(Path("mine")) == Path("mine/rooms")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--objects", "teapot"), "No object is called 'teapot'"),
        (("--objects", "teacup", "--models", "somewhere"), "not several"),
        (("--objects", "teacup", "--without", "bowl_1"), "needs --turntable"),
        (("--objects", "teacup", "--azimuth-sign", "-1"), "needs --turntable"),
        (("--objects", "teacup", "--instances", "3"), "needs --objects rgbd5"),
        (("--turntable", "somewhere", "--distractors", "3"), "--distractors"),
        (("--turntable", "somewhere", "--renderer", "blender"), "nothing is rendered"),
        (("--objects", "teacup", "--symmetry", "ball=full"), "--symmetry ball: no such class"),
        (("--rooms", "3"), "--backgrounds and --rooms, not both"),
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


@pytest.mark.parametrize(("sign", "azimuth_bin"), [((), 1), (("--azimuth-sign", "-1"), 3)])
def test_turntable_pictures_of_either_sense(tmp_path, recipe, sign, azimuth_bin):
    """One bowl at 90°: bin 1 of 4, or bin 3 where angles grow clockwise."""
    folder = tmp_path / "rgbd-dataset" / "bowl" / "bowl_1"
    folder.mkdir(parents=True)
    Image.new("RGB", (40, 30), "red").save(folder / "bowl_1_2_7_crop.png")
    Image.new("L", (40, 30), 1).save(folder / "bowl_1_2_7_maskcrop.png")
    (folder / "bowl_1_2_7_pose.txt").write_text("90")
    common = ["--backgrounds", str(recipe.backgrounds[0].parent), "--cache", str(tmp_path / "c")]
    grid = ["--azimuths", "4", "--elevations", "30,45,60", "--n", "2"]
    turntable = ["--turntable", str(folder.parents[1])]
    arguments = ["synth", str(tmp_path / "out"), *turntable, *common, *grid, *sign]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("synth views: 1 instances, 1 pictures = 1 used\n")
    coco = json.loads((tmp_path / "out" / "annotations.json").read_text())
    assert coco["annotations"]
    bins = {(a["azimuth_bin"], a["elevation_bin"]) for a in coco["annotations"]}
    assert bins == {(azimuth_bin, 1)}
