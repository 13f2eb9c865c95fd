"""Exported text encoders with made-up graphs, the cache of a data set, models of length."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save_file

from latentmotion.diffusion.condition import TextEmbedding, TextEncoder
from latentmotion.engine import encoder as cache
from latentmotion.engine.encoder import (
    CachedTextEncoder,
    EncoderWithVocabulary,
    GraphTextEncoder,
    LazyTextEncoder,
    StudentTextEncoder,
    UnknownWordsWarning,
    load_text_encoder,
    warn_of_unknown,
)
from latentmotion.engine.lengths import QUANTILES, SHORTEST_USUAL, LengthFile, LengthModel
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import TEXT_GRAPH_FILE, TOKENIZER_FILE, find_model
from tests.support.tiny_text import teacher_tokenizer


class Session:
    """A graph whose pooled numbers are the token ids' sum and count, and whose words are both."""

    def __init__(self) -> None:
        self.runs = 0

    def run(self, _: None, given: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        self.runs += 1
        tokens, mask = given["tokens"], given["mask"]
        assert tokens.dtype == np.int64 and mask.dtype == bool and len(tokens) == 1
        words = np.stack([tokens, np.ones_like(tokens)], axis=-1).astype(np.float32)
        return words.sum(1), words


def graph_encoder() -> GraphTextEncoder:
    return GraphTextEncoder("made up", 2, Session(), teacher_tokenizer())


def student() -> StudentTextEncoder:
    known = frozenset({"kicking"})
    return StudentTextEncoder("made up", 2, Session(), teacher_tokenizer(), known)


def test_every_sentence_is_encoded_once_and_alone() -> None:
    encoder = graph_encoder()
    together = encoder(["a person walks", "a kick", "a person walks"])
    assert encoder.session.runs == 2
    assert together.mask.sum(1).tolist() == [5, 4, 5]
    alone = encoder(["a kick"])
    np.testing.assert_array_equal(together.words[1, :4], alone.words[0])
    np.testing.assert_array_equal(together.pooled[[0]], together.pooled[[2]])
    assert isinstance(encoder, TextEncoder) and isinstance(encoder, EncoderWithVocabulary)
    assert encoder.unknown_words("zzz") == []
    with pytest.raises(InputError, match="no sentence to encode"):
        encoder([])


def test_what_the_shipped_encoder_reads_together_is_the_same_to_the_last_bit() -> None:
    encoder = StudentTextEncoder.load(find_model("starter"))
    sentences = [f"a person {act} left" for act in ("turns", "kicks", "walks", "looks", "runs")]
    sentences.append("someone who is tired sits down")
    together = encoder(sentences)
    for row, sentence in enumerate(sentences):
        alone = encoder([sentence])
        np.testing.assert_array_equal(together.pooled[row], alone.pooled[0])
        np.testing.assert_array_equal(together.words[row][together.mask[row]], alone.words[0])


def test_pieces_that_were_added_change_no_sentence_of_other_words() -> None:
    """The embedding is that of the encoder before it got further rows of its teacher's."""
    encoder = StudentTextEncoder.load(find_model("starter"))
    assert encoder.pieces("toilet") == ["toilet"] and encoder.name == "student-3ce408f26463"
    first = [-0.01922224, -0.02492021, 0.01682085, 0.01364292]
    embedding = encoder(["a person walks forward and waves"]).pooled[0, :4]
    np.testing.assert_allclose(embedding, first, atol=1e-6)


def test_words_of_several_pieces_are_unknown_unless_they_occurred() -> None:
    encoder = student()
    assert encoder.unknown_words("a person kicking and Walking") == ["walking"]
    with pytest.warns(UnknownWordsWarning, match=r"by their pieces: 'walking', 'zab'; another"):
        encoder(["walking zab", "zab"])
    encoder(["a person kicking"])


def test_no_warning_of_no_words() -> None:
    warn_of_unknown([])
    with pytest.warns(UnknownWordsWarning, match=r"'a', 'b'; another English word"):
        warn_of_unknown(["a", "b", "a"])


def test_a_warning_of_many_and_long_words_is_short() -> None:
    with pytest.warns(UnknownWordsWarning, match=r"x…', '0', .* '10' and 9 more; another") as told:
        warn_of_unknown(["x" * 6000, *map(str, range(20))])
    assert len(str(told[0].message)) < 300


@pytest.mark.parametrize("load", [load_text_encoder, StudentTextEncoder.load])
def test_a_folder_without_an_encoder(tmp_path: Path, load: Any) -> None:
    with pytest.raises(ModelError, match=str(tmp_path)):
        load(tmp_path)
    for name in (TEXT_GRAPH_FILE, TOKENIZER_FILE):
        (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(ModelError, match="the text encoder cannot be loaded"):
        load(tmp_path)


def test_an_encoder_is_loaded_when_it_is_first_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[Path] = []

    def load(folder: Path) -> GraphTextEncoder:
        loaded.append(folder)
        return graph_encoder()

    monkeypatch.setattr("latentmotion.engine.encoder.load_text_encoder", load)
    encoder = LazyTextEncoder(tmp_path, "made up", 2)
    assert not loaded
    encoder(["a kick"])
    assert encoder.unknown_words("walking") == [] and loaded == [tmp_path]


class Counting:
    """An encoder that notes how many sentences it is given at a time."""

    def __init__(self, name: str = "counting") -> None:
        self.name, self.width = name, 2
        self.batches: list[int] = []

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        self.batches.append(len(sentences))
        longest = max(len(text) for text in sentences)
        mask = np.arange(longest) < np.array([[len(text)] for text in sentences])
        words = np.where(mask[..., None], np.ones((1, 1, 2)), 0).astype(np.float32)
        return TextEmbedding(words.sum(1), words, mask)


def test_a_data_sets_cache_has_files_of_many_sentences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "SENTENCES_PER_FILE", 4)
    texts = [letter * (n % 3 + 1) for n, letter in enumerate("abcdefghij")]
    first, second = Counting(), Counting()
    made = CachedTextEncoder(first, tmp_path)(texts + texts[:2])
    assert first.batches == [4, 4, 2] and len(list(tmp_path.rglob("*.safetensors"))) == 3
    found = CachedTextEncoder(second, tmp_path)([*texts[::-1], " a \n"])
    assert second.batches == []
    np.testing.assert_array_equal(found.pooled[:10], made.pooled[:10][::-1])
    np.testing.assert_array_equal(found.pooled[10], made.pooled[0])


def test_a_data_sets_cache_computes_what_is_new_alone(tmp_path: Path) -> None:
    encoder = Counting()
    remembering = CachedTextEncoder(encoder, tmp_path)
    for texts in (["a", "bb"], ["bb", "ccc", "a"], ["ccc"]):
        remembering(texts)
    assert encoder.batches == [2, 1] and (remembering.name, remembering.width) == ("counting", 2)


@pytest.mark.parametrize("name", ["counting/2", "counting-2", "x" * 90])
def test_encoders_of_other_names_have_folders_of_their_own(tmp_path: Path, name: str) -> None:
    CachedTextEncoder(Counting(), tmp_path)(["a"])
    other = Counting(name)
    CachedTextEncoder(other, tmp_path)(["a"])
    folders = [path.name for path in tmp_path.iterdir()]
    assert other.batches == [1] and len(folders) == 2 and max(map(len, folders)) < 60


def test_a_sentence_keeps_no_padding_of_its_batch(tmp_path: Path) -> None:
    encoder = CachedTextEncoder(Counting(), tmp_path)
    encoder(["a", "bbbbbbb"])
    assert encoder(["a"]).mask.shape == (1, 1)


MODEL = LengthModel(
    "made up",
    weights=(
        np.array([[1.0, 0.0], [0.0, -1.0], [2.0, 2.0]], np.float32),
        np.array([[0.0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, 2], [1, 1, 1]], np.float32),
    ),
    biases=(
        np.array([0.0, 1.0, -2.0], np.float32),
        np.array([0.5, 0.0, 0.25, 0.0, 1.0], np.float32),
    ),
)


@pytest.mark.parametrize(
    ("embedding", "expected"),
    [
        ([0.0, 0.0], [0.0, 0.25, 0.5, 1.0, 2.0]),
        ([3.0, 0.0], [1.0, 3.25, 4.5, 8.0, 9.0]),
        ([-5.0, 4.0], [0.0, 0.0, 0.25, 0.5, 1.0]),
    ],
)
def test_lengths_by_hand_rise(embedding: list[float], expected: list[float]) -> None:
    found = MODEL(np.array([embedding, [1.0, 1.0]], np.float32))
    assert found[0].tolist() == expected
    usual = MODEL.usual(np.array([embedding], np.float32))
    assert usual == pytest.approx([max(expected[QUANTILES.index(0.5)], SHORTEST_USUAL)])


def test_deeper_models_are_layer_after_layer(tmp_path: Path) -> None:
    into, out = MODEL.weights
    twice = LengthModel("made up", (into, np.eye(3, dtype=np.float32) * 2, out),
                        (MODEL.biases[0], np.zeros(3, np.float32), MODEL.biases[1]))  # fmt: skip
    doubled = replace(MODEL, weights=(into, 2 * out))
    x = np.array([[3.0, 0.0], [-1.0, 2.0]], np.float32)
    np.testing.assert_array_equal(twice(x), doubled(x))
    twice.write(tmp_path / "deep.safetensors")
    np.testing.assert_array_equal(LengthModel.read(tmp_path / "deep.safetensors")(x), twice(x))


def test_weights_in_16_bits_are_read_as_they_stand(tmp_path: Path) -> None:
    parts = {"weight": MODEL.weights, "bias": MODEL.biases}
    arrays = {
        f"{layer}.{part}": array.astype(np.float16)
        for part, layers in parts.items()
        for layer, array in enumerate(layers)
    }
    about = {"encoder": "made up", "quantiles": json.dumps(QUANTILES)}
    save_file(arrays, tmp_path / "lengths.safetensors", about)
    x = np.array([[3.0, 0.5]], np.float32)
    read = LengthModel.read(tmp_path / "lengths.safetensors")
    np.testing.assert_array_equal(read(x), MODEL(x))


def test_files_with_other_arrays_are_refused(tmp_path: Path) -> None:
    path, about = (
        tmp_path / "many.safetensors",
        {"encoder": "x", "quantiles": json.dumps(QUANTILES)},
    )
    save_file({f"{n}.weight": np.zeros((1, 1)) for n in range(25)}, path, about)
    with pytest.raises(ModelError, match="25 arrays; expected at most 24"):
        LengthModel.read(path)
    save_file(
        {"0.weight": np.zeros((5, 2)), "0.bias": np.zeros(5), "odd": np.zeros(1)}, path, about
    )
    with pytest.raises(ModelError, match="is damaged"):
        LengthModel.read(path)


def test_a_model_of_lengths_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "length.safetensors"
    MODEL.write(path)
    back = LengthModel.read(path, "made up")
    np.testing.assert_array_equal(back.weights[0], MODEL.weights[0])
    pooled = np.array([[3.0, 0.0]], np.float32)
    assert LengthFile(path, None).usual(pooled) == MODEL.usual(pooled) == [4.5]
    with pytest.raises(ModelError, match="reads the text encoder 'made up', not 'clip'"):
        LengthFile(path, "clip").usual(pooled)


@pytest.mark.parametrize(
    "changes",
    [
        {"weights": (np.ones((3, 3), np.float32),), "biases": (np.ones(3, np.float32),)},
        {"weights": (MODEL.weights[1], MODEL.weights[1])},
        {"biases": (MODEL.biases[0], np.full(5, np.nan, np.float32))},
        {"biases": MODEL.biases[::-1]},
        {"weights": (), "biases": ()},
    ],
)
def test_a_model_of_lengths_that_does_not_fit_together(tmp_path: Path, changes: dict) -> None:
    path = tmp_path / "length.safetensors"
    replace(MODEL, **changes).write(path)
    with pytest.raises(ModelError, match="is no model of lengths by"):
        LengthModel.read(path)
    with pytest.raises(ModelError, match="is no file; make one: latentmotion train length"):
        LengthModel.read(tmp_path / "none")
