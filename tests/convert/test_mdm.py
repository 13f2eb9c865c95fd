"""MDM's checkpoints: converted, they give what MDM's own code gave with the same weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from latentmotion.convert import convert_checkpoint
from latentmotion.convert.mld import Origin
from latentmotion.diffusion.condition import Conditioning, SentenceCondition, TextEmbedding
from latentmotion.diffusion.schedule import Cosine
from latentmotion.errors import InputError, ModelError
from latentmotion.networks.checkpoint import load_model
from latentmotion.networks.transformer import sine_rate, sines

WIDTH, HIDDEN, WORDS, ACTIONS, FRAMES = 8, 12, 6, 3, 4


def weights(kind: str) -> dict[str, Tensor]:
    """MDM's weights by a formula: sin(0.7 n + number of the name), norms around 1."""
    features = 5 if kind == "text" else 150
    linear = {
        "input_process.poseEmbedding": (WIDTH, features),
        "output_process.poseFinal": (features, WIDTH),
        "embed_timestep.time_embed.0": (WIDTH, WIDTH),
        "embed_timestep.time_embed.2": (WIDTH, WIDTH),
        **({"embed_text": (WIDTH, WORDS)} if kind == "text" else {}),
    }
    shapes: dict[str, tuple[int, ...]] = {}
    for layer in range(2):
        prefix = f"seqTransEncoder.layers.{layer}"
        linear |= {
            f"{prefix}.self_attn.out_proj": (WIDTH, WIDTH),
            f"{prefix}.linear1": (HIDDEN, WIDTH),
            f"{prefix}.linear2": (WIDTH, HIDDEN),
        }
        shapes |= {f"{prefix}.norm{n}.{w}": (WIDTH,) for n in (1, 2) for w in ("weight", "bias")}
        shapes[f"{prefix}.self_attn.in_proj_weight"] = (3 * WIDTH, WIDTH)
        shapes[f"{prefix}.self_attn.in_proj_bias"] = (3 * WIDTH,)
    for name, (outputs, inputs) in linear.items():
        shapes |= {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}
    if kind == "action":
        shapes["embed_action.action_embedding"] = (ACTIONS, WIDTH)
    state: dict[str, Tensor] = {}
    for number, (name, shape) in enumerate(sorted(shapes.items())):
        count = torch.arange(int(np.prod(shape)), dtype=torch.float64)
        wave = torch.sin(0.7 * count + number) * (0.3 if len(shape) > 1 else 0.1)
        ones = "norm" in name and name.endswith("weight")
        state[name] = (wave + ones).float().reshape(shape)
    table = sines(torch.arange(5000), sine_rate(WIDTH))[:, None]
    state["sequence_pos_encoder.pe"] = table
    state["embed_timestep.sequence_pos_encoder.pe"] = table
    return state


def converted(tmp_path: Path, kind: str, content: object) -> Path:
    torch.save(content, tmp_path / "model000475000.pt")
    features = 5 if kind == "text" else 150
    normalizer = (np.zeros(features), np.ones(features))
    origin = Origin(normalizer, heads=2, diffusion_steps=50)
    others = convert_checkpoint(tmp_path / "model000475000.pt", tmp_path / "model", origin)
    assert others == ({"clip_model": 1} if kind == "text" else {})
    return tmp_path / "model"


def wave(step: float, *shape: int) -> Tensor:
    count = torch.arange(int(np.prod(shape)), dtype=torch.float64)
    return torch.cos(step * count).float().reshape(shape)


# The last frame's first five numbers of two motions, with and without the prompt, computed by
# MDM's own class `MDM` with these weights.
TEXT = [
    [0.9201337, 0.2436603, -0.5436063, -1.0869184, -1.1410068],
    [0.8395076, 0.1636551, -0.5870789, -1.0743448, -1.0780309],
    [0.8988684, 0.2135584, -0.5690331, -1.0962569, -1.1300652],
    [0.8630854, 0.1874005, -0.5738245, -1.0775311, -1.0962274],
]
ACTION = [
    [0.1019938, 0.8032045, 1.1417630, 0.9659873, 0.3559263],
    [-0.6333131, -0.2944026, 0.1745367, 0.5632991, 0.6985300],
    [-0.1464834, 0.5100096, 0.9354563, 0.9391734, 0.5206410],
    [-0.7235698, -0.2474758, 0.3375830, 0.7692786, 0.8549851],
]


@pytest.mark.parametrize(("kind", "golden"), [("text", TEXT), ("action", ACTION)])
def test_the_converted_network_gives_mdms_numbers(
    tmp_path: Path, kind: str, golden: list[list[float]]
) -> None:
    clip = {"clip_model.positional_embedding": torch.zeros(2)} if kind == "text" else {}
    model = load_model(converted(tmp_path, kind, {"model": weights(kind) | clip}))
    card, denoiser = model.card, model.denoiser.eval()
    assert card.schedule == Cosine(50) and card.sampling.steps == 50
    assert card.sampling.sampler == "ddpm" and card.sampling.guidance == 2.5
    rows = wave(0.5, 2, 1, WORDS) if kind == "text" else torch.eye(ACTIONS)[[2, 0]][:, None]
    real = torch.ones(2, 1, dtype=torch.bool)
    z = wave(0.3, 2, FRAMES, card.latents.width)
    mask = torch.ones(2, FRAMES, dtype=torch.bool)
    for tokens, expected in ((rows, golden[:2]), (torch.zeros_like(rows), golden[2:])):
        with torch.no_grad():
            out = denoiser(z, torch.tensor([3.0, 700.0]), Conditioning(tokens, real), mask)
        torch.testing.assert_close(out[:, -1, :5], torch.tensor(expected), atol=2e-5, rtol=0)


def test_without_a_sentence_mdm_sees_zeros(tmp_path: Path) -> None:
    clip = {"clip_model.w": torch.zeros(2)}
    card = load_model(converted(tmp_path, "text", {"model_avg": weights("text") | clip})).card
    assert card.condition.encoder == "openai/clip-vit-base-patch32"

    class Ones:
        name, width = "ones", WORDS

        def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
            ones = np.ones((len(sentences), 1, WORDS), np.float32)
            return TextEmbedding(ones[:, 0], ones, np.ones((len(sentences), 1), dtype=bool))

    condition = card.condition.condition(WORDS, Ones)
    assert isinstance(condition, SentenceCondition)
    assert not condition.null(2).tokens.any() and condition.null(2).mask.all()
    assert condition(["a person walks"]).tokens.all()


def test_settings_of_other_code_are_refused(tmp_path: Path) -> None:
    torch.save(weights("text"), tmp_path / "mdm.pt")
    torch.save({"vae.final_layer.weight": torch.zeros(2, 2)}, tmp_path / "mld.ckpt")
    with pytest.raises(InputError, match="leave --predicts"):
        convert_checkpoint(tmp_path / "mdm.pt", tmp_path / "model", Origin(predicts="sample"))
    with pytest.raises(InputError, match="leave --diffusion-steps out"):
        convert_checkpoint(tmp_path / "mld.ckpt", tmp_path / "model", Origin(diffusion_steps=50))
    assert not (tmp_path / "model").exists()


def test_variants_with_a_decoder_are_refused(tmp_path: Path) -> None:
    state = {name.replace("TransEncoder", "TransDecoder"): w for name, w in weights("text").items()}
    with pytest.raises(ModelError, match="trans_enc"):
        converted(tmp_path, "text", state)
