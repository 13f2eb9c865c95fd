"""`latentmotion convert FILE.ckpt -o FOLDER`: the MLD authors' checkpoint becomes our folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from latentmotion.errors import InputError, MissingExtraError


@dataclass(frozen=True)
class Convert:
    """Turn a checkpoint of the MLD authors' code into a model folder.

    The file is opened without running any code inside it. Sizes are told by its shapes; what shapes
    can't tell has an option, whose default is what the authors trained.
    """

    file: tyro.conf.Positional[Path]
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

    def run(self) -> None:
        """Converts, and says what was left behind."""
        try:
            from latentmotion.upstream.configurations import Unstated
            from latentmotion.upstream.conversion import Origin, convert_checkpoint
        except ImportError as error:
            raise MissingExtraError("converting a checkpoint", "PyTorch", "train") from error
        unstated = Unstated(heads=self.heads, activation=self.activation, norm=self.norm)
        origin = Origin(self._normalizer(), unstated, self.predicts)
        others = convert_checkpoint(self.file, self.output, origin)
        left = ", ".join(f"{name} ({count})" for name, count in sorted(others.items()))
        print(f"wrote {self.output}" + (f"; left behind: {left}" if left else ""))

    def _normalizer(self) -> tuple[np.ndarray, np.ndarray] | None:
        if self.mean is None and self.std is None:
            return None
        if self.mean is None or self.std is None:
            raise InputError("--mean and --std belong together: pass both")
        return _read_array(self.mean), _read_array(self.std)


def _read_array(path: Path) -> np.ndarray:
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is not a readable .npy file: {error}") from error
