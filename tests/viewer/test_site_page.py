"""The static site's page in a real browser, with and without Python in it.

The model is a stand-in that always makes the same walk. So is Pyodide, whose stand-in lets this
process run the function that the page calls; `LATENTMOTION_PYODIDE=folder` takes the real one.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import shutil
import threading
import zipfile
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.corrections import Corrections
from latentmotion.formats.content import rewritten
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion
from latentmotion.viewer.site import RUNTIME_FILE
from tests.support.pages import CHROMIUM, walking

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
if CHROMIUM is None:
    pytest.skip("needs Chromium (Debian: apt-get install chromium)", allow_module_level=True)

AXE = Path(__file__).parents[2] / "src/latentmotion/viewer/source/node_modules/axe-core/axe.min.js"
PATIENCE = 120_000  # milliseconds; a busy machine is no fault of the page
FLAGS = ("--no-sandbox", "--disable-3d-apis")  # figures drawn without WebGL cost little
REAL = os.environ.get("LATENTMOTION_PYODIDE")
GENERATED = Corrections(sharpens=True, settles=True)  # of a motion whose length is given

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
"""What stands for `latentmotion.js`."""

CONTROLLED = """
async () => {
  const { serviceWorker } = navigator;
  if (serviceWorker.controller) return;
  await new Promise((found) => serviceWorker.addEventListener("controllerchange", found));
}
"""
"""Waits until the service worker hears of what the page asks for."""

PYODIDE = """
export async function loadPyodide() {
  function rewritten(content, form, clean) {
    const request = new XMLHttpRequest();
    const place = new URL(`../rewritten?form=${form}&clean=${clean}`, import.meta.url);
    request.open("POST", place, false);
    request.responseType = "arraybuffer";
    request.send(content);
    if (request.status !== 200) throw new Error("Traceback\\nerrors.InputError: cannot be written");
    const answer = [new Uint8Array(request.response), request.getResponseHeader("X-Form")];
    return { toJs: () => answer };
  }
  return {
    unpackArchive() {}, FS: { writeFile() {} }, toPy: (content) => content,
    pyimport: () => ({ path: { insert() {} }, rewritten }),
  };
}
"""
"""What stands for `pyodide.mjs`."""


class Host(SimpleHTTPRequestHandler):
    """A static host that forbids foreign code, and runs Python where Pyodide is a stand-in."""

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

    def do_POST(self) -> None:
        query = parse_qs(urlsplit(self.path).query)
        content = self.rfile.read(int(self.headers["Content-Length"]))
        answer, form = rewritten(content, query["form"][0], query["clean"] == ["true"])
        self.send_response(200)
        self.send_header("X-Form", form)
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def pyodide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of Pyodide's files."""
    if REAL:
        return Path(REAL)
    folder = tmp_path_factory.mktemp("pyodide")
    for name in ("pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "numpy.whl"):
        (folder / name).write_bytes(name.encode())
    (folder / "pyodide.mjs").write_text(PYODIDE)
    wheel = {"file_name": "numpy.whl", "sha256": hashlib.sha256(b"numpy.whl").hexdigest()}
    lock = {"info": {"python": "3.14.2"}, "packages": {"numpy": wheel}}
    (folder / "pyodide-lock.json").write_text(json.dumps(lock))
    return folder


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
def sites(
    parts: list[str], pyodide: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[str]:
    """The address of a host with sites: `with` Python, `without`, `broken`, `labels`, `nothing`."""
    root = tmp_path_factory.mktemp("root")
    for name in ("with", "without", "broken"):
        python = [] if name == "without" else ["--pyodide", str(pyodide)]
        main(["web", *parts, "-o", str(root / name), *python])
        (root / name / "latentmotion.js").write_text(MODEL)
    (root / "broken" / "python" / "pyodide.mjs").unlink()
    for name, labels in (("labels", ["walk", "jump"]), ("nothing", [])):
        shutil.copytree(root / "without", root / name)
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


def test_python_cleans_up_and_writes_what_is_shown(page):
    made(page, "with")
    assert not any("/python/" in name for name in Host.asked)
    before = shown(page)
    page.check("#clean")
    page.wait_for_selector("#status:has-text('Cleaned up.')")
    expected = Motion(before[0]).cleaned(corrections=GENERATED).joints
    np.testing.assert_allclose(shown(page), [expected] * 2, atol=1e-6)
    assert np.abs(expected - before[0]).max() > 0.005
    npz = saved(page, "npz")
    assert npz.name == "a_person_walks_3.npz"
    for form in ("glb", "csv", "html", "bvh"):
        file = saved(page, form)
        content, ending = rewritten(npz.read_bytes(), form)
        assert file.name == f"a_person_walks_3.{ending}"
        assert abs(len(content) - file.stat().st_size) < 0.01 * len(content)
        if form in formats.READABLE:
            (native := file.with_name(f"native.{form}")).write_bytes(content)
            for mine, theirs in zip(formats.load(native), formats.load(file), strict=True):
                np.testing.assert_allclose(mine.joints, theirs.joints, atol=1e-4)
    with zipfile.ZipFile(file) as archive:
        assert archive.namelist() == ["motion-1.bvh", "motion-2.bvh"]
    page.uncheck("#clean")
    page.wait_for_selector("#status:has-text('As the model made it.')")
    np.testing.assert_array_equal(shown(page), before)


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


def test_one_take_is_looked_at_cleaned_up_and_saved_alone(page):
    made(page, "with")
    page.click("#takes button:last-child")
    page.check("#clean")
    page.wait_for_selector("#status:has-text('Cleaned up.')")
    assert page.inner_text("#takes [aria-pressed=true]") == "seed 4"
    (motion,) = formats.load(saved(page, "npz"))
    assert motion.metadata["seed"] == 4
    np.testing.assert_array_equal(motion.joints, shown(page)[1])


def test_a_figure_is_chosen_for_all_takes(page):
    made(page, "without")
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


def test_python_that_was_used_works_without_a_network(page, monkeypatch):
    page.goto("/with/")
    page.evaluate(CONTROLLED)
    made(page, "with")
    saved(page, "glb")
    monkeypatch.setattr(Host, "is_down", True)
    Host.asked.clear()
    page.reload()
    page.wait_for_selector("body[data-state=ready][data-takes='2']")
    assert len(formats.load(saved(page, "glb"))) == 2
    assert {name.split("?")[0] for name in Host.asked} <= {"/with/service.js"}
    page.faults[:] = [fault for fault in page.faults if "503" not in fault]


@pytest.mark.parametrize("form", ("glb", "bvh", "npz"))
def test_without_python_the_page_offers_what_it_can_do(page, form):
    made(page, "without")
    assert "--pyodide" not in page.inner_text("body")
    assert page.is_hidden("#clean")
    offered = page.eval_on_selector_all("#format option", "all => all.map((o) => o.value)")
    assert offered == ["glb", "bvh", "npz"]
    page.click("#takes button:first-child")
    (motion,) = formats.load(saved(page, form))
    assert len(motion) == 40
    assert np.abs(motion.joints - shown(page)[0]).mean() < 0.03
    if form != "bvh":
        assert motion.caption == "a person walks"
        assert motion.metadata["weights_license"] == "CC0"
    assert not any("/python/" in name for name in Host.asked)


def test_python_that_cannot_be_loaded_takes_nothing_away(page):
    made(page, "broken")
    page.check("#clean")
    page.wait_for_selector("#status.wrong")
    assert "pyodide.mjs" in page.inner_text("#status")
    assert not page.is_checked("#clean")
    assert len(formats.load(saved(page, "npz"))) == 2
    page.faults[:] = [fault for fault in page.faults if "404" not in fault]


@pytest.mark.parametrize("site", ("with", "without"))
@pytest.mark.parametrize(("width", "colors"), [(1280, "light"), (390, "dark")])
def test_the_page_fits_and_can_be_used_by_all(page, site, width, colors):
    page.set_viewport_size({"width": width, "height": 700})
    page.emulate_media(color_scheme=colors, reduced_motion="reduce")
    made(page, site)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    box = page.locator("#controls").bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= width
    if not AXE.is_file():
        pytest.skip("needs axe-core: cd src/latentmotion/viewer/source && npm ci")
    page.evaluate(AXE.read_text())
    found = page.evaluate("async () => (await axe.run()).violations")
    serious = [one for one in found if one["impact"] in ("serious", "critical")]
    assert [(one["id"], one["nodes"][0]["html"]) for one in serious] == []
