"""`latentmotion train vae|denoiser|decoder|distill`: the parts of a motion model.

The same command again resumes a run that was stopped. Under torchrun it uses several devices:
`torchrun --nproc-per-node 8 -m latentmotion train vae …`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, arg

from latentmotion.cli.options import (
    AUTO,
    TEXT_ENCODER,
    Changes,
    Data,
    Device,
    OptionalTextEncoder,
    TextEncoderName,
)
from latentmotion.condition.interface import TextEncoder
from latentmotion.condition.task import TASKS
from latentmotion.distillation import Distillation
from latentmotion.experiment import Experiment, TrainingSettings, with_changes
from latentmotion.model.card import read_card
from latentmotion.model.folder import find_model
from latentmotion.presets import PRESETS, preset_named

Preset = Annotated[
    str,
    arg(
        help=f"Experiment to start from: {', '.join(PRESETS)}. The defaults below are those of "
        "the preset."
    ),
]
PRESET = "starter"
"""The preset that training starts from by default."""

Training = OmitArgPrefixes[TrainingSettings]
"""Settings of the optimization, each an option of its own: `--steps`, `--learning-rate` …"""

RunFolder = Annotated[
    Path, arg(aliases=["-o"], help="Run folder to write; an existing run is resumed.")
]


@dataclass(frozen=True)
class TrainVAE:
    """Train a motion VAE (stage 1) and write it to OUTPUT/model."""

    data: Data
    output: RunFolder
    preset: Preset = PRESET
    set: Changes = ()
    """Change any other setting of the experiment, e.g. vae_objective.bones=0.5; repeatable."""
    body: Path | None = None
    """SMPL model file (.npz, or .pkl of plain arrays), for losses on vertices."""
    device: Device = AUTO
    training: Training = field(default_factory=lambda: preset_named(PRESET).vae_training)

    @staticmethod
    def training_of(preset: str) -> TrainingSettings:
        """Returns a preset's settings of this training."""
        return preset_named(preset).vae_training

    def run(self) -> None:
        """Trains to the last step."""
        from latentmotion.training.devices import training_place
        from latentmotion.training.stages import train_vae

        experiment = replace(preset_named(self.preset), vae_training=self.training)
        experiment = with_changes(experiment, self.set)
        with training_place(self.device) as place:
            print(train_vae(experiment, self.data, self.output, place, self.body))


@dataclass(frozen=True)
class TrainDenoiser:
    """Train the denoiser on the latents of a trained VAE (stage 2) and write OUTPUT/model."""

    data: Data
    vae: Path
    """Run folder of `latentmotion train vae`, or model folder; `none` for diffusion on raw
    frames."""
    output: RunFolder
    start: str | None = None
    """Model whose denoiser training starts from, by name, run folder or model folder; its VAE must
    be that of --vae."""
    text_encoder: TextEncoderName = TEXT_ENCODER
    preset: Preset = PRESET
    set: Changes = ()
    """Change any other setting of the experiment, e.g. task=action or sampling.steps=20;
    repeatable."""
    device: Device = AUTO
    training: Training = field(default_factory=lambda: preset_named(PRESET).denoiser_training)

    @staticmethod
    def training_of(preset: str) -> TrainingSettings:
        """Returns a preset's settings of this training."""
        return preset_named(preset).denoiser_training

    def run(self) -> None:
        """Trains to the last step."""
        from latentmotion.training.devices import training_place
        from latentmotion.training.stages import train_denoiser

        experiment = self._experiment()
        vae = None if str(self.vae) == "none" else self.vae
        encoder = self._encoder() if TASKS[experiment.task].reads_text else None
        with training_place(self.device) as place:
            start = self._start()
            print(train_denoiser(experiment, self.data, vae, encoder, self.output, place, start))

    def _experiment(self) -> Experiment:
        experiment = replace(preset_named(self.preset), denoiser_training=self.training)
        return with_changes(experiment, self.set)

    def _start(self) -> Path | None:
        if self.start is None:
            return None
        run = Path(self.start) / "model"
        return run if run.is_dir() else find_model(self.start)

    def _encoder(self) -> TextEncoder:
        from latentmotion.condition.text.cache import CachedTextEncoder

        return CachedTextEncoder(text_encoder_named(self.text_encoder), self.output / "text")


