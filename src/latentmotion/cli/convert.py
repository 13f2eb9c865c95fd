"""`latentmotion convert` and `convert evaluator`: checkpoints of other code to model folders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from latentmotion.cli import options
from latentmotion.errors import FileFormatError, InputError
from latentmotion.storage.array_files import read_array
from latentmotion.storage.files import read_lines


@dataclass(frozen=True)
class Convert:
    """Turn a checkpoint of MLD's, MotionLCM's or MDM's code into a model folder.

    The file is opened without running any code inside it. Its shapes tell most of the sizes; what
    they cannot tell has an option, whose default is what the authors trained.
    """

    file: options.File
    """Checkpoint, e.g. 1222_mld_humanml3d_FID041.ckpt."""
    output: options.Output
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
    """Quantity that the denoiser was trained to predict."""
    text_activation: Literal["relu", "none"] | None = None
    """Activation before the projection of the text: relu in MLD, none in MotionLCM's second
    version; by default told by the shapes."""
    text_encoder: str | None = None
    """Text encoder it was trained with, KIND:FOLDER; by default MLD's or MotionLCM's."""
    labels: tuple[str, ...] = ()
    """Names of its actions, in order; by default HumanAct12's if there are twelve."""
    diffusion_steps: int = 1000
    """Steps of MDM's diffusion: 1000, or 50 in its fast form."""

    def run(self) -> None:
        """Converts the file and prints the networks in it that are not converted.

        Raises:
            InputError: The normalizer is given by half, or does not fit.
            ModelError: The file is no checkpoint of that code, or may hold code.
        """
        from latentmotion.convert import convert_checkpoint, mld

        if (self.mean is None) != (self.std is None):
            raise InputError("--mean and --std belong together: pass both")
        arrays = []
        for path in (self.mean, self.std):
            try:
                arrays += [] if path is None else [read_array(path)]
            except FileFormatError as error:
                raise InputError(f"{error}; not a readable .npy file") from error
        statistics = (arrays[0], arrays[1]) if arrays else None
        origin = mld.Origin(statistics, **options.values_for(mld.Origin, self))
        others = convert_checkpoint(self.file, self.output, origin)
        kinds = {
            "rot2xyz": ": SMPL's body, whose license forbids to pass it on",
            "text_encoder": ": CLIP",
            "clip_model": ": CLIP",
        }
        left = ", ".join(
            f"{name} ({count}{kinds.get(name, '')})" for name, count in sorted(others.items())
        )
        print(f"wrote {self.output}" + (f"; left behind: {left}" if left else ""))


@dataclass(frozen=True)
class ConvertEvaluator:
    """Turn a file of the authors' evaluation into an evaluator folder.

    The names in the file tell what it holds: the T2M evaluator (finest.tar, or one of MLD's
    checkpoints; needs --statistics and --glove), HumanAct12's GRU (humanact12_gru.tar) or UESTC's
    graph network (uestc_rot6d_stgcn.tar). It is opened without running any code inside it.
    """

    file: options.File
    """File of an official evaluator."""
    output: options.Output
    """Evaluator folder to write."""
    statistics: Path | None = None
    """T2M evaluator: folder with mean.npy and std.npy (Comp_v6_KLD01/meta), or t2m_mean.npy ..."""
    glove: Path | None = None
    """T2M evaluator: folder of our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl."""
    labels: Path | None = None
    """Action classifiers: text file with the actions in the order of the logits, one per line, e.g.
    UESTC's action_classes.txt; HumanAct12's are known."""

    def run(self) -> None:
        """Converts the file and prints what it held.

        Raises:
            InputError: Another file is needed and not given.
        """
        from latentmotion.convert import evaluators, reading

        weights = evaluators.action_classifier_weights(reading.read_content(self.file))
        if weights is not None:
            reason = f"{self.file} holds an action classifier"
            options.refuse_unused(self, reason, "statistics", "glove")
            labels = read_lines(self.labels, "label") if self.labels else None
            description = evaluators.convert_action_classifier(
                weights, self.file, self.output, labels
            )
            kind = type(description.network).__name__.removesuffix("Config")
            print(f"wrote {self.output}: {kind}, {len(description.labels)} actions")
            return
        evaluators.evaluator_weights(self.file)
        options.refuse_unused(self, f"{self.file} holds a T2M evaluator", "labels")
        if self.statistics is None or self.glove is None:
            raise InputError(
                f"{self.file} holds a T2M evaluator, which needs --statistics (its own mean.npy "
                "and std.npy) and --glove (its word vectors)"
            )
        evaluators.convert_evaluator(self.file, self.statistics, self.glove, self.output)
        print(f"wrote {self.output}: evaluator of text and motion")
