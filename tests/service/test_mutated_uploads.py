"""Mutated files, sent to the service: an answer or a refusal, and the service goes on.

LATENTMOTION_FUZZ=N sends N of each kind in place of a few; LATENTMOTION_FUZZ_SEED draws others.
"""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import pytest

from latentmotion.motion import Motion
from tests.fuzz.test_mutated_files import INPUTS, SEED, mutated
from tests.service.conftest import Called
from tests.support.walker import walker

CLEAN, CONVERT = "/v1/clean?source={}&format=npz", "/v1/convert?source={}&format=bvh"
RETARGET = "/v1/retarget?source={0}&format={0}&prompt=a+person+walks&seconds=2&clean=false"
PATHS = [CLEAN.format(name) for name in ("bvh", "csv", "npz")]
PATHS += [CONVERT.format(name) for name in ("glb", "gltf", "npz")]
PATHS += [RETARGET.format(name) for name in ("glb", "bvh")]
MAY_FAIL = (503,)  # A worker took too long, or died of its limits; others take its place.


@pytest.mark.parametrize("path", PATHS)
def test_mutated_uploads(path: str, called: Called, tmp_path: Path) -> None:
    source = path.partition("source=")[2].partition("&")[0]
    motion = Motion(walker(12).joints().astype("f4"))
    motion.save(tmp_path / f"a.{source}")
    content = (tmp_path / f"a.{source}").read_bytes()
    draw, statuses = random.Random(f"{path} {SEED}"), Counter[int]()
    for number in range(INPUTS + 1):
        body = mutated(content, draw) if number else content
        answer = called.post(path, content=body or b"\n")
        statuses[answer.status_code] += 1
        problem = f"input {number} of {path}: {answer.status_code} {answer.text[:300]}"
        assert answer.status_code < 500 or answer.status_code in MAY_FAIL, problem
        if answer.status_code >= 400:
            assert number and answer.json()["detail"] and "Traceback" not in answer.text, problem
            assert "/tmp/" not in answer.text, problem
        assert called.get("/livez").status_code == 200
    print(path, sorted(statuses.items()))
    assert set(statuses) >= {200} and sum(statuses.values()) == INPUTS + 1
