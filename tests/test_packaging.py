"""What is published: a README whose links lead somewhere, and an sdist with all that tests read."""

from __future__ import annotations

import importlib.util
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def hook(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The build hook, without hatchling."""
    interface = ModuleType("interface")
    interface.MetadataHookInterface = object  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "hatchling.metadata.plugin.interface", interface)
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_links_of_the_published_readme_lead_to_files_of_the_repository(hook: ModuleType) -> None:
    links = re.findall(r"\]\(([^)]*)\)", hook.absolute((ROOT / "README.md").read_text()))
    ours = [link for link in links if "latentmotion/latentmotion/" in link]
    assert len(ours) > 20 and all(link.startswith("http") for link in links)
    for link in ours:
        assert (ROOT / re.split(r"/main/|#", link)[1]).exists(), link


def test_absolute_links_and_anchors_stay(hook: ModuleType) -> None:
    text = "[a](http://b.c) [d](#e)"
    assert hook.absolute(text) == text
    assert hook.absolute("![p](x.gif) [q](y.md)") == (
        f"![p]({hook.PICTURES}x.gif) [q]({hook.REPOSITORY}y.md)"
    )


def test_the_sdist_has_what_tests_read() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    included = settings["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    for name in ("tests", "docs", "data", "Makefile", "mkdocs.yml", ".importlinter"):
        assert f"/{name}" in included and (ROOT / name).exists()
