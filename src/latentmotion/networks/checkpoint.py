"""A trained model as a folder: its card, `model.json`, and `weights.safetensors`.

Nothing is ever unpickled here; foreign checkpoints are the business of `convert/reading.py`.

Networks with fresh weights from configurations, or with weights of a narrower network.

The order in which a network's parts are built is the order in which a seed's numbers are drawn for
their weights, so it is part of what a training run yields.

A network that starts from one with fewer latent channels answers as that one until training uses
the new ones. What reads latents gives them no weight. What makes them begins at zero, except for
the VAE's means: the encoder shows something in them, so that there is something to read.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TypeVar, overload

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from latentmotion.errors import InputError, ModelError
from latentmotion.model import config as configs
from latentmotion.model.card import CARD_FILE, ModelCard, find_model, read_card, shipped_models
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.vae.convolutional import ConvolutionalVAE
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.networks.vae.transformer import IdentityVAE, TransformerVAE, VPoserT
from latentmotion.storage.configuration import part_named
from latentmotion.storage.files import atomic_folder

WEIGHTS_FILE = "weights.safetensors"

SCALE = ".scale"  # Ends the name of the scales of a matrix in 8 bits, one for each row.

# Metadata key of the hash of an encoder that is in a shipped model instead.
ENCODER_HASH = "vae_encoder"

Network = TypeVar("Network", bound=nn.Module)

_ENCODER = "vae.encoder."
_DTYPES = {
    *(torch.float16, torch.bfloat16, torch.float32, torch.float64),
    *(torch.bool, torch.uint8, torch.int8, torch.int16, torch.int32, torch.int64),
}


@dataclass(frozen=True)
class FirstStageModel:
    """A model folder in memory, with PyTorch: its VAE, which may be the identity."""

    card: ModelCard  # Its description.
    vae: MotionVAE  # Motion to latents and back.

    @property
    def networks(self) -> dict[str, nn.Module]:
        """Its networks by the names that their weights have."""
        return {"vae": self.vae}


@dataclass(frozen=True)
class LatentModel(FirstStageModel):
    """A model folder with both stages."""

    denoiser: DenoiserNetwork  # Noise to latents.

    @property
    def networks(self) -> dict[str, nn.Module]:
        """Its networks by the names that their weights have."""
        return {"vae": self.vae, "denoiser": self.denoiser}


def save_model(folder: str | Path, model: FirstStageModel) -> None:
    """Writes a model folder in place of what is there, or nothing at all.

    Raises:
        InputError: The folder cannot be written.
    """
    weights = {
        f"{part}.{key}": tensor.detach().cpu().contiguous()
        for part, module in model.networks.items()
        for key, tensor in module.state_dict().items()
    }
    with atomic_folder(folder, CARD_FILE) as temporary:
        model.card.write(temporary)
        save_file(weights, temporary / WEIGHTS_FILE)


def load_model(folder: str | Path) -> LatentModel:
    """Reads the folder of a model with both stages; the networks are in `eval()` mode, on the CPU.

    Raises:
        ModelError: As for `load_stages`, or there is no denoiser.
    """
    model = load_stages(folder)
    match model:
        case LatentModel():
            return model
        case _:
            raise ModelError(
                f"{folder} has a VAE but no denoiser; train both stages first: latentmotion "
                "train denoiser, or sample the VAE's prior: latentmotion generate --prior"
            )


def load_stages(folder: str | Path) -> FirstStageModel:
    """Reads a model folder; a `LatentModel` where there is a denoiser, else the VAE alone.

    Raises:
        ModelError: Something is missing, damaged, or does not fit the rest.
    """
    card = read_card(Path(folder))
    weights = model_weights(Path(folder))
    source = str(Path(folder) / WEIGHTS_FILE)

    def fresh() -> nn.ModuleDict:
        denoiser = {"denoiser": build(card.denoiser)} if card.denoiser else {}
        return nn.ModuleDict({"vae": build(card.vae), **denoiser})

    networks: dict[str, Any] = dict(built(fresh, weights, source))
    return LatentModel(card, **networks) if card.denoiser else FirstStageModel(card, **networks)


def check_sizes(make: Callable[[], nn.Module], weights: Mapping[str, Tensor], source: str) -> None:
    """Compares weights with a network that takes no memory yet.

    Args:
        make: Builds the network.
        weights: Its weights.
        source: Name of the file, for errors.

    Raises:
        ModelError: A key is missing or unknown, or a shape differs.
    """
    with torch.device("meta"):
        _check_shapes(make(), weights, source)


def built(make: Callable[[], Network], weights: dict[str, Tensor], source: str) -> Network:
    """Builds a network with the weights of a file, whose sizes are compared first.

    Raises:
        ModelError: Names or shapes differ from the network's.
    """
    check_sizes(make, weights, source)
    network = make()
    load_weights(network, weights, source)
    return network


def load_weights(module: nn.Module, weights: dict[str, Tensor], source: str) -> None:
    """Copies the weights into `module` and puts it in `eval()` mode.

    Raises:
        ModelError: A key is missing or unknown, a shape differs, or a number is not finite.
    """
    _check_shapes(module, weights, source)
    for key, tensor in weights.items():
        if tensor.dtype not in _DTYPES:
            raise ModelError(f"{source}: {key} holds {tensor.dtype}, expected floats or integers")
        if not tensor.isfinite().all():
            raise ModelError(f"{source}: {key} holds numbers that are not finite; make it again")
    module.load_state_dict(weights)
    module.eval()


def _check_shapes(module: nn.Module, weights: Mapping[str, Tensor], source: str) -> None:
    expected = module.state_dict()
    check_keys(weights, expected, source)
    for key, tensor in weights.items():
        if tensor.shape != expected[key].shape:
            actual, shape = tuple(tensor.shape), tuple(expected[key].shape)
            raise ModelError(f"{source}: {key} has shape {actual}, expected {shape}")


def check_keys(actual: Iterable[str], expected: Iterable[str], source: str) -> None:
    """Compares two sets of names.

    Raises:
        ModelError: They differ; the message names the nearest.
    """
    unknown, missing = sorted(set(actual) - set(expected)), sorted(set(expected) - set(actual))
    if unknown:
        near = difflib.get_close_matches(unknown[0], missing or list(expected), n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ModelError(f"{source}: {len(unknown)} unknown weights, first {unknown[0]!r}{hint}")
    if missing:
        raise ModelError(f"{source}: {len(missing)} weights missing, first {missing[0]!r}")


def model_weights(folder: Path) -> dict[str, Tensor]:
    """Reads the weights of a model folder; a VAE's encoder may lie in a shipped model's instead.

    Raises:
        ModelError: A file is missing or damaged, or no shipped model has that encoder.
    """
    weights = read_weights(folder / WEIGHTS_FILE)
    with safe_open(folder / WEIGHTS_FILE, "pt") as file:
        digest = (file.metadata() or {}).get(ENCODER_HASH)
    if digest is None:
        return weights
    if (holder := encoder_holder(digest)) is None:
        raise ModelError(
            f"{folder} has its VAE's encoder in common with a shipped model, and none of them has "
            "it; install the version of latentmotion that the model came with"
        )
    return weights | encoder_weights(read_weights(holder / WEIGHTS_FILE))


def encoder_holder(digest: str, besides: Path | None = None) -> Path | None:
    """Returns the folder of a shipped model that holds a VAE's encoder, found by its hash.

    Args:
        digest: `encoder_hash` of the encoder.
        besides: A folder that does not count.
    """
    for name in shipped_models():
        folder = find_model(name)
        if besides is None or folder.resolve() != besides.resolve():
            encoder = encoder_weights(read_weights(folder / WEIGHTS_FILE))
            if encoder and encoder_hash(encoder) == digest:
                return folder
    return None


def encoder_weights(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Returns what belongs to a VAE's encoder, which only training and evaluation need."""
    return {key: value for key, value in weights.items() if key.startswith(_ENCODER)}


