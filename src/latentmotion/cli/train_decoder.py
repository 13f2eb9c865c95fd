"""`latentmotion train decoder`: another decoder for the latents that a model has, resumable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from latentmotion.cli.train import Changes, Output, Preset
from latentmotion.experiment import with_changes
from latentmotion.presets import preset_named


@dataclass(frozen=True)
class TrainDecoder:
    """Trains a cheaper decoder for a model's latents and writes the whole model to OUTPUT/model.

    Encoder and denoiser stay as they are. The same command again goes on where a killed run was.

    Example: latentmotion train decoder --vae starter --data my_data -o runs/decoder
    """

    vae: str
    """Name, run folder or model folder of the model whose latents are decoded."""
    data: Path
    """Folder that `latentmotion data prepare` made, the one that the model was trained on."""
    output: Output
    """Run folder; one that exists is gone on with."""
    preset: Preset = "starter"
    set: Changes = ()
    """Change one value of it, e.g. vae_training.steps=1000 or vae.decoder.dilations='[9,3,1]'; may
    be given several times. Its VAE is the model's with a cheaper decoder."""
    imitate: Path | None = None
    """Run folder of a distillation with the same latents. Of those that it generated the new
    decoder then learns, beside the motions of DATA, to make what that model's decoder makes."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""

    def run(self) -> None:
        """Trains until done."""
        from latentmotion.model.folder import find_model
        from latentmotion.training.decoder import cheaper_vae, train_decoder
        from latentmotion.training.devices import training_place

        model = find_model(self.vae)
        experiment = replace(preset_named(self.preset), vae=cheaper_vae(model))
        experiment = with_changes(experiment, self.set)
        with training_place(self.device) as place:
            print(train_decoder(experiment, self.data, model, self.output, place, self.imitate))
