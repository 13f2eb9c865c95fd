"""Tiny text encoders with random weights, each with the tokenizer of a few words."""

from __future__ import annotations

import json
from pathlib import Path

import torch
from safetensors.torch import save_file
from tokenizers import Tokenizer, models, normalizers, pre_tokenizers, processors
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

from latentmotion.networks.pretrained_text import KINDS, PretrainedTextEncoder

CAPTIONS = ("a person walks", "a person kicks", "person walks and kicks", "a kick")
SPECIAL = ("[PAD]", "[unused0]", "[UNK]", "[CLS]", "[SEP]", "[MASK]")
WORDS = ("a", "person", "walks", "kicks", "and", "kick", "the", "turns", "left", "right")


def teacher_tokenizer() -> Tokenizer:
    """A WordPiece tokenizer with a few words, letters and ends."""
    letters = [chr(code) for code in range(ord("a"), ord("z") + 1)]
    pieces = [*SPECIAL, *WORDS, *letters[1:], "##s", "##ing"]
    pieces += [f"##{letter}" for letter in letters if letter != "s"]
    vocabulary = {piece: place for place, piece in enumerate(pieces)}
    tokenizer = Tokenizer(models.WordPiece(vocabulary, unk_token="[UNK]"))
    tokenizer.normalizer = normalizers.BertNormalizer(lowercase=True)
    tokenizer.pre_tokenizer = pre_tokenizers.BertPreTokenizer()
    tokenizer.post_processor = processors.TemplateProcessing(
        single="[CLS] $A [SEP]",
        special_tokens=[("[CLS]", vocabulary["[CLS]"]), ("[SEP]", vocabulary["[SEP]"])],
    )
    tokenizer.add_special_tokens([name for name in SPECIAL if name != "[unused0]"])
    return tokenizer


def tiny_teacher() -> PretrainedTextEncoder:
    """A BERT of four narrow layers behind the interface of MiniLM."""
    tokenizer = teacher_tokenizer()
    config = BertConfig(
        vocab_size=tokenizer.get_vocab_size(),
        hidden_size=16,
        num_hidden_layers=4,
        num_attention_heads=2,
        intermediate_size=32,
        max_position_embeddings=32,
    )
    torch.manual_seed(0)
    model = BertModel(config).eval().requires_grad_(False)
    fast = PreTrainedTokenizerFast(tokenizer_object=tokenizer, pad_token="[PAD]")
    return PretrainedTextEncoder("minilm:tiny", model, fast, KINDS["minilm"])


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


MODELS = {
    "minilm": bert, "clip": clip, "clip_hidden": clip, "distilbert": distilbert,
    "sentence_t5": t5, "t5": t5,
}  # fmt: skip


def write_dense(folder: Path, kind: str = "safetensors", **settings: str) -> torch.Tensor:
    """The layer that sentence-transformers keeps beside T5."""
    place = folder / "2_Dense"
    place.mkdir()
    weight = torch.randn(12, WIDTH) / 4
    about = {"in_features": WIDTH, "out_features": 12, "bias": False}
    about |= {"activation_function": "torch.nn.modules.linear.Identity", **settings}
    (place / "config.json").write_text(json.dumps(about))
    if kind == "safetensors":
        save_file({"linear.weight": weight}, place / "model.safetensors")
    else:
        torch.save({"linear.weight": weight}, place / "pytorch_model.bin")
    return weight


def write_t5(folder: Path) -> None:
    torch.manual_seed(0)
    t5().save_pretrained(folder)
    PreTrainedTokenizerFast(
        tokenizer_object=teacher_tokenizer(), pad_token="[PAD]", eos_token="[SEP]"
    ).save_pretrained(folder)
