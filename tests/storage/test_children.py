"""Child processes: no code of the working folder, one thread, limits that hold where they may."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import latentmotion
from latentmotion.storage import children


def test_the_working_folder_is_not_on_a_childs_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for place in ("", ".", str(Path.cwd()), "relative", str(tmp_path)):
        monkeypatch.syspath_prepend(place)
    places = children.environment()["PYTHONPATH"].split(os.pathsep)
    assert places[0] == str(tmp_path)
    assert all(Path(place).is_absolute() for place in places)
    assert str(Path.cwd()) not in places
    assert places[-1] == str(Path(latentmotion.__file__).parents[1])
    (tmp_path / "program.py").write_text("import sys; print(sys.flags.safe_path, *sys.argv[1:])")
    words = children.command("program", "a", "b c")
    done = subprocess.run(words, env=children.environment(), capture_output=True, text=True)
    assert done.stdout == "True a b c\n"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")
@pytest.mark.parametrize("hard, expected", [("unlimited", 7 << 30), ("2000000", 2_000_000 << 10)])
def test_the_lesser_of_the_wanted_and_the_hard_limit_holds(hard: str, expected: int) -> None:
    code = (
        "import resource; from latentmotion.storage.children import limit\n"
        "limit('AS', 7 << 30); print(resource.getrlimit(resource.RLIMIT_AS)[0])"
    )
    shell = f'ulimit -v {hard} && exec "$@"'
    words = ["bash", "-c", shell, "bash", sys.executable, "-P", "-c", code]
    done = subprocess.run(words, env=children.environment(), capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"{expected}\n", "")


@pytest.mark.parametrize("count, expected", [(20, 30), (40, 40), (90, 50)])
def test_open_files_are_allowed_and_never_fewer_than_before(count: int, expected: int) -> None:
    code = (
        "import resource; from latentmotion.storage.children import allow_open_files\n"
        "resource.setrlimit(resource.RLIMIT_NOFILE, (30, 50))\n"
        f"allow_open_files({count}); print(*resource.getrlimit(resource.RLIMIT_NOFILE))"
    )
    pytest.importorskip("resource")
    words = [sys.executable, "-P", "-c", code]
    done = subprocess.run(words, env=children.environment(), capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"{expected} 50\n", "")