def encoder_hash(weights: Mapping[str, Tensor]) -> str:
    """Returns a SHA-256 over names, shapes and numbers."""
    digest = sha256()
    for key in sorted(weights):
        digest.update(f"{key} {tuple(weights[key].shape)} {weights[key].dtype}".encode())
        # Adding zero makes -0 the 0 that it equals.
        digest.update((weights[key] + 0).contiguous().numpy().tobytes())
    return digest.hexdigest()


def read_weights(path: Path) -> dict[str, Tensor]:
    """Reads a file of tensors; what has 8 bits comes back in 32.

    Raises:
        ModelError: It is missing or damaged.
    """
    try:
        weights = load_file(path)
    except (OSError, SafetensorError) as error:
        raise ModelError(
            f"{path} cannot be read, it is missing or damaged: {error}; copy the folder again"
        ) from error
    packed = [key for key in weights if key + SCALE in weights]
    for key in packed:
        matrix, scale = weights[key], weights.pop(key + SCALE)
        actual, shape = tuple(scale.shape), (len(matrix), *[1] * (matrix.ndim - 1))
        if actual != shape:
            raise ModelError(f"{path}: {key}{SCALE} has shape {actual}, expected {shape}")
        weights[key] = matrix * scale
    return weights


@overload
def build(config: configs.DenoiserConfig) -> DenoiserNetwork: ...
@overload
def build(config: configs.VAEConfig) -> MotionVAE: ...
def build(config: configs.DenoiserConfig | configs.VAEConfig) -> DenoiserNetwork | MotionVAE:
    """Builds the network of a configuration with fresh weights.

    Raises:
        InputError: A stack with long skips has an even number of layers.
    """
    match config:
        case configs.DenoiserConfig():
            if config.plugin:
                return part_named("latentmotion.denoisers", config.plugin)(config)
            return DenoiserNetwork(config)
        case configs.PluginVAEConfig():
            vae = part_named("latentmotion.vaes", config.plugin)
            return vae(features=config.features, **config.settings)
        case configs.TransformerVAEConfig():
            return TransformerVAE(config)
        case configs.ConvolutionalVAEConfig():
            return ConvolutionalVAE(config)
        case configs.VPoserTConfig():
            return VPoserT(config)
        case configs.IdentityVAEConfig():
            return IdentityVAE(config.features)


