"""The pipeline on PyTorch, for any model folder: of a training run, converted or exported.

    host: prompts → words, seeds → noise       device: noise, words → latents → features → joints

Networks are sessions, as ONNX graphs are. Noise is drawn on the CPU, so that a seed means the same
motion on every device.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.backend import ON_CPU, Backend, ExecutionOptions, Padding
from latentmotion.engine.encoder import load_text_encoder
from latentmotion.engine.lengths import LengthFile
from latentmotion.engine.prior import MotionPrior
from latentmotion.engine.session import Session
from latentmotion.errors import InputError, LatentMotionError, ModelError
from latentmotion.model import card as cards
from latentmotion.networks.checkpoint import load_model, load_stages
from latentmotion.networks.denoiser import DenoiserNetwork, forward_of
from latentmotion.networks.device import (
    GPU,
    FunctionRecorder,
    device_named,
    network_session,
    on_gpu,
)
from latentmotion.networks.pretrained_text import KINDS, PretrainedTextEncoder, local_encoder
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import MAX_BATCH_SIZE, MotionPipeline
from latentmotion.plugins import plugin_names
from latentmotion.storage.configuration import part_named

GPU_BATCH_SIZE = 256  # Maximum number of motions that go through the networks of a GPU at once.

BUCKET_FRAMES = 32  # Lengths are padded to a multiple of this.
BUCKET_WORDS = 8  # The words after the pooled sentence are padded to a multiple of this.


@dataclass(frozen=True)
class Buckets(Padding):
    """Padding to powers of two of motions, 1 + 8 n words and 32 n frames, so that few shapes occur.

    A recorded or compiled chain is made anew for every shape. Padding does not change a motion;
    where it would, sizes stay as they are.
    """

    card: cards.ModelCard  # States the longest motion, and whether padding would change motions.

    def sizes(self, rows: int, words: int, frames: int) -> tuple[int, int, int]:
        """Returns the next power of two, 1 + 8 n and 32 n; no words stay none.

        Frames are no more than those of the longest motion that the model makes.
        """
        # If the context comes before the latents, more words would move the latents' positions.
        if words and self.card.trained_denoiser.positions != "context_first":
            words = 1 + -(-(words - 1) // BUCKET_WORDS) * BUCKET_WORDS
        if self.card.masks_padding:
            padded = -(-frames // BUCKET_FRAMES) * BUCKET_FRAMES
            frames = max(frames, min(padded, self.card.frames[1]))
        return 1 << (rows - 1).bit_length(), words, frames


def torch_pipeline(
    folder: str | Path, encoder: TextEncoder | None = None, execution: ExecutionOptions = ON_CPU
) -> MotionPipeline:
    """Loads the weights of any model folder, exported or not.

    Args:
        folder: Name or folder of the model.
        encoder: Text encoder; by default the folder's, else the one that the card names, if it is
            on this machine.
        execution: Device, precision and launch mode; by default eager on the CPU.

    Raises:
        ModelError: The folder is damaged, has no denoiser, or its text encoder is not found.
    """
    folder = cards.find_model(folder)
    model = load_model(folder)
    card, lengths = model.card, cards.file_beside(model.card, folder, cards.LENGTHS_FILE)
    return MotionPipeline(
        card,
        card.prompt_condition(lambda: encoder or find_encoder(card, folder)),
        torch_backend(
            card,
            denoiser_session(model.denoiser, execution),
            decoder_session(model.vae, execution),
            execution,
        ),
        GPU_BATCH_SIZE if execution.device_type == GPU else MAX_BATCH_SIZE,
        lengths=lengths and LengthFile(lengths, card.condition.encoder),
    )


def torch_backend(
    card: cards.ModelCard, denoiser: Session, decoder: Session, execution: ExecutionOptions = ON_CPU
) -> Backend:
    """Returns a backend whose arrays are tensors on a device.

    From words to joints nothing leaves the device. Where the chain is recorded or compiled, batches
    are padded to few sizes.

    Raises:
        InputError: There is no such device here, or it runs no CUDA graphs.
    """
    repeats, device = execution.launch != "eager", device_named(execution.device)
    if execution.launch == "graph" and device.type != GPU:
        raise InputError(
            f"launch graph on device {execution.device!r}: CUDA graphs need cuda; "
            "use launch eager or compiled"
        )
    return Backend(
        denoiser,
        decoder,
        padding=Buckets(card) if repeats else Padding(),
        launch=FunctionRecorder(on_gpu(device)) if repeats and device.type == GPU else None,
        to_device=lambda array: torch.tensor(array, device=device),
        to_host=lambda tensor: tensor.cpu().numpy(),
    )


def torch_prior(folder: str | Path, execution: ExecutionOptions = ON_CPU) -> MotionPrior:
    """Loads the VAE of any model folder, to sample its prior.

    Raises:
        ModelError: The folder is damaged or has no VAE.
    """
    model = load_stages(cards.find_model(folder))
    most = GPU_BATCH_SIZE if execution.device_type == GPU else MAX_BATCH_SIZE
    return MotionPrior(model.card, decoder_session(model.vae, execution), most)


def denoiser_session(denoiser: DenoiserNetwork, execution: ExecutionOptions = ON_CPU) -> Session:
    """Returns a network as a session of the inputs of `forward_of`."""
    return network_session(denoiser, forward_of(denoiser), execution)


def decoder_session(vae: MotionVAE, execution: ExecutionOptions = ON_CPU) -> Session:
    """Returns a VAE's decoder as a session: latents, mask → normalized features."""
    return network_session(vae, vae.decode, execution)


def find_encoder(card: cards.ModelCard, folder: Path) -> TextEncoder:
    """Returns the text encoder of a model's folder, else the one on this machine that it names.

    Raises:
        ModelError: It is not on this machine.
    """
    encoder_folder = cards.text_encoder_folder(card, folder)
    if encoder_folder is not None:
        return load_text_encoder(encoder_folder)
    name = card.condition.encoder or "none"
    try:
        return local_encoder(name)
    except LatentMotionError as error:
        raise ModelError(
            f"model {card.name!r} reads sentences with the text encoder {name!r}, which is not at "
            f"hand ({error}); pass it: --text-encoder FOLDER, or clip:FOLDER"
        ) from error


def text_encoder_named(name: str) -> TextEncoder:
    """Loads a text encoder by the name or folder of its model, or by its kind (`clip:FOLDER`).

    Other packages add kinds (`latentmotion.text_encoders`): functions of what follows the colon.

    Raises:
        ModelError: There is none, or it cannot be loaded.
    """
    kind, _, source = name.partition(":")
    if kind in KINDS:
        return PretrainedTextEncoder.load(kind, source or None)
    if kind in plugin_names("latentmotion.text_encoders"):
        return part_named("latentmotion.text_encoders", kind)(source)
    return load_text_encoder(cards.find_model(name))
