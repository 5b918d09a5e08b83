"""Settings: every fault is one line that names file and key, and near misses are offered."""

import math
from pathlib import Path

import pytest
from pydantic import ValidationError

from imodbatch.core.errors import ConfigError
from imodbatch.settings.config import MOVED, Pipeline, load_pipeline
from imodbatch.settings.toml import apply_settings, did_you_mean, read_toml

DEFAULT_FILE = Path(__file__).parents[2] / "pipelines" / "default.toml"


def fault(action, *mentions):
    with pytest.raises(ConfigError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text
    return text


def written(tmp_path, text, name="pipeline.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_without_a_file_and_with_an_empty_one_all_is_default(tmp_path):
    assert load_pipeline(None) == Pipeline()
    assert load_pipeline(written(tmp_path, "# nothing\n")) == Pipeline()


def test_the_file_of_defaults_holds_the_defaults():
    assert load_pipeline(DEFAULT_FILE) == Pipeline()


def test_a_file_changes_what_it_says_and_nothing_else(tmp_path):
    path = written(tmp_path, "[lift]\nvoxel_size_m = 0.1\n[fuse]\nmethods = ['imod']\n")
    pipeline = load_pipeline(path)
    assert pipeline.lift.voxel_size_m == 0.1
    assert pipeline.fuse.methods == ("imod",)
    default = Pipeline()
    assert pipeline.lift.model_copy(update={"voxel_size_m": 0.2}) == default.lift
    assert (pipeline.poses, pipeline.detect, pipeline.metrics) == (
        default.poses,
        default.detect,
        default.metrics,
    )


@pytest.mark.parametrize(
    ("text", "key", "nearest"),
    [
        ("[fues]\nmode = 'both'", "fues", "'fuse'"),
        ("[fuse]\ncell_reduction = 'max'", "fuse.cell_reduction", "'cell_reduce'"),
        ("[lift]\nvoxel_size = 0.2", "lift.voxel_size", "'voxel_size_m'"),
        ("[poses]\nmax_gap = 20", "poses.max_gap", "'max_gap_ms'"),
        ("[viewpoint]\nelevation_deg = [10]", "viewpoint.elevation_deg", "'elevations_deg'"),
    ],
)
def test_an_unknown_name_offers_the_nearest(tmp_path, text, key, nearest):
    path = written(tmp_path, text)
    fault(lambda: load_pipeline(path), path, f"{key}: unknown key", f"Did you mean {nearest}?")


def test_a_name_far_from_all_lists_the_known_ones(tmp_path):
    path = written(tmp_path, "[fuse]\nzzz = 1")
    fault(lambda: load_pipeline(path), "fuse.zzz", "Known: methods, mode, cell_reduce")


def test_did_you_mean_knows_its_limits():
    assert did_you_mean("imodd", ["single", "imod"]) == " Did you mean 'imod'?"
    assert did_you_mean("zzz", ["single", "imod"]) == " Known: single, imod."
    assert did_you_mean("zzz", []) == ""


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("detect.score_threshold=1.1", "detect.score_threshold"),
        ("detect.score_threshold=-0.1", "detect.score_threshold"),
        ("detect.score_threshold='high'", "detect.score_threshold"),
        ("detect.device=3", "detect.device"),
        ("detect.batch_size=0", "detect.batch_size"),
        ("detect.batch_size=1.5", "detect.batch_size"),
        ("viewpoint.n_azimuths=0", "viewpoint.n_azimuths"),
        ("viewpoint.elevations_deg=[]", "elevations_deg must rise"),
        ("viewpoint.elevations_deg=[30, 10]", "elevations_deg must rise"),
        ("viewpoint.elevations_deg=[10, 10]", "elevations_deg must rise"),
        ("viewpoint.elevations_deg=[91]", "viewpoint.elevations_deg.0"),
        ("viewpoint.elevations_deg=30", "viewpoint.elevations_deg"),
        ("lift.voxel_size_m=0", "lift.voxel_size_m"),
        ("lift.window=0", "lift.window"),
        ("lift.depth=median", "lift.depth"),
        ("lift.max_depth_m=inf", "lift.max_depth_m"),
        ("poses.max_gap_ms=nan", "poses.max_gap_ms"),
        ("poses.max_gap_ms=-1", "poses.max_gap_ms"),
        ("poses.source=gps", "poses.source"),
        ("poses.interpolate=yes", "poses.interpolate"),
        ("pose_quality.rpe_delta_frames=0", "pose_quality.rpe_delta_frames"),
        ("fuse.probability_floor=0.5", "fuse.probability_floor"),
        ("fuse.methods=imod", "fuse.methods"),
        ("fuse.methods=['imod', 'magic']", "fuse.methods.1"),
        ("matching.iou_percents=[0]", "matching.iou_percents.0"),
        ("matching.iou_percents=[]", "matching.iou_percents"),
        ("metrics.names=['map']", "metrics.names.0"),
        ("jitter.shifts_m=[0.01, -0.02]", "jitter.shifts_m.1"),
        ("jitter.shifts_m=[0]", "jitter.shifts_m.0"),
        ("jitter.shifts_m=0.05", "jitter.shifts_m"),
        ("jitter.turns_deg=[-1]", "jitter.turns_deg.0"),
        ("jitter.repeats=0", "jitter.repeats"),
        ("report.n_frames=61", "report.n_frames"),
    ],
)
def test_a_wrong_value_is_one_line_with_file_and_key(tmp_path, setting, key):
    path = written(tmp_path, "")
    fault(lambda: load_pipeline(path, [setting]), path, key, "(got ")


