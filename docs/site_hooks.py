"""Hooks of the site's build: one page of API reference for each room of the package.

The pages are made from the source tree, so a room that is added, renamed or split needs no change
here. Only names without a leading underscore appear.
"""

from __future__ import annotations

from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

PACKAGE = Path(__file__).parents[1] / "src" / "latentmotion"
LEFT_OUT = {"blender", "cli", "models", "viewer", "__main__"}
"""Rooms without public names: Blender's add-on, commands, shipped weights, a web page."""
FOLDER = "reference/api"


def rooms() -> list[str]:
    """Returns the names of the package's rooms and top-level modules, sorted."""
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"}
    return sorted((packages | modules) - LEFT_OUT)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Appends the API pages to the navigation."""
    assert config.nav is not None
    pages = [{room: f"{FOLDER}/{room}.md"} for room in rooms()]
    config.nav.append({"API": [f"{FOLDER}/index.md", *pages]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the API pages, which exist only while the site is built."""
    for room in rooms():
        files.append(_page(config, room, f"# `{room}`\n\n::: latentmotion.{room}\n"))
    files.append(_page(config, "index", _overview()))
    return files


def _page(config: MkDocsConfig, name: str, content: str) -> File:
    return File.generated(config, f"{FOLDER}/{name}.md", content=content)


def _overview() -> str:
    lines = "\n".join(f"* [`latentmotion.{room}`]({room}.md)" for room in rooms())
    return (
        "# API reference\n\n"
        "`from latentmotion import …` gives the names that most programs need:\n\n"
        "::: latentmotion\n    options:\n      show_submodules: false\n"
        "      show_root_heading: false\n\n"
        f"Every room of the package has a page:\n\n{lines}\n"
    )
