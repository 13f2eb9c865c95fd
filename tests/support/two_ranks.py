"""A program that trains alone and as two ranks, sharded and not, into folders to be compared.

python -m tests.support.two_ranks FOLDER
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch
import torch.distributed.fsdp  # seconds, once for all ranks
import torch.utils.tensorboard  # likewise

from latentmotion.networks.checkpoint import build
from latentmotion.training.distributed import DistributedContext, distributed_context, shard
from latentmotion.training.stages import train_denoiser, train_vae
from tests.support.moving_figures import write_moving_figures
from tests.support.small_training import CHANGES, LetterCount, killed_at, small

TRANSFORMER = {**CHANGES["denoiser.transformer"], "dropout": 0.0}  # type: ignore[dict-item]


EPSILON = 1e-3
"""AdamW's, in place of 1e-8.

AdamW divides a gradient by its own size + epsilon. The bias of an attention's keys changes no
softmax: its gradient is zero in exact arithmetic and rounding in floats, which AdamW with 1e-8
scales up to whole steps. With this epsilon, gradients that differ by rounding, 1e-7 of a norm
clipped to 1, move a weight by at most rate · 1e-7 / 1e-3 apart, on every processor; and a gradient
that is wrong by a factor, which AdamW would hide, shows.
"""


def main() -> None:
    """Trains all."""
    torch.set_num_threads(1)
    torch.optim.AdamW = partial(torch.optim.AdamW, eps=EPSILON)  # type: ignore[misc]
    folder = Path(sys.argv[1])
    data = write_moving_figures(folder / "figures")

    def train(name: str, parallel: str, stop: int | None = None) -> Callable[..., None]:
        def run(context: DistributedContext) -> None:
            settings = {"parallel": parallel, "steps": 4, "validate_every": 4}
            changes = {
                f"{stage}_training.{key}": value
                for stage in ("vae", "denoiser")
                for key, value in settings.items()
            }
            experiment = small(**changes, **{"denoiser.transformer": TRANSFORMER})
            if "denoiser" in name:
                vae, encoder = folder / "one", LetterCount()
                train_denoiser(experiment, data, vae, encoder, folder / name, context)
            elif stop is None:
                train_vae(experiment, data, folder / name, context)
            else:
                with killed_at(stop):
                    train_vae(experiment, data, folder / name, context)

        return run

    alone, shared = "auto", "sharded"
    together(1, train("one", alone))
    together(2, train("sharded-alone", shared, 2))
    together(1, train("sharded-alone", alone))
    together(1, train("alone-sharded", alone, 2))
    together(2, train("alone-sharded", shared))
    together(1, train("denoiser-one", alone))
    together(2, train("denoiser-sharded", shared))
    together(2, lambda context: parts(folder, context))


def parts(folder: Path, context: DistributedContext) -> None:
    """Writes how many of a network's numbers each rank holds, and of how many."""
    network = build(small().vae)
    every = sum(weights.numel() for weights in network.parameters())
    shard(network, network, context)
    own = sum(weights.to_local().numel() for weights in network.parameters())  # type: ignore
    path = folder / f"parts-{context.ranks.rank}.json"
    path.write_text(json.dumps([own, every]), encoding="utf-8")


def together(world: int, work: Callable[[DistributedContext], None]) -> None:
    """Runs something as so many ranks."""
    with socket.create_server(("127.0.0.1", 0)) as place:
        port = place.getsockname()[1]
    children = []
    for rank in range(world):
        if child := os.fork():
            children.append(child)
            continue
        code = 1
        try:
            about = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": world, "MASTER_PORT": port}
            os.environ.update({key: str(value) for key, value in about.items()})
            os.environ["MASTER_ADDR"] = "127.0.0.1"
            with distributed_context("cpu") as context:
                work(context)
            code = 0
        finally:
            sys.stderr.flush()
            os._exit(code)
    codes = [os.waitpid(child, 0)[1] for child in children]
    assert not any(codes), codes


if __name__ == "__main__":
    main()
