"""What tests of pages share: a walk to show, a browser, and a reader of HTML."""

from __future__ import annotations

import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion

HOSTILE = 'walk </script><b>&amp; <!--<script> {{script}} "quoted" \\u003c é'
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)


def walking(seconds: float = 2.0, caption: str = "a person walks", speed: float = 1.2) -> Motion:
    """A figure that strides along +z: legs and arms swing as pendulums around the resting body."""
    times = np.arange(round(seconds * 20)) / 20
    joints = np.tile(HUMANML3D.rest_joints(), (len(times), 1, 1))
    joints += [0.0, -joints[..., 1].min(), 0.0]
    swing = 0.6 * np.sin(2 * np.pi * times)
    for hip, limb, sign in ((1, (4, 7, 10), 1), (2, (5, 8, 11), -1), (16, (18, 20), -1)):
        for joint in limb:
            arm = joints[:, joint] - joints[:, hip]
            joints[:, joint, 2] += sign * np.sin(swing) * -arm[:, 1]
            joints[:, joint, 1] += (np.cos(swing) - 1) * arm[:, 1]
    joints[..., 2] += speed * times[:, None]
    return Motion(joints.astype(np.float32), caption=caption)


class Elements(HTMLParser):
    """Collects what a browser would see: start tags with attributes, and text by element."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: dict[str, list[str]] = {}
        self.open = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.open = tag

    def handle_endtag(self, tag: str) -> None:
        self.open = ""

    def handle_data(self, data: str) -> None:
        self.text.setdefault(self.open, []).append(data)


def chromium(address: str, folder: Path, *flags: str) -> str:
    """Opens a page, and skips the test where there is no browser."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")
    waits = "--virtual-time-budget=300"  # until the script is unpacked
    command = [CHROMIUM, *FLAGS, waits, f"--user-data-dir={folder}", "--window-size=700,600"]
    done = subprocess.run([*command, *flags, address], capture_output=True, check=True)
    return done.stdout.decode()


def pictured(address: str, picture: Path, *flags: str) -> None:
    """Opens a page and takes its picture once its script has run; skips where there is no browser.

    Virtual time, as above, never ends where a page draws on the graphics card.

    Args:
        address: Of the page.
        picture: File of the picture.
        flags: Further ones of the browser.
    """
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, *flags])
        page = browser.new_page(viewport={"width": 700, "height": 600})
        page.set_default_timeout(60_000)
        page.goto(address)
        page.wait_for_selector("body[data-joints]", state="attached")
        page.screenshot(path=picture)
        browser.close()
