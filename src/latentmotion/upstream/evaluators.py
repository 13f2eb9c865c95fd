"""The T2M authors' evaluator (`finest.tar`) becomes an evaluator folder.

The file is a dictionary of `text_encoder`, `movement_encoder` and `motion_encoder`, beside the
optimizers' states; MLD's own checkpoints hold the same networks under names with `t2m_`. Neither
holds the statistics that motions are normalized by, which are not those of the data set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from latentmotion.checkpoint import load_weights
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.extractors.glove import read_glove
from latentmotion.evaluation.extractors.networks import TextMotionConfig
from latentmotion.evaluation.extractors.text_motion import TextMotionCard, TextMotionEvaluator
from latentmotion.evaluation.extractors.text_motion_folder import save_text_motion
from latentmotion.model.card import Provenance
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.files import sha256
from latentmotion.upstream.reading import read_content

_PARTS = {
    "text_encoder": "t2m_textencoder",
    "movement_encoder": "t2m_moveencoder",
    "motion_encoder": "t2m_motionencoder",
}
"""The networks, by their names in finest.tar and in MLD's checkpoints."""

_CONTACTS = 4
"""Features that the evaluator leaves out."""

_KNOWN = {263: ("humanml3d", "t2m"), 251: ("kit", "kit")}
"""Representation, and the authors' name for the data set, by the number of features."""


@dataclass(frozen=True)
class EvaluatorFiles:
    """What an evaluator is made of."""

    checkpoint: Path
    """`text_mot_match/model/finest.tar`, or a checkpoint of MLD's code."""
    statistics: Path
    """Folder with mean.npy and std.npy (`Comp_v6_KLD01/meta`), or t2m_mean.npy and so on."""
    glove: Path
    """Folder with our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl."""


def convert_evaluator(files: EvaluatorFiles, output: str | Path) -> TextMotionCard:
    """Converts the authors' evaluator; writes the whole folder or nothing, returns what it is.

    Raises:
        ModelError: A file is missing, can't be opened safely, or is none of their evaluator.
        FileFormatError: The word vectors or statistics are damaged.
        InputError: Statistics or word vectors do not fit the networks.
    """
    weights = evaluator_weights(files.checkpoint)
    config = evaluator_config(weights, files.checkpoint)
    networks = config.build()
    load_weights(networks, weights, str(files.checkpoint))
    vectors = read_glove(files.glove)
    if vectors.width != config.word_width:
        raise InputError(
            f"{files.glove} has vectors of {vectors.width} numbers, the evaluator reads "
            f"{config.word_width}"
        )
    card = TextMotionCard(
        name=files.checkpoint.stem,
        representation=_KNOWN[config.features][0],
        networks=config,
        words=vectors.name,
        vocabulary=vectors.words,
        provenance=_provenance(files),
    )
    normalizer = _statistics(files.statistics, config.features)
    save_text_motion(output, TextMotionEvaluator(card, networks, normalizer, vectors))
    return card


def evaluator_weights(path: Path) -> dict[str, Tensor]:
    """Returns the weights of the three networks, by our names.

    Raises:
        ModelError: The file is missing, damaged, holds code, or lacks one of the networks.
    """
    content = read_content(path)
    parts = _parts(content if isinstance(content, Mapping) else {})
    missing = [part for part in _PARTS if not parts[part]]
    if missing:
        found = ", ".join(map(str, list(content)[:5])) if isinstance(content, Mapping) else content
        raise ModelError(
            f"{path} lacks {', '.join(missing)}, found {found!s:.100}; expected the T2M code's "
            "text_mot_match/model/finest.tar"
        )
    return {
        f"{part}.{name}": tensor.float()
        for part, weights in parts.items()
        for name, tensor in weights.items()
    }


def evaluator_config(weights: Mapping[str, Tensor], source: str | Path) -> TextMotionConfig:
    """Returns the sizes that the shapes tell.

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
    except (KeyError, ValueError) as error:
        raise ModelError(f"{source} is no evaluator of the T2M code: {error!r}") from error
    if config.features not in _KNOWN:
        raise ModelError(
            f"{source} sees {features} features a frame, expected 259 (HumanML3D) or 247 (KIT)"
        )
    return config


def _parts(content: Mapping[Any, Any]) -> dict[str, dict[str, Tensor]]:
    state = content.get("state_dict", {})
    return {
        part: _tensors(content.get(part, {})) or _tensors(_without(state, f"{prefix}."))
        for part, prefix in _PARTS.items()
    }


def _tensors(weights: Any) -> dict[str, Tensor]:
    items = weights.items() if isinstance(weights, Mapping) else ()
    return {str(name): value for name, value in items if isinstance(value, Tensor)}


def _without(state: Any, prefix: str) -> dict[str, Any]:
    items = state.items() if isinstance(state, Mapping) else ()
    return {str(k).removeprefix(prefix): v for k, v in items if str(k).startswith(prefix)}


def _statistics(folder: Path, features: int) -> Normalizer:
    mean, std = (_statistic(folder, name, features) for name in ("mean", "std"))
    return Normalizer(mean, std)


def _statistic(folder: Path, name: str, features: int) -> np.ndarray:
    choices = [folder / f"{name}.npy", folder / f"{_KNOWN[features][1]}_{name}.npy"]
    path = next((path for path in choices if path.is_file()), None)
    if path is None:
        raise InputError(
            f"{folder} has neither {choices[0].name} nor {choices[1].name}; pass the evaluator's "
            "own statistics, Comp_v6_KLD01/meta (KIT: Comp_v6_KLD005/meta) of the T2M code"
        )
    try:
        values = np.load(path, allow_pickle=False).astype(np.float32).ravel()
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is not a readable .npy file: {error}") from error
    if len(values) != features:
        raise InputError(f"{path} has {len(values)} numbers, the evaluator {features} features")
    return values


def _provenance(files: EvaluatorFiles) -> Provenance:
    return Provenance(
        data_hashes={files.checkpoint.name: sha256(files.checkpoint)},
        license="as its authors say (the T2M code is MIT; the data behind it has terms of its own)",
        commands=(f"latentmotion convert evaluator {files.checkpoint.name}",),
    )
