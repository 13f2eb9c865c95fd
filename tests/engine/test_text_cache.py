"""The text cache: found again, made again, never too much."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from safetensors import SafetensorError

from latentmotion import MotionPipeline
from latentmotion.diffusion.condition import TextEmbedding, TextEncoder
from latentmotion.engine import encoder as cache
from latentmotion.engine.encoder import CachedTextEncoder, LazyTextEncoder, UnknownWordsWarning
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import TEXT_GRAPH_FILE, TOKENIZER_FILE
from latentmotion.storage.files import cache_folder


class Letters:
    """An encoder that counts how often it is asked, and knows no word with a z."""

    name, width = "letters", 2

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        (sentence,) = sentences
        self.asked.append(sentence)
        words = np.array([[[len(word), 1] for word in ["", *sentence.split()]]], np.float32)
        return TextEmbedding(words.mean(1), words, np.ones(words.shape[:2], bool))

    def unknown_words(self, sentence: str) -> list[str]:
        return [word for word in sentence.split() if "z" in word]


def remembering(folder: Path, encoder: Letters, most: int = 100) -> CachedTextEncoder:
    file = folder / "encoder"
    if not file.exists():
        file.write_bytes(b"weights")
    return CachedTextEncoder(encoder, folder / "prompts", (file,), most)


def kept(folder: Path) -> list[Path]:
    return sorted((folder / "prompts").iterdir())


def test_a_known_prompt_needs_no_encoder(tmp_path: Path) -> None:
    first, second = Letters(), Letters()
    sentences = ["a person walks", "sits", " a person  walks\n", ""]
    made = remembering(tmp_path, first)(sentences)
    found = remembering(tmp_path, second)(sentences)
    assert first.asked == ["a person walks", "sits", ""] and not second.asked
    for one, other in zip(vars(found).values(), vars(made).values(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert found.mask.sum(1).tolist() == [4, 2, 4, 1]
    assert isinstance(remembering(tmp_path, second), TextEncoder)
    with pytest.raises(InputError, match="no sentence"):
        remembering(tmp_path, second)([])


def test_unknown_words_are_told_every_time(tmp_path: Path) -> None:
    remembering(tmp_path, Letters())(["zaps"])
    with pytest.warns(UnknownWordsWarning, match="'zaps'"):
        remembering(tmp_path, Letters())(["zaps"])


@pytest.mark.parametrize("damage", [b"", b"{}", None])
def test_a_damaged_answer_is_made_again(tmp_path: Path, damage: bytes | None) -> None:
    expected = remembering(tmp_path, Letters())(["walks"])
    (path,) = kept(tmp_path)
    path.write_bytes(path.read_bytes()[:-1] + b"x" if damage is None else damage)
    encoder = Letters()
    np.testing.assert_array_equal(remembering(tmp_path, encoder)(["walks"]).words, expected.words)
    assert encoder.asked == ["walks"] and remembering(tmp_path, encoder)(["walks"])
    assert encoder.asked == ["walks"]


def test_another_encoder_has_other_answers(tmp_path: Path) -> None:
    remembering(tmp_path, Letters())(["walks"])
    (tmp_path / "encoder").write_bytes(b"others!")
    encoder = Letters()
    remembering(tmp_path, encoder)(["walks"])
    assert encoder.asked == ["walks"] and len(kept(tmp_path)) == 2


def test_the_longest_unused_go(tmp_path: Path) -> None:
    encoder = remembering(tmp_path, Letters(), most=10)
    for number in range(10):
        encoder([f"walks {number}"])
    for age, path in enumerate(kept(tmp_path)):
        os.utime(path, (age, age))
    oldest = kept(tmp_path)[:2]
    encoder(["one more"])
    assert len(kept(tmp_path)) == 9 and not any(path.exists() for path in oldest)


def test_several_may_share_a_folder_and_none_needs_it(tmp_path: Path) -> None:
    encoders = [remembering(tmp_path, Letters(), most=5) for _ in range(4)]
    prompts = [f"walks {number % 7}" for number in range(28)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda n: encoders[n % 4]([prompts[n]]).words.shape, range(28)))
    assert set(found) == {(1, 3, 2)}
    (tmp_path / "file").write_bytes(b"")
    files = (tmp_path / "encoder",)
    nowhere = CachedTextEncoder(Letters(), tmp_path / "file" / "x", files, 5)
    assert nowhere(["walks"]).words.shape == (1, 2, 2)


def test_a_full_disk_costs_time_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise SafetensorError("Error while serializing: I/O error: No space left on device")

    monkeypatch.setattr(cache, "save_file", full)
    encoder = Letters()
    for _ in range(2):
        assert remembering(tmp_path, encoder)(["walks"]).words.shape == (1, 2, 2)
    assert encoder.asked == ["walks", "walks"] and not kept(tmp_path)


def test_answers_are_read_where_nothing_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    remembering(tmp_path, Letters())(["walks"])

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError("read-only")

    for name in ("utime", "open"):
        monkeypatch.setattr(os, name, refuse)
    encoder = Letters()
    assert remembering(tmp_path, encoder)(["walks"]) and not encoder.asked


def test_where_the_cache_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for said, expected in (("off", None), (str(tmp_path), tmp_path)):
        monkeypatch.setenv("LATENTMOTION_CACHE", said)
        assert cache_folder() == expected
    monkeypatch.delenv("LATENTMOTION_CACHE")
    for platform, variable in (("linux", "XDG_CACHE_HOME"), ("win32", "LOCALAPPDATA")):
        monkeypatch.setattr("sys.platform", platform)
        monkeypatch.setenv(variable, str(tmp_path))
        assert cache_folder() == tmp_path / "latentmotion"
    monkeypatch.setattr("sys.platform", "darwin")
    assert str(cache_folder()).endswith(str(Path("Library") / "Caches" / "latentmotion"))


def test_a_generator_remembers_and_says_the_same(tmp_path: Path) -> None:
    order = ["a person walks", "a person jumps"], [24, 24], [3, 4], 2
    expected = MotionPipeline.from_pretrained("starter", "onnxruntime", 1).features(*order)
    for _ in range(2):
        generate = MotionPipeline.from_pretrained("starter", "onnxruntime", 1, tmp_path)
        for one, other in zip(generate.features(*order), expected, strict=True):
            np.testing.assert_array_equal(one, other)
    assert len(kept(tmp_path)) == 3  # the null prompt is one


def test_a_damaged_encoder_is_named_when_it_is_needed(tmp_path: Path) -> None:
    files = tmp_path / TEXT_GRAPH_FILE, tmp_path / TOKENIZER_FILE
    for file in files:
        file.write_bytes(b"")
    broken = CachedTextEncoder(
        LazyTextEncoder(tmp_path, "broken", 2), tmp_path / "prompts", files, 5
    )
    with pytest.raises(ModelError, match="cannot be loaded"):
        broken(["walks"])
