"""Commands by entry point, and the one that a run calls to make its data."""

import re
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, get_args

import click
import pytest
from click.testing import Result

from imodbatch.cli import plugins as cli_plugins
from imodbatch.cli.main import main
from imodbatch.core.errors import ConfigError
from imodbatch.lab.commands import simulate
from imodbatch.settings.manifest import Manifest, load_manifest
from imodbatch.settings.sections import SimulateSection
from imodbatch.settings.shipped import shipped_folder, shipped_names
from imodbatch.settings.toml import validate

Plug = Callable[..., None]


@click.command()
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def recorder(arguments: tuple[str, ...]) -> None:
    """Say what it was called with."""
    click.echo(f"called: {' '.join(arguments)}")


recorder.context_settings = {"ignore_unknown_options": True}
no_command = "text"


@pytest.fixture
def plug(monkeypatch: pytest.MonkeyPatch) -> Iterator[Plug]:
    """Put entry points in place of those installed."""

    def put(**values: str) -> None:
        found = [EntryPoint(name, value, cli_plugins.GROUP) for name, value in values.items()]
        monkeypatch.setattr(cli_plugins, "entry_points", lambda **_: found)
        cli_plugins._joining.cache_clear()

    monkeypatch.setitem(sys.modules, "plugged", sys.modules[__name__])
    yield put
    cli_plugins._joining.cache_clear()


def test_the_labs_commands_are_installed() -> None:
    found = {entry.name: entry.load() for entry in entry_points(group=cli_plugins.GROUP)}
    assert found["simulate"] is simulate
    assert {"simulate", "synth", "train"} <= set(found)


def test_a_command_joins_and_replaces_none(cli: Callable[..., Result], plug: Plug) -> None:
    plug(extra="plugged:recorder", schema="plugged:recorder")
    assert main.list_commands(click.Context(main)) == [*main.commands, "extra"]
    assert re.search(r"extra +Say what it was called with\.", cli("--help").stdout)
    assert cli("extra", "--some", "thing").stdout == "called: --some thing\n"
    assert "called" not in cli("schema").stdout
    assert cli("other").exit_code == 2


@pytest.mark.parametrize(
    ("value", "why"),
    [
        ("no_such_module:command", "cannot be loaded (No module named 'no_such_module')"),
        ("plugged:missing", "cannot be loaded (module"),
        ("plugged:no_command", "plugged:no_command is no click command"),
    ],
)
def test_a_command_that_cannot_be_loaded_breaks_no_other(
    cli: Callable[..., Result], plug: Plug, value: str, why: str
) -> None:
    plug(broken=value, extra="plugged:recorder")
    listed = cli("--help")
    assert (listed.exit_code, listed.stderr) == (0, "")
    (line,) = [line for line in listed.stdout.splitlines() if line.startswith("  broken")]
    assert "broken: " in line
    assert cli("extra", "x").stdout == "called: x\n"
    result = cli("broken", "folder", "--with", "options")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"imodbatch: error: broken: {why}")
    assert line.endswith("Update or remove another package.")


def test_our_own_broken_command_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = next(e for e in entry_points(group=cli_plugins.GROUP) if e.name == "simulate")
    monkeypatch.setattr(EntryPoint, "load", lambda _: __import__("no_such_module"))
    broken = cli_plugins._load(entry)
    with pytest.raises(ConfigError, match=r"pip install 'imodbatch\[lab\]'$"):
        broken.main([], standalone_mode=False)


# Data that make themselves


def manifest_with(tmp_path: Path, simulate: str) -> Path:
    path = tmp_path / "m.toml"
    path.write_text(
        'name = "m"\nadapter = "folder"\nroot = "data/deep"\nclasses = ["a"]\n'
        f"[simulate]\n{simulate}\n[[sequences]]\nid = 's'\n"
    )
    return path


@pytest.mark.parametrize(
    ("section", "workers", "called"),
    [
        ('world = "analytic"', 3, "data/deep --world analytic --split test --seed 0"),
        (
            'folder = ".."\nlayout = "rgbd_scenes_v1"\nsplit = "val"\nworlds = 5\nframes = 60',
            3,
            "data --layout rgbd_scenes_v1 --split val --seed 0 --worlds 5 --frames 60 --workers 3",
        ),
    ],
)
@pytest.mark.parametrize("stage", ["run", "index"])
def test_run_and_index_make_the_data_first(
    cli: Callable[..., Result],
    plug: Plug,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    section: str,
    workers: int,
    called: str,
    stage: str,
) -> None:
    plug(simulate="plugged:recorder")
    monkeypatch.chdir(tmp_path)
    result = cli(stage, manifest_with(tmp_path, section), "--workers", workers)
    assert result.stdout.splitlines()[0] == f"called: {called}"
    assert "called" not in cli("poses", tmp_path / "m.toml").stdout


