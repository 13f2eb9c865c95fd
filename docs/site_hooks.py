"""Hooks of the site's build: API reference by object, and the demo of the first page.

There is a page for each name of `latentmotion`, and for each that a page of the docs imports. The
demo is the site that `latentmotion web` wrote, if LATENTMOTION_DEMO names its folder; else motions
that the shipped model makes now, to be played.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import latentmotion
from latentmotion.viewer.page import write_page

DOCS = Path(__file__).parent
FOLDER = "reference/api"
DEMO = "LATENTMOTION_DEMO"
PROMPTS = ("a person walks forward and waves", "a person kicks with the right leg")

_IMPORT = re.compile(r"^from (latentmotion\.[\w.]+) import ([\w, ]+)$", re.MULTILINE)


def objects() -> dict[str, str]:
    """Returns the path of each object by the name of its page."""
    homes = latentmotion._HOMES
    paths = {name: f"latentmotion.{module}.{name}" for name, module in homes.items()}
    for page in sorted(DOCS.rglob("*.md")):
        for module, names in _IMPORT.findall(page.read_text("utf-8")):
            for name in names.replace(" ", "").split(","):
                # Functions such as `check` say little without their module.
                title = name if name[0].isupper() else f"{module.rpartition('.')[2]}.{name}"
                if name not in homes and not module.startswith("latentmotion.cli"):
                    paths[title] = f"{module}.{name}"
    return dict(sorted(paths.items(), key=lambda item: item[0].lower()))


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Appends the API pages to the navigation."""
    assert config.nav is not None
    pages = [{name: f"{FOLDER}/{name}.md"} for name in objects()]
    config.nav.append({"API": [f"{FOLDER}/index.md", *pages]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the API pages, which exist only while the site is built."""
    for name, path in objects().items():
        options = "    options: { heading_level: 1, show_root_full_path: false }\n"
        files.append(
            _page(config, name, f"---\nsearch: {{boost: 0.3}}\n---\n\n::: {path}\n{options}")
        )
    files.append(_page(config, "index", _overview()))
    return files


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Names the theme's search for screen readers."""
    return output.replace('role="dialog"', 'role="dialog" aria-label="Search"', 1)


def on_post_build(config: MkDocsConfig) -> None:
    """Writes the demo beside the pages."""
    folder = Path(config.site_dir) / "demo"
    if site := os.environ.get(DEMO):
        shutil.copytree(site, folder, dirs_exist_ok=True)
        return
    folder.mkdir(exist_ok=True)
    generate = latentmotion.MotionPipeline.from_pretrained()
    write_page(folder / "index.html", generate(PROMPTS, seconds=4))


def _page(config: MkDocsConfig, name: str, content: str) -> File:
    return File.generated(config, f"{FOLDER}/{name}.md", content=content)


def _overview() -> str:
    lines = "\n".join(f"* [`{path}`]({name}.md)" for name, path in objects().items())
    return (
        "# API reference\n\n"
        "`from latentmotion import …` gives the names that most programs need; what guides import "
        "besides has a page, too. Everything else is read [in the code](../architecture.md).\n\n"
        f"{lines}\n"
    )
