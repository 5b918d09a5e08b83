"""Weights by name: what a name finds, what a path means, and how a mistake is told."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from detectors import load_network
from safetensors import safe_open

from imodbatch.core.errors import ConfigError
from imodbatch.detection import weights
from imodbatch.detection.checkpoint import stored_tensors
from imodbatch.detection.files import checkpoint_files, read_card, read_checkpoint
from imodbatch.detection.weights import find_weights
from imodbatch.run import runner
from imodbatch.run.plan import Plan
from imodbatch.run.provenance import files_digest
from imodbatch.run.steps import STEPS
from imodbatch.settings.config import load_pipeline
from imodbatch.settings.manifest import load_manifest
from imodbatch.settings.shipped import shipped_names

REPOSITORY = Path(__file__).parents[2]
NAMES = ("robot17_3x16", "robot17_3x8", "robot17_noview")
FAMILIES = {"robot17": NAMES, "rgbd5": ("rgbd5_3x12", "rgbd5_noview")}
DETECTORS = [name for names in FAMILIES.values() for name in names]


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the cards of three detectors in place of the package's own."""
    folder = tmp_path / "shipped"
    folder.mkdir()
    for name in NAMES:
        (folder / f"{name}.json").write_text("{}", encoding="utf-8")
    monkeypatch.setattr(weights, "FOLDER", folder)
    return folder


def test_the_shipped_weights_lie_in_the_package() -> None:
    assert (weights.FOLDER / "__init__.py").is_file()
    assert shipped_names(weights.FOLDER, weights.SUFFIX) == sorted(DETECTORS)


@pytest.mark.parametrize("name", DETECTORS)
def test_every_shipped_detector_loads(name: str) -> None:
    network, card = load_network(find_weights(name))  # strict: no tensor too many or too few
    assert card.name == name
    assert network.state_dict()["head.class_logits.bias"].shape == (len(card.classes) + 1,)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_family_holds_what_its_members_share_once(family: str) -> None:
    file = weights.FOLDER / f"{family}.safetensors"
    assert file.stat().st_size < 13e6
    assert {checkpoint_files(find_weights(name))[0] for name in FAMILIES[family]} == {file}
    with safe_open(str(file), "pt") as stored:
        names = set(stored.keys())
    shared = {name for name in names if "/" not in name}
    for member in FAMILIES[family]:
        own = set(stored_tensors(read_checkpoint(find_weights(member)))) - shared
        assert len(own) == 6
        assert all(name.startswith("head.") for name in own)
        assert {f"{member}/{name}" for name in own} <= names
    assert len(names) == len(shared) + 6 * len(FAMILIES[family])


def test_a_name_is_found_in_the_package(shipped: Path) -> None:
    assert shipped_names(weights.FOLDER, weights.SUFFIX) == sorted(NAMES)
    assert find_weights("robot17_3x8") == shipped / "robot17_3x8.json"


@pytest.mark.parametrize(
    "path", ["own.safetensors", "./own", "runs/own.safetensors", "/a/b", "v.1"]
)
def test_a_path_stays_as_it_is(shipped: Path, path: str) -> None:
    del shipped
    assert find_weights(path) == Path(path)


def test_a_tilde_is_the_home_folder(shipped: Path) -> None:
    del shipped
    assert find_weights("~/own.safetensors") == Path.home() / "own.safetensors"


def test_an_unknown_name_is_told_in_one_line(shipped: Path) -> None:
    del shipped
    with pytest.raises(ConfigError) as caught:
        find_weights("robot17_3x12")
    assert str(caught.value) == (
        "detect.weights 'robot17_3x12': none of that name is shipped. Did you mean 'robot17_3x16'? "
        "Known: robot17_3x16, robot17_3x8, robot17_noview. "
        "One of your own goes by its path: ./robot17_3x12.json"
    )
    with pytest.raises(ConfigError, match=r"shipped\. Known: robot17_3x16, robot17_3x8, "):
        find_weights("yolo")


def test_the_command_line_tells_it_without_a_traceback(
    shipped: Path,
    cli: Callable[..., Result],
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    tmp_path: Path,
) -> None:
    del shipped
    manifest = tmp_path / "small.toml"
    manifest.write_text(analytic_manifest(analytic_data, "walk_1"))
    settings = ("--set", "detect.weights=robot17_3x6", "--out", tmp_path / "run")
    result = cli("run", manifest, *settings)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("imodbatch: error: detect.weights 'robot17_3x6': none of that name")


@pytest.mark.parametrize("name", NAMES)
def test_the_pipelines_of_table_1_name_their_detector(shipped: Path, name: str) -> None:
    pipeline = load_pipeline(REPOSITORY / f"pipelines/{name}.toml")
    assert pipeline.detect.weights == name
    assert find_weights(name).parent == shipped
    assert pipeline.viewpoint.n_azimuths == (8 if name == "robot17_3x8" else 16)
    assert pipeline.viewpoint.elevations_deg == (10.0, 30.0, 50.0)
    assert pipeline.report.paper == "table1"


@pytest.mark.parametrize("changed", ["robot17.safetensors", "robot17_3x16.json"])
def test_other_weights_of_the_same_name_are_another_provenance(
    changed: str,
    analytic_data: Path,
    analytic_manifest: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shipped = tmp_path / "shipped"
    shipped.mkdir()
    for path in weights.FOLDER.glob("robot17*"):
        shutil.copy(path, shipped)
    monkeypatch.setattr(weights, "FOLDER", shipped)
    (tmp_path / "small.toml").write_text(analytic_manifest(analytic_data, "walk_1"))
    manifest = load_manifest(tmp_path / "small.toml")
    pipeline = load_pipeline(None, ["detect.weights=robot17_3x16"])
    plan = Plan(manifest, pipeline, tmp_path / "run", manifest.sequences)
    list(runner.run_stage(plan, "index"))
    step = next(step for step in STEPS if step.stage == "detect")
    before = files_digest(plan, step)
    assert files_digest(plan, step) == before
    with (shipped / changed).open("ab") as file:
        file.write(b" ")
    assert read_card(shipped / "robot17_3x16.json").family is not None
    assert files_digest(plan, step) != before
