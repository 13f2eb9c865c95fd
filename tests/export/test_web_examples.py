"""The npm package's examples in Chromium: plain HTML, three.js, React."""

from __future__ import annotations

import functools
import shutil
import subprocess
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from tests.support.pages import CHROMIUM, FLAGS, walking

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
if CHROMIUM is None:
    pytest.skip("needs Chromium (Debian: apt-get install chromium)", allow_module_level=True)

PACKAGE = Path(__file__).parents[2] / "packages" / "web"
PAGE = """<!doctype html><title>example</title><body><div id="root"></div>
<script type="module" src="{}.js"></script>"""
BUNDLED = {"three": "three.js", "react": "react.jsx"}


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Says nothing."""


@pytest.fixture(scope="module")
def host(web_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A static host of the examples beside what they load."""
    if not (PACKAGE / "node_modules" / "react").is_dir():
        pytest.skip("needs the package's dependencies: cd packages/web && npm ci")
    root = tmp_path_factory.mktemp("examples")
    shutil.copytree(web_folder, root / "model")
    shipped = resources.files("latentmotion.viewer").joinpath("web")
    for name in ("latentmotion.js", "worker.js"):
        (root / name).write_bytes(shipped.joinpath(name).read_bytes())
    wasm = "ort-wasm-simd-threaded.wasm"
    shutil.copyfile(PACKAGE / "node_modules/onnxruntime-web/dist" / wasm, root / wasm)
    shutil.copyfile(PACKAGE / "examples/plain.html", root / "plain.html")
    walking().save(root / "figure.glb")
    for name, source in BUNDLED.items():
        command = ["node_modules/.bin/esbuild", f"examples/{source}", "--bundle", "--format=esm"]
        command += ["--jsx=automatic", "--alias:latentmotion=./latentmotion.js"]
        command += ["--external:./latentmotion.js", f"--outfile={root / name}.js"]
        subprocess.run(command, cwd=PACKAGE, check=True, capture_output=True)
        (root / f"{name}.html").write_text(PAGE.format(name))
    handler = functools.partial(Quiet, directory=str(root))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.fixture
def page(host: str) -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        page = browser.new_page(base_url=host, viewport={"width": 400, "height": 300})
        page.set_default_timeout(120_000)
        page.faults = []
        page.on("pageerror", lambda error: page.faults.append(str(error)))
        yield page
        assert page.faults == []


def test_plain_page_draws_a_stick_figure(page):
    page.goto("/plain.html")
    page.wait_for_selector("body[data-state=ready]")
    pen = "document.querySelector('canvas').getContext('2d')"
    drawn = f"{pen}.getImageData(0, 0, 400, 400).data.filter((v, i) => i % 4 === 3 && v).length"
    assert page.evaluate(drawn) > 200


def test_three_moves_a_skinned_figure(page):
    page.goto("/three.html")
    page.wait_for_selector("body[data-state=ready]")
    first = page.locator("canvas").screenshot()
    page.wait_for_timeout(1500)
    assert page.locator("canvas").screenshot() != first


def test_react_gives_a_question_up_when_the_prompt_changes(page):
    page.goto("/react.html")
    page.fill("input", "a person sits")
    page.fill("input", "a person sits down")
    page.wait_for_selector("main[data-state=ready]")
    assert page.inner_text("p") == "a person sits down: 3 s, 60 frames"
