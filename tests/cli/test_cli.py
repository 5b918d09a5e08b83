"""The command line's face: help, exit codes, speed; and that the files beside it tell the truth."""

import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from imodbatch.cli.main import main
from imodbatch.run.steps import STAGES
from imodbatch.settings.config import Pipeline, load_pipeline
from imodbatch.settings.manifest import load_manifest
from imodbatch.settings.shipped import shipped_folder, shipped_names
from imodbatch.tables.schemas import TABLES

REPOSITORY = Path(__file__).parents[2]
COMMANDS = main.list_commands(click.Context(main))
NAMES = {
    name
    for kind in ("manifests", "pipelines")
    for name in shipped_names(shipped_folder(kind), ".toml")
}
PIPELINES = sorted((REPOSITORY / "pipelines").glob("*.toml"))
MANIFESTS = sorted((REPOSITORY / "manifests").glob("*.toml"))


def text_of(name: str) -> str:
    return (REPOSITORY / name).read_text(encoding="utf-8")


# Help


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_a_sentence_and_an_example(cli: Callable[..., Result], command: str) -> None:
    result = cli(command, "--help")
    assert (result.exit_code, result.stderr) == (0, "")
    assert cli(command, "-h").stdout == result.stdout
    usage, sentence, example, *_ = result.stdout.split("\n\n")
    assert usage.startswith(f"Usage: main {command} ")
    words = " ".join(sentence.split())
    assert words.endswith(".")
    assert words[:-1].count(". ") == 0
    title, line = example.splitlines()
    assert title.strip() == "Example:"
    program, named, *arguments = line.split()
    assert (program, named) == ("imodbatch", command)
    for argument in arguments:
        names_new_files = command in {"simulate", "synth", "train", "export"}
        assert argument in NAMES or argument in TABLES or names_new_files


@pytest.mark.parametrize("stage", STAGES)
def test_the_help_of_a_stage_says_what_goes_in_and_comes_out(
    cli: Callable[..., Result], stage: str
) -> None:
    assert " → " in cli(stage, "--help").stdout.split("\n\n")[1]


def test_help_lists_the_stages_in_their_order(cli: Callable[..., Result]) -> None:
    listed = re.findall(r"(?m)^  ([a-z]+)  ", cli("--help").stdout.split("Commands:")[1])
    assert listed == COMMANDS
    assert listed[-3:] == ["simulate", "synth", "train"]
    assert listed[: len(STAGES)] == list(STAGES)


