"""What every motion VAE is held to (architecture, section 4), and the posterior's formulas."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from latentmotion.errors import InputError
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    IdentityVAEConfig,
    QuarterRateDecoder,
    TransformerConfig,
    TransformerVAEConfig,
    VPoserTConfig,
)
from latentmotion.networks.checkpoint import build, start_from
from latentmotion.networks.vae.interface import (
    MotionVAE,
    Posterior,
    copy_encoder,
    decoder_modules,
    fingerprint,
)
from latentmotion.training.experiment import preset_named

FEATURES = 19
SMALL = TransformerConfig(width=32, layers=3, heads=2, hidden=48)
PAPER = TransformerVAEConfig(features=FEATURES, transformer=SMALL)
ACTOR = dataclasses.replace(SMALL, skips=False, final_norm=False)
LENGTHS = [13, 40, 22]

CONFIGS = {
    **{f"mld-{n}": dataclasses.replace(PAPER, tokens=n) for n in (1, 2, 5, 7, 10)},
    "sine": dataclasses.replace(PAPER, position="sine"),
    "linear distribution": dataclasses.replace(PAPER, distribution="linear", tokens=2),
    "joint decoding": dataclasses.replace(PAPER, decoding="joint", tokens=2),
    "pre-norm": dataclasses.replace(PAPER, transformer=dataclasses.replace(SMALL, norm="pre")),
    "actor": dataclasses.replace(PAPER, transformer=ACTOR, position="sine"),
    "adapted": dataclasses.replace(PAPER, latent_width=6, tokens=4),
    "two rates": dataclasses.replace(PAPER, decoding="two_rate", tokens=2),
    "coarse alone": dataclasses.replace(PAPER, decoding="two_rate", fine_layers=0, tokens=2),
    "convolutional": ConvolutionalVAEConfig(FEATURES, width=24, channels=6),
    "quarter rate": ConvolutionalVAEConfig(
        FEATURES, width=24, channels=6, decoder=QuarterRateDecoder((3, 1))
    ),
    "identity": IdentityVAEConfig(FEATURES),
    "vposer-t": VPoserTConfig(FEATURES, frames=44, hidden=24, width=12),
}


def prefix_mask(lengths: list[int]) -> Tensor:
    return torch.arange(max(lengths)) < torch.tensor(lengths)[:, None]


@pytest.fixture(params=CONFIGS)
def vae(request: pytest.FixtureRequest) -> MotionVAE:
    torch.manual_seed(0)
    network = build(CONFIGS[request.param]).eval()
    for parameter in network.parameters():  # nothing may hide behind a zero at the start
        torch.nn.init.normal_(parameter, std=0.1 if parameter.ndim > 1 else 0.5)
    return network


@pytest.fixture
def motion() -> Tensor:
    return torch.randn(3, 40, FEATURES, generator=torch.Generator().manual_seed(1))


@torch.no_grad()
def test_padding_changes_nothing_and_each_motion_is_alone(vae: MotionVAE, motion: Tensor) -> None:
    mask = prefix_mask(LENGTHS)
    posterior = vae.encode(motion, mask)
    features = vae.decode(posterior.mean, mask)
    tokens = vae.latent_mask(mask).sum(1)
    for i, (length, count) in enumerate(zip(LENGTHS, tokens.tolist(), strict=True)):
        row, alone = slice(i, i + 1), prefix_mask([length])
        single = vae.encode(motion[row, :length], alone)
        assert single.mean.shape[1] == count
        assert torch.allclose(single.mean, posterior.mean[row, :count], atol=1e-5)
        assert torch.allclose(single.logvar, posterior.logvar[row, :count], atol=1e-5)
        decoded = vae.decode(single.mean, alone)
        assert torch.allclose(decoded, features[row, :length], atol=1e-5)
        assert features[i, length:].abs().max() == 0 if length < 40 else True


@torch.no_grad()
def test_what_padding_holds_does_not_matter(vae: MotionVAE, motion: Tensor) -> None:
    mask = prefix_mask(LENGTHS)
    other = torch.where(mask[..., None], motion, 1e3)
    real = vae.latent_mask(mask)[..., None]
    found, same = vae.encode(motion, mask).mean * real, vae.encode(other, mask).mean * real
    assert torch.allclose(found, same, atol=1e-5)


@torch.no_grad()
def test_evaluation_is_deterministic_and_training_is_not_needed(
    vae: MotionVAE, motion: Tensor
) -> None:
    mask = prefix_mask(LENGTHS)
    assert torch.equal(vae.encode(motion, mask).mean, vae.encode(motion, mask).mean)


def test_gradient_reaches_every_parameter(vae: MotionVAE, motion: Tensor) -> None:
    mask = prefix_mask(LENGTHS)
    motion.requires_grad_()  # the network without weights passes it on
    posterior = vae.train().encode(motion, mask)
    latents = posterior.mean + posterior.std
    assert latents.shape == (3, vae.latent_mask(mask).shape[1], vae.latent_width)
    vae.decode(latents, mask).square().sum().backward()
    assert all(parameter.grad is not None for parameter in [motion, *vae.parameters()])


@torch.no_grad()
@pytest.mark.parametrize("length", [1, 2, 3, 5, 8])
def test_any_length(vae: MotionVAE, motion: Tensor, length: int) -> None:
    mask = prefix_mask([length])
    latents = vae.encode(motion[:1, :length], mask).mean
    assert vae.decode(latents, mask).shape == (1, length, FEATURES)


@torch.no_grad()
def test_the_way_back_is_told_apart(vae: MotionVAE, motion: Tensor) -> None:
    """Other weights there change no latent, other weights elsewhere change no decoding."""
    mask = prefix_mask(LENGTHS)
    latents, before = vae.encode(motion, mask).mean, fingerprint(vae)
    features = vae.decode(latents, mask)
    inside = list(decoder_modules(vae).parameters())
    _scale(inside, 2.0)
    assert torch.equal(vae.encode(motion, mask).mean, latents)
    assert fingerprint(vae) == before
    _scale(inside, 0.5)
    outside = [p for p in vae.parameters() if all(p is not other for other in inside)]
    _scale(outside, 2.0)
    assert torch.equal(vae.decode(latents, mask), features)
    assert fingerprint(vae) != before or not outside


def _scale(parameters: list[torch.nn.Parameter], factor: float) -> None:
    for parameter in parameters:
        parameter.mul_(factor)


@torch.no_grad()
def test_another_way_back_keeps_latents_and_begins_alike(motion: Tensor) -> None:
    """The mirrored decoder begins as that of a quarter of the rate does; the rest is fresh."""
    torch.manual_seed(0)
    old = build(CONFIGS["convolutional"]).eval()
    blocks = QuarterRateDecoder((9, 3, 1, 3, 1))
    new = build(dataclasses.replace(CONFIGS["convolutional"], decoder=blocks)).eval()
    copy_encoder(new, old)
    mask = prefix_mask(LENGTHS)
    assert torch.equal(new.encode(motion, mask).mean, old.encode(motion, mask).mean)
    assert fingerprint(new) == fingerprint(old)
    same = [
        torch.equal(own, given)
        for own, given in zip(
            new.decoder[:4].parameters(), old.decoder[:4].parameters(), strict=True
        )
    ]
    assert all(same)
    assert not torch.equal(new.decoder[5].dilated.weight, old.decoder[5].dilated.weight)
    trained = {id(p) for p in new.parameters() if p.requires_grad}
    assert trained == {id(p) for p in new.decoder.parameters()}


def test_convolutional_latents_keep_time() -> None:
    vae = build(CONFIGS["convolutional"])
    assert vae.latent_mask(prefix_mask([13, 40, 22])).sum(1).tolist() == [4, 10, 6]


def test_identity_latents_are_the_frames_without_doubt(motion: Tensor) -> None:
    vae, mask = build(CONFIGS["identity"]), prefix_mask(LENGTHS)
    posterior = vae.encode(motion, mask)
    assert posterior.std.abs().max() == 0
    assert torch.equal(posterior.mean, motion * mask[..., None])
    assert torch.equal(vae.decode(posterior.mean, mask), motion * mask[..., None])


def test_vposer_t_knows_one_length(motion: Tensor) -> None:
    """A shorter motion stands still after its end; a longer one is refused."""
    vae = build(VPoserTConfig(FEATURES, frames=44, hidden=24, width=12)).eval()
    mask = prefix_mask([13])
    still = torch.cat([motion[:1, :13], motion[:1, 12:13].expand(-1, 31, -1)], dim=1)
    whole = vae.encode(still, prefix_mask([44])).mean
    assert torch.allclose(vae.encode(motion[:1], prefix_mask([13, 40])[:1]).mean, whole, atol=1e-6)
    assert torch.allclose(vae.encode(motion[:1, :13], mask).mean, whole, atol=1e-6)
    for refused in (vae.encode, vae.decode):
        with pytest.raises(InputError, match=r"45 frames.*at most 44"):
            refused(torch.zeros(1, 45, FEATURES), prefix_mask([45]))


def test_vposer_t_deviation_is_a_softplus_that_never_vanishes(motion: Tensor) -> None:
    vae, mask = build(VPoserTConfig(FEATURES, frames=40, hidden=24, width=12)), prefix_mask(LENGTHS)
    torch.nn.init.zeros_(vae.deviation[0].weight)
    torch.nn.init.zeros_(vae.deviation[0].bias)
    assert torch.allclose(vae.encode(motion, mask).std, torch.tensor(math.log(2.0)))
    torch.nn.init.constant_(vae.deviation[0].bias, -200.0)
    vae.encode(motion, mask).kl().sum().backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in vae.parameters())


def test_actor_and_vposer_t_have_the_size_of_the_authors() -> None:
    def count(network: torch.nn.Module) -> int:
        return sum(parameter.numel() for parameter in network.parameters())

    assert count(build(preset_named("mld_humanact12").vae)) == 11_136_918
    features = 196 * 263
    inner = 512 * 512 + 512
    encoder = 2 * features + features * 512 + 512 + 2 * 512 + 2 * inner + 2 * (512 * 256 + 256)
    decoder = 256 * 512 + 512 + inner + 512 * features + features
    assert count(build(VPoserTConfig())) == encoder + decoder


def test_long_skips_need_an_odd_number_of_layers() -> None:
    with pytest.raises(InputError, match="odd"):
        build(TransformerVAEConfig(transformer=TransformerConfig(layers=4)))


def test_the_paper_has_18_million_weights() -> None:
    count = sum(parameter.numel() for parameter in build(TransformerVAEConfig()).parameters())
    assert count == 18_032_135


def test_posterior_formulas() -> None:
    mean, logvar = torch.randn(2, 3, 4), torch.randn(2, 3, 4)
    posterior = Posterior(mean, logvar)
    theirs = torch.distributions.Normal(mean, torch.exp(logvar).sqrt())
    standard = torch.distributions.Normal(0.0, 1.0)
    expected = torch.distributions.kl_divergence(theirs, standard)
    assert torch.allclose(posterior.kl(), expected, atol=1e-5)


def test_more_latent_channels_change_nothing_at_first() -> None:
    config = ConvolutionalVAEConfig(
        FEATURES, width=24, channels=6, decoder=QuarterRateDecoder((3,))
    )
    trained, wide = build(config), build(dataclasses.replace(config, channels=9))
    start_from(wide, trained, 9, 6)
    mask = prefix_mask(LENGTHS)
    x = torch.randn(3, max(LENGTHS), FEATURES) * mask[..., None]
    one, other = trained.encode(x, mask), wide.encode(x, mask)
    assert torch.allclose(one.mean, other.mean[..., :6], atol=1e-6)
    assert torch.allclose(one.logvar, other.logvar[..., :6], atol=1e-6)
    assert other.mean[..., 6:].std() > 0 and other.logvar[..., 6:].abs().max() == 0
    decoded = trained.decode(one.mean, mask), wide.decode(other.mean, mask)
    assert torch.allclose(*decoded, atol=1e-5)
    with pytest.raises(InputError, match="more latent channels"):
        start_from(trained, wide, 6, 9)
    with pytest.raises(InputError, match="has encoder"):
        start_from(build(dataclasses.replace(config, width=32)), trained, 6, 6)
