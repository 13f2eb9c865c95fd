"""The static site: complete, from files at hand, and nothing in it that its host did not choose."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from latentmotion.cli.main import main
from latentmotion.viewer.site import RUNTIME_FILE, RUNTIME_VERSION

PAGE = {"index.html", "site.css", "viewer.js", "latentmotion.js", "worker.js", "LICENSES.txt"}


@pytest.fixture
def parts(tmp_path: Path) -> list[str]:
    """Options for a model and a runtime of few bytes."""
    model, runtime = tmp_path / "model", tmp_path / "onnxruntime-web" / "dist"
    model.mkdir()
    runtime.mkdir(parents=True)
    (model / "web.json").write_text("{}")
    (runtime / RUNTIME_FILE).write_bytes(b"\0asm")
    package = {"name": "onnxruntime-web", "version": RUNTIME_VERSION}
    (runtime.parent / "package.json").write_text(json.dumps(package))
    return [str(model), "--runtime", str(runtime), "-o", str(tmp_path / "site")]


def test_the_site_is_complete(parts: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    main(["web", *parts])
    main(["web", *parts])  # a site is replaced
    assert f"wrote {tmp_path / 'site'}" in capsys.readouterr().out
    site = tmp_path / "site"
    assert {file.name for file in site.iterdir()} == PAGE | {"model", "service.js", RUNTIME_FILE}
    kept = re.search(r"FILES = (\[.*\]);", (site / "service.js").read_text("utf-8"))
    assert kept is not None
    assert set(json.loads(kept[1])) == PAGE | {"./", RUNTIME_FILE}
    page = (site / "index.html").read_text("utf-8")
    for name in re.findall(r'(?:src|href)="([^"]+)"', page):
        assert name.startswith("data:") or (site / name).is_file()


def test_the_page_runs_no_code_but_its_own(parts: list[str], tmp_path: Path):
    main(["web", *parts])
    page = (tmp_path / "site" / "index.html").read_text("utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    assert policy is not None
    assert "unsafe-inline" not in policy[1]
    assert "default-src 'none'" in policy[1]
    assert not re.search(r"<script>|<style>| style=| on\w+=|https?://", page)
    scripts = ("latentmotion.js", "worker.js", "site.css")
    texts = [(tmp_path / "site" / name).read_text("utf-8") for name in scripts]
    assert not any("cdn." in text or "unpkg" in text for text in texts)


@pytest.mark.parametrize("lack", ("model", "runtime", "version"))
def test_what_is_missing_is_said(lack: str, parts: list[str], tmp_path: Path, capsys):
    runtime = tmp_path / "onnxruntime-web"
    if lack == "model":
        (tmp_path / "model" / "web.json").unlink()
        parts[0] = "nobody"
    elif lack == "runtime":
        (runtime / "dist" / RUNTIME_FILE).unlink()
    else:
        (runtime / "package.json").write_text('{"version": "1.2.3"}')
    with pytest.raises(SystemExit):
        main(["web", *parts])
    words = {"model": "nobody", "runtime": "npm install onnxruntime-web@", "version": "1.2.3"}[lack]
    assert words in capsys.readouterr().err
    assert not (tmp_path / "site").exists()
