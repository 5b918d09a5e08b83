"""Manifests: paths and variables, cameras, slices, and one line for each thing that is wrong."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError
from imodbatch.settings.manifest import Manifest, SequenceSection, load_manifest
from imodbatch.settings.sections import WorldSection
from imodbatch.settings.toml import validate

MINIMAL = """
name = "tiny"
adapter = "folder"
classes = ["mug"]
"""
SEQUENCE = '\n[[sequences]]\nid = "s"\n'
SIZES = {"width_px": 64, "height_px": 48}
INTRINSICS = {**SIZES, "fx_px": 50.0, "fy_px": 51.0, "cx_px": 31.5, "cy_px": 23.5}
BASE = {"name": "tiny", "adapter": "folder", "classes": ["mug"], "sequences": [{"id": "s"}]}


def manifest(**more):
    return validate(Manifest, {**BASE, **more}, "m.toml")


def written(folder, text, name="m.toml"):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def fault(action, *mentions):
    with pytest.raises(ConfigError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text
    return text


def test_the_minimal_manifest(tmp_path):
    split = load_manifest(written(tmp_path, MINIMAL + SEQUENCE))
    assert (split.name, split.classes, split.root) == ("tiny", ("mug",), ".")
    assert split.choose(["s"])[0].path == "."
    assert split.world.up == "+z"
    assert split.annotations.format == "none"
    assert split.root_path.resolve() == tmp_path.resolve()


def test_shipped_manifests_are_valid(monkeypatch):
    monkeypatch.setenv("IMODBATCH_DATA", "/data")
    paths = sorted((Path(__file__).parents[2] / "manifests").glob("*.toml"))
    assert paths
    for path in paths:
        assert load_manifest(path).sequences


def test_root_is_relative_to_the_manifest_wherever_one_stands(tmp_path, monkeypatch):
    path = written(tmp_path / "manifests", 'root = "../data"' + MINIMAL + SEQUENCE)
    (tmp_path / "data").mkdir()
    monkeypatch.chdir(path.parent)
    relative = load_manifest(Path("m.toml"))
    monkeypatch.chdir("/")
    assert load_manifest(path).root_path.resolve() == (tmp_path / "data").resolve()
    assert relative.root_path.resolve() == (tmp_path / "data").resolve()


def test_variables_are_expanded_in_every_string(tmp_path, monkeypatch):
    monkeypatch.setenv("TINY_ROOT", str(tmp_path / "x"))
    monkeypatch.setenv("TINY_CLASS", "bowl")
    text = MINIMAL.replace("mug", "${TINY_CLASS}") + 'root = "${TINY_ROOT}/data"' + SEQUENCE
    text += 'path = "${TINY_CLASS}_${TINY_CLASS}"'
    split = load_manifest(written(tmp_path, text))
    assert split.root_path == tmp_path / "x" / "data"
    assert split.classes == ("bowl",)
    assert split.sequences[0].path == "bowl_bowl"


def test_an_unset_variable_says_how_to_set_it(tmp_path, monkeypatch):
    monkeypatch.delenv("TINY_ROOT", raising=False)
    path = written(tmp_path, 'root = "${TINY_ROOT}/data"' + MINIMAL + SEQUENCE)
    fault(lambda: load_manifest(path), path, "TINY_ROOT is not set", "export TINY_ROOT=")


def test_a_dollar_without_braces_is_text(tmp_path):
    path = written(tmp_path, 'description = "costs $5 {frame}"' + MINIMAL + SEQUENCE)
    assert load_manifest(path).description == "costs $5 {frame}"


def test_where_the_manifest_lies_is_not_a_key(tmp_path):
    path = written(tmp_path, 'folder = "elsewhere"' + MINIMAL + SEQUENCE)
    fault(lambda: load_manifest(path), "folder: unknown key", "'root'")


@pytest.mark.parametrize(
    ("more", "key", "hint"),
    [
        ({"clases": ["a"]}, "clases", "'classes'"),
        ({"camera": {"colour": INTRINSICS}}, "camera.colour", "'color'"),
        ({"camera": {"color": {**INTRINSICS, "fx": 1.0}}}, "camera.color.fx", "fx_px"),
        ({"camera": {"color": {**SIZES, "fx": 1.0}}}, "camera.color.fx", "fx_px"),
        ({"camera": {"depth": {"scale": 0.001}}}, "camera.depth.scale", "'scale_m'"),
        ({"world": {"upp": "+z"}}, "world.upp", "'up'"),
        ({"images": {"color": "a{frame}", "colour": "x"}}, "images.colour", "'color'"),
        ({"odometry": {"format": "tum", "pth": "x"}}, "odometry.pth", "'path'"),
        ({"reference": {"format": "tum", "path": "x", "upp": "+z"}}, "reference.upp", "'up'"),
        ({"annotations": {"fmt": "coco"}}, "annotations.fmt", "'format'"),
        ({"detections": {"format": "coco", "path": "x", "renam": {}}}, "renam", "'rename'"),
        ({"sequences": [{"id": "s", "pth": "x"}]}, "sequences.0.pth", "'path'"),
        ({"sequences": [{"id": "s"}, {"id": "t", "frame": "0:1"}]}, "sequences.1.frame", "frames"),
    ],
)
def test_unknown_keys_are_found_at_every_depth(more, key, hint):
    fault(lambda: manifest(**more), "m.toml", f"{key}: unknown key", hint)


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ({"classes": []}, "classes"),
        ({"classes": "mug"}, "classes"),
        ({"sequences": []}, "sequences"),
        ({"sequences": {"id": "s"}}, "sequences"),
        ({"name": "a/b"}, "name"),
        ({"camera": {"color": {**INTRINSICS, "fx_px": 0}}}, "camera.color.fx_px"),
        ({"camera": {"color": {**INTRINSICS, "cx_px": float("nan")}}}, "camera.color.cx_px"),
        ({"camera": {"color": {**INTRINSICS, "width_px": 64.5}}}, "camera.color.width_px"),
        ({"camera": {"color": SIZES}}, "camera.color.fx_px"),
        ({"camera": {"pixel_origin": "middle"}}, "camera.pixel_origin"),
        ({"camera": {"depth": {"scale_m": 0}}}, "camera.depth.scale_m"),
        ({"odometry": {"format": "tum"}}, "odometry.path"),
        ({"odometry": {"format": "euroc", "path": "x"}}, "odometry.format"),
        ({"odometry": {"format": "csv", "path": "x", "columns": {"tx": 3}}}, "odometry.columns.tx"),
        (
            {"odometry": {"format": "tum", "path": "x", "clock_offset_ms": float("inf")}},
            "odometry.clock_offset_ms",
        ),
        ({"reference": {"format": "tum"}}, "reference.path"),
        ({"reference": {"format": "tum", "path": "x", "up": "estimate"}}, "reference.up"),
        ({"reference": {"format": "tum", "path": "x", "up": [0, 0, 0]}}, "reference.up"),
        ({"images": {"color": "{frame}.png", "frames_per_second": 0}}, "images.frames_per_second"),
        ({"images": {"color": "/data/{frame}.png"}}, "images.color"),
        ({"images": {"color": "{frame}.png", "depth": "/data/{frame}.png"}}, "images.depth"),
        ({"sequences": [{"id": "s", "path": "/data/s"}]}, "sequences.0.path"),
        ({"annotations": {"format": "coco"}}, "annotations"),
    ],
)
def test_a_wrong_value_is_one_line_with_file_and_key(more, key):
    fault(lambda: manifest(**more), f"m.toml: {key}: ")


@pytest.mark.parametrize("key", ["name", "adapter", "classes", "sequences"])
def test_what_is_needed(key):
    data = {name: value for name, value in BASE.items() if name != key}
    fault(lambda: validate(Manifest, data, "m.toml"), f"m.toml: {key}: Field required")


def test_names_stand_once():
    fault(lambda: manifest(classes=["mug", "cap", "mug"]), "classes: 'mug' stands 2 times")
    twice = [{"id": "a"}, {"id": "b"}, {"id": "a"}, {"id": "a"}]
    fault(lambda: manifest(sequences=twice), "sequences: 'a' stands 3 times")


@pytest.mark.parametrize("name", ["", "a/b", "../a", ".a", "_a", "a b", "ä", "a\n"])
def test_sequence_ids_are_file_names(name):
    fault(lambda: manifest(sequences=[{"id": name}]), "sequences.0.id", "letters, digits")


@pytest.mark.parametrize(
    "text", ["", "5", "0-5", "a:b", "0:5:0", "0:5:-1", "-5:", "0:5:1:1", "0,5"]
)
def test_bad_slices(text):
    fault(lambda: manifest(sequences=[{"id": "s", "frames": text}]), "frames", "'0:450'")


LIMITS = st.one_of(st.none(), st.integers(0, 40))


@given(LIMITS, LIMITS, st.one_of(st.none(), st.integers(1, 9)))
def test_slices_are_those_of_python(start, stop, step):
    text = ":".join("" if part is None else str(part) for part in (start, stop))
    text += "" if step is None else f":{step}"
    section = SequenceSection(id="s", frames=text)
    kept = [number for number in range(50) if section.keeps(number)]
    assert kept == list(range(50))[slice(start, stop, step)]


def test_without_a_slice_all_is_kept():
    assert SequenceSection(id="s").keeps(10**9)


@pytest.mark.parametrize(
    ("up", "direction"),
    [
        ("+x", (1, 0, 0)),
        ("-x", (-1, 0, 0)),
        ("+y", (0, 1, 0)),
        ("-y", (0, -1, 0)),
        ("+z", (0, 0, 1)),
        ("-z", (0, 0, -1)),
        ((0.1, -0.9, 0.2), (0.1, -0.9, 0.2)),
        ("estimate", None),
    ],
)
def test_up_directions(up, direction):
    assert WorldSection(up=up).direction() == direction


@pytest.mark.parametrize("up", ["z", "+w", [0, 0, 0], [0, 1], [0, 0, float("nan")], 3])
def test_bad_up_directions(up):
    text = fault(lambda: manifest(world={"up": up}), "m.toml: world.up: ")
    assert "literal[" not in text


def test_pixel_origin_center_adds_half_a_pixel():
    for origin, shift in (("corner", 0.0), ("center", 0.5)):
        camera = manifest(camera={"color": INTRINSICS}).camera.color.camera(origin)
        assert camera == PinholeCamera(64, 48, 50.0, 51.0, 31.5 + shift, 23.5 + shift)


def test_depth_intrinsics_are_all_or_none():
    assert manifest(camera={"depth": {"scale_m": 0.0002}}).camera.depth.intrinsics() is None
    whole = manifest(camera={"depth": INTRINSICS}).camera.depth
    assert whole.intrinsics().model_dump() == INTRINSICS
    for name in INTRINSICS:
        part = {key: value for key, value in INTRINSICS.items() if key != name}
        fault(
            lambda part=part: manifest(camera={"depth": part}),
            f"camera.depth: {name} missing",
            "all six",
        )


SCALED = np.diag([2.0, 2.0, 2.0, 1.0])
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0])
TRANSPOSED = np.eye(4)
TRANSPOSED[3, 0] = 0.05


@pytest.mark.parametrize(
    "matrix", [SCALED, MIRRORED, TRANSPOSED], ids=["scaled", "mirror", "turned"]
)
def test_color_from_depth_must_be_rigid(matrix):
    rows = matrix.tolist()
    fault(lambda: manifest(camera={"color_from_depth": rows}), "camera.color_from_depth", "rigid")


def test_color_from_depth_has_four_rows_of_four():
    rows = np.eye(4).tolist()
    assert manifest(camera={"color_from_depth": rows}).camera.color_from_depth[3] == (0, 0, 0, 1)
    fault(lambda: manifest(camera={"color_from_depth": rows[:3]}), "camera.color_from_depth")


def test_paths_are_found_beside_the_sequence_then_in_the_root(tmp_path):
    split = manifest(root=str(tmp_path), sequences=[{"id": "s", "path": "walk"}])
    section = split.sequences[0]
    assert split.path_in(section, "a.txt") == tmp_path / "a.txt"
    (tmp_path / "walk").mkdir()
    (tmp_path / "walk" / "a.txt").touch()
    assert split.path_in(section, "a.txt") == tmp_path / "walk" / "a.txt"
    assert split.path_in(section, "x/{sequence}.txt") == tmp_path / "x" / "walk.txt"


@pytest.mark.parametrize(
    ("up", "direction"), [(None, None), ("-y", (0, -1, 0)), ([0.1, 0, 2], (0.1, 0, 2))]
)
def test_a_reference_may_say_where_its_up_is(up, direction):
    given = {"format": "tum", "path": "true.txt", **({} if up is None else {"up": up})}
    assert manifest(reference=given).reference.up_direction() == direction
    assert manifest().reference is None


def test_a_number_in_a_path_is_the_one_that_the_sequence_ends_in(tmp_path):
    split = manifest(root=str(tmp_path), sequences=[{"id": "s", "path": "room/scene_07"}])
    section = split.sequences[0]
    assert split.path_in(section, "pc/{number}.ply") == tmp_path / "pc" / "07.ply"
    without = SequenceSection(id="s", path="room/first")
    fault(lambda: split.path_in(without, "pc/{number}.ply"), "room/first", "{number}", "scene_01")


def test_sequences_are_chosen_in_the_manifests_order():
    split = manifest(sequences=[{"id": name} for name in "abc"])
    assert [s.id for s in split.choose(["c", "a"])] == ["a", "c"]
    assert split.choose([]) == split.sequences
    fault(lambda: split.choose(["a", "d"]), "--sequence d", "not in manifest tiny", "a, b, c")