def test_a_section_that_is_no_table(tmp_path):
    path = written(tmp_path, "fuse = 3")
    fault(lambda: load_pipeline(path), path, "fuse", "(got 3)")
    fault(lambda: load_pipeline(path, ["fuse.mode=both"]), "fuse is not a section")


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("fuse.cell_reduce=max", "max"),
        ("fuse.cell_reduce='max'", "max"),
        ('fuse.cell_reduce = "max"', "max"),
        ("detect.device=cuda:0", "cuda:0"),
        ("detect.weights=/some/where/a.safetensors", "/some/where/a.safetensors"),
        ("detect.score_threshold=0.25", 0.25),
        ("detect.batch_size=8", 8),
        ("fuse.methods=['imod', 'single']", ("imod", "single")),
        ("viewpoint.elevations_deg=[0, 45.5]", (0.0, 45.5)),
        ("metrics.threshold_sequences=['a=b']", ("a=b",)),
    ],
)
def test_settings_are_toml_and_bare_words_strings(setting, value):
    section, key = setting.split("=")[0].strip().split(".")
    found = getattr(getattr(load_pipeline(None, [setting]), section), key)
    assert found == value
    assert type(found) is type(value)


def test_settings_lie_over_the_file_and_the_last_one_wins(tmp_path):
    path = written(tmp_path, "[lift]\nvoxel_size_m = 0.1\nwindow = 0.5\n")
    pipeline = load_pipeline(path, ["lift.voxel_size_m=0.3", "lift.voxel_size_m=0.4"])
    assert (pipeline.lift.voxel_size_m, pipeline.lift.window) == (0.4, 0.5)


def test_settings_do_not_change_the_data_they_lie_over():
    data = {"lift": {"window": 0.5}}
    assert apply_settings(data, ["lift.window=0.1"]) == {"lift": {"window": 0.1}}
    assert data == {"lift": {"window": 0.5}}


@pytest.mark.parametrize("setting", ["fuse.mode", "mode=both", "", "=3", "fuse mode=both"])
def test_a_malformed_setting_shows_the_form(setting):
    fault(lambda: load_pipeline(None, [setting]), f"--set {setting}", "STAGE.KEY=VALUE")


def test_settings_of_unknown_sections_and_keys():
    fault(lambda: load_pipeline(None, ["lfit.window=0.1"]), "lfit", "Did you mean 'lift'?")
    fault(lambda: load_pipeline(None, ["lift.windo=0.1"]), "lift.windo", "Did you mean 'window'?")
    fault(lambda: load_pipeline(None, ["lift.window.x=0.1"]), "lift.window.x", "unknown key")


def test_a_misspelt_required_key_is_reported_as_misspelt(tmp_path):
    path = written(tmp_path, "[lift]\nwindw = 0.1\nvoxel_size_m = -1\n")
    fault(lambda: load_pipeline(path), "lift.windw", "Did you mean 'window'?")


def test_models_are_frozen_all_the_way():
    pipeline = Pipeline()
    with pytest.raises(ValidationError):
        pipeline.lift = pipeline.lift
    for section in pipeline.__class__.model_fields:
        model = getattr(pipeline, section)
        name = next(iter(model.__class__.model_fields))
        with pytest.raises(ValidationError):
            setattr(model, name, getattr(model, name))


def test_the_grid_is_in_radians():
    grid = load_pipeline(None, ["viewpoint.elevations_deg=[-90, 0, 60]"]).viewpoint.grid()
    assert grid.elevations_rad == pytest.approx((-math.pi / 2, 0, math.pi / 3))
    assert grid.n_azimuths == 16


def test_a_missing_file_offers_a_similar_one(tmp_path):
    written(tmp_path, "", "default.toml")
    written(tmp_path, "", "paper_table1.toml")
    path = tmp_path / "defautl.toml"
    fault(lambda: load_pipeline(path), path, "no such file", "Did you mean 'default.toml'?")
    far = tmp_path / "zzz.toml"
    fault(lambda: load_pipeline(far), "Known: default.toml, paper_table1.toml")


def test_a_missing_file_in_an_empty_or_missing_folder(tmp_path):
    for path in (tmp_path / "a.toml", tmp_path / "nowhere" / "a.toml"):
        text = fault(lambda path=path: load_pipeline(path), path, "no such file")
        assert "Did you mean" not in text


def test_a_folder_is_no_file(tmp_path):
    fault(lambda: read_toml(tmp_path), tmp_path, "is a folder")


@pytest.mark.parametrize("text", ["[fuse", "a = ", "a = 1\na = 2", "fuse: both"])
def test_not_toml(tmp_path, text):
    path = written(tmp_path, text)
    fault(lambda: load_pipeline(path), path, "not valid TOML", "line")


def test_not_text(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xff\xfe\x00name")
    fault(lambda: load_pipeline(path), path, "cannot be read")


@pytest.mark.parametrize(("old", "new"), MOVED.items())
def test_a_setting_under_its_old_name_says_its_new_one(tmp_path: Path, old: str, new: str) -> None:
    section, key = old.split(".")
    with pytest.raises(ConfigError, match=f"^pipeline: {old} is now {new}"):
        load_pipeline(None, [f"{old}=1"])
    path = tmp_path / "own.toml"
    path.write_text(f"[{section}]\n{key} = 1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=f"own.toml: {old} is now {new}"):
        load_pipeline(path)
    assert new in {f"{s}.{k}" for s, model in Pipeline() for k in type(model).model_fields}