def start_from(network: nn.Module, trained: nn.Module, channels: int, before: int) -> None:
    """Gives a network the weights of a trained one, in place.

    Args:
        network: VAE or denoiser with fresh weights.
        trained: One with the same layers, but for the number of latent channels.
        channels: Latent channels of `network`.
        before: Latent channels of `trained`.

    Raises:
        InputError: They differ in more than the latent channels, or there were more of them.
    """
    fresh, start = network.state_dict(), trained.state_dict()
    if fresh.keys() != start.keys() or channels < before:
        raise InputError(
            "the model to start from has other layers, or more latent channels; use the preset and "
            "settings that it was trained with"
        )
    weights: dict[str, Tensor] = {}
    for name, trained_tensor in start.items():
        weights[name] = result = fresh[name].clone()
        shapes = tuple(result.shape), tuple(trained_tensor.shape)
        if shapes[0] == shapes[1]:
            weights[name] = trained_tensor
            continue
        match shapes:
            case ((to, *_), (of, *_)) if (to, of) == (2 * channels, 2 * before):
                # The encoder's last layer: all means, then all log variances.
                result[channels:] = 0
                means, variances = trained_tensor.chunk(2)
                result[:before], result[channels : channels + before] = means, variances
            case ((to, *_), (of, *_)) if (to, of) == (channels, before):
                result[before:] = 0
                result[:before] = trained_tensor
            case ((_, to, *_), (_, of, *_)) if (to, of) == (channels, before):
                result[:, before:] = 0
                result[:, :before] = trained_tensor
            case _:
                raise InputError(
                    f"the model to start from has {name} of shape {shapes[1]}, expected "
                    f"{shapes[0]}; use the preset and settings that it was trained with"
                )
    network.load_state_dict(weights)
