"""`latentmotion convert` and `convert evaluator`: files of other code become our folders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from latentmotion.cli.options import File, Output
from latentmotion.errors import InputError, MissingExtraError
from latentmotion.storage.files import read_lines


@dataclass(frozen=True)
class Convert:
    """Turn a checkpoint of MLD's or MotionLCM's code into a model folder.

    The file is opened without running any code inside it. Its shapes tell most of the sizes; what
    they cannot tell has an option, whose default is what the authors trained.
    """

    file: File
    """Checkpoint, e.g. 1222_mld_humanml3d_FID041.ckpt."""
    output: Output
    """Model folder to write."""
    mean: Path | None = None
    """Mean.npy of the data set it was trained on."""
    std: Path | None = None
    """Std.npy of the data set it was trained on."""
    heads: int = 4
    """Attention heads."""
    activation: Literal["gelu", "relu"] = "gelu"
    """Activation of the VAE's feed-forward layers."""
    norm: Literal["post", "pre"] = "post"
    """Whether the VAE's layers normalize after (post) or before (pre) their sublayers."""
    predicts: Literal["epsilon", "sample"] = "epsilon"
    """What the denoiser was trained to predict."""
    text_activation: Literal["relu", "none"] | None = None
    """Activation before the projection of the text: relu in MLD, none in MotionLCM's second
    version; by default told by the shapes."""
    text_encoder: str | None = None
    """Text encoder it was trained with, KIND:FOLDER; by default MLD's or MotionLCM's."""
    labels: tuple[str, ...] = ()
    """Names of its actions, in order; by default HumanAct12's if there are twelve."""

    def run(self) -> None:
        """Converts, and prints what was left behind."""
        try:
            from latentmotion.upstream.configurations import Unstated
            from latentmotion.upstream.conversion import Origin, convert_checkpoint
        except ImportError as error:
            raise MissingExtraError("converting a checkpoint", "PyTorch", "train") from error
        unstated = Unstated(
            heads=self.heads,
            activation=self.activation,
            norm=self.norm,
            text_activation=self.text_activation,
        )
        known = self._normalizer(), unstated, self.predicts, self.text_encoder, self.labels
        origin = Origin(*known)
        others = convert_checkpoint(self.file, self.output, origin)
        left = ", ".join(_told(name, count) for name, count in sorted(others.items()))
        print(f"wrote {self.output}" + (f"; left behind: {left}" if left else ""))

    def _normalizer(self) -> tuple[np.ndarray, np.ndarray] | None:
        if self.mean is None and self.std is None:
            return None
        if self.mean is None or self.std is None:
            raise InputError("--mean and --std belong together: pass both")
        return _read_array(self.mean), _read_array(self.std)


@dataclass(frozen=True)
class ConvertEvaluator:
    """Turn a file of the authors' evaluation into an evaluator folder.

    The names in the file tell what it holds: the T2M evaluator (finest.tar, or one of MLD's
    checkpoints; needs --statistics and --glove), HumanAct12's GRU (humanact12_gru.tar) or UESTC's
    graph network (uestc_rot6d_stgcn.tar). It is opened without running any code inside it.
    """

    file: File
    """File of an official evaluator."""
    output: Output
    """Evaluator folder to write."""
    statistics: Path | None = None
    """T2M evaluator: folder with mean.npy and std.npy (Comp_v6_KLD01/meta), or t2m_mean.npy ..."""
    glove: Path | None = None
    """T2M evaluator: folder of our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl."""
    labels: Path | None = None
    """Action classifiers: text file with the actions in the order of the logits, one per line, e.g.
    UESTC's action_classes.txt; HumanAct12's are known."""

    def run(self) -> None:
        """Converts, and prints what it was.

        Raises:
            InputError: Another file is needed and not given.
        """
        try:
            from latentmotion.upstream.action_classifiers import weights_of
            from latentmotion.upstream.reading import read_content
        except ImportError as error:
            raise MissingExtraError("converting an evaluator", "PyTorch", "train") from error
        weights = weights_of(read_content(self.file))
        what = self._text_motion() if weights is None else self._actions(weights)
        print(f"wrote {self.output}: {what}")

    def _text_motion(self) -> str:
        from latentmotion.upstream.evaluators import (
            EvaluatorFiles,
            convert_evaluator,
            evaluator_weights,
        )

        evaluator_weights(self.file)
        if self.statistics is None or self.glove is None:
            raise InputError(
                f"{self.file} holds a T2M evaluator, which needs --statistics (its own mean.npy "
                "and std.npy) and --glove (its word vectors)"
            )
        convert_evaluator(EvaluatorFiles(self.file, self.statistics, self.glove), self.output)
        return "evaluator of text and motion"

    def _actions(self, weights: dict) -> str:
        from latentmotion.upstream.action_classifiers import convert_action_classifier

        about = convert_action_classifier(weights, self.file, self.output, self._labels())
        kind = type(about.network).__name__.removesuffix("Config")
        return f"{kind}, {len(about.labels)} actions"

    def _labels(self) -> list[str] | None:
        return read_lines(self.labels, "label") if self.labels else None


def _told(name: str, count: int) -> str:
    """Describes the weights of a foreign network."""
    kinds = {"rot2xyz": "SMPL's body, whose license forbids to pass it on", "text_encoder": "CLIP"}
    return f"{name} ({count}" + (f": {kinds[name]})" if name in kinds else ")")


def _read_array(path: Path) -> np.ndarray:
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is not a readable .npy file: {error}") from error
