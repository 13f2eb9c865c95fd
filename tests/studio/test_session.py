"""Who is let in without the header: a browser with the cookie that it was given for the token."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from latentmotion.errors import InputError
from latentmotion.studio.app import COOKIE, kept_token
from tests.service.conftest import TOKEN
from tests.service.test_guard import answered


def test_a_token_becomes_a_cookie_that_no_script_or_other_site_has(app: Any) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}", "Host": "localhost:8765"}
    answer = answered(app, "POST", "/studio/v1/session", headers=headers)
    assert answer.status_code == 204
    given = answer.headers["set-cookie"]
    assert given.startswith(f"{COOKIE}-8765={TOKEN};")
    assert {"HttpOnly", "Path=/", "SameSite=strict"} <= {*given.split("; ")}


def test_nobody_is_given_a_cookie_without_the_token(app: Any) -> None:
    answer = answered(app, "POST", "/studio/v1/session")
    assert answer.status_code == 401
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize(
    ("name", "value", "site", "status"),
    [
        (f"{COOKIE}-8765", TOKEN, None, 200),
        (f"{COOKIE}-8765", TOKEN, "same-origin", 200),
        (f"{COOKIE}-8765", TOKEN, "same-site", 401),  # a page at another port of this machine
        (f"{COOKIE}-8765", TOKEN, "cross-site", 401),
        (f"{COOKIE}-8766", TOKEN, None, 401),
        (f"{COOKIE}-8765", TOKEN[:-1], None, 401),
    ],
)
def test_the_cookie_of_this_port_lets_its_own_pages_in(
    app: Any, name: str, value: str, site: str | None, status: int
) -> None:
    headers = {"Host": "localhost:8765", "Cookie": f"other=1; {name}={value}"}
    headers |= {} if site is None else {"Sec-Fetch-Site": site}
    assert answered(app, "GET", "/studio/v1/takes", headers=headers).status_code == status


def test_a_library_keeps_its_token_where_only_its_owner_reads_it(tmp_path: Path) -> None:
    token = kept_token(tmp_path / "library")
    file = tmp_path / "library" / "token"
    assert len(token) == 43
    assert kept_token(tmp_path / "library") == token
    if os.name == "nt":
        return
    assert file.stat().st_mode & 0o777 == 0o600
    file.chmod(0o644)  # others may have read it
    assert kept_token(tmp_path / "library") != token
    assert file.stat().st_mode & 0o777 == 0o600
    file.write_text("short\n")
    assert len(kept_token(tmp_path / "library")) == 43


def test_a_library_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        kept_token(tmp_path / "file")