@dataclass(frozen=True)
class TrainDecoder:
    """Train a cheaper decoder for a model's latents and write the whole model to OUTPUT/model.

    Encoder and denoiser stay as they are.

    Example: latentmotion train decoder --model starter --data my_data -o runs/decoder
    """

    model: str
    """Name, run folder or model folder of the model whose latents are decoded."""
    data: Data
    output: RunFolder
    preset: Preset = PRESET
    set: Changes = ()
    """Change any other setting of the experiment, e.g. vae.decoder.dilations='[9,3,1]';
    repeatable. Its VAE is the model's, with a cheaper decoder."""
    imitate: Path | None = None
    """Run folder of a distillation with the same latents. The decoder then also learns to decode
    the latents generated there as that model's own decoder does."""
    device: Device = AUTO
    training: Training = field(default_factory=lambda: preset_named(PRESET).vae_training)

    @staticmethod
    def training_of(preset: str) -> TrainingSettings:
        """Returns a preset's settings of this training."""
        return preset_named(preset).vae_training

    def run(self) -> None:
        """Trains to the last step."""
        from latentmotion.training.decoder import cheaper_vae, train_decoder
        from latentmotion.training.devices import training_place

        model = find_model(self.model)
        experiment = replace(
            preset_named(self.preset), vae=cheaper_vae(model), vae_training=self.training
        )
        experiment = with_changes(experiment, self.set)
        with training_place(self.device) as place:
            print(train_decoder(experiment, self.data, model, self.output, place, self.imitate))


@dataclass(frozen=True)
class TrainDistill:
    """Distill a trained model to 1, 2 and 4 sampling steps, with guidance as an input.

    Example: latentmotion train distill --teacher starter --data my_data -o runs/fast
    """

    teacher: str
    """Name, run folder or model folder of the model to distill."""
    data: Data
    output: RunFolder
    set: Changes = ()
    """Change any other setting of the distillation, e.g. leaps.steps='[1,2,4,8]' for other numbers
    of sampling steps; repeatable."""
    start: Path | None = None
    """Run or model folder of an earlier student of the same teacher, whose weights are the first
    ones."""
    text_encoder: OptionalTextEncoder = None
    device: Device = AUTO
    training: Training = field(default_factory=lambda: Distillation().training)

    def run(self) -> None:
        """Trains to the last step."""
        from latentmotion.training.devices import training_place
        from latentmotion.training.distill import distill, model_folder

        settings = with_changes(Distillation(training=self.training), self.set)
        teacher = model_folder(find_model(self.teacher))
        encoder = self._encoder(teacher)
        start = model_folder(self.start) if self.start else None
        with training_place(self.device) as place:
            print(distill(settings, self.data, teacher, encoder, self.output, place, start))

    def _encoder(self, teacher: Path) -> TextEncoder | None:
        from latentmotion.condition.text.cache import CachedTextEncoder
        from latentmotion.runtime.eager import find_encoder

        card = read_card(teacher)
        if not card.condition.reads_text:
            return None
        named = text_encoder_named(self.text_encoder) if self.text_encoder else None
        return CachedTextEncoder(named or find_encoder(card, teacher), self.output / "text")


def text_encoder_named(name: str) -> TextEncoder:
    """Returns a text encoder by folder, by the model that it belongs to, or by its kind.

    Raises:
        ModelError: There is none, or it cannot be loaded.
    """
    from latentmotion.condition.text.pretrained import KINDS, PretrainedTextEncoder
    from latentmotion.condition.text.student import load_text_encoder

    kind, _, source = name.partition(":")
    if kind in KINDS:
        return PretrainedTextEncoder.load(kind, source or None)
    return load_text_encoder(find_model(name))
