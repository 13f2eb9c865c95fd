"""Official evaluators to evaluator folders: the T2M authors', and two action classifiers.

T2M: `finest.tar` is a dictionary of `text_encoder`, `movement_encoder` and `motion_encoder`, beside
the optimizers' states; MLD's own checkpoints hold the same networks under names with `t2m_`.
Neither holds the statistics that motions are normalized by, which are not those of the data set.

Actions: HumanAct12's GRU is `humanact12_gru.tar` (Action2Motion, MIT), a training state whose entry
`model` holds the weights; UESTC's graph network is `uestc_rot6d_stgcn.tar` (ACTOR), the weights
alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from latentmotion.convert.reading import read_content, tensors_of
from latentmotion.data.sources.actor import ACTIONS
from latentmotion.errors import FileFormatError, InputError, ModelError
from latentmotion.evaluation.evaluators import action, text_motion
from latentmotion.evaluation.evaluators.interface import EVALUATOR_FILE
from latentmotion.evaluation.evaluators.text_motion_network import TextMotionConfig
from latentmotion.evaluation.evaluators.words import read_glove
from latentmotion.model.card import Provenance
from latentmotion.networks.checkpoint import built
from latentmotion.representation.interface import Normalizer
from latentmotion.storage.array_files import read_array
from latentmotion.storage.files import check_replaceable, sha256

# Weights by which the action classifiers are recognized.
GRU_WEIGHT, GRAPH_WEIGHT = "recurrent.weight_ih_l0", "st_gcn_networks.0.gcn.conv.weight"

# The networks, by their names in finest.tar and in MLD's checkpoints.
_PARTS = {
    "text_encoder": "t2m_textencoder",
    "movement_encoder": "t2m_moveencoder",
    "motion_encoder": "t2m_motionencoder",
}

# Features that the evaluator does not read.
_CONTACTS = 4

# Representation, and the authors' name for the data set, by the number of features.
_KNOWN = {263: ("humanml3d", "t2m"), 251: ("kit", "kit")}


def convert_evaluator(
    checkpoint: Path, statistics: Path, glove: Path, output: str | Path
) -> text_motion.TextMotionCard:
    """Converts the authors' evaluator; writes the whole folder or nothing, returns its card.

    Args:
        checkpoint: `text_mot_match/model/finest.tar`, or a checkpoint of MLD's code.
        statistics: Folder with mean.npy and std.npy (`Comp_v6_KLD01/meta`), or t2m_mean.npy and
            so on.
        glove: Folder with our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl.
        output: Folder to write.

    Raises:
        ModelError: A file is missing, cannot be opened safely, or is not of their evaluator.
        FileFormatError: The word vectors or statistics are damaged.
        InputError: Statistics or word vectors do not fit the networks.
    """
    weights = evaluator_weights(checkpoint)
    config = evaluator_config(weights, checkpoint)
    networks, features = built(config.build, weights, str(checkpoint)), config.features
    vectors = read_glove(glove)
    if vectors.width != config.word_width:
        raise InputError(
            f"{glove} has vectors of {vectors.width} numbers, the evaluator reads "
            f"{config.word_width}"
        )
    card = text_motion.TextMotionCard(
        name=checkpoint.stem,
        representation=_KNOWN[config.features][0],
        networks=config,
        words=vectors.name,
        vocabulary=vectors.words,
        provenance=Provenance(
            data_hashes={checkpoint.name: sha256(checkpoint)},
            license="as its authors say (the T2M code is MIT; the data behind it has terms of its "
            "own)",
            commands=(f"latentmotion convert evaluator {checkpoint.name}",),
        ),
    )
    mean, std = (read_statistic(statistics, name, features) for name in ("mean", "std"))
    normalizer = Normalizer(mean, std)
    text_motion.save_text_motion(
        output, text_motion.T2MEvaluator(card, networks, normalizer, vectors)
    )
    return card


def evaluator_weights(path: Path) -> dict[str, Tensor]:
    """Returns the weights of the three networks, by our names.

    Raises:
        ModelError: The file is missing, damaged, holds code, or lacks one of the networks.
    """
    content = read_content(path)
    networks = content if isinstance(content, Mapping) else {}
    state = tensors_of(networks.get("state_dict"))
    parts = {
        part: tensors_of(networks.get(part))
        or {k.removeprefix(f"{old}."): v for k, v in state.items() if k.startswith(f"{old}.")}
        for part, old in _PARTS.items()
    }
    missing = [part for part in _PARTS if not parts[part]]
    if missing:
        keys = ", ".join(map(str, list(content)[:5])) if isinstance(content, Mapping) else content
        raise ModelError(
            f"{path} lacks {', '.join(missing)}, found {keys!s:.100}; expected the T2M code's "
            "text_mot_match/model/finest.tar"
        )
    return {
        f"{part}.{name}": tensor.float()
        for part, weights in parts.items()
        for name, tensor in weights.items()
    }


def evaluator_config(weights: Mapping[str, Tensor], source: str | Path) -> TextMotionConfig:
    """Returns the sizes of the networks from the shapes of their weights.

    Raises:
        ModelError: A weight is missing, or the features are of no known data set.
    """
    try:
        movement, features, _ = weights["movement_encoder.main.0.weight"].shape
        config = TextMotionConfig(
            features=features + _CONTACTS,
            left_out=_CONTACTS,
            word_width=weights["text_encoder.pos_emb.weight"].shape[0],
            movement_width=movement,
            motion_hidden=weights["motion_encoder.hidden"].shape[-1],
            text_hidden=weights["text_encoder.hidden"].shape[-1],
            width=weights["motion_encoder.output_net.3.weight"].shape[0],
        )
    except (KeyError, ValueError, IndexError) as error:
        raise ModelError(f"{source} is no evaluator of the T2M code: {error!r}") from error
    if config.features not in _KNOWN:
        raise ModelError(
            f"{source} sees {features} features a frame, expected 259 (HumanML3D) or 247 (KIT)"
        )
    return config


def read_statistic(folder: Path, name: str, features: int) -> np.ndarray:
    """Reads the mean or the standard deviation of an evaluator's features.

    Args:
        folder: Folder of the statistics.
        name: `mean` or `std`.
        features: Number of features.

    Raises:
        InputError: There is no such file, it is damaged, or it is of other features.
    """
    choices = [folder / f"{name}.npy", folder / f"{_KNOWN[features][1]}_{name}.npy"]
    path = next((path for path in choices if path.is_file()), None)
    if path is None:
        raise InputError(
            f"{folder} has neither {choices[0].name} nor {choices[1].name}; pass the evaluator's "
            "own statistics, Comp_v6_KLD01/meta (KIT: Comp_v6_KLD005/meta) of the T2M code"
        )
    try:
        values = read_array(path).astype(np.float32).ravel()
    except (FileFormatError, ValueError) as error:
        raise InputError(f"{path} is not a readable .npy file: {error}") from error
    if len(values) != features:
        raise InputError(f"{path} has {len(values)} numbers, the evaluator {features} features")
    return values


def action_classifier_weights(content: Any) -> dict[str, Tensor] | None:
    """Returns the weights of an action classifier from a file's content; None for other files."""
    state = content.get("model", content) if isinstance(content, Mapping) else None
    if not isinstance(state, Mapping) or not {GRU_WEIGHT, GRAPH_WEIGHT} & set(state):
        return None
    return tensors_of(state)


