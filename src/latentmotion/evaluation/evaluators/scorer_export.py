"""Export of an evaluator of small towers as a scorer: two graphs, a card, vectors of its clips."""

from __future__ import annotations

from pathlib import Path

import onnx
import torch
from onnx import helper, numpy_helper
from torch import Tensor, nn

from latentmotion.data.dataset import Dataset
from latentmotion.errors import ModelError
from latentmotion.evaluation.evaluators.text_motion import T2MEvaluator
from latentmotion.evaluation.evaluators.text_motion_network import TowerNetworks
from latentmotion.evaluation.evaluators.words import EncodedWords
from latentmotion.export.graph_weights import FEWEST
from latentmotion.export.onnx import trace
from latentmotion.ranking import scorer as scorers
from latentmotion.ranking.nearest import training_vectors
from latentmotion.storage.configuration import write_json
from latentmotion.storage.files import atomic_folder


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
        motions = _MotionGraph(networks, evaluator)
        trace(motions, {"features": features, "mask": frames}, temporary / scorers.MOTION_FILE)
        states, mask = torch.randn(2, 7, words.width), torch.ones(2, 7, dtype=torch.bool)
        trace(_TextGraph(networks), {"words": states, "mask": mask}, temporary / scorers.TEXT_FILE)
        for graph in (scorers.MOTION_FILE, scorers.TEXT_FILE):
            halve_weights(temporary / graph)
        if data is not None:
            scorer = scorers.Scorer.load(temporary, words.encoder)
            training_vectors(data, scorer).write(temporary / scorers.CLIPS_FILE)


def halve_weights(graph: Path) -> None:
    """Keeps a graph's weights in 16 bits; engines cast them to 32 while they load it."""
    model = onnx.load(graph)
    casts = []
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.data_type != onnx.TensorProto.FLOAT or values.size < FEWEST:
            continue
        name = tensor.name
        tensor.CopyFrom(numpy_helper.from_array(values.astype("float16"), f"{name}.half"))
        casts.append(helper.make_node("Cast", [f"{name}.half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    copies = [onnx.NodeProto.FromString(node.SerializeToString()) for node in nodes]
    del model.graph.node[:]
    model.graph.node.extend(copies)
    graph.write_bytes(model.SerializeToString())


class _MotionGraph(nn.Module):
    """The motion tower, from features in their own units."""

    mean: Tensor
    std: Tensor

    def __init__(self, networks: TowerNetworks, evaluator: T2MEvaluator) -> None:
        super().__init__()
        self.networks = networks
        self.register_buffer("mean", torch.tensor(evaluator.normalizer.mean))
        self.register_buffer("std", torch.tensor(evaluator.normalizer.std))

    def forward(self, features: Tensor, mask: Tensor) -> Tensor:
        normalized = (features - self.mean) / self.std
        return self.networks.motions(normalized * mask[..., None], mask)


class _TextGraph(nn.Module):
    """The text tower."""

    def __init__(self, networks: TowerNetworks) -> None:
        super().__init__()
        self.networks = networks

    def forward(self, words: Tensor, mask: Tensor) -> Tensor:
        return self.networks.texts(words, mask.long(), mask)
