"""Python for the site: checked against Pyodide's lock file, complete, and the function it runs."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.corrections import Corrections
from latentmotion.errors import InputError, LatentMotionError
from latentmotion.formats.content import rewritten
from latentmotion.viewer.site import pyodide_files, write_python
from tests.support.pages import walking

GENERATED = Corrections(sharpens=True, settles=True)
"""What generated motions of a given length are cleaned up with."""

WITHOUT = ("lzma", "ssl", "sqlite3", "_multiprocessing", "fcntl", "safetensors", "onnxruntime")
"""Modules that Python in the browser lacks."""


@pytest.fixture
def pyodide(tmp_path: Path) -> Path:
    """A folder with files of the names of Pyodide's."""
    folder = tmp_path / "pyodide"
    folder.mkdir()
    for name in ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip"):
        (folder / name).write_text(name)
    (folder / "numpy.whl").write_bytes(b"wheel")
    lock(folder)
    return folder


def lock(folder: Path, python: str = "3.14.2", file: str = "numpy.whl") -> None:
    wheel = {"file_name": file, "sha256": hashlib.sha256(b"wheel").hexdigest()}
    facts = {"info": {"python": python}, "packages": {"numpy": wheel}}
    (folder / "pyodide-lock.json").write_text(json.dumps(facts))


def test_the_archive_and_numpy_are_all_that_python_needs(pyodide, tmp_path):
    write_python(pyodide, tmp_path / "python")
    with zipfile.ZipFile(tmp_path / "python" / "latentmotion.zip") as archive:
        archive.extractall(tmp_path / "packages")
    (tmp_path / "packages" / "latentmotion" / "viewer" / "viewer.js").write_text("// script")
    numpy = Path(np.__file__).parent
    for folder in (numpy, numpy.with_name("numpy.libs")):
        (tmp_path / "packages" / folder.name).symlink_to(folder)
    walking().save(tmp_path / "walk.npz")
    program = f"""
import sys
sys.path.insert(0, {str(tmp_path / "packages")!r})
sys.modules.update(dict.fromkeys({WITHOUT}))
from latentmotion.formats.content import rewritten
content = open("walk.npz", "rb").read()
for form in ("raw", "glb", "bvh", "csv", "html", "npz"):
    with open("walk2." + form, "wb") as file:
        file.write(rewritten(content, form, clean=form == "raw")[0])
"""
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    content = (tmp_path / "walk.npz").read_bytes()
    for form in ("bvh", "csv", "glb"):
        assert (tmp_path / f"walk2.{form}").read_bytes() == rewritten(content, form)[0]
    packed = re.search('atob\\("(.*?)"', (tmp_path / "walk2.html").read_text("utf-8"))
    assert packed is not None and b"// script" in gzip.decompress(base64.b64decode(packed[1]))
    cleaned = walking().cleaned(corrections=GENERATED)
    assert (tmp_path / "walk2.raw").read_bytes() == cleaned.joints.tobytes()


def test_the_same_files_make_the_same_folder(pyodide, tmp_path):
    write_python(pyodide, tmp_path / "one")
    write_python(pyodide, tmp_path / "two")
    names = {file.name for file in (tmp_path / "one").iterdir()}
    assert names == {file.name for file in pyodide.iterdir()} | {"python.js", "latentmotion.zip"}
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_older_versions_have_a_loader_of_another_name(pyodide):
    (pyodide / "pyodide.asm.mjs").rename(pyodide / "pyodide.asm.js")
    assert pyodide / "pyodide.asm.js" in pyodide_files(pyodide)


@pytest.mark.parametrize("name", ("pyodide.mjs", "pyodide.asm.mjs", "pyodide-lock.json"))
def test_a_missing_file_is_named(pyodide, name):
    (pyodide / name).unlink()
    with pytest.raises(InputError, match=rf"{name} is missing.*npm install pyodide@"):
        pyodide_files(pyodide)


def test_a_missing_wheel_is_named_and_where_it_is(pyodide):
    (pyodide / "numpy.whl").unlink()
    with pytest.raises(InputError, match=r"numpy.whl is missing.*release"):
        pyodide_files(pyodide)


def test_another_wheel_is_refused(pyodide, tmp_path):
    (pyodide / "numpy.whl").write_bytes(b"another")
    with pytest.raises(InputError, match="SHA-256"):
        write_python(pyodide, tmp_path / "python")
    assert not (tmp_path / "python").exists()


def test_a_wheel_lies_beside_its_lock_file(pyodide, tmp_path):
    (tmp_path / "numpy.whl").write_bytes(b"wheel")
    lock(pyodide, file="../numpy.whl")
    assert pyodide_files(pyodide)[-1] == pyodide / "numpy.whl"


def test_an_old_python_is_refused(pyodide):
    lock(pyodide, python="3.10.2")
    with pytest.raises(InputError, match=r"has Python 3\.10, expected 3\.11"):
        pyodide_files(pyodide)


@pytest.mark.parametrize("content", ("[]", "{", '{"info": {"python": "3.14"}, "packages": {}}'))
def test_a_damaged_lock_file_is_refused(pyodide, content):
    (pyodide / "pyodide-lock.json").write_text(content)
    with pytest.raises(LatentMotionError, match=r"pyodide-lock\.json"):
        pyodide_files(pyodide)


def test_rewritten_motions_are_the_cleaned_ones(tmp_path):
    formats.save(tmp_path / "two.npz", [walking(), walking(3.0)])
    content = (tmp_path / "two.npz").read_bytes()
    raw, form = rewritten(content, "raw", True)
    walks = [walking(seconds).cleaned(corrections=GENERATED) for seconds in (2.0, 3.0)]
    expected = [walk.joints.ravel() for walk in walks]
    assert [len(walk) for walk in walks] == [len(walking()), len(walking(3.0))]
    assert form == "raw"
    np.testing.assert_allclose(np.frombuffer(raw, "<f4"), np.concatenate(expected), atol=1e-6)
    assert rewritten(content, "bvh")[1] == "zip"


@pytest.mark.parametrize(("content", "form"), [(b"PK nothing", "glb"), (None, "nope")])
def test_what_cannot_be_rewritten_is_refused_in_words(content, form, tmp_path):
    walking().save(tmp_path / "walk.npz")
    with pytest.raises(LatentMotionError, match=r"\.nope|motion\.npz"):
        rewritten(content or (tmp_path / "walk.npz").read_bytes(), form)
