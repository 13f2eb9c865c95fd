"""What the studio's page takes in Chromium: a library of 10,000 takes, and Enter to four figures.

    python -m benchmarks.generation.studio_page --figure mannequin

A real server and headless Chromium on this machine, which draws in software unless `--gpu` finds
one. Wall times grow with the machine's load; main is the processor time of the page's main thread,
longest that of its longest task. `--figure none` draws without WebGL.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.generation.studio import PROMPT, fill, opened
from benchmarks.harness.contest import figure, table

CHROMIUM = "/usr/bin/chromium"
DRAWN = {"none": ["--disable-3d-apis"], "gpu": ["--use-angle=vulkan"]}
SOFTWARE = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SCROLLED = 600  # Takes that are scrolled through.

PATIENCE = 60_000  # Milliseconds.

# Marks when the first picture is drawn, not only asked for: a fence behind it is passed.
FIGURE = """
const { prototype } = WebGL2RenderingContext;
const { drawElements } = prototype;
prototype.drawElements = function (...of) {
  prototype.drawElements = drawElements;
  setTimeout(() => {
    const fence = this.fenceSync(this.SYNC_GPU_COMMANDS_COMPLETE, 0);
    const look = () => {
      const isDrawn = this.getSyncParameter(fence, this.SYNC_STATUS) === this.SIGNALED;
      isDrawn ? performance.mark("figure") : setTimeout(look, 5);
    };
    this.flush();
    look();
  });
  return drawElements.apply(this, of);
};
"""

# Whether the page can be used and its first picture is drawn.
OPENED = """
() => {
  const { state, model } = document.body.dataset;
  const { renderer } = window.latentmotion?.player.stage ?? {};
  const isDrawn = !renderer || performance.getEntriesByName("figure").length > 0;
  return state === "ready" && model === "warm" && isDrawn;
}
"""

# When a page could be used and its figure stood there, milliseconds after its address.
STARTED = """
() => {
  const [ready] = performance.getEntriesByName("ready");
  const [figure] = performance.getEntriesByName("figure");
  return { "can be used": ready.duration, "figure drawn": figure?.startTime ?? ready.duration };
}
"""

# What the time from Enter to the frame with four figures is made of, milliseconds.
PARTS = """
() => {
  const entries = performance.getEntriesByType("resource");
  const posted = entries.filter(({ name }) => name.endsWith("/takes")).at(-1);
  const read = entries.filter(({ name }) => name.includes("/joints?")).at(-1);
  const [begun] = performance.getEntriesByName("takes").slice(-1);
  return {
    server: posted.responseEnd - posted.startTime,
    joints: read.responseEnd - posted.responseEnd,
    page: begun.startTime + begun.duration - read.responseEnd,
    all: begun.duration,
  };
}
"""


@dataclass(frozen=True)
class Cost:
    """What an action took, milliseconds."""

    wall: float
    main: float
    longest: float
    longest_wall: float

    def row(self, name: str) -> list[str]:
        """Returns the row of the table."""
        return [name, *map(figure, (self.wall, self.main, self.longest, self.longest_wall))]


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--takes", type=int, default=10_000)
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--figure", choices=("mannequin", "stick", "none"), default="mannequin")
    parser.add_argument("--gpu", action="store_true")
    options = parser.parse_args(arguments)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, figures: {options.figure}")
    drawn = DRAWN.get("gpu" if options.gpu else options.figure, SOFTWARE)
    with tempfile.TemporaryDirectory() as folder:
        names = fill(Path(folder), options.takes)
        with opened(Path(folder)) as (client, _, _):
            token = client.headers["Authorization"].removeprefix("Bearer ")
            place = f"{client.base_url}/studio#token={token}"
            client.get(f"/studio/v1/takes/{names[0]}/file?format=csv")
            starts = [start(drawn, place) for _ in range(options.turns)]
            print(table(["page opened", "median ms", "least ms"], medians(starts)))
            with chromium(drawn) as (browser, page):
                page.goto(place)
                page.wait_for_function(OPENED)
                rows = [[*row] for row in library(browser, page, len(names))]
                head = ["", "wall ms", "main ms", "longest ms", "longest wall"]
                print(table([f"{len(names):,} takes", *head[1:]], rows))
                print(table(["Enter to figures", "median ms", "least ms"], enter(page, options)))


@contextmanager
def chromium(drawn: Sequence[str]) -> Iterator[tuple[Browser, Page]]:
    """Yields a browser and its page."""
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", *drawn], timeout=PATIENCE
        )
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(PATIENCE)
        page.add_init_script(FIGURE)
        yield browser, page
        browser.close()


def start(drawn: Sequence[str], place: str) -> dict[str, float]:
    """Returns when a new browser's page can be used and its figure stands there, milliseconds."""
    with chromium(drawn) as (_, page):
        page.goto(place)
        page.wait_for_function(OPENED)
        return page.evaluate(STARTED)


