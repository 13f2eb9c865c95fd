"""Odd words in written files: captions and notes come back to the letter, or are refused.

Seeds are fixed. LATENTMOTION_FUZZ=N writes N files of each format, and N/10 of USD.
"""

from __future__ import annotations

import os
import random
from importlib.util import find_spec
from pathlib import Path

import pytest

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.motion import Motion
from tests.support.walker import walker

FILES = int(os.environ.get("LATENTMOTION_FUZZ", "3"))
USD = (".usda", ".usdc", ".usdz")

PIECES = [
    *("a", "walk", "é", "𝄞", "😀", "\u202e", "\x1b", "\0", "\n", "\r", " ", "1", "-", "_"),
    *('"', '"""', "'", "'''", "\\", "{", "}", "#", "@", "/", ".", "</", "<!--", "%s", "\ud800"),
]


@pytest.mark.parametrize("ending", [".npz", ".amass.npz", ".glb", ".gltf", *USD])
def test_odd_words_come_back_or_are_refused(ending: str, tmp_path: Path) -> None:
    if ending in USD and not (find_spec("pxr") and "LATENTMOTION_FUZZ" in os.environ):
        pytest.skip("a second for each file; set LATENTMOTION_FUZZ")
    draw = random.Random(f"{ending} 13")

    def words() -> str:
        return "".join(draw.choices(PIECES, k=draw.randrange(12)))

    joints = walker(6).joints().astype("f4")
    for _ in range(-(-FILES // 10) if ending in USD else FILES):
        notes = {words() or "a": draw.choice([words(), 1.5, None, [1, words()], {"a": True}])}
        take = Motion(joints, caption=words(), metadata=notes)
        path = tmp_path / f"a{ending}"
        if "\0" in take.caption or "\\ud800" in ascii((take.caption, notes)):
            with pytest.raises(InputError, match=r"what is no character|the character NUL"):
                formats.save(path, [take])
            continue
        formats.save(path, [take])
        (found,) = formats.load(path)
        assert (found.caption, dict(found.metadata)) == (take.caption, notes)


def test_bytes_of_another_encoding_are_no_words(tmp_path: Path) -> None:
    take = Motion(walker(6).joints().astype("f4"), caption="caf\udce9")
    for ending in set(formats.ENDINGS) - set(() if find_spec("pxr") else (*USD, ".usd")):
        with pytest.raises(InputError, match=r"'caf\\udce9' holds what is no character \(at 3\)"):
            formats.save(tmp_path / f"a{ending}", [take])
    assert not list(tmp_path.iterdir())
