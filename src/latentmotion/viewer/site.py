"""A static site on which a model turns sentences into motion in the visitor's browser.

The site is plain files for any host: the page and its scripts, which ship with the package, the
model as `latentmotion export --web` wrote it, and ONNX Runtime's WebAssembly, which does not ship
with it; nor does Pyodide, which cleans motions up and writes their files. `viewer.js`,
`latentmotion.js` and `worker.js` are build products; see
`source/README.md` and `packages/web/build.js`.
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from importlib import resources
from pathlib import Path

from latentmotion.errors import InputError
from latentmotion.storage.files import atomic_folder, sha256
from latentmotion.viewer.pyodide import write_python

MODEL_FOLDER = "model"
PYTHON_FOLDER = "python"
MANIFEST_FILE = "web.json"
RUNTIME_FILE = "ort-wasm-simd-threaded.wasm"
RUNTIME_VERSION = "1.30.0"
"""Version of onnxruntime-web that `worker.js` holds: its WebAssembly has to match."""

_PAGE = "index.html"
_SERVICE = "service.js"
_PAGE_FILES = (_PAGE, "site.css", "latentmotion.js", "worker.js", "LICENSES.txt", _SERVICE)


def write_site(output: Path, model: Path, runtime: Path, pyodide: Path | None = None) -> None:
    """Writes the site.

    Args:
        output: Folder to write, replaced as a whole.
        model: Folder that `latentmotion export --web` wrote.
        runtime: Folder with ONNX Runtime's `ort-wasm-simd-threaded.wasm`.
        pyodide: Folder of Pyodide's files with NumPy's wheel; without it the page says that it
            cannot clean motions up, and which formats it lacks.

    Raises:
        FileFormatError: A file is damaged.
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
        python: list[Path] = []
        if pyodide is not None:
            write_python(pyodide, folder / PYTHON_FOLDER)
            python = sorted((folder / PYTHON_FOLDER).iterdir())
        size = sum(file.stat().st_size for file in python) / 1e6
        _fill(folder / _PAGE, {"python": str(math.ceil(size))})
        files = sorted(file for file in folder.iterdir() if file.is_file())
        names = ["./", *(file.name for file in files if file.name != _SERVICE)]
        fields = {"version": _digest(files), "python": _digest(python), "files": json.dumps(names)}
        _fill(folder / _SERVICE, fields)


def _fill(file: Path, fields: dict[str, str]) -> None:
    text = file.read_text("utf-8")
    for field, value in fields.items():
        text = text.replace(f"{{{{{field}}}}}", value)
    file.write_text(text, "utf-8")


def _digest(files: list[Path]) -> str:
    """Returns a digest by which files of another version of the site are told apart."""
    return hashlib.sha256("".join(map(sha256, files)).encode()).hexdigest()[:16]


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
