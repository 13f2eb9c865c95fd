"""The authors' numbers, reached through the converter that users run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor

from latentmotion.convert import convert_checkpoint
from latentmotion.convert.mld import Origin
from latentmotion.diffusion.condition import Conditioning, TextEmbedding, TextEncoder
from latentmotion.diffusion.guidance import guided
from latentmotion.diffusion.samplers import DDIM, sample
from latentmotion.errors import InputError
from latentmotion.model.config import IdentityVAEConfig
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import (
    FirstStageModel,
    LatentModel,
    load_model,
    load_stages,
    save_model,
)
from latentmotion.pipeline import MotionPipeline
from tests.support.golden import formula, golden_input, prefix_mask, relative

ONE_PASS = 1e-5
FIFTY_STEPS = 1e-3


def plain_normalizer(features: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(features, np.float32), np.ones(features, np.float32)


@pytest.fixture(scope="module")
def golden(shared: Path) -> dict[str, np.ndarray]:
    return dict(np.load(shared / "reference" / "mld_outputs.npz"))


@pytest.fixture(scope="module")
def mld(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> LatentModel:
    """MLD-1 at full size, made by the converter from a file with the authors' names."""
    shapes = json.loads((shared / "reference" / "mld_shapes.json").read_text())["shapes"]
    state = {key: torch.from_numpy(formula(key, tuple(shape))) for key, shape in shapes.items()}
    folder = tmp_path_factory.mktemp("mld")
    torch.save({"state_dict": state, "epoch": 1999}, folder / "mld.ckpt")
    others = convert_checkpoint(
        folder / "mld.ckpt", folder / "model", Origin(plain_normalizer(263))
    )
    assert set(others) == {"t2m_textencoder", "t2m_motionencoder", "t2m_moveencoder", "model"}
    return load_model(folder / "model")


MLD_MASK = prefix_mask([60, 196, 120], 196)


def parts(model: LatentModel) -> tuple[Any, Any]:
    return model.vae, model.denoiser


@torch.no_grad()
def test_full_size_vae(mld: LatentModel, golden: dict[str, np.ndarray]) -> None:
    vae, _ = parts(mld)
    motion = golden_input("motion", (3, 196, 263)) * MLD_MASK[..., None]
    posterior = vae.encode(motion, MLD_MASK)
    assert relative(posterior.mean, golden["encode_mu"]) < ONE_PASS
    assert relative(posterior.std, golden["encode_std"]) < ONE_PASS
    features = vae.decode(golden_input("latent", (1, 3, 256)).transpose(0, 1), MLD_MASK)
    assert relative(features, golden["decode_features"]) < ONE_PASS


@torch.no_grad()
def test_full_size_denoiser(mld: LatentModel, golden: dict[str, np.ndarray]) -> None:
    _, denoiser = parts(mld)
    times = torch.tensor([981.0, 501.0, 1.0, 0.0, 999.0, 250.0])
    always = torch.ones(6, 1, dtype=torch.bool)
    text = Conditioning(golden_input("text", (6, 1, 768)), always)
    output = denoiser(golden_input("sample", (6, 1, 256)), times, text, always)
    assert relative(output, golden["denoiser_out"]) < ONE_PASS


@torch.no_grad()
def test_fifty_guided_steps(mld: LatentModel, golden: dict[str, np.ndarray]) -> None:
    vae, denoiser = parts(mld)
    always = torch.ones(3, 1, dtype=torch.bool)
    null = Conditioning(golden_input("uncond", (1, 1, 768)), always[:1])
    text = Conditioning(golden_input("cond", (3, 1, 768)), always)
    model = mld.card.parametrized(denoiser)
    model = guided("classifier_free", model, null, mld.card.sampling.guidance)
    sampler = DDIM(mld.card.schedule)
    noise = golden_input("noise", (3, 1, 256))
    latents = sample(model, sampler, noise, text, always, mld.card.sampling.steps, np.zeros)
    assert relative(latents, golden["ddim50_latent"]) < FIFTY_STEPS
    assert relative(vae.decode(latents, MLD_MASK), golden["ddim50_features"]) < FIFTY_STEPS


VAE_VARIANTS = {
    "vae_latent1": {},
    "vae_latent7": {},
    "vae_all_encoder": {},
    "vae_actor_pe": {},
    "vae_mlp_dist": {},
    "vae_pre_norm": {"norm": "pre"},
    "vae_relu": {"activation": "relu"},
    "actor_vae": {},
}
DENOISER_VARIANTS = [
    "den_text",
    "den_text7",
    "den_text_same_dim",
    "den_noskip",
    "den_cross",
    "den_actor_pe",
    "den_action",
    "den_novae_dec",
    "den_novae_enc",
]


class Variants:
    """The tiny networks of `variants.npz`, converted on demand."""

    def __init__(self, folder: Path, out: Path) -> None:
        self.arrays = dict(np.load(folder / "variants.npz"))
        self.about = json.loads((folder / "variants.json").read_text())
        self.out = out

    def state(self, name: str) -> dict[str, Tensor]:
        head = f"{name}/state_dict/"
        found = {k.removeprefix(head): v for k, v in self.arrays.items() if k.startswith(head)}
        return {key: torch.from_numpy(value) for key, value in found.items()}

    def load(self, name: str, **unstated: Any) -> FirstStageModel:
        torch.save({"state_dict": self.state(name)}, self.out / f"{name}.ckpt")
        frames = "novae" in name or not name.startswith("den")
        origin = Origin(plain_normalizer(19 if frames else 32), heads=2, **unstated)
        convert_checkpoint(self.out / f"{name}.ckpt", self.out / name, origin)
        return load_stages(self.out / name)

    def tensor(self, name: str) -> Tensor:
        return torch.from_numpy(self.arrays[name])


