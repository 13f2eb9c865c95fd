"""A folder with Python files of others: the service and the studio run there, and run none."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from latentmotion import formats
from latentmotion.motion import Motion
from tests.support.walker import walker

CANARIES = ("json", "numpy", "random", "resource")  # Modules that a worker imports early.


@pytest.mark.parametrize("program", ["serve", "studio --no-browser --library library"])
def test_code_of_the_working_folder_is_not_run(program: str, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    for name in CANARIES:
        (tmp_path / f"{name}.py").write_text("open('canary', 'w'); raise SystemExit(9)")
    figure = formats.save(
        tmp_path / "a.usda", [Motion(walker(30).joints().astype("f4"), caption="walks")]
    )[0].read_bytes()
    shell = 'ulimit -v 8000000; exec "$@"'  # as in a container: the limit cannot be raised
    command = ["bash", "-c", shell, "bash", str(Path(sys.executable).with_name("latentmotion"))]
    command += [*program.split(), "--port", "0"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            page, _, token = process.stdout.readline().strip().partition("#token=")
            base = page.removesuffix("/studio")
            headers = {"Authorization": f"Bearer {token}"} if token else {}
            with httpx.Client(base_url=base, headers=headers, timeout=120) as client:
                while client.get("/readyz").status_code != 200:
                    assert process.poll() is None
                body = {"prompt": "a person walks", "seconds": 1, "format": "glb"}
                assert client.post("/v1/motions", json=body).status_code == 200
                place = "/v1/convert?source=usda&format=bvh"
                if token:
                    place = "/studio/v1/import?name=a.usda"
                answer = client.post(place, content=figure)
                assert answer.status_code == 200, answer.text
            process.send_signal(signal.SIGTERM)
            process.wait(60)
        finally:
            process.kill()
    assert not (tmp_path / "canary").exists()