def test_two_worlds_at_a_time_where_there_are_two_processors(
    cli: Callable[..., Result], plug: Plug, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plug(simulate="plugged:recorder")
    path = manifest_with(tmp_path, 'world = "house"')
    for n_processors, n_workers in ((8, 2), (1, 1), (None, 1)):
        monkeypatch.setattr("os.cpu_count", lambda n=n_processors: n)
        assert f"--workers {n_workers}\n" in cli("index", path).stdout


def test_without_the_lab_data_that_are_there_are_read(
    cli: Callable[..., Result], plug: Plug, tmp_path: Path
) -> None:
    path = manifest_with(tmp_path, 'world = "house"')
    for installed in ({}, {"simulate": "no_such_module:simulate"}):
        plug(**installed)
        (line,) = cli("index", path).stderr.splitlines()
        assert line.endswith("which makes it. Install it: pip install 'imodbatch[lab]'")
        assert f"{tmp_path}/data/deep is missing" in line
    (tmp_path / "data/deep").mkdir(parents=True)
    assert "lab" not in cli("index", path).stderr


def test_an_analytic_dataset_makes_itself_and_mends_itself(
    cli: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (shipped_folder("manifests") / "analytic.toml").read_text(encoding="utf-8")
    Path("manifests").mkdir()
    small = text.replace('world = "analytic"', 'world = "analytic"\nworlds = 1\nframes = 4')
    Path("manifests/a.toml").write_text(small[: small.index("[[sequences]]   # approaches")])
    first = cli("index", "manifests/a.toml")
    assert (first.exit_code, first.stderr) == (0, "")
    assert first.stdout.startswith("simulate: data/analytic\nindex walk_1: 4 frames")
    assert cli("index", "manifests/a.toml").stdout.endswith("(up to date)\n")
    lost = Path("data/analytic/walk_1/color/000002.png")
    lost.unlink()
    assert cli("index", "manifests/a.toml").exit_code == 0
    assert lost.is_file()


EMBEDDED = [
    name
    for name in shipped_names(shipped_folder("manifests"), ".toml")
    if name.startswith(("analytic", "house_", "scenes_"))
]


@pytest.mark.parametrize("name", EMBEDDED)
def test_embedded_manifests_say_what_simulate_understands(name: str) -> None:
    manifest = load_manifest(Path(name))
    assert manifest.simulate is not None
    text = (shipped_folder("manifests") / f"{name}.toml").read_text(encoding="utf-8")
    folder = (manifest.root_path / manifest.simulate.folder).resolve().relative_to(Path.cwd())
    # The first line of the file says the command in full.
    words = text.splitlines()[0].split("`")[1].removeprefix("imodbatch simulate ").split()
    assert parsed([str(folder), *manifest.simulate.options()]) == parsed(words)


def parsed(arguments: list[str]) -> dict[str, Any]:
    """What `simulate` understands, without doing it."""
    root = click.Context(main, **main.context_settings)
    with simulate.make_context("simulate", arguments, root) as ctx:
        return ctx.params


def test_the_section_has_options_and_choices_of_the_command() -> None:
    options = {option.name: option for option in simulate.params}
    for name, field in SimulateSection.model_fields.items():
        choices = [
            v for part in (field.annotation, *get_args(field.annotation)) for v in get_args(part)
        ]
        texts = {choice for choice in choices if isinstance(choice, str)}
        kind = options[name].type
        assert texts <= set(kind.choices if isinstance(kind, click.Choice) else ())


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ({}, "simulate: give either world or layout"),
        ({"world": "house", "layout": "rgbd_scenes_v1"}, "give either world or layout"),
        ({"world": "rooms"}, "simulate.world: "),
        ({"wrold": "house"}, "simulate.wrold: unknown key. Did you mean 'world'?"),
        ({"world": "house", "frames": 1}, "simulate.frames: "),
    ],
)
def test_mistakes_in_the_section(section: dict[str, Any], said: str) -> None:
    data = {"name": "m", "adapter": "folder", "classes": ["a"], "sequences": [{"id": "s"}]}
    with pytest.raises(ConfigError) as caught:
        validate(Manifest, {**data, "simulate": section}, "m.toml")
    assert said in str(caught.value)
