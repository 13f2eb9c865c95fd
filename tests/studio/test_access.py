"""Who is let in, what the page may load, what the model can do, and that no request breaks it."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from latentmotion.studio import app as application
from tests.service.conftest import TOKEN, Called
from tests.service.test_guard import answered
from tests.service.test_schemathesis import CASES, check_requests

PRIVATE = [
    ("GET", "/studio/v1/capabilities"),
    ("GET", "/studio/v1/takes"),
    ("POST", "/studio/v1/takes"),
    ("GET", "/studio/v1/takes/01M83KC31REF7RP72GNKH69SHQ/joints"),
    ("GET", "/studio/v1/joints?take=01M83KC31REF7RP72GNKH69SHQ"),
    ("GET", "/studio/v1/models"),
    ("POST", "/studio/v1/models"),
    ("GET", "/studio/v1/best?take=01M83KC31REF7RP72GNKH69SHQ"),
    ("GET", "/studio/v1/characters/01M83KC31REF7RP72GNKH69SHQ/model"),
    ("POST", "/studio/v1/session"),
    ("POST", "/studio/v1/import?name=x.bvh"),
    ("POST", "/studio/v1/characters?name=x.glb"),
    ("GET", "/studio/v1/projects"),
    ("GET", "/studio/assets/"),
    ("GET", "/studio/assets/nothing.js"),
    ("POST", "/v1/motions"),
]


@pytest.mark.parametrize(("method", "path"), PRIVATE)
@pytest.mark.parametrize("header", [None, "Bearer x", f"Basic {TOKEN}", f"Bearer {TOKEN[:-1]}"])
def test_nobody_is_let_in_without_the_token(
    app: Any, method: str, path: str, header: str | None
) -> None:
    headers = {} if header is None else {"Authorization": header}
    assert answered(app, method, path, headers=headers).status_code == 401
    assert answered(app, method, f"{path}#token={TOKEN}").status_code == 401


@pytest.mark.parametrize(
    ("header", "value"),
    [
        ("Host", "evil.example"),
        ("Host", "localhost.evil.example:80"),
        ("Origin", "http://evil.example"),
        ("Origin", "http://localhost:81"),
        ("Origin", "null"),
    ],
)
@pytest.mark.parametrize("path", ["/studio", "/studio/v1/takes"])
def test_other_pages_and_names_are_kept_out(app: Any, header: str, value: str, path: str) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}", header: value}
    assert answered(app, "GET", path, headers=headers).status_code == 403


@pytest.mark.parametrize("path", ["/studio", "/studio/"])
def test_the_page_is_open_and_may_load_its_own_files_alone(app: Any, path: str) -> None:
    answer = answered(app, "GET", path)
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'self'; ")
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy


def test_all_assets_are_open_and_have_a_kind(app: Any) -> None:
    folder = Path(application.__file__).parent / "assets"
    names = [file.name for file in folder.iterdir()]
    assert "index.html" in names
    for name in names:
        answer = answered(app, "GET", f"/studio/assets/{name}")
        assert answer.status_code == 200, name
        assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("path", ["..%2Fapp.py", "%2e%2e/app.py", "index.html%00.js"])
def test_no_other_file_is_an_asset(app: Any, path: str) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}"}
    assert answered(app, "GET", f"/studio/assets/{path}", headers=headers).status_code == 404


def test_a_body_that_is_no_upload_is_small(app: Any) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}"}
    large = {"headers": headers, "content": b"x" * (1 << 19)}
    assert answered(app, "PUT", "/studio/v1/projects/a", **large).status_code == 413
    too_large = {**headers, "Content-Length": str((64 << 20) + 1)}
    for path in ("import?name=x.bvh", "characters?name=x.glb"):
        answer = answered(app, "POST", f"/studio/v1/{path}", headers=too_large)
        assert answer.status_code == 413


def test_before_the_model_is_loaded_the_page_and_the_library_answer(app: Any) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}"}
    for path in ("takes", "characters", "projects", "capabilities"):
        assert answered(app, "GET", f"/studio/v1/{path}", headers=headers).status_code == 200
    body = {"recipe": {"prompt": "a person walks"}}
    answer = answered(app, "POST", "/studio/v1/takes", headers=headers, json=body)
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "2")


def test_capabilities_are_those_of_the_model(studio: Called) -> None:
    found = studio.get("/studio/v1/capabilities").json()
    assert (found["model"], found["steps"], found["usual_steps"]) == ("fast", [1, 2, 4], 4)
    assert found["guidance"] == {"least": 1.0, "most": 9.0, "usual": 6.0}
    assert len(found["joints"]) == len(found["parents"]) == len(found["directions"]) == 22
    assert found["can"] == dict.fromkeys(found["can"], True) | {"best_of": 32}
    assert {"glb", "bvh", "npz", "csv", "html"} <= set(found["formats"])


def test_a_model_that_cannot_direct_offers_nothing_of_it(
    studio: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = studio.service.pipeline
    other = replace(own, backend=replace(own.backend, pullback=None))
    monkeypatch.setattr(studio.service, "pipeline", other)
    can = studio.get("/studio/v1/capabilities").json()["can"]
    assert {name for name, there in can.items() if there} == {"best_of", "teach"}


@pytest.mark.filterwarnings("ignore")  # words that no model knows
def test_no_request_is_the_studios_fault(studio: Called) -> None:
    check_requests(studio, "/studio", CASES // 3)


def test_many_at_once_lose_nothing(studio: Called) -> None:
    body = {"recipe": {"prompt": "a person jumps", "seconds": 1, "steps": 1}, "takes": 2}

    async def ask() -> list[httpx.Response]:
        client = studio.client
        return await asyncio.gather(
            *(client.post("/studio/v1/takes", json=body) for _ in range(4)),
            *(client.get("/studio/v1/takes") for _ in range(8)),
        )

    answers = studio.wait(ask())
    assert {answer.status_code for answer in answers} == {200}
    names = [take["id"] for answer in answers[:4] for take in answer.json()["takes"]]
    assert len(set(names)) == 8
