"""Manifests and pipelines by name: what a name finds, what a path means, where data then lie."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from imodbatch.core.errors import ConfigError
from imodbatch.run.plan import default_run_dir
from imodbatch.settings import shipped
from imodbatch.settings.manifest import load_manifest
from imodbatch.settings.shipped import find_shipped, is_name, shipped_folder, shipped_names

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", ["manifests", "pipelines"])
def test_folders_lie_in_the_package_or_else_beside_it(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "analytic" in shipped_names(shipped_folder("manifests"), ".toml")
    assert "robot17_3x16" in shipped_names(shipped_folder("pipelines"), ".toml")
    monkeypatch.setattr(shipped, "PACKAGE", tmp_path / "imodbatch")
    assert shipped_folder(kind) == tmp_path / kind
    (tmp_path / "imodbatch" / kind).mkdir(parents=True)
    assert shipped_folder(kind) == tmp_path / "imodbatch" / kind


def test_a_name_has_neither_suffix_nor_slash_and_is_no_file(here: Path) -> None:
    (here / "analytic").mkdir()  # a folder is no manifest
    (here / "robot").touch()
    assert is_name("analytic")
    assert not any(map(is_name, ["robot", "./analytic", "m/analytic", "a.toml", "~/a", "/a"]))
    assert find_shipped("robot", "manifest", here) == Path("robot")
    assert find_shipped("~/a", "manifest", here) == Path.home() / "a"


def test_an_unknown_name_is_told_with_all_names(here: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_manifest(Path("hous_test"))
    message = str(caught.value)
    assert message.startswith("manifest 'hous_test': none of that name is shipped. Did you mean ")
    assert "'house_test'? Known: analytic, house_test, " in message
    assert message.endswith("One of your own goes by its path: ./hous_test.toml")
    with pytest.raises(ConfigError, match=r"^manifest 'x': none of that name is shipped\. One of"):
        find_shipped("x", "manifest", here)


def test_a_shipped_manifest_is_read_as_if_it_lay_in_manifests_here(here: Path) -> None:
    assert load_manifest(Path("house_test")).root_path == here / "data/house_test"
    assert load_manifest(Path("scenes_val")).root_path == here / "data/scenes_val/rgbd-scenes"
    by_path = load_manifest(REPOSITORY / "manifests/house_test.toml")
    assert by_path.root_path == REPOSITORY / "data/house_test"
    assert by_path == load_manifest(Path("house_test")).model_copy(
        update={"folder": by_path.folder}
    )


@pytest.mark.parametrize("manifest", ["house_test", str(REPOSITORY / "manifests/house_test.toml")])
def test_a_manifest_names_its_pipeline(here: Path, manifest: str) -> None:
    del here
    loaded = load_manifest(Path(manifest))
    own = loaded.pipeline_file(None)
    assert own == REPOSITORY / "pipelines/robot17_3x16.toml"
    assert default_run_dir(loaded.name, own) == Path("runs/house_test--robot17_3x16")
    other = loaded.pipeline_file(Path("robot17_3x8"))
    assert default_run_dir(loaded.name, other) == Path("runs/house_test--robot17_3x8")
    assert loaded.pipeline_file(Path("my/own.toml")) == Path("my/own.toml")


def test_a_pipeline_by_path_is_relative_to_the_manifest(here: Path) -> None:
    text = 'name = "a"\nadapter = "folder"\nclasses = ["b"]\n{}\n[[sequences]]\nid = "c"\n'
    (here / "sub").mkdir()
    (here / "sub/a.toml").write_text(text.format('pipeline = "own.toml"'))
    assert load_manifest(Path("sub/a.toml")).pipeline_file(None) == here / "sub/own.toml"
    (here / "sub/a.toml").write_text(text.format(""))
    assert load_manifest(Path("sub/a.toml")).pipeline_file(None) is None
    (here / "sub/a.toml").write_text(text.format('pipeline = "robt17_3x16"'))
    with pytest.raises(ConfigError, match="Did you mean 'robot17_3x16'"):
        load_manifest(Path("sub/a.toml")).pipeline_file(None)


def test_every_default_pipeline_is_shipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMODBATCH_DATA", "/data")
    named = {n: load_manifest(Path(n)) for n in shipped_names(shipped_folder("manifests"), ".toml")}
    files = {name: manifest.pipeline_file(None) for name, manifest in named.items()}
    assert {file.stem for file in files.values() if file} == {"robot17_3x16", "rgbd5_3x12"}
    for name, manifest in named.items():
        assert manifest.name == name
        assert (manifest.simulate is not None) == name.startswith(("analytic", "house_", "scenes_"))


@pytest.mark.parametrize(
    ("arguments", "folder"),
    [
        ((), "runs/house_val--robot17_3x16"),
        (("--pipeline", "slam"), "runs/house_val--slam"),
        (("--pipeline", REPOSITORY / "pipelines/sfm.toml"), "runs/house_val--sfm"),
    ],
)
def test_status_by_name(
    cli: Callable[..., Result], here: Path, arguments: tuple[object, ...], folder: str
) -> None:
    result = cli("status", "house_val", *arguments)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.splitlines()[0] == str(here / folder)


def test_compare_takes_names(cli: Callable[..., Result], here: Path) -> None:
    del here
    result = cli("compare", "house_test", "robot17_noview")
    assert "runs/house_test--robot17_noview: no such run." in result.stderr
    assert "`imodbatch run house_test --pipeline robot17_noview`" in result.stderr
    assert "pipeline 'robot17': none of that" in cli("compare", "house_test", "robot17").stderr


def test_doctor_and_export_take_names(cli: Callable[..., Result], here: Path) -> None:
    assert f"{here}/data/analytic/walk_1" in cli("doctor", "analytic").stdout
    result = cli("export", "analytic", "--to", "out")
    assert f"{here}/runs/analytic--default/frames/walk_1.parquet" in result.stderr
