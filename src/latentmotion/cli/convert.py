"""`latentmotion convert FILE.ckpt -o FOLDER`: MLD's or MotionLCM's file becomes our folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from latentmotion.errors import InputError, MissingExtraError


@dataclass(frozen=True)
class Convert:
    """Turn a checkpoint of MLD's or MotionLCM's code into a model folder.

    The file is opened without running any code inside it. Sizes are told by its shapes; what shapes
    can't tell has an option, whose default is what the authors trained.
    """

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """The checkpoint, e.g. 1222_mld_humanml3d_FID041.ckpt."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """The model folder to write."""
    mean: Path | None = None
    """Mean.npy of the data set it was trained on."""
    std: Path | None = None
    """Std.npy of the data set it was trained on."""
    heads: int = 4
    """Attention heads."""
    activation: Literal["gelu", "relu"] = "gelu"
    """Activation of the VAE's feed-forward parts."""
    norm: Literal["post", "pre"] = "post"
    """Whether the VAE's layers normalize after or before their parts."""
    predicts: Literal["epsilon", "sample"] = "epsilon"
    """What the denoiser was trained to predict."""
    text_activation: Literal["relu", "none"] | None = None
    """What is before the text's projection: relu in MLD, none in MotionLCM's second version."""
    text_encoder: str | None = None
    """The text encoder it was trained with, KIND:FOLDER; by default MLD's or MotionLCM's."""
    labels: tuple[str, ...] = ()
    """Names of its actions, in their order; by default HumanAct12's for its twelve."""

    def run(self) -> None:
        """Converts, and says what was left behind."""
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


def _told(name: str, count: int) -> str:
    """Says what the weights of a foreign network are."""
    kinds = {"rot2xyz": "SMPL's body, whose license forbids to pass it on", "text_encoder": "CLIP"}
    return f"{name} ({count}" + (f": {kinds[name]})" if name in kinds else ")")


def _read_array(path: Path) -> np.ndarray:
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is not a readable .npy file: {error}") from error