@pytest.fixture(scope="module")
def variants(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Variants:
    return Variants(shared / "reference", tmp_path_factory.mktemp("variants"))


@torch.no_grad()
@pytest.mark.parametrize(("name", "unstated"), VAE_VARIANTS.items())
def test_vae_variant(variants: Variants, name: str, unstated: dict[str, str]) -> None:
    vae = variants.load(name, **unstated).vae
    mask = prefix_mask(variants.about[name]["lengths"], 20)
    posterior = vae.encode(variants.tensor(f"{name}/motion"), mask)
    for part, found in (("mu", posterior.mean), ("std", posterior.std)):
        expected = variants.arrays[f"{name}/{part}"]
        expected = expected[None] if expected.ndim == 2 else expected
        assert relative(found.transpose(0, 1), expected) < ONE_PASS
    latent = variants.tensor(f"{name}/latent").transpose(0, 1)
    assert relative(vae.decode(latent, mask), variants.arrays[f"{name}/feats"]) < ONE_PASS


@torch.no_grad()
@pytest.mark.parametrize("name", DENOISER_VARIANTS)
def test_denoiser_variant(variants: Variants, name: str) -> None:
    denoiser = variants.load(name).networks["denoiser"]
    z = variants.tensor(f"{name}/sample")
    mask = torch.ones(z.shape[:2], dtype=torch.bool)
    if "novae" in name:
        mask = prefix_mask(variants.about[name]["lengths"], z.shape[1])
    condition = variants.tensor(f"{name}/cond")
    if name == "den_action":  # in the authors' eval mode the first half is unconditional: zero
        condition = torch.nn.functional.one_hot(condition, 12).float()
        condition[:2] = 0
    times = variants.tensor(f"{name}/timesteps").float()
    always = torch.ones(condition.shape[:2], dtype=torch.bool)
    output = denoiser(z, times, Conditioning(condition, always), mask)
    assert relative(output, variants.arrays[f"{name}/out"]) < ONE_PASS


@dataclass(frozen=True)
class Counting:
    """A text encoder whose vectors count letters."""

    width: int
    name: str = "counting"

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        rows = [[sentence.count(chr(97 + i)) for i in range(self.width)] for sentence in sentences]
        pooled = np.asarray(rows, np.float32)
        return TextEmbedding(pooled, pooled[:, None], np.ones((len(rows), 1), bool))


def generator_of(
    model: FirstStageModel, folder: Path, encoder: TextEncoder | None
) -> MotionPipeline:
    """The tiny networks have 19 features a frame, which is no representation; HumanML3D's name is
    borrowed for its frame rate.
    """
    card = replace(model.card, representation="humanml3d")
    save_model(folder, replace(model, card=card))
    return torch_pipeline(folder, encoder)


def test_a_whole_action_file_generates_by_label(variants: Variants) -> None:
    """ACTOR's VAE, a denoiser of twelve labels, and SMPL's body, which is left behind."""
    state = variants.state("actor_vae") | variants.state("den_action")
    smpl = {"rot2xyz.smpl_model.v_template": torch.zeros(6890, 3)}
    torch.save({"state_dict": state | smpl, "epoch": 1}, variants.out / "action.ckpt")
    origin = Origin(plain_normalizer(19), heads=2)
    others = convert_checkpoint(variants.out / "action.ckpt", variants.out / "action", origin)
    assert others == {"rot2xyz": 1}
    model = load_model(variants.out / "action")
    weights = load_file(variants.out / "action/weights.safetensors")
    assert all(6890 not in tensor.shape for tensor in weights.values())
    assert (model.card.task, model.card.frames) == ("action", (60, 60))
    assert model.card.condition.labels[:2] == ("warm_up", "walk")
    generator = generator_of(model, variants.out / "action", None)
    walk, jump = generator.features(["walk", "jump"], [60, 60], [1, 1], steps=2)
    assert walk.shape == (60, 19)
    assert not np.allclose(walk, jump)


def test_an_action_file_with_other_labels(variants: Variants) -> None:
    torch.save({"state_dict": variants.state("den_action")}, variants.out / "labels.ckpt")
    for labels, message in ((("a", "b"), "2 labels for a checkpoint of 12"), ((), "")):
        origin = Origin(plain_normalizer(32), heads=2, labels=labels)
        if message:
            with pytest.raises(InputError, match=message):
                convert_checkpoint(variants.out / "labels.ckpt", variants.out / "labels", origin)
            assert not (variants.out / "labels").exists()
        else:
            convert_checkpoint(variants.out / "labels.ckpt", variants.out / "labels", origin)


def test_a_file_without_vae_generates_by_sentence(variants: Variants) -> None:
    model = variants.load("den_novae_dec")
    assert model.card.vae == IdentityVAEConfig(19)
    assert (model.card.sampling.sampler, model.card.sampling.steps) == ("ddpm", 1000)
    encoder = Counting(model.card.condition.condition_width)
    generator = generator_of(model, variants.out / "den_novae_dec", encoder)
    prompts = ["a person walks", "a person kicks"]
    first, second = generator.features(prompts, [20, 16], [1, 2], steps=3)
    assert (first.shape, second.shape) == ((20, 19), (16, 19))
