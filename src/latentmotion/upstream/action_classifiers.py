"""The action classifiers of the authors' evaluation → evaluator folders.

HumanAct12's GRU is `humanact12_gru.tar` (Action2Motion, MIT), a training state whose entry `model`
holds the weights; UESTC's graph network is `uestc_rot6d_stgcn.tar` (ACTOR), the weights alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torch import Tensor

from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.extractors.action_classifier import (
    ActionClassifier,
    save_action_classifier,
)
from latentmotion.evaluation.extractors.gru import HUMANACT12_LABELS, MotionGRUConfig
from latentmotion.evaluation.extractors.interface import EVALUATOR_FILE
from latentmotion.evaluation.extractors.stgcn import GraphNetworkConfig
from latentmotion.storage.files import check_replaceable, sha256

GRU_WEIGHT, GRAPH_WEIGHT = "recurrent.weight_ih_l0", "st_gcn_networks.0.gcn.conv.weight"
"""Names by which the files are known."""


def weights_of(content: Any) -> dict[str, Tensor] | None:
    """Returns the weights in what a file of one of the classifiers holds; None for other files."""
    state = content.get("model", content) if isinstance(content, Mapping) else None
    if not isinstance(state, Mapping) or not {GRU_WEIGHT, GRAPH_WEIGHT} & set(state):
        return None
    return {str(key): value for key, value in state.items() if isinstance(value, Tensor)}


def convert_action_classifier(
    weights: Mapping[str, Tensor], source: Path, folder: Path, labels: Sequence[str] | None = None
) -> ActionClassifier:
    """Writes the evaluator folder of an official file; returns what it says.

    Args:
        weights: What `weights_of` returned.
        source: The file, for the record.
        folder: The folder to write.
        labels: The labels in the order of the logits; HumanAct12's are known, others are counted
            from 0 where none are given.

    Raises:
        ModelError: The weights have names or shapes of another network.
        InputError: The number of labels differs, or the folder cannot be written.
    """
    check_replaceable(folder, EVALUATOR_FILE)
    network = _network(weights, source)
    about = ActionClassifier(
        labels=_labels(labels, network.labels),
        representation="smpl",
        network=network,
        origin=f"{source.name}, SHA-256 {sha256(source)}",
        license="MIT, (c) Chuan Guo" if isinstance(network, MotionGRUConfig) else "see ACTOR",
    )
    save_action_classifier(folder, about, weights)
    return about


def _network(weights: Mapping[str, Tensor], source: Path) -> MotionGRUConfig | GraphNetworkConfig:
    try:
        if GRU_WEIGHT in weights:
            return _gru(weights)
        labels, channels = len(weights["fcn.weight"]), weights[GRAPH_WEIGHT].shape[1]
        return GraphNetworkConfig(labels=labels, channels=channels)
    except (KeyError, IndexError) as error:
        raise ModelError(f"{source}: a weight is missing: {error}; download it again") from error


def _gru(weights: Mapping[str, Tensor]) -> MotionGRUConfig:
    labels, width = weights["linear2.weight"].shape
    return MotionGRUConfig(
        joints=weights[GRU_WEIGHT].shape[1] // 3,
        labels=labels,
        hidden=weights["recurrent.weight_hh_l0"].shape[1],
        layers=sum(key.startswith("recurrent.weight_ih_l") for key in weights),
        width=width,
    )


def _labels(given: Sequence[str] | None, count: int) -> tuple[str, ...]:
    if given is None:
        known = len(HUMANACT12_LABELS) == count
        return HUMANACT12_LABELS if known else tuple(str(number) for number in range(count))
    if len(given) != count:
        raise InputError(f"{len(given)} labels given, the classifier has {count}; give them all")
    return tuple(given)
