"""From the studio's first screen to a GLB of one's own character: clicks, seconds and pictures.

    python -m benchmarks.generation.studio_walk CHARACTER.glb -o PICTURES

A new library, headless Chromium, drawing in software: as somebody goes who never saw the page.
Prints when each step was done, and counts clicks; keys and the choice of a file are none.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.generation.studio import opened
from benchmarks.generation.studio_page import SOFTWARE, chromium
from benchmarks.harness.contest import figure, table
from latentmotion.formats.gltf_document import Document

PROMPT = "a person walks forward and waves"


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("character", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("walk"))
    options = parser.parse_args(arguments)
    options.output.mkdir(exist_ok=True)
    rows, clicks = [], 0
    with (
        tempfile.TemporaryDirectory() as folder,
        opened(Path(folder)) as (client, _, _),
        chromium(SOFTWARE) as (_, page),
    ):
        token = client.headers["Authorization"].removeprefix("Bearer ")
        began = time.monotonic()

        def step(name: str, work: Callable[[], object], clicked: int = 0) -> None:
            nonlocal clicks
            work()
            clicks += clicked
            rows.append([name, figure(time.monotonic() - began), str(clicks)])
            page.screenshot(path=options.output / f"{len(rows)}.png")

        def enter() -> None:
            page.goto(f"{client.base_url}/studio#token={token}")
            page.wait_for_selector("body[data-state=ready]")

        def make() -> None:
            page.keyboard.type(PROMPT)  # the field has the focus
            page.keyboard.press("Enter")
            page.wait_for_selector("body[data-takes='4']")

        def show() -> None:
            page.click("#screens a[href='#character']")
            page.wait_for_selector("#drop:visible")

        def choose() -> None:
            with page.expect_file_chooser() as chooser:
                page.click("#character-open")
            chooser.value.set_files(options.character)
            page.wait_for_selector("#character-body:visible")

        def save() -> None:
            with page.expect_download() as download:
                page.click("#character-export")
            download.value.save_as(options.output / "own.glb")

        step("page can be used", enter)
        step("four takes", make)
        step("screen Character", show, 1)
        step("own character shown", choose, 1)
        step("GLB saved", save, 1)
    document = Document.read(options.output / "own.glb").json
    print(table(["step", "seconds", "clicks"], rows))
    bones, takes = len(document["skins"][0]["joints"]), len(document["animations"])
    print(f"own.glb: {bones} bones, {takes} animations")


if __name__ == "__main__":
    main()
