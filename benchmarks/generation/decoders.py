"""What decoders cost: parameters, FLOPs, and time on ONNX Runtime and OpenVINO, on one thread.

    python -m benchmarks.generation.decoders --models starter cheap=runs/decoder

All take turns in one run. Graphs are made anew, so that any trained model will do.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch

from benchmarks.generation.ours import Model
from benchmarks.harness.contest import Contender, figure, table, take_turns, whole
from latentmotion.engine.session import Runtime, open_session
from latentmotion.evaluation.cost import flops, parameters
from latentmotion.export.onnx import export_decoder
from latentmotion.networks.checkpoint import load_stages
from latentmotion.networks.vae.interface import MotionVAE, decoder_modules

RUNTIMES: tuple[Runtime, ...] = ("onnxruntime", "openvino")


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    models: dict[str, Any] = {"nargs": "+", "type": Model.of, "metavar": "NAME[=FOLDER]"}
    parser.add_argument("--models", required=True, **models)
    parser.add_argument("--frames", type=int, default=80)
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 32])
    parser.add_argument("--turns", type=int, default=30)
    options = parser.parse_args(arguments)
    print(report(options.models, options.frames, options.batches, options.turns))


@torch.no_grad()
def report(models: Sequence[Model], frames: int, batches: Sequence[int], turns: int) -> str:
    """Returns the table.

    Args:
        models: Whose decoders are compared; ratios are of the first one's time.
        frames: Length of the motions.
        batches: Motions decoded together.
        turns: Turns that count.
    """
    contenders: dict[str, Contender] = {}
    costs = {}
    with tempfile.TemporaryDirectory() as folder:
        for model in models:
            vae = _vae(model)
            latents, mask = _latents(vae, 1, frames)
            costs[model.name] = flops(partial(vae.decode, latents, mask)) / 1e6
            contenders |= _contenders(model, vae, frames, batches, Path(folder))
        times = take_turns(contenders, turns)
    columns = [f"{runtime}, {batch} at once" for runtime in RUNTIMES for batch in batches]
    rows = []
    for model in models:
        row = [model.name, f"{parameters(decoder_modules(_vae(model))) / 1e6:.2f}"]
        row.append(figure(costs[model.name]))
        for column in columns:
            name, first = f"{model.name}, {column}", f"{models[0].name}, {column}"
            row.append(f"{figure(times.whole(name))} ({times.ratio(name, first):.2f} ×)")
        rows.append(row)
    head = ["decoder of", "parameters, M", "MFLOP"]
    return f"{times}\n\n{table([*head, *(f'{column}, ms' for column in columns)], rows)}"


def _contenders(
    model: Model, vae: MotionVAE, frames: int, batches: Sequence[int], folder: Path
) -> dict[str, Contender]:
    path = folder / f"{model.name}.onnx"
    export_decoder(vae, model.card.latents.frames_per_token, path)
    found = {}
    for runtime in RUNTIMES:
        session = open_session(path, runtime, threads=1)
        for batch in batches:
            latents, mask = (x.numpy() for x in _latents(vae, batch, frames))
            run = partial(session, latents=latents, mask=mask)
            found[f"{model.name}, {runtime}, {batch} at once"] = whole(run)
    return found


def _vae(model: Model) -> MotionVAE:
    found = load_stages(model.folder)
    if not found.card.vae.has_weights:
        raise SystemExit(f"{model.folder} has no VAE; name another model")
    return found.vae


def _latents(vae: MotionVAE, batch: int, frames: int) -> tuple[torch.Tensor, torch.Tensor]:
    mask = torch.ones(batch, frames, dtype=torch.bool)
    noise = torch.Generator().manual_seed(0)
    tokens = int(vae.latent_mask(mask)[0].sum())
    return torch.randn(batch, tokens, vae.latent_width, generator=noise), mask


if __name__ == "__main__":
    main()