def test_help_answers_at_once() -> None:
    """It imports the standard library and click: counted, for seconds are another machine's."""
    code = (
        "import sys\n"
        "before = set(sys.modules)\n"
        "from imodbatch.cli.main import main\n"
        "main(['--help'], standalone_mode=False)\n"
        "loaded = {name.partition('.')[0] for name in sys.modules.keys() - before}\n"
        "print(*loaded - sys.stdlib_module_names, file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert b"Usage:" in done.stdout
    assert set(done.stderr.split()) == {b"click", b"imodbatch"}


def test_help_is_printed_whatever_the_terminal_can_show() -> None:
    result = CliRunner(charset="latin-1").invoke(main, ["index", "--help"])
    assert (result.exit_code, result.exception) == (0, None)
    assert "Dataset folder ? frames" in result.stdout


# Exit codes


@pytest.mark.parametrize(
    ("arguments", "exit_code"),
    [
        (["--version"], 0),
        (["schema"], 0),
        (["status", str(REPOSITORY / "manifests/analytic.toml")], 0),
        (["schema", "fusd"], 1),
        (["index", "nowhere.toml"], 1),
        (["run", str(REPOSITORY / "manifests/analytic.toml"), "--pipeline", "nowhere.toml"], 1),
        (["run", "analytik"], 1),
        (["run", "analytic", "--pipeline", "robot17"], 1),
        (["status", "analytic"], 0),
        (["run"], 2),
        (["rnu", "nowhere.toml"], 2),
        (["run", "nowhere.toml", "--worker"], 2),
        (["run", "nowhere.toml", "--workers", "0"], 2),
        (["fuse", "nowhere.toml", "--device", "cpu"], 2),
    ],
)
def test_exit_codes(
    cli: Callable[..., Result],
    arguments: list[str],
    exit_code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """0 done, 1 an error of the user's in one line, 2 wrong usage; none of them leaves a file."""
    monkeypatch.chdir(tmp_path)
    result = cli(*arguments)
    assert result.exit_code == exit_code
    assert bool(result.stderr) == (exit_code > 0)
    if exit_code == 1:
        (line,) = result.stderr.splitlines()
        assert line.startswith("imodbatch: error: ")
    assert list(tmp_path.iterdir()) == []


def test_the_exit_code_of_the_process() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "imodbatch.cli.main", "index", "nowhere.toml"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("imodbatch: error: nowhere.toml: no such file.")
    assert done.stderr.count("\n") == 1


def test_an_error_does_not_stick(cli: Callable[..., Result]) -> None:
    assert cli("index", "nowhere.toml").exit_code == 1
    assert cli("schema").exit_code == 0


def test_a_bug_keeps_its_traceback(
    cli: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    def bug(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("imodbatch.settings.manifest.load_manifest", bug)
    with pytest.raises(ZeroDivisionError):
        cli("index", "nowhere.toml")


# Schema and simulate


def test_schema_prints_every_table_and_column(cli: Callable[..., Result]) -> None:
    printed = cli("schema").stdout
    for name, spec in TABLES.items():
        alone = cli("schema", name).stdout
        assert alone in printed
        title, *rows = alone.splitlines()
        place = "run" if spec.per_run else "<sequence_id>"
        assert title == f"{name}/{place}.parquet (version {spec.version})"
        assert [row.split()[0].lower() for row in rows] == spec.schema.names
        assert {row.split()[0].lower() for row in rows if row.split()[0].isupper()} == set(spec.key)
        assert all(c.meaning in row for c, row in zip(spec.columns, rows, strict=True))


def test_schema_of_a_misspelt_table(cli: Callable[..., Result]) -> None:
    line = cli("schema", "fusd").stderr
    assert line == "imodbatch: error: fusd: no such table. Did you mean 'fused'?\n"


def test_simulate_writes_where_it_says(
    cli: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def write_dataset(folder: Path, seed: int, progress: Callable[[int, int], None]) -> None:
        progress(1, 2)
        calls.append((folder, seed))

    monkeypatch.setattr("imodbatch.lab.analytic.write_dataset", write_dataset)
    result = cli("simulate", tmp_path / "data", "--seed", 3)
    assert (result.exit_code, result.stdout) == (0, f"simulate: {tmp_path / 'data'}\n")
    assert calls == [(tmp_path / "data", 3)]


def test_simulate_writes_rooms_without_objects(cli: Callable[..., Result], tmp_path: Path) -> None:
    result = cli("simulate", tmp_path / "rooms", "--world", "rooms", "--frames", 4)
    assert result.exit_code == 0, result.output
    assert len(list((tmp_path / "rooms").glob("*.jpg"))) == 4


@pytest.mark.parametrize("world", [(), ("--world", "house")])
def test_simulate_puts_models_into_houses(
    cli: Callable[..., Result],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    world: tuple[str, ...],
) -> None:
    calls: list[dict[str, Any]] = []

    def write_house_dataset(*which: Any, progress: Callable[[int, int], None], **how: Any) -> None:
        progress(1, 2)
        calls.append({"which": which, **how})

    monkeypatch.setattr("imodbatch.lab.models.load_models", lambda folder: [folder])
    monkeypatch.setattr("imodbatch.lab.houses.write_house_dataset", write_house_dataset)
    result = cli("simulate", tmp_path, "--models", "mine", *world, "--worlds", 2, "--workers", 2)
    assert result.exit_code == 0, result.output
    assert result.stdout == f"simulate: {tmp_path}, described by {tmp_path / 'manifest.toml'}\n"
    assert calls == [
        {
            "which": (tmp_path, "test", 0),
            "models": [Path("mine")],
            "n_worlds": 2,
            "n_processes": 2,
        }
    ]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--models", "mine", "--world", "analytic"), "--world analytic takes no models."),
        (("--models", "mine", "--world", "rooms"), "--world rooms takes no models."),
        (("--workers", "2"), "--workers needs --world house or rooms"),
    ],
)
def test_simulate_refuses_what_does_not_apply(
    cli: Callable[..., Result], tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    result = cli("simulate", tmp_path / "data", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert not (tmp_path / "data").exists()


def test_simulate_replaces_no_foreign_files(cli: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    result = cli("simulate", tmp_path)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"imodbatch: error: {tmp_path}: holds 'thesis.tex'")
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


# The files beside the code


@pytest.mark.parametrize("path", PIPELINES, ids=lambda path: path.stem)
def test_shipped_pipelines_load(path: Path) -> None:
    assert isinstance(load_pipeline(path), Pipeline)


def test_the_default_pipeline_is_the_codes_defaults() -> None:
    path = REPOSITORY / "pipelines/default.toml"
    assert path in PIPELINES
    assert load_pipeline(path) == Pipeline()


def test_the_default_pipeline_lists_every_setting() -> None:
    """A key whose default is None cannot stand in TOML: it stands in a comment."""
    text = text_of("pipelines/default.toml")
    written = tomllib.loads(text)
    defaults = Pipeline().model_dump()
    assert list(written) == list(defaults)
    for section, keys in defaults.items():
        assert [key for key in keys if key in written[section]] == list(written[section])
        for key in keys.keys() - written[section].keys():
            assert keys[key] is None
            assert f"\n# {key} = " in text


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.stem)
def test_shipped_manifests_load(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMODBATCH_DATA", "/dummy")
    manifest = load_manifest(path)
    assert manifest.name == path.stem
    assert "${" not in str(manifest.root_path)


def test_the_manifests_are_there() -> None:
    assert {"analytic", "redkitchen"} <= {path.stem for path in MANIFESTS}


def test_the_makefile_has_a_target_for_every_stage() -> None:
    text = text_of("Makefile")
    (stages,) = re.findall(r"(?m)^STAGES\s*:=\s*(.+)$", text)
    assert tuple(stages.split()) == STAGES
    assert re.search(r"(?m)^\$\(STAGES\):.*\n\t\$\(BIN\)/imodbatch \$@ \$\(MANIFEST\)", text)
    assert re.search(r"(?m)^\.PHONY:.*\$\(STAGES\)", text)
    named = re.findall(r"\$\(BIN\)/imodbatch ([a-z]+)", text)
    assert "run" in named
    assert set(named) <= set(COMMANDS)


def test_the_readme_names_only_commands_that_exist() -> None:
    named = set(re.findall(r"imodbatch ([a-z]+)", code_of(text_of("README.md"))))
    assert "run" in named
    assert named - set(COMMANDS) == set()


def test_the_readme_names_only_make_targets_that_exist() -> None:
    named = set(re.findall(r"\bmake ([a-z0-9]+)", code_of(text_of("README.md"))))
    targets = set(re.findall(r"(?m)^([a-z0-9]+):", text_of("Makefile"))) | set(STAGES)
    assert "all" in named
    assert named - targets == set()


def code_of(markdown: str) -> str:
    """What stands in fences, in indented blocks and between backticks."""
    fences = re.findall(r"(?ms)^ *```\w*\n(.*?)^ *```", markdown)
    rest = re.sub(r"(?ms)^ *```.*?^ *```", "", markdown)
    indented = re.findall(r"(?m)^ {4,}(.+)$", rest)
    inline: list[Any] = re.findall(r"`([^`\n]+)`", rest)
    return "\n".join([*fences, *indented, *inline])


def test_a_closed_pipe_is_no_error() -> None:
    """`imodbatch schema | head -1`."""
    command = f"{shlex.quote(sys.executable)} -m imodbatch.cli.main schema | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("frames/")
    assert done.stderr == ""
