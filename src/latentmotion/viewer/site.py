"""A static site on which a model turns sentences into motion in the visitor's browser.

The site is plain files for any host: the page and its scripts, which ship with the package, the
model as `latentmotion export --web` wrote it, and ONNX Runtime's WebAssembly, which does not ship
with it. `viewer.js`, `latentmotion.js` and `worker.js` are build products; see `source/README.md`
and `packages/web/build.js`.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from importlib import resources
from pathlib import Path

from latentmotion.errors import InputError
from latentmotion.storage.files import atomic_folder, sha256

MODEL_FOLDER = "model"
MANIFEST_FILE = "web.json"
RUNTIME_FILE = "ort-wasm-simd-threaded.wasm"
# Version of onnxruntime-web that `worker.js` holds: its WebAssembly has to match.
RUNTIME_VERSION = "1.30.0"

_SERVICE = "service.js"
_PAGE_FILES = ("index.html", "site.css", "latentmotion.js", "worker.js", "LICENSES.txt", _SERVICE)


def write_site(output: Path, model: Path, runtime: Path) -> None:
    """Writes the site.

    Args:
        output: Folder to write, replaced as a whole.
        model: Folder that `latentmotion export --web` wrote.
        runtime: Folder with ONNX Runtime's `ort-wasm-simd-threaded.wasm`.

    Raises:
        InputError: A folder lacks its files, or there is something else at `output`.
    """
    wasm = runtime_file(runtime)
    if not (model / MANIFEST_FILE).is_file():
        raise InputError(
            f"{model} has no {MANIFEST_FILE}; make one: latentmotion export MODEL --web -o {model}"
        )
    shipped = resources.files("latentmotion.viewer")
    with atomic_folder(output, _SERVICE) as folder:
        (folder / "viewer.js").write_bytes(shipped.joinpath("viewer.js").read_bytes())
        for name in _PAGE_FILES:
            (folder / name).write_bytes(shipped.joinpath("web", name).read_bytes())
        shutil.copyfile(wasm, folder / RUNTIME_FILE)
        shutil.copytree(model, folder / MODEL_FOLDER)
        files = sorted(file for file in folder.iterdir() if file.is_file())
        names = ["./", *(file.name for file in files if file.name != _SERVICE)]
        # Files of another version of the site are told apart by it.
        version = hashlib.sha256("".join(map(sha256, files)).encode()).hexdigest()[:16]
        text = (folder / _SERVICE).read_text("utf-8").replace("{{version}}", version)
        (folder / _SERVICE).write_text(text.replace("{{files}}", json.dumps(names)), "utf-8")


def runtime_file(folder: Path) -> Path:
    """Returns the WebAssembly of a folder, of the version that the scripts were built with."""
    file = folder / RUNTIME_FILE
    if not file.is_file():
        raise InputError(
            f"{file} is missing: ONNX Runtime's WebAssembly (14 MB) does not come with this "
            f"package. Run: npm install onnxruntime-web@{RUNTIME_VERSION}; then pass "
            "--runtime node_modules/onnxruntime-web/dist"
        )
    package = folder.parent / "package.json"
    if package.is_file():
        version = json.loads(package.read_text("utf-8")).get("version")
        if version != RUNTIME_VERSION:
            raise InputError(
                f"{folder} is of onnxruntime-web {version}, the page needs {RUNTIME_VERSION}. Run: "
                f"npm install onnxruntime-web@{RUNTIME_VERSION}"
            )
    return file