def medians(turns: Sequence[dict[str, float]]) -> list[list[str]]:
    """Returns a row for each part: its median and its least."""
    return [
        [part, figure(statistics.median(values)), figure(min(values))]
        for part in turns[0]
        if (values := [one[part] for one in turns])
    ]


def library(browser: Browser, page: Page, count: int) -> Iterator[list[str]]:
    """Yields rows: the library's list, scrolled, searched, and a take of it."""

    def go() -> None:
        page.click("#screens a[href='#library']")
        page.wait_for_function("() => document.getElementById('grid').dataset.listed >= 60")
        page.wait_for_selector("#grid li:first-child img")

    def scroll() -> None:
        page.wait_for_function(
            "(listed) => { document.getElementById('more').scrollIntoView();"
            " return document.getElementById('grid').dataset.listed >= listed }",
            arg=min(count, SCROLLED),
        )

    def search() -> None:
        page.fill("#query", "kick 99")
        page.wait_for_function(
            "() => { const { ariaBusy, dataset } = document.getElementById('grid');"
            " return ariaBusy === 'false' && Number(dataset.listed) <= 60 }"
        )

    def open_one() -> None:
        page.click("#grid li:first-child .picture")
        page.wait_for_selector("body[data-screen=make][data-takes='1']")

    for name, work in {
        "library's first 60, with pictures": go,
        f"scrolled to take {min(count, SCROLLED)}": scroll,
        "search of two words": search,
        "a take opened": open_one,
    }.items():
        yield cost(browser, page, work).row(name)


def enter(page: Page, options: argparse.Namespace) -> list[list[str]]:
    """Returns rows: the parts of the time from Enter to four figures."""
    if options.figure != "none":
        page.select_option("#figure", options.figure)
    page.click("#more-options")
    page.fill("[name=takes]", "4")
    page.fill("[name=seconds]", "4")
    turns: list[dict[str, float]] = []
    for turn in range(options.turns + 1):
        page.fill("[name=seed]", str(np.random.default_rng(turn).integers(1 << 30)))
        page.evaluate("() => { latentmotion.before = latentmotion.studio.takes }")
        page.fill("#prompt", PROMPT)
        page.press("#prompt", "Enter")
        page.wait_for_function(
            "() => latentmotion.studio.takes !== latentmotion.before"
            " && document.body.dataset.state === 'ready'"
        )
        page.wait_for_function(f"() => performance.getEntriesByName('takes').length > {turn}")
        turns.append(page.evaluate(PARTS))
    return medians(turns[1:])


def cost(browser: Browser, page: Page, work: Callable[[], None]) -> Cost:
    """Returns what an action takes, by Chromium's own trace."""
    browser.start_tracing(page=page, categories=["toplevel", "__metadata"])
    work()
    events: list[dict[str, Any]] = json.loads(browser.stop_tracing())["traceEvents"]
    mains = {
        (event["pid"], event["tid"])
        for event in events
        if event["name"] == "thread_name" and event["args"]["name"] == "CrRendererMain"
    }
    tasks = [
        event
        for event in events
        if event["name"] == "ThreadControllerImpl::RunTask"
        and (event["pid"], event["tid"]) in mains
        and "tdur" in event
    ]
    first = min(task["ts"] for task in tasks)
    wall = max(task["ts"] + task["dur"] for task in tasks) - first
    spent = [task["tdur"] for task in tasks]
    longest = max(task["dur"] for task in tasks)
    return Cost(wall / 1e3, sum(spent) / 1e3, max(spent) / 1e3, longest / 1e3)


if __name__ == "__main__":
    main()