def convert_action_classifier(
    weights: Mapping[str, Tensor], source: Path, folder: Path, labels: Sequence[str] | None = None
) -> action.ActionClassifier:
    """Writes the evaluator folder of an official action classifier; returns its description.

    Args:
        weights: Weights that `action_classifier_weights` returned.
        source: The file, for the record.
        folder: The folder to write.
        labels: The labels in the order of the logits; HumanAct12's are known, others are counted
            from 0 where none are given.

    Raises:
        ModelError: The weights have names or shapes of another network.
        InputError: The number of labels differs, or the folder cannot be written.
    """
    check_replaceable(folder, EVALUATOR_FILE)
    network = action_classifier_config(weights, source)
    count = network.labels
    if labels is None:
        is_humanact12 = len(ACTIONS) == count
        labels = ACTIONS if is_humanact12 else [str(number) for number in range(count)]
    if len(labels) != count:
        raise InputError(f"{len(labels)} labels given, the classifier has {count}; give them all")
    description = action.ActionClassifier(
        labels=tuple(labels),
        representation="smpl",
        network=network,
        origin=f"{source.name}, SHA-256 {sha256(source)}",
        license="MIT, (c) Chuan Guo"
        if isinstance(network, action.MotionGRUConfig)
        else "see ACTOR",
    )
    action.save_action_classifier(folder, description, weights)
    return description


def action_classifier_config(
    weights: Mapping[str, Tensor], source: Path
) -> action.MotionGRUConfig | action.GraphNetworkConfig:
    """Returns the sizes of a classifier from the shapes of its weights.

    Raises:
        ModelError: A weight is missing.
    """
    try:
        if GRU_WEIGHT not in weights:
            labels, channels = len(weights["fcn.weight"]), weights[GRAPH_WEIGHT].shape[1]
            return action.GraphNetworkConfig(labels=labels, channels=channels)
        labels, width = weights["linear2.weight"].shape
        return action.MotionGRUConfig(
            joints=weights[GRU_WEIGHT].shape[1] // 3,
            labels=labels,
            hidden=weights["recurrent.weight_hh_l0"].shape[1],
            layers=sum(key.startswith("recurrent.weight_ih_l") for key in weights),
            width=width,
        )
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise ModelError(f"{source}: a weight is missing: {error}; download it again") from error
