"""`latentmotion train vae` and `latentmotion train denoiser`: both stages, resumable.

The same command again goes on where a killed run was. Under torchrun it runs on many devices:
`torchrun --nproc-per-node 8 -m latentmotion train vae …`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from latentmotion.condition.interface import TextEncoder
from latentmotion.condition.task import TASKS
from latentmotion.experiment import Experiment, with_changes
from latentmotion.presets import PRESETS, preset_named

Output = Annotated[Path, tyro.conf.arg(aliases=["-o"])]
Preset = Annotated[str, tyro.conf.arg(help=f"Experiment to start from: {', '.join(PRESETS)}.")]
Changes = tyro.conf.UseAppendAction[tuple[str, ...]]


@dataclass(frozen=True)
class TrainVAE:
    """Trains a motion VAE (stage 1) and writes it to OUTPUT/model."""

    data: Path
    """Folder that `latentmotion data prepare` made."""
    output: Output
    """Run folder; one that exists is gone on with."""
    preset: Preset = "starter"
    set: Changes = ()
    """Change one value of it, e.g. vae_training.steps=1000; may be given several times."""
    body: Path | None = None
    """SMPL model file (.npz, or .pkl of plain arrays), for losses on vertices."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""

    def run(self) -> None:
        """Trains until done."""
        from latentmotion.training.devices import training_place
        from latentmotion.training.stages import train_vae

        experiment = experiment_of(self.preset, self.set)
        with training_place(self.device) as place:
            print(train_vae(experiment, self.data, self.output, place, self.body))


@dataclass(frozen=True)
class TrainDenoiser:
    """Trains the diffusion on the latents of a trained VAE (stage 2); writes OUTPUT/model."""

    data: Path
    """Folder that `latentmotion data prepare` made."""
    vae: Path
    """Run folder of `latentmotion train vae`, or a model folder; none for raw frames."""
    output: Output
    """Run folder; one that exists is gone on with."""
    text_encoder: str = "starter"
    """Where the task is text: folder of a text encoder, name of a model whose encoder is used, or
    minilm, clip, clip_hidden, distilbert, sentence_t5 or t5, from the hub or after a colon from a
    folder (clip:my/clip)."""
    preset: Preset = "starter"
    set: Changes = ()
    """Change one value of it, e.g. denoiser_training.steps=1000 or task=action; may be given
    several times."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""

    def run(self) -> None:
        """Trains until done."""
        from latentmotion.training.devices import training_place
        from latentmotion.training.stages import train_denoiser

        experiment = experiment_of(self.preset, self.set)
        encoder = self._encoder() if TASKS[experiment.task].reads_text else None
        with training_place(self.device) as place:
            print(train_denoiser(experiment, self.data, self._vae(), encoder, self.output, place))

    def _encoder(self) -> TextEncoder:
        from latentmotion.condition.text.cache import CachedTextEncoder

        return CachedTextEncoder(text_encoder_named(self.text_encoder), self.output / "text")

    def _vae(self) -> Path | None:
        return None if str(self.vae) == "none" else self.vae


def experiment_of(preset: str, changes: tuple[str, ...]) -> Experiment:
    """Returns a preset with changes.

    Raises:
        InputError: Preset or key is unknown; the nearest is named.
    """
    return with_changes(preset_named(preset), changes)


def text_encoder_named(name: str) -> TextEncoder:
    """Returns a text encoder by folder, by the model that it belongs to, or by its kind.

    Raises:
        ModelError: There is none, or it cannot be loaded.
    """
    from latentmotion.condition.text.pretrained import KINDS, PretrainedTextEncoder
    from latentmotion.condition.text.student import load_text_encoder
    from latentmotion.model.folder import find_model

    kind, _, source = name.partition(":")
    if kind in KINDS:
        return PretrainedTextEncoder.load(kind, source or None)
    return load_text_encoder(find_model(name))
