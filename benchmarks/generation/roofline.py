"""How near a model is to what the machine can do: floors of time by part, and the time it takes.

    python -m benchmarks.generation.roofline starter --batch 1 32 --threads 1
    python -m benchmarks.generation.roofline MODEL --batch 1 256 --device cuda --precision bfloat16

FLOPs and bytes are counted of matrix products and convolutions, weights read anew by every pass of
the denoiser. Divided by what the machine was just measured to do (a product of large matrices or
a large convolution, whichever is faster; a copy of as many bytes as the part moves, in a cache
where they fit one) they give two times. No version that makes the same products runs faster than
the larger: "times the floor" says how far a part is from it. Lengths are all the same, 4 s by
default; words are encoded on the CPU.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import onnx
import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry

from benchmarks.harness.ceilings import Ceilings
from benchmarks.harness.contest import figure, table
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.schedule import StepCondition
from latentmotion.engine.backend import ON_CPU, ExecutionOptions
from latentmotion.engine.request import GenerationRequest
from latentmotion.engine.session import Session
from latentmotion.evaluation.cost import flops
from latentmotion.model.card import TEXT_GRAPH_FILE, ModelCard, find_model, text_encoder_folder
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import load_model
from latentmotion.networks.device import describe_machine
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import MotionPipeline

CAPTION = "a person walks forward and kicks with the left leg"
COLUMNS = (
    "batch, part",
    "GFLOP",
    "MB weights",
    "MB activations",
    "ms by FLOPs",
    "ms by bytes",
    "ms measured",
    "times the floor",
)
# Names of the matrices in the small text encoder's graph.
MATRIX = re.compile(r"layers\.\d+\.\w+\.packed")


# The only product here that PyTorch's counter of FLOPs does not know.
_ATTENTION = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu


@dataclass(frozen=True)
class Traffic:
    """Bytes that are read or written."""

    weights: int  # Bytes of parameters.
    activations: int  # Bytes of everything else.

    @property
    def total(self) -> int:
        """Bytes of parameters and activations."""
        return self.weights + self.activations


def traffic(network: nn.Module, action: Callable[[], object]) -> Traffic:
    """Returns the bytes that a network's products move while an action runs.

    Every product reads its operands once and writes its result once; what stands between products
    is taken to be fused into them: a lower bound, since small caches and separate operations add.
    """
    with _Counter(network) as counter, torch.no_grad():
        action()
    return Traffic(counter.weights, counter.activations)


class _Counter(TorchDispatchMode):
    """Counts the operands and results of the products among all operations."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.weights = self.activations = 0
        self._learned = {_storage(parameter) for parameter in network.parameters()}

    def __torch_dispatch__(
        self,
        operation: Any,
        types: Any,
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        """Runs an operation and counts it."""
        output = operation(*args, **(kwargs or {}))
        if operation.overloadpacket in flop_registry or operation.overloadpacket is _ATTENTION:
            first = output[:1] if isinstance(output, tuple) else [output]
            for tensor in [*_tensors(args), *_tensors((kwargs or {}).values()), *first]:
                size = tensor.numel() * tensor.element_size()
                if _storage(tensor) in self._learned:
                    self.weights += size
                else:
                    self.activations += size
        return output


def _tensors(values: Iterable[Any]) -> list[Tensor]:
    return [value for value in values if isinstance(value, Tensor)]


def _storage(tensor: Tensor) -> int:
    return tensor.untyped_storage().data_ptr()


@dataclass(frozen=True)
class Part:
    """What a part of the chain must do for one batch."""

    name: str  # What it is called.
    passes: int  # How many times it goes over its weights.
    flops: float  # Floating-point operations of a pass.
    moved: Traffic  # Bytes of a pass.
    run: Callable[[], object]  # One pass, where and how it is measured.
    ceilings: Ceilings  # Of what runs it.

    def row(self, batch: int) -> list[str]:
        """Measures it and returns its line of the table."""
        ceilings, moved = self.ceilings, self.moved
        # What a pass moves decides whether it stays in a cache for the next.
        floors = self.flops / ceilings.flops, moved.total / ceilings.bandwidth(moved.total)
        seconds = ceilings.seconds(self.run)
        counts = self.flops / 1e9, moved.weights / 1e6, moved.activations / 1e6
        each = *counts, *(1e3 * time for time in (*floors, seconds))
        figures = [figure(self.passes * value) for value in each]
        name = f"{self.passes} x {self.name}" if self.passes > 1 else self.name
        return [f"{batch}, {name}", *figures, figure(seconds / max(floors))]


class Chain:
    """A model's parts, counted on the CPU and run where it is asked for.

    Args:
        model: Name or folder.
        execution: Where and how.
    """

    def __init__(self, model: str, execution: ExecutionOptions) -> None:
        self.generator = torch_pipeline(model, execution=execution)
        self.networks = load_model(find_model(model))
        self.encoder = text_encoder_folder(self.generator.card, find_model(model))
        self.host = Ceilings(ON_CPU)
        self.device = self.host if execution == ON_CPU else Ceilings(execution)
        self.shrink = 2 if execution.precision == "bfloat16" else 1

    def parts(self, order: GenerationRequest) -> Iterator[Part]:
        """Yields text, denoiser and decoder, for motions of one length."""
        condition = self.generator.condition(order.prompts)
        if self.encoder is not None:
            yield self.text(order, int(condition.mask[0].sum()))
        yield self.denoiser(order, condition)
        yield self.decoder(order, self.networks.vae)

    def text(self, order: GenerationRequest, words: int) -> Part:
        """The small text encoder, which reads one sentence after the other."""
        assert self.encoder is not None  # the caller asked
        numbers, width, layers = encoder_sizes(self.encoder / TEXT_GRAPH_FILE)
        # Two for each multiply-add of the matrices; scores and means of attention.
        each = 2 * words * numbers + 4 * words**2 * width * layers
        moved = Traffic(4 * numbers, 0)
        run = partial(self.generator.condition, order.prompts[:1])
        return Part("text", len(order.prompts), each, moved, run, self.host)

    def denoiser(self, order: GenerationRequest, condition: Conditioning) -> Part:
        """One pass, of two rows per motion where it is guided from outside."""
        card, network = self.generator.card, self.networks.denoiser
        assert network is not None  # it generates
        rows = 1 if card.few_step or order.sampling.guidance == 1 else 2
        words, seen = (
            torch.tensor(array).repeat(rows, *[1] * (array.ndim - 1))
            for array in (condition.tokens, condition.mask)
        )
        z, mask = latents_of(order, card, rows)
        ones = z.new_ones(len(z))
        told = {"guidance": ones, "step_size": ones} if card.few_step else {}
        inputs = {"z": z, "t": ones, "words": words, "words_mask": seen, "mask": mask, **told}
        step_condition = StepCondition(**told) if told else None
        action = partial(network, z, ones, Conditioning(words, seen), mask, step_condition)
        return self._part(
            "denoiser",
            order.sampling.steps,
            network,
            action,
            self.generator.backend.denoiser,
            inputs,
        )

    def decoder(self, order: GenerationRequest, vae: MotionVAE) -> Part:
        """The way from latents to features."""
        latents, _ = latents_of(order, self.generator.card, 1)
        mask = torch.ones(len(order.frames), order.frames[0], dtype=torch.bool)
        inputs = {"latents": latents, "mask": mask}
        action = partial(vae.decode, latents, mask)
        return self._part("decoder", 1, vae, action, self.generator.backend.decoder, inputs)

    def walk(self, order: GenerationRequest) -> Tensor:
        """Walks from sentences to joints, which stay on the device."""
        features = self.generator.generate_batch(order)
        return self.generator.joints_of(features)

    def _part(
        self,
        name: str,
        passes: int,
        network: nn.Module,
        action: Callable[[], object],
        session: Session,
        inputs: Mapping[str, Tensor],
    ) -> Part:
        moved = traffic(network, action)
        moved = Traffic(moved.weights // self.shrink, moved.activations // self.shrink)
        place = self.generator.backend.to_device
        there = {key: place(value.numpy()) for key, value in inputs.items()}
        run = partial(session, **there)
        return Part(name, passes, flops(action), moved, run, self.device)


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model")
    parser.add_argument("--batch", type=int, nargs="+", default=[1, 32])
    parser.add_argument("--steps", type=int, help="by default the model's own")
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--precision", default="float32", choices=("float32", "bfloat16"))
    parser.add_argument("--launch", default="eager", choices=("eager", "graph", "compiled"))
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    execution = ExecutionOptions(options.device, options.precision, options.launch)
    print(report(options.model, options.batch, options.steps, options.seconds, execution))


def report(
    model: str,
    batches: Sequence[int],
    steps: int | None,
    seconds: float,
    execution: ExecutionOptions,
) -> str:
    """Returns the table of a model, with the ceilings above it."""
    chain, rows = Chain(model, execution), []
    for batch in batches:
        order = ordered(chain.generator, batch, seconds, steps)
        rows.extend(part.row(batch) for part in chain.parts(order))
        whole = chain.device.seconds(partial(chain.walk, order))
        rows.append([f"{batch}, **text to joints**", *[""] * 5, f"**{figure(1e3 * whole)}**", ""])
    load = f"load {os.getloadavg()[0]:.1f}"
    about = f"`{model}`, {seconds:g} s, {describe_machine()}, {load}; {chain.device}"
    return f"{about}\n\n{table(COLUMNS, rows)}\n"


def ordered(
    generator: MotionPipeline, batch: int, seconds: float, steps: int | None = None
) -> GenerationRequest:
    """Returns one sentence so many times, with other seeds."""
    card, frames = generator.card, round(seconds * generator.representation.fps)
    prompts, seeds = (CAPTION,) * batch, tuple(range(batch))
    steps = steps or card.sampling.steps
    return GenerationRequest(prompts, (frames,) * batch, seeds, card.sampling.but(steps))


def latents_of(order: GenerationRequest, card: ModelCard, rows: int) -> tuple[Tensor, Tensor]:
    """Returns noise of the latents' shape and its mask, `rows` for each motion."""
    tokens = card.latents.tokens_of(order.frames[0])
    z = torch.randn(rows * len(order.frames), tokens, card.latents.width)
    return z, torch.ones(z.shape[:2], dtype=torch.bool)


def encoder_sizes(graph: Path) -> tuple[int, int, int]:
    """Returns the numbers in a text encoder's matrices, its width and its layers."""
    parts = onnx.load(graph).graph.initializer
    matrices = [list(part.dims) for part in parts if MATRIX.fullmatch(part.name)]
    layers = sum(part.name.endswith(".out.packed") for part in parts)
    return sum(rows * columns for rows, columns in matrices), min(map(min, matrices)), layers


if __name__ == "__main__":
    main()
