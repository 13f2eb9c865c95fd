"""The static site's page in a real browser; its model is a stand-in that always makes one walk."""

from __future__ import annotations

import functools
import json
import shutil
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.viewer.site import RUNTIME_FILE
from tests.support.pages import CHROMIUM, walking

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
if CHROMIUM is None:
    pytest.skip("needs Chromium (Debian: apt-get install chromium)", allow_module_level=True)

AXE = Path(__file__).parents[2] / "src/latentmotion/viewer/source/node_modules/axe-core/axe.min.js"
PATIENCE = 120_000  # milliseconds; a busy machine is no fault of the page
FLAGS = ("--no-sandbox", "--disable-3d-apis")  # figures drawn without WebGL cost little
# What stands for `latentmotion.js`.
MODEL = """
export async function load(folder) {
  const kept = await caches.open("model");
  const get = async (name) => {
    const place = `${folder}${name}`;
    if (!(await kept.match(place))) await kept.add(place);
    return kept.match(place);
  };
  const model = await (await get("web.json")).json();
  const joints = new Float32Array(await (await get("weights.bin")).arrayBuffer());
  const frames = joints.length / model.skeleton.names.length / 3;
  const generate = async (prompt, asked) => ({
    ...asked, prompt, frames, joints: joints.slice(), fps: model.fps, seconds: frames / model.fps,
    skeleton: model.skeleton, model: model.name,
    rights: model.rights, weightsLicense: model.weightsLicense,
  });
  return { model, generate };
}
"""

# Waits until the service worker hears of what the page asks for.
CONTROLLED = """
async () => {
  const { serviceWorker } = navigator;
  if (serviceWorker.controller) return;
  await new Promise((found) => serviceWorker.addEventListener("controllerchange", found));
}
"""


class Host(SimpleHTTPRequestHandler):
    """A static host that forbids foreign code."""

    asked: ClassVar[list[str]] = []
    is_down: ClassVar[bool] = False

    def end_headers(self) -> None:
        self.send_header("Content-Security-Policy", "script-src 'self' 'wasm-unsafe-eval'")
        super().end_headers()

    def do_GET(self) -> None:
        self.asked.append(self.path)
        if Host.is_down:
            self.send_error(503)
        else:
            super().do_GET()

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Options for a model and a runtime that are stand-ins."""
    folder = tmp_path_factory.mktemp("parts")
    skeleton = {
        "name": HUMANML3D.name,
        "names": HUMANML3D.names,
        "parents": HUMANML3D.parents,
        "directions": HUMANML3D.offsets.tolist(),
    }
    about = {"name": "walk", "rights": "any", "weightsLicense": "CC0", "fps": 20, "steps": [4]}
    about |= {"skeleton": skeleton}
    about |= {"guidance": [1, 9], "frames": [12, 196], "usual": {"steps": 4, "guidance": 4}}
    (folder / "web.json").write_text(json.dumps(about))
    trembling = np.random.default_rng(0).normal(0, 0.01, walking().joints.shape)
    (folder / "weights.bin").write_bytes((walking().joints + trembling).astype("<f4").tobytes())
    (folder / RUNTIME_FILE).write_bytes(b"\0asm")
    return [str(folder), "--runtime", str(folder)]


@pytest.fixture(scope="module")
def sites(parts: list[str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a host with sites: `sentences`, `labels` and `nothing`."""
    root = tmp_path_factory.mktemp("root")
    main(["web", *parts, "-o", str(root / "sentences")])
    (root / "sentences" / "latentmotion.js").write_text(MODEL)
    for name, labels in (("labels", ["walk", "jump"]), ("nothing", [])):
        shutil.copytree(root / "sentences", root / name)
        about = root / name / "model" / "web.json"
        kind = {"prompts": name, "labels": labels}
        about.write_text(json.dumps(json.loads(about.read_text()) | kind))
    with ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Host, directory=str(root))
    ) as host:
        thread = threading.Thread(target=host.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{host.server_port}"
        host.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        yield driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))


@pytest.fixture
def page(browser: Any, sites: str) -> Iterator[Any]:
    """A page without anything kept; what it asks of other hosts or is refused is a fault."""
    context = browser.new_context(
        viewport={"width": 840, "height": 560}, reduced_motion="reduce", base_url=sites
    )
    context.set_default_timeout(PATIENCE)
    page = context.new_page()
    page.faults = []
    page.on("console", lambda said: said.type == "error" and page.faults.append(said.text))
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    context.on("request", lambda asked: noted(page, sites, asked.url))
    Host.asked.clear()
    yield page
    context.close()
    assert page.faults == []


