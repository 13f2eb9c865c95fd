"""A tiny BERT teacher with random weights and its tokenizer, made in memory."""

from __future__ import annotations

import torch
from tokenizers import Tokenizer, models, normalizers, pre_tokenizers, processors
from transformers import BertConfig, BertModel, PreTrainedTokenizerFast

from latentmotion.condition.text.pretrained import KINDS, PretrainedTextEncoder

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
