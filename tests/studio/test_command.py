"""`latentmotion studio`: a real server with a token of its own; what keeps it from starting."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote, urlsplit

import httpx
import pytest

from latentmotion.cli.main import main
from latentmotion.studio.library import default_folder


@contextmanager
def started(folder: Path, *words: str, **variables: str) -> Iterator[str]:
    """Starts a studio whose library is below a folder; yields the line that it prints."""
    command = [sys.executable, "-m", "latentmotion", "studio", "--port", "0", *words]
    variables |= {"PYTHONPATH": os.pathsep.join(sys.path), "XDG_DATA_HOME": str(folder)}
    environment = os.environ | variables
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline()
            process.send_signal(signal.SIGTERM)
            assert process.wait(60) in (0, -signal.SIGTERM)
        finally:
            process.kill()


def test_the_command_prints_a_page_that_its_token_opens(tmp_path: Path) -> None:
    with started(tmp_path, "--no-browser") as line:
        printed = re.fullmatch(r"(http://127\.0\.0\.1:\d+)(/studio)#token=(\S{43})\n", line)
        assert printed is not None
        base, page, token = printed.groups()
        with httpx.Client(base_url=base, timeout=60) as client:
            assert client.get(page).headers["content-type"].startswith("text/html")
            assert client.get("/studio/v1/takes").status_code == 401
            headers = {"Authorization": f"Bearer {token}"}
            assert client.get("/studio/v1/takes", headers=headers).json()["total"] == 0
    folder = tmp_path / "latentmotion" / "library"
    assert sys.platform != "linux" or (folder / "library.sqlite3").is_file()


@pytest.mark.skipif(os.name == "nt", reason="a shell script stands for the browser")
def test_no_list_of_processes_has_the_token(tmp_path: Path) -> None:
    """A browser of ours keeps the words that start it, and what the file in them holds."""
    browser, words = tmp_path / "browser", tmp_path / "words"
    browser.write_text(
        f"#!{sys.executable}\nimport pathlib, sys, urllib.request\n"
        "page = urllib.request.urlopen(sys.argv[1]).read().decode()\n"
        f"pathlib.Path({str(words)!r}).write_text(sys.argv[1] + chr(10) + page)\n"
    )
    browser.chmod(0o700)
    with started(tmp_path, BROWSER=str(browser)) as line:
        address = line.strip()
        while not (words.is_file() and words.read_text().count("\n") > 2):
            time.sleep(0.05)
        place, _, page = words.read_text().partition("\n")
        assert place.startswith("file://") and address.partition("=")[2] not in place
        assert f'content="0; url={address}"' in page
        file = Path(unquote(urlsplit(place).path))
        assert file.stat().st_mode & 0o777 == 0o600


def test_a_second_studio_on_the_same_port_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(SystemExit) as ended:
        port = str(taken.getsockname()[1])
        main(["studio", "--port", port, "--no-browser", "--library", str(tmp_path / "new")])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert f"cannot serve at 127.0.0.1:{port}: Address already in use" in told
    assert "choose another --port" in told
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--library", "FILE"], "cannot be written"),
        (["--runtime", "pytorch"], "export the model first"),
        (["--port", "99999"], "expected 0 to 65535"),
        (["--deadline", "0"], "expected 0.1 to 3600 seconds"),
        (["--model", "nobody"], "no model 'nobody'"),
        (["--model", "fast", "--model", "nobody"], "no model 'nobody'"),
    ],
)
def test_what_cannot_be_served_is_told_at_once(
    tmp_path: Path, options: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    options = [str(tmp_path / "file") if one == "FILE" else one for one in options]
    if "--library" not in options:
        options += ["--library", str(tmp_path / "library")]
    with pytest.raises(SystemExit) as ended:
        main(["studio", "--port", "0", "--no-browser", *options])
    assert ended.value.code == 2
    assert told in capsys.readouterr().err


def test_the_library_is_where_the_platform_keeps_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("XDG_DATA_HOME", raising=False)
    assert default_folder() == Path.home() / ".local/share/latentmotion/library"
    monkeypatch.setenv("XDG_DATA_HOME", "/data")
    assert default_folder() == Path("/data/latentmotion/library")
    monkeypatch.setattr(sys, "platform", "darwin")
    assert default_folder().parts[-4:-2] == ("Library", "Application Support")
