"""Output of a run: progress with time left, journal, TensorBoard's events, sampled motions."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.parametrization import Estimator
from latentmotion.diffusion.samplers import Sampler, SeededNoise
from latentmotion.engine.backend import Batch, FeatureDecoder
from latentmotion.errors import InputError, MissingExtraError, hint
from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import features_from_noise
from latentmotion.plugins import plugin, plugin_names, warn_of
from latentmotion.representation.interface import representation_named
from latentmotion.storage.files import atomic_file

NAME = "journal.jsonl"

LOGGERS = "LATENTMOTION_LOGGERS"
"""Environment variable: names of plugins that receive the figures, separated by commas."""


class Journal:
    """Writes figures of a run; lines of steps that a kill undid are removed on opening.

    Args:
        folder: The run folder.
        steps: Steps of the whole run, for the time left.
        done: Steps that the snapshot holds.

    Raises:
        InputError: LATENTMOTION_LOGGERS names a logger that is not installed.
    """

    def __init__(self, folder: Path, steps: int, done: int = 0) -> None:
        self._steps = steps
        self._loggers = _opened_loggers(folder, done)
        lines = [line for line in read_journal(folder) if line["step"] <= done]
        with atomic_file(folder / NAME) as temporary:
            text = "".join(json.dumps(line) + "\n" for line in lines)
            temporary.write_text(text, encoding="utf-8")
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError as error:
            raise MissingExtraError(
                "the journal of a training run", "tensorboard", "train"
            ) from error
        self._file = (folder / NAME).open("a", encoding="utf-8")
        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=done + 1)

    def close(self) -> None:
        """Ends the files."""
        self._file.close()
        self._board.close()
        self._notify(lambda logger: logger.close())

    def write(self, step: int, kind: str, figures: Mapping[str, float]) -> None:
        """Appends figures (losses, rates, millimeters) of `kind` "train" or "validation"."""
        rounded = {name: float(f"{value:.6g}") for name, value in figures.items()}
        self._file.write(json.dumps({"step": step, "kind": kind, **rounded}) + "\n")
        self._file.flush()
        for name, value in rounded.items():
            self._board.add_scalar(f"{kind}/{name}", value, step)
        self._notify(lambda logger: logger.write(step, kind, rounded))

    def _notify(self, what: Callable[[Any], object]) -> None:
        """Calls every logger; one that fails is left out from then on."""
        for name in list(self._loggers):
            try:
                what(self._loggers[name])
            except Exception as error:  # of a package that is not ours
                warn_of("latentmotion.loggers", name, error)
                del self._loggers[name]

    def show(self, step: int, kind: str, figures: Mapping[str, float], pace: float) -> None:
        """Prints a line: step, figures and, from the pace in seconds a step, the time left."""
        left = readable_time((self._steps - step) * pace)
        values = "  ".join(f"{name} {value:.4g}" for name, value in figures.items())
        line = f"{step}/{self._steps} {kind}  {values}  ({pace:.3f} s a step, {left} left)"
        print(line, file=sys.stderr, flush=True)


def readable_time(seconds: float) -> str:
    """Writes a duration as 2 h 05 min, 3 min 20 s or 12 s."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def read_journal(folder: str | Path) -> list[dict[str, Any]]:
    """Returns the lines of a run's journal; a last line cut short by a kill is left out."""
    path = Path(folder) / NAME
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]


def _opened_loggers(folder: Path, done: int) -> dict[str, Any]:
    """Returns the loggers that the environment names, opened; broken ones are warned of."""
    opened = {}
    names = plugin_names("latentmotion.loggers") if os.environ.get(LOGGERS) else ()
    for name in filter(None, os.environ.get(LOGGERS, "").split(",")):
        if name not in names:
            advice = hint(name, names) if names else "no plugin adds one"
            raise InputError(f"{LOGGERS}: no logger {name!r}; {advice}")
        try:
            if (open_logger := plugin("latentmotion.loggers", name)) is not None:
                opened[name] = open_logger(folder, done)
        except Exception as error:  # of a package that is not ours
            warn_of("latentmotion.loggers", name, error)
    return opened


def write_strip(path: Path, motions: Sequence[Motion]) -> None:
    """Writes `motions` as a picture, a row each; does nothing without Pillow or motions."""
    try:
        from latentmotion.render.strip import write
    except MissingExtraError:
        return
    if motions:
        write(path, motions)


class Previews:
    """The pipeline from noise to motions, for the networks in training.

    Args:
        vae: The trained VAE.
        card: Its scales and representation.
        frames: Length of the motions.
    """

    def __init__(self, vae: MotionVAE, card: ModelCard, frames: int) -> None:
        self._vae, self._card, self._frames = vae, card, frames

    def sample(
        self,
        guided: Estimator,
        sampler: Sampler,
        steps: int,
        condition: Conditioning,
        captions: Sequence[str],
    ) -> list[Motion]:
        """Returns a motion for each caption, with the seeds 0, 1, 2, ….

        Args:
            guided: The denoiser with its guidance, and the meaning of its output.
            sampler: The rule of a step.
            steps: Number of steps.
            condition: That of the captions; says on which device all is computed.
            captions: What the motions are called.
        """
        device, noise = condition.tokens.device, SeededNoise(range(len(captions)))
        frames = torch.ones(len(captions), self._frames, dtype=torch.bool)
        tokens = self._vae.latent_mask(frames).to(device)
        z = torch.from_numpy(noise((*tokens.shape, self._card.latents.width))).to(device)
        batch = Batch(z, tokens, condition.tokens, condition.mask, frames.to(device))
        decoder = self._decoder(device)
        features = features_from_noise(batch, guided, sampler, steps, noise, decoder)
        return self._motions(features, captions)

    def decode(
        self, z: Float[torch.Tensor, "batch tokens width"], captions: Sequence[str]
    ) -> list[Motion]:
        """Returns a motion for each row of latents in the denoiser's scale."""
        frames = torch.ones(len(z), self._frames, dtype=torch.bool, device=z.device)
        return self._motions(self._decoder(z.device)(z, frames), captions)

    def _decoder(self, device: torch.device) -> FeatureDecoder:
        # Distillation, and a resumed stage 2, need the VAE for nothing else.
        decode = self._vae.to(device).decode
        return FeatureDecoder.of(self._card, decode, partial(torch.tensor, device=device))

    def _motions(
        self, features: Float[torch.Tensor, "batch frames features"], captions: Sequence[str]
    ) -> list[Motion]:
        part = representation_named(self._card.representation)
        joints = part.decode(features.cpu().numpy())
        return [
            Motion(each, part.fps, part.skeleton, caption)
            for each, caption in zip(joints, captions, strict=True)
        ]
