"""What the tests of the whole command line share: a small analytic dataset and a way to call it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from imodbatch.cli import main
from imodbatch.simulation.analytic import write_dataset

REPOSITORY = Path(__file__).parents[1]
SEQUENCE = '[[sequences]]\nid = "{0}"\npath = "{0}"\n'


@pytest.fixture(scope="session")
def analytic_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two walks of eight frames. Only to be read: a test that damages files copies them first."""
    folder = tmp_path_factory.mktemp("analytic") / "data"
    write_dataset(folder, n_sequences=2, n_frames=8)
    return folder


@pytest.fixture(scope="session")
def analytic_manifest() -> Callable[..., str]:
    """The shipped manifest's text for a dataset that lies elsewhere and for the walks named."""
    shipped = (REPOSITORY / "manifests/analytic.toml").read_text(encoding="utf-8")
    head = shipped[: shipped.index("[[sequences]]")]
    assert head.count('root = "../data/analytic"') == 1

    def text(root: Path, *sequences: str) -> str:
        moved = head.replace("../data/analytic", root.as_posix())
        return moved + "\n".join(SEQUENCE.format(name) for name in sequences)

    return text


@pytest.fixture(scope="session")
def cli() -> Callable[..., Result]:
    """Call the command line in this process; what it does not catch fails the test."""

    def call(*arguments: object) -> Result:
        return CliRunner().invoke(main, [str(a) for a in arguments], catch_exceptions=False)

    return call
