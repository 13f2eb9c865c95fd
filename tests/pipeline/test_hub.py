"""Models by name, folder or hub id: only an id is downloaded, and of it only a model's files."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.errors import MissingExtraError, ModelError
from latentmotion.model.card import download, find_model, is_hub_id

COMMIT = "0123456789abcdef0123456789abcdef01234567"
MODEL = "someone/walks"


@dataclass
class Hub:
    """A server on loopback that knows one model, as far as huggingface_hub asks."""

    files: dict[str, bytes]
    asked: list[str] = field(default_factory=list)

    def handler(self) -> type[BaseHTTPRequestHandler]:
        hub = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                path = self.path.partition("?")[0]
                hub.asked.append(path)
                information = re.fullmatch(rf"/api/models/{MODEL}(/revision/(main|v2))?", path)
                file = path.removeprefix(f"/{MODEL}/resolve/{COMMIT}/")
                if information:
                    names = [{"rfilename": name} for name in hub.files]
                    about = {"id": MODEL, "sha": COMMIT, "siblings": names}
                    self._answer(200, json.dumps(about).encode(), "application/json")
                elif path == f"/api/models/{MODEL}/tree/{COMMIT}":
                    listed = [
                        {"type": "file", "oid": "0" * 40, "size": len(content), "path": name}
                        for name, content in hub.files.items()
                    ]
                    self._answer(200, json.dumps(listed).encode(), "application/json")
                elif file in hub.files:
                    self._answer(200, hub.files[file], "application/octet-stream", f'"{file}-1"')
                else:
                    self._answer(404, b"{}", "application/json")

            do_HEAD = do_GET  # noqa: N815 - the library's name

            def _answer(self, status: int, body: bytes, kind: str, tag: str = "") -> None:
                self.send_response(status)
                headers = {"Content-Type": kind, "Content-Length": str(len(body))}
                headers |= {"X-Repo-Commit": COMMIT, "ETag": tag} if tag else {}
                headers |= {"X-Error-Code": "RepoNotFound"} if status == 404 else {}
                for name, value in headers.items():
                    self.send_header(name, value)
                self.end_headers()
                if self.command == "GET":
                    self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Says nothing."""

        return Handler


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Hub]:
    constants = pytest.importorskip("huggingface_hub.constants")
    files = {path.name: path.read_bytes() for path in find_model("starter").iterdir()}
    more = {"pytorch_model.bin": b"pickle", "code.py": b"raise", "old/model.json": b"{}"}
    hub = Hub(files | more)
    server = ThreadingHTTPServer(("127.0.0.1", 0), hub.handler())
    monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{server.server_port}")
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
    thread = Thread(target=server.serve_forever)
    thread.start()
    yield hub
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_model_on_the_hub_generates_as_the_one_that_ships(hub: Hub) -> None:
    generate = MotionPipeline.from_pretrained(MODEL, threads=1)
    expected = MotionPipeline.from_pretrained("starter", threads=1)
    order = "a person walks", 1.0, 3, 2
    np.testing.assert_array_equal(generate(*order).joints, expected(*order).joints)
    fetched = {path.rpartition("/")[2] for path in hub.asked if "/resolve/" in path}
    assert {"model.json", "weights.safetensors", "denoiser.onnx", "tokenizer.json"} <= fetched
    assert not {"pytorch_model.bin", "code.py"} & fetched
    assert not any("old/" in path for path in hub.asked)


def test_a_revision_is_asked_for_and_files_are_fetched_once(hub: Hub) -> None:
    folder = download(f"{MODEL}@v2")
    assert folder.name == COMMIT and f"/api/models/{MODEL}/revision/v2" in hub.asked
    hub.asked.clear()
    assert download(f"{MODEL}@v2") == folder
    assert not any("/resolve/" in path for path in hub.asked)


def test_a_model_that_is_nowhere_says_where_was_looked(hub: Hub) -> None:
    with pytest.raises(ModelError, match=r"no model 'someone/runs': .* no such folder here.* hub"):
        MotionPipeline.from_pretrained("someone/runs")


def test_a_folder_is_never_looked_for_on_the_hub(
    hub: Hub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(find_model("starter"), tmp_path / MODEL)
    pipeline = MotionPipeline.from_pretrained(MODEL)
    assert pipeline.card.name == "starter" and not hub.asked
    for path in ("missing", "a/b/c", "./someone/runs", "../someone", str(tmp_path / "x")):
        with pytest.raises(ModelError, match="neither by name nor as a folder"):
            MotionPipeline.from_pretrained(path)
    with pytest.raises(ModelError, match="neither by name nor as a folder"):
        MotionPipeline.from_pretrained(Path("someone/runs"))  # a path is never an id
    assert not hub.asked


def test_the_command_line_takes_ids_too(
    hub: Hub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["generate", "a person walks", "--model", MODEL, "--seconds", "1", "-o", "a.npz"])
    assert (tmp_path / "a.npz").is_file() and any("/resolve/" in path for path in hub.asked)
    hub.asked.clear()
    (tmp_path / "runs").mkdir()
    with pytest.raises(SystemExit, match="2"):
        main(["generate", "a person walks", "--model", "runs/denoisr"])
    assert "neither by name nor as a folder" in capsys.readouterr().err
    assert not hub.asked  # a mistyped folder is asked of nobody


def test_ids_of_the_hub() -> None:
    assert is_hub_id("someone/walks") and is_hub_id("some-one/walks.v2@refs/pr/1")
    assert not any(map(is_hub_id, ("starter", "a/b/c", "/a/b", "a/b@", "~/b", "a\\b", "a/b c")))


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(MissingExtraError, match=r"huggingface_hub.*latentmotion\[hub\]"):
        MotionPipeline.from_pretrained("someone/walks")
