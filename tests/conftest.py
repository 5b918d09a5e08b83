"""What tests share: the same examples everywhere, a small analytic dataset, the command line."""

from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest
from click.testing import CliRunner, Result

from imodbatch.cli.main import main
from imodbatch.lab.analytic import write_dataset

REPOSITORY = Path(__file__).parents[1]
SEQUENCE = '[[sequences]]\nid = "{0}"\npath = "{0}"\n'
WIDE = {"COLUMNS": "100"}  # help is wrapped by the terminal's width

# Every machine and every run draws the same examples, however long one takes.
hypothesis.settings.register_profile(
    "everywhere",
    derandomize=True,
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile("everywhere")


@pytest.fixture(scope="session")
def analytic_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two walks of eight frames. Only to be read: a test that damages files copies them first."""
    folder = tmp_path_factory.mktemp("analytic") / "data"
    write_dataset(folder, n_sequences=2, n_frames=8)
    return folder


@pytest.fixture(scope="session")
def analytic_manifest() -> Callable[..., str]:
    """The shipped manifest's text for data that lie elsewhere and are there, and for some walks."""
    shipped = (REPOSITORY / "manifests/analytic.toml").read_text(encoding="utf-8")
    simulate = shipped[shipped.index("[simulate]") : shipped.index("[camera]")]
    head = shipped[: shipped.index("[[sequences]]")].replace(simulate, "")
    assert head.count('root = "../data/analytic"') == 1

    def text(root: Path, *sequences: str) -> str:
        moved = head.replace("../data/analytic", root.as_posix())
        return moved + "\n".join(SEQUENCE.format(name) for name in sequences)

    return text


@pytest.fixture(scope="session")
def cli() -> Callable[..., Result]:
    """Call the command line in this process; what it does not catch fails the test."""

    def call(*arguments: object) -> Result:
        words = [str(a) for a in arguments]
        return CliRunner(env=WIDE).invoke(main, words, catch_exceptions=False)

    return call
