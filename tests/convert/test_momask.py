"""MoMask's first stage: converted, it gives what MoMask's own code gave with the same weights."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from latentmotion.cli.main import main
from latentmotion.convert import convert_checkpoint
from latentmotion.convert.mld import Origin, Unstated
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.model.config import QuantizedVAEConfig
from latentmotion.networks.checkpoint import load_stages
from latentmotion.networks.vae.convolutional import QuantizedVAE
from tests.support.small_training import CHANGES

WIDTH, CHANNELS, CODES, BOOKS, DEPTH = 8, 6, 7, 3, 3

# Numbers of the codes of two motions of 16 frames, and the first and last frame decoded from them,
# computed by MoMask's own class `RVQVAE` with these weights.
INDICES = [
    [[4, 0, 5], [4, 0, 2], [4, 0, 2], [1, 0, 2]],
    [[4, 0, 5], [4, 0, 2], [1, 0, 2], [1, 0, 2]],
]
DECODED = [
    [
        [-0.8549382, 0.4763285, 0.6511674, -0.8518175, 0.2419292],
        [0.5839608, 0.1911923, -0.5250193, 0.5170068, 0.1569397],
    ],
    [
        [-0.8551506, 0.4761191, 0.6515728, -0.8519816, 0.2416750],
        [0.5853244, 0.1952145, -0.5300887, 0.5176553, 0.1614116],
    ],
]


def weights(features: int = 5) -> dict[str, Tensor]:
    """MoMask's weights by a formula: sin(0.7 n + number of the name)."""
    layers = {
        "encoder.model.0": (WIDTH, features, 3),
        "encoder.model.4": (CHANNELS, WIDTH, 3),
        "decoder.model.0": (WIDTH, CHANNELS, 3),
        "decoder.model.4": (WIDTH, WIDTH, 3),
        "decoder.model.6": (features, WIDTH, 3),
    }
    for rate in (2, 3):
        layers[f"encoder.model.{rate}.0"] = (WIDTH, WIDTH, 4)
        layers[f"decoder.model.{rate}.2"] = (WIDTH, WIDTH, 3)
        for n in range(DEPTH):
            for block in (f"encoder.model.{rate}.1.model.{n}", f"decoder.model.{rate}.0.model.{n}"):
                layers |= {f"{block}.conv1": (WIDTH, WIDTH, 3), f"{block}.conv2": (WIDTH, WIDTH, 1)}
    shapes: dict[str, tuple[int, ...]] = {f"{name}.weight": of for name, of in layers.items()}
    shapes |= {f"{name}.bias": of[:1] for name, of in layers.items()}
    shapes |= {f"quantizer.layers.{n}.codebook": (CODES, CHANNELS) for n in range(BOOKS)}
    state: dict[str, Tensor] = {}
    for number, (name, of) in enumerate(sorted(shapes.items())):
        count = torch.arange(int(np.prod(of)), dtype=torch.float64)
        wave = torch.sin(0.7 * count + number) * (0.3 if len(of) > 1 else 0.1)
        state[name] = wave.float().reshape(of)
    return state


def converted(folder: Path, normalizer: tuple[np.ndarray, np.ndarray], **others: object) -> Path:
    state = {"vq_model": weights(len(normalizer[0])), "ep": 3, **others}
    torch.save(state, folder / "net_best_fid.tar")
    convert_checkpoint(folder / "net_best_fid.tar", folder / "vq", Origin(normalizer))
    return folder / "vq"


@torch.no_grad()
def test_the_converted_network_gives_momasks_numbers(tmp_path: Path) -> None:
    optimizer = {"opt_vq_model": {"state": {0: {"step": torch.tensor(3.0)}}, "param_groups": []}}
    model = load_stages(converted(tmp_path, (np.zeros(5), np.ones(5)), **optimizer))
    vae = model.vae
    assert isinstance(vae, QuantizedVAE)
    assert model.card.vae == QuantizedVAEConfig(5, WIDTH, CHANNELS, CODES, BOOKS)
    count = torch.arange(2 * 16 * 5, dtype=torch.float64)
    motion, mask = torch.cos(0.3 * count).float().reshape(2, 16, 5), torch.ones(2, 16).bool()
    indices = vae.indices(motion, mask)
    assert indices.tolist() == INDICES
    latents = vae.latents_of(indices)
    torch.testing.assert_close(vae.encode(motion, mask).sample(), latents, atol=1e-6, rtol=0)
    features = vae.decode(latents, mask)
    torch.testing.assert_close(features[:, [0, -1]], torch.tensor(DECODED), atol=1e-5, rtol=0)
    coarse = vae.latents_of(indices[..., :1])
    assert torch.equal(coarse, vae.codebooks[0][indices[..., 0]])


def test_what_is_not_momasks_published_form_is_refused(tmp_path: Path) -> None:
    path, output = tmp_path / "vq.tar", tmp_path / "vq"
    torch.save({"net": weights()}, path)
    for origin in (Origin(predicts="sample"), Origin(unstated=Unstated(heads=8))):
        with pytest.raises(InputError, match="only settings are --mean and --std"):
            convert_checkpoint(path, output, origin)
    with pytest.raises(InputError, match="pass the data set's own"):
        convert_checkpoint(path, output)
    norm = {"encoder.model.2.1.model.0.norm1.weight": torch.ones(WIDTH)}
    torch.save({"net": weights() | norm}, path)
    with pytest.raises(ModelError, match=r"1 unknown weights.*norm1"):
        convert_checkpoint(path, output, Origin((np.zeros(5), np.ones(5))))
    torch.save({"net": weights() | {"quantizer.layers.1.codebook": torch.ones(3, 2)}}, path)
    with pytest.raises(ModelError, match="codebooks differ in size"):
        convert_checkpoint(path, output, Origin((np.zeros(5), np.ones(5))))
    assert not output.exists()


@pytest.mark.filterwarnings("ignore::latentmotion.cleanup.pipeline.CleanUpWarning")
def test_it_is_measured_and_diffused_by_command(
    figures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    normalizer, data = Dataset.load(figures).normalizer, str(figures)
    vq = str(converted(tmp_path, (normalizer.mean, normalizer.std)))
    main(["evaluate", vq, "--data", data, "--split", "val", "--replications", "1"])
    assert "| MPJPE mm ↓ |" in capsys.readouterr().out
    kind = '--set=vae={"kind": "QuantizedVAEConfig"}'
    with pytest.raises(SystemExit):
        main(["train", "vae", "--data", data, kind, "-o", str(tmp_path / "no")])
    assert "a quantized VAE is not trained here" in capsys.readouterr().err
    keys = [key for key in CHANGES if key.partition(".")[0] not in ("vae", "vae_training")]
    short = [f"--set={key}={json.dumps(CHANGES[key])}" for key in keys]
    words = ["--vae", vq, "--data", data, "--text-encoder", "starter", "--device", "cpu", *short]
    main(["train", "denoiser", *words, "-o", str(tmp_path / "run")])
    generate = ["generate", "a person walks", "--model", str(tmp_path / "run"), "--seconds", "1"]
    main([*generate, "-o", str(tmp_path / "walk.npz")])
    assert (tmp_path / "walk.npz").is_file()
