"""Text-motion evaluators, T2M's or small towers: embeddings, and evaluator folders.

A folder holds `evaluator.json`, `weights.safetensors` and, for words without a table, the text
encoder. The weights file holds the networks, the evaluator's own statistics and a table of word
vectors if there is one. The files of a small text encoder are copied; others are named.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
import torch
from jaxtyping import Float
from safetensors.torch import save_file

from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.encoder import StudentTextEncoder
from latentmotion.engine.request import batches
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.evaluators.interface import EVALUATOR_FILE, WEIGHTS_FILE
from latentmotion.evaluation.evaluators.text_motion_network import (
    FRAMES,
    TextMotionConfig,
    TextMotionNetworks,
    TowerConfig,
    TowerNetworks,
)
from latentmotion.evaluation.evaluators.words import EncodedWords, GloveWords, WordVectors
from latentmotion.export.onnx import FEWEST, FunctionModule, scaled_rows, trace
from latentmotion.model.card import TEXT_GRAPH_FILE, TOKENIZER_FILE, Provenance
from latentmotion.networks.checkpoint import load_weights, read_weights
from latentmotion.ranking import scorer as scorers
from latentmotion.ranking.search import training_vectors
from latentmotion.representation.interface import ClipFeatures, Normalizer
from latentmotion.storage.configuration import read_json, to_json, write_json
from latentmotion.storage.files import atomic_folder

FORMAT = 1  # Version of evaluator.json.

MAX_BATCH_SIZE = 64  # Most motions or captions that go through a network at once.

# Names in the weights file of the values that are not weights.
MEAN, STD, WORDS = "normalizer.mean", "normalizer.std", "words.vectors"


@dataclass(frozen=True)
class TextMotionCard:
    """Content of `evaluator.json`."""

    name: str  # Name of the evaluator.
    representation: str  # Name of the motion features.
    networks: TextMotionConfig | TowerConfig  # Sizes of the networks.
    words: str  # Source of word vectors: `glove`, or the name of a text encoder.
    vocabulary: tuple[str, ...] = ()  # Words that have vectors; empty if a text encoder gives them.
    provenance: Provenance = field(default_factory=Provenance)  # Origin of the weights.
    figures: dict[str, Any] = field(default_factory=dict)  # Measured figures, by name.
    kind: Literal["text_motion"] = "text_motion"  # Kind of evaluator.
    format: int = FORMAT  # Version of this file.


@dataclass(frozen=True, eq=False)
class T2MEvaluator:
    """Motions and captions to embeddings in one space; a `TextMotionEvaluator`."""

    card: TextMotionCard  # The evaluator's card.
    networks: TextMotionNetworks | TowerNetworks  # The networks, in `eval()` mode.
    normalizer: Normalizer  # The evaluator's own statistics, which differ from the data set's.
    vectors: WordVectors  # Captions to word vectors.

    @property
    def width(self) -> int:
        """Numbers per embedding."""
        return self.card.networks.width

    @property
    def official(self) -> bool:
        """Whether papers use it: a converted file of its authors."""
        commands = self.card.provenance.commands
        return bool(commands) and all("convert evaluator" in command for command in commands)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of weights, statistics and sizes."""
        digest = hashlib.sha256(json.dumps([to_json(self.card.networks), self.card.words]).encode())
        for name, tensor in sorted(tensors_of(self).items()):
            digest.update(name.encode() + tensor.cpu().numpy().tobytes())
        return digest.hexdigest()

    @torch.no_grad()
    def motions(self, features: Sequence[ClipFeatures]) -> Float[np.ndarray, "items width"]:
        """Returns the embeddings of motions, each as it would be alone.

        Frames after the last complete movement of four are ignored.

        Raises:
            InputError: A motion is shorter than four frames, or of other features.
        """
        for motion in features:
            frames, width = motion.shape
            if width != self.card.networks.features:
                raise InputError(
                    f"a motion of {width} features a frame; the evaluator {self.card.name!r} takes "
                    f"{self.card.networks.features} ({self.card.representation})"
                )
            if frames < FRAMES:
                raise InputError(
                    f"a motion of {frames} frames; the evaluator needs {FRAMES} or more"
                )
        lengths = [len(motion) // FRAMES * FRAMES for motion in features]
        embeddings = np.zeros((len(features), self.width), np.float32)
        for rows in batches(lengths, MAX_BATCH_SIZE, mixed=False):
            motions = np.stack([features[row][: lengths[row]] for row in rows]).astype(np.float32)
            normalized = torch.from_numpy(self.normalizer.normalize(motions))
            mask = torch.ones(normalized.shape[:2], dtype=torch.bool)
            embeddings[rows] = self.networks.motions(normalized, mask).numpy()
        return embeddings

    @torch.no_grad()
    def texts(self, captions: Sequence[Caption]) -> Float[np.ndarray, "items width"]:
        """Returns the embeddings of captions; each different sentence is read once."""
        numbers: dict[tuple[str, str], int] = {}
        rows = [numbers.setdefault((c.text, c.tokens), len(numbers)) for c in captions]
        different = [Caption(text, 0, 0, tokens) for text, tokens in numbers]
        embeddings = [np.zeros((0, self.width), np.float32)]
        for start in range(0, len(different), MAX_BATCH_SIZE):
            sentences = self.vectors(different[start : start + MAX_BATCH_SIZE])
            arrays = sentences.words, sentences.parts, sentences.mask
            embeddings.append(self.networks.texts(*map(torch.from_numpy, arrays)).numpy())
        return np.concatenate(embeddings)[rows]


def tensors_of(evaluator: T2MEvaluator) -> dict[str, torch.Tensor]:
    """Returns weights, statistics and word vectors by their names in the file."""
    statistics = {MEAN: evaluator.normalizer.mean, STD: evaluator.normalizer.std}
    arrays = {name: np.asarray(values, np.float32) for name, values in statistics.items()}
    if isinstance(evaluator.vectors, GloveWords):
        arrays[WORDS] = np.asarray(evaluator.vectors.vectors, np.float32)
    tensors = {name: torch.from_numpy(values.copy()) for name, values in arrays.items()}
    return {**tensors, **evaluator.networks.state_dict()}


def save_text_motion(
    folder: str | Path, evaluator: T2MEvaluator, encoder: Path | None = None
) -> None:
    """Writes an evaluator folder in place of what is there, or nothing at all.

    Args:
        folder: Folder to write.
        evaluator: The evaluator.
        encoder: Folder of the small text encoder of its words, which is copied.

    Raises:
        InputError: The folder cannot be written.
    """
    tensors = {name: t.detach().cpu().contiguous() for name, t in tensors_of(evaluator).items()}
    with atomic_folder(folder, EVALUATOR_FILE) as temporary:
        write_json(temporary / EVALUATOR_FILE, evaluator.card)
        save_file(tensors, temporary / WEIGHTS_FILE)
        for name in (TEXT_GRAPH_FILE, TOKENIZER_FILE) if encoder else ():
            shutil.copyfile(Path(encoder or "") / name, temporary / name)


def load_text_motion(folder: Path) -> T2MEvaluator:
    """Reads an evaluator folder; the networks are in `eval()` mode, on the CPU.

    Raises:
        ModelError: Something is missing, damaged, or does not fit the rest.
    """
    path = folder / EVALUATOR_FILE
    try:
        card = read_json(TextMotionCard, path)
    except InputError as error:
        raise ModelError(str(error)) from error
    if card.format != FORMAT:
        raise ModelError(f"{path}: format {card.format}, expected {FORMAT}; update latentmotion")
    tensors = read_weights(folder / WEIGHTS_FILE)
    try:
        mean, std = (tensors.pop(name).numpy() for name in (MEAN, STD))
        normalizer = Normalizer(mean, std)
        vectors: WordVectors = (
            GloveWords(card.vocabulary, tensors.pop(WORDS).numpy())
            if card.vocabulary
            else EncodedWords(_text_encoder(card.words, folder))
        )
    except (KeyError, InputError) as error:
        raise ModelError(f"{folder / WEIGHTS_FILE} does not fit: {error}") from error
    networks = card.networks.build()
    load_weights(networks, tensors, str(folder / WEIGHTS_FILE))
    return T2MEvaluator(card, networks, normalizer, vectors)


def _text_encoder(name: str, folder: Path) -> TextEncoder:
    """Loads the text encoder of this name, from the folder or from the hub's cache."""
    if (folder / TEXT_GRAPH_FILE).is_file():
        encoder: TextEncoder = StudentTextEncoder.load(folder)
    else:
        from latentmotion.networks.pretrained_text import KINDS, PretrainedTextEncoder

        kind, _, source = name.partition(":")
        if kind not in KINDS:
            raise ModelError(
                f"{folder} lacks its text encoder {name!r}: {TEXT_GRAPH_FILE}; copy it again"
            )
        encoder = PretrainedTextEncoder.load(kind, source)
    if encoder.name != name:
        raise ModelError(
            f"{folder} reads words through {name!r}, found {encoder.name!r}; "
            "put that text encoder there, or train the evaluator again"
        )
    return encoder


def export_scorer(
    evaluator: T2MEvaluator, folder: Path, data: Dataset | None = None, name: str | None = None
) -> None:
    """Writes a scorer's folder in place of what is there, or nothing at all.

    Args:
        evaluator: Small towers (`train evaluator --preset scorer`).
        folder: Folder to write.
        data: Training data, whose clips' vectors are added.
        name: Name of the scorer; by default the evaluator's.

    Raises:
        DataError: The data have other features.
        InputError: The folder cannot be written.
        ModelError: The evaluator has other networks, or its words come from no text encoder.
    """
    networks, words, card = evaluator.networks, evaluator.vectors, evaluator.card
    if not isinstance(networks, TowerNetworks) or not isinstance(words, EncodedWords):
        raise ModelError(
            f"evaluator {card.name!r} cannot be exported: expected one of latentmotion train "
            "evaluator --preset scorer, without --glove"
        )
    about = scorers.ScorerCard(
        name=name or card.name,
        representation=card.representation,
        text_encoder=words.name,
        word_width=words.width,
        width=evaluator.width,
        fingerprint=evaluator.fingerprint,
        provenance=card.provenance,
        figures=card.figures,
    )
    with atomic_folder(folder, scorers.CARD_FILE) as temporary:
        write_json(temporary / scorers.CARD_FILE, about)
        frames = torch.ones(2, 28, dtype=torch.bool)
        features = torch.randn(2, 28, networks.config.features)
        mean, std = (torch.tensor(v) for v in (evaluator.normalizer.mean, evaluator.normalizer.std))

        def motion_tower(features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            """The motion tower, from features in their own units."""
            return networks.motions((features - mean) / std * mask[..., None], mask)

        towers = FunctionModule(motion_tower, networks=networks)
        trace(towers, {"features": features, "mask": frames}, temporary / scorers.MOTION_FILE)
        states, mask = torch.randn(2, 7, words.width), torch.ones(2, 7, dtype=torch.bool)
        text_tower = FunctionModule(
            lambda words, mask: networks.texts(words, mask.long(), mask), networks=networks
        )
        trace(text_tower, {"words": states, "mask": mask}, temporary / scorers.TEXT_FILE)
        for graph in (scorers.MOTION_FILE, scorers.TEXT_FILE):
            pack_weights(temporary / graph)
        if data is not None:
            scorer = scorers.Scorer.load(temporary, words.encoder)
            training_vectors(data, scorer).write(temporary / scorers.CLIPS_FILE)


def pack_weights(graph: Path) -> None:
    """Keeps a graph's matrices and kernels in 8 bits; engines restore them while they load it.

    Each output of a layer has a scale of its own: of a matrix a column, of a kernel a row.
    """
    model = onnx.load(graph)
    nodes: list[onnx.NodeProto] = []
    for tensor in [*model.graph.initializer]:
        values, name = onnx.numpy_helper.to_array(tensor), tensor.name
        if tensor.data_type != onnx.TensorProto.FLOAT or values.size < FEWEST or values.ndim < 2:
            continue
        inputs = 0 if values.ndim == 2 else tuple(range(1, values.ndim))
        scale = np.maximum(np.abs(values).max(axis=inputs, keepdims=True) / 127, 1e-12)
        packed = np.round(values / scale).astype(np.int8)
        tensor.CopyFrom(onnx.numpy_helper.from_array(packed, f"{name}.packed"))
        model.graph.initializer.append(onnx.numpy_helper.from_array(scale, f"{name}.scale"))
        nodes += scaled_rows(f"{name}.packed", f"{name}.scale", name)
    nodes += model.graph.node
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    graph.write_bytes(model.SerializeToString())