def noted(page: Any, host: str, address: str) -> None:
    if not address.startswith((host, f"blob:{host}", "data:")):
        page.faults.append(address)


def made(page: Any, site: str, takes: int = 2) -> None:
    """Opens a site that makes takes."""
    page.goto(f"/{site}/#prompt=a+person+walks&takes={takes}&seed=3")
    page.wait_for_selector(f"body[data-state=ready][data-takes='{takes}']")


def saved(page: Any, form: str) -> Path:
    page.select_option("#format", form)
    with page.expect_download() as download:
        page.click("#write")
    path = download.value.path()
    page.wait_for_selector("body[data-state=ready]")
    return path.rename(path.with_name(download.value.suggested_filename))


def shown(page: Any) -> np.ndarray:
    return np.array(
        page.evaluate("latentmotion.player.takes.map((take) => [...take.positions])"), np.float32
    ).reshape(-1, 40, 22, 3)


def test_a_model_of_labels_offers_them(page):
    page.goto("/labels/")
    page.wait_for_selector("#status:has-text('Choose what the person does')")
    assert page.locator("select#prompt option").all_inner_texts() == ["walk", "jump"]
    page.select_option("#prompt", "jump")
    page.click("#generate")
    page.wait_for_selector("body[data-state=ready][data-takes='3']")
    assert "prompt=jump" in page.url


def test_a_model_without_prompts_has_no_field_for_one(page):
    page.goto("/nothing/")
    page.wait_for_selector("#status:has-text('moves as it likes')")
    assert page.is_hidden("#prompt")
    page.click("#generate")
    page.wait_for_selector("body[data-state=ready][data-takes='3']")


def test_one_take_is_looked_at_and_saved_alone(page):
    made(page, "sentences")
    page.click("#takes button:last-child")
    assert page.inner_text("#takes [aria-pressed=true]") == "seed 4"
    (motion,) = formats.load(saved(page, "npz"))
    assert motion.metadata["seed"] == 4
    np.testing.assert_array_equal(motion.joints, shown(page)[1])


def test_a_figure_is_chosen_for_all_takes(page):
    made(page, "sentences")
    page.click("#takes button:last-child")
    # Without WebGL all figures are lines, so what the stage is asked for is looked at.
    page.evaluate(
        "() => { latentmotion.player.stage.show ="
        " (_, __, { makers }) => { window.makers = makers.length } }"
    )
    page.select_option("#figure", "stick")
    page.wait_for_function("window.makers === 2")
    assert page.inner_text("#takes [aria-pressed=true]") == "seed 4"
    page.select_option("#figure", "mannequin")
    page.wait_for_function("window.makers === 0")
    assert len(shown(page)) == 2


def test_the_page_works_without_a_network(page, monkeypatch):
    page.goto("/sentences/")
    page.evaluate(CONTROLLED)
    made(page, "sentences")
    saved(page, "glb")
    monkeypatch.setattr(Host, "is_down", True)
    Host.asked.clear()
    page.reload()
    page.wait_for_selector("body[data-state=ready][data-takes='2']")
    assert len(formats.load(saved(page, "glb"))) == 2
    assert {name.split("?")[0] for name in Host.asked} <= {"/sentences/service.js"}
    page.faults[:] = [fault for fault in page.faults if "503" not in fault]


@pytest.mark.parametrize("form", ("glb", "bvh", "npz"))
def test_files_hold_what_is_shown(page, form):
    made(page, "sentences")
    offered = page.eval_on_selector_all("#format option", "all => all.map((o) => o.value)")
    assert offered == ["glb", "bvh", "npz"]
    page.click("#takes button:first-child")
    (motion,) = formats.load(saved(page, form))
    assert len(motion) == 40
    assert np.abs(motion.joints - shown(page)[0]).mean() < 0.03
    if form != "bvh":
        assert motion.caption == "a person walks"
        assert motion.metadata["weights_license"] == "CC0"


@pytest.mark.parametrize(("width", "colors"), [(1280, "light"), (390, "dark")])
def test_the_page_fits_and_can_be_used_by_all(page, width, colors):
    page.set_viewport_size({"width": width, "height": 700})
    page.emulate_media(color_scheme=colors, reduced_motion="reduce")
    made(page, "sentences")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    box = page.locator("#controls").bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= width
    if not AXE.is_file():
        pytest.skip("needs axe-core: cd src/latentmotion/viewer/source && npm ci")
    page.evaluate(AXE.read_text())
    found = page.evaluate("async () => (await axe.run()).violations")
    serious = [one for one in found if one["impact"] in ("serious", "critical")]
    assert [(one["id"], one["nodes"][0]["html"]) for one in serious] == []
