"""The page: it shows a motion in a real browser, under a policy without anything inline."""

from __future__ import annotations

import re

import pytest

from tests.service.conftest import Called
from tests.support.pages import Elements


def test_the_pages_hold_nothing_inline(called: Called) -> None:
    for path in ("/", "/docs", "/viewer"):
        answer = called.get(path)
        policy = answer.headers["content-security-policy"]
        assert "unsafe" not in policy
        assert "default-src 'none'" in policy
        for tag, attributes in Elements(answer.text).tags:
            assert "style" not in attributes
            assert not any(name.startswith("on") for name in attributes)
            assert tag != "style"
            if tag == "script":
                assert "src" in attributes or attributes["type"] == "application/json"
            for address in (attributes.get("src"), attributes.get("href")):
                assert address is None or re.match(r"/(?!/)|data:", address)


@pytest.mark.parametrize(
    "name", ["page.css", "page.js", "docs.js", "show.js", "viewer.css", "viewer.js"]
)
def test_its_files_are_there(called: Called, name: str) -> None:
    answer = called.get(f"/assets/{name}")
    assert answer.status_code == 200
    assert len(answer.content) > 100


def test_no_other_file_is(called: Called) -> None:
    for name in ("page.html", "..%2Fapp.py", "%2Fetc%2Fpasswd"):
        assert called.get(f"/assets/{name}").status_code == 404
