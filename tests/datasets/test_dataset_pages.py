"""docs/datasets: manifests on the pages load, files they name are there, the README lists them."""

import re
import tomllib
from pathlib import Path

import pytest

from imodbatch.datasets.registry import LAYOUTS
from imodbatch.settings.manifest import Manifest, load_manifest
from imodbatch.settings.toml import validate

REPOSITORY = Path(__file__).parents[2]
PAGES = sorted((REPOSITORY / "docs" / "datasets").glob("*.md"))
NO_ADAPTER = {"rgbd_object"}
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_says_holds(page):
    text = page.read_text(encoding="utf-8")
    for block in re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL):
        data = tomllib.loads(block)
        if "adapter" in data:
            assert validate(Manifest, data, page.name).adapter == page.stem
    for named in re.findall(r"\b(?:manifests|pipelines)/\w+\.toml", text):
        assert (REPOSITORY / named).is_file(), named
    if page.stem not in NO_ADAPTER:
        assert f'adapter = "{page.stem}"' in text
        assert page.stem in LAYOUTS
    assert f"(docs/datasets/{page.name})" in README


def test_the_readme_lists_every_adapter():
    start = README.index("## Datasets")
    section = README[start : README.index("\n## ", start + 1)]
    listed = set(re.findall(r"(?m)^\| `(\w+)` \|", section))
    assert listed == set(LAYOUTS)


def test_every_shipped_manifest_names_a_layout(monkeypatch):
    monkeypatch.setenv("IMODBATCH_DATA", "/data")
    paths = sorted((REPOSITORY / "manifests").glob("*.toml"))
    assert paths
    for path in paths:
        assert load_manifest(path).adapter in LAYOUTS
