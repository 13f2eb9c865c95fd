"""A static site on which a model turns sentences into motion in the visitor's browser.

The site is plain files for any host: the page and its scripts, which ship with the package, the
model as `latentmotion export --web` wrote it, and ONNX Runtime's WebAssembly, which does not ship
with it; nor does Pyodide, which cleans motions up and writes their files. `viewer.js`,
`latentmotion.js` and `worker.js` are build products; see
`source/README.md` and `packages/web/build.js`.

Pyodide's npm package has no NumPy, and neither PyPI nor npm has NumPy's wheel for it, so both come
from a folder that the user names. Files that Pyodide's lock file lists are checked against it.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
import shutil
import zipfile
from collections.abc import Iterator
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from latentmotion.errors import InputError
from latentmotion.storage.files import atomic_folder, sha256
from latentmotion.storage.reading import read_json_file

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


_WORKER_FILE = "python.js"
_ARCHIVE_FILE = "latentmotion.zip"
PYODIDE_VERSION = "314.0.7"
"""Version of Pyodide that errors and help name; others are taken as well."""

_LOCK_FILE = "pyodide-lock.json"
_CORE_FILES = ("pyodide.mjs", "pyodide.asm.wasm", "python_stdlib.zip", _LOCK_FILE)
# Names that versions of Pyodide have for one file.
_LOADERS = ("pyodide.asm.mjs", "pyodide.asm.js")

_OLDEST_PYTHON = (3, 11)

# Modules that clean up and write motion; `viewer.js` lies beside the site's page.
_PARTS = (
    *("__init__.py", "arrays.py", "corrections.py", "errors.py", "motion.py", "plugins.py"),
    *("progress.py", "cleanup", "formats", "kinematics", "language", "measure", "render"),
    *("representation", "storage"),
    *("viewer/__init__.py", "viewer/page.py", "viewer/template.html"),
)

# Files of these parts that are needed.
_ENDINGS = (".py", ".json", ".toml", ".tsv", ".txt")

# Distributions that those parts import, besides NumPy, and what of them is needed.
_LIBRARIES = {
    "array-api-compat": ("__init__.py", "_internal.py", "common", "numpy"),
    "jaxtyping": (".",),
    "wadler-lindig": (".",),
}


def write_python(source: Path, output: Path) -> None:
    """Writes the folder from which the page starts Python.

    Args:
        source: Folder of Pyodide's files, with NumPy's wheel.
        output: Folder to make.

    Raises:
        FileFormatError: The lock file is damaged.
        InputError: A file is missing, or is another one than Pyodide's lock file says.
    """
    files = pyodide_files(source)
    output.mkdir()
    for file in files:
        shutil.copyfile(file, output / file.name)
    worker = resources.files("latentmotion.viewer").joinpath("web", _WORKER_FILE)
    (output / _WORKER_FILE).write_bytes(worker.read_bytes())
    sources = list(_files("latentmotion", _PARTS))
    for name, parts in _LIBRARIES.items():
        sources += _files(name.replace("-", "_"), parts)
        for file in metadata.distribution(name).files or ():
            if file.name == "METADATA" or "license" in file.name.lower():
                sources.append((file.as_posix(), file.read_binary()))
    with zipfile.ZipFile(output / _ARCHIVE_FILE, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sources:
            # A fixed time, so that the same package makes the same archive.
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED, 9)


def pyodide_files(folder: Path) -> list[Path]:
    """Returns the files that a page needs, NumPy's wheel last.

    Raises:
        FileFormatError: The lock file is damaged.
        InputError: A file is missing, or is another one than Pyodide's lock file says.
    """
    loader = next((name for name in _LOADERS if (folder / name).is_file()), _LOADERS[0])
    core = [folder / name for name in (*_CORE_FILES, loader)]
    for file in core:
        if not file.is_file():
            raise InputError(
                f"{file} is missing: Pyodide does not come with this package. Run: npm install "
                f"pyodide@{PYODIDE_VERSION}; then pass --pyodide node_modules/pyodide"
            )
    lock = folder / _LOCK_FILE
    facts = read_json_file(lock)
    try:
        python = tuple(int(number) for number in str(facts["info"]["python"]).split(".")[:2])
        numpy: dict[str, Any] = facts["packages"]["numpy"]
        wheel, digest = folder / Path(numpy["file_name"]).name, str(numpy["sha256"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{lock} is no lock file of Pyodide with NumPy ({error!r})") from error
    if python < _OLDEST_PYTHON:
        raise InputError(
            f"{folder} has Python {'.'.join(map(str, python))}, expected 3.11 or later: "
            f"npm install pyodide@{PYODIDE_VERSION}"
        )
    if not wheel.is_file():
        raise InputError(
            f"{wheel} is missing: NumPy for Pyodide is on neither npm nor PyPI. Take this file "
            f"from Pyodide's release of the same version and put it into {folder}: "
            "https://github.com/pyodide/pyodide/releases"
        )
    if sha256(wheel) != digest:
        raise InputError(
            f"{wheel} is damaged or of another version of Pyodide: expected SHA-256 {digest}, as "
            f"{lock.name} says, found {sha256(wheel)}"
        )
    return [*core, wheel]


def _files(package: str, parts: tuple[str, ...]) -> Iterator[tuple[str, bytes]]:
    """Yields names and contents of a package's files."""
    spec = importlib.util.find_spec(package)
    assert spec is not None and spec.submodule_search_locations is not None
    root = Path(next(iter(spec.submodule_search_locations)))
    for part in parts:
        whole = root / part
        # Tables beside modules, too: skeletons, names of bones, acts and words.
        inside = (file for file in whole.rglob("*.*") if file.suffix in _ENDINGS)
        for file in sorted(inside) if whole.is_dir() else [whole]:
            yield f"{package}/{file.relative_to(root).as_posix()}", file.read_bytes()
