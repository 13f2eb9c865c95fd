"""The training loop of every network: losses of step k → gradients → AdamW → average; snapshots.

The average is ē ← d ē + (1 − d) θ, with d growing at the start. A snapshot holds all that a killed
run needs to resume, in one file that is whole or absent: weights, their average, the optimizer's
moments and the number of steps done. The position in the data and the state of every random
generator follow from that number (`distributed.py`).

A stage is a module whose forward takes a step's number and returns that step's losses; it finds
batch and random numbers from the number alone, so weights and number are the whole state.
"""

from __future__ import annotations

import copy
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import torch
from torch.nn.parallel import DistributedDataParallel

from latentmotion.errors import LatentMotionError, ModelError
from latentmotion.motion import Motion
from latentmotion.networks.device import autocast
from latentmotion.storage.files import atomic_file
from latentmotion.training import distributed
from latentmotion.training.distributed import DistributedContext, whole
from latentmotion.training.experiment import TrainingSettings
from latentmotion.training.run_folder import Journal, write_strip, write_tensors

Network = TypeVar("Network", bound=torch.nn.Module)


class ExponentialMovingAverage(Generic[Network]):
    """A smoothed copy of a network, which is what is validated, sampled from and saved.

    The decay at step k is min(decay, (1 + k) / (10 + k)), so that the random first weights are
    forgotten at once (as in TensorFlow's `ExponentialMovingAverage`).

    Args:
        network: The network to follow; it is copied.
        decay: d for large k; 0 makes the average equal to the network.
    """

    def __init__(self, network: Network, decay: float) -> None:
        self.network = copy.deepcopy(network).eval().requires_grad_(False)
        self.decay = decay
        self._unshared: Network | None = None

    def shard(self, context: DistributedContext) -> None:
        """Leaves each rank its part of the weights."""
        self._unshared = copy.deepcopy(self.network)
        distributed.shard(self.network, self.network, context)

    def whole(self, context: DistributedContext) -> Network:
        """Returns the network with all weights; every rank must call it."""
        if self._unshared is None:
            return self.network
        network = copy.deepcopy(self._unshared)
        network.load_state_dict(whole(self.network.state_dict()))
        return network.to(context.device)

    @torch.no_grad()
    def update(self, network: Network, step: int) -> None:
        """Moves the average towards `network` after optimizer step number `step`, from 0."""
        weight = 1 - min(self.decay, (1 + step) / (10 + step))
        mine, others = self.network.state_dict(), network.state_dict()
        for name, tensor in mine.items():
            if tensor.is_floating_point():  # weights, and the running statistics that fit them
                tensor.lerp_(others[name], weight)
            else:
                tensor.copy_(others[name])


NAME = "snapshot.pt"


class Progress(NamedTuple):
    """Progress of a run, over all its resumptions; times include validation and pictures."""

    step: int = 0  # Optimizer steps.
    seconds: float = 0.0  # Time on the clock.
    # Time of the processor, over all threads; that of a GPU is not in it.
    processor_seconds: float = 0.0


def read_progress(folder: Path) -> Progress:
    """Returns how far the last snapshot of a run folder is; zeros without one.

    Raises:
        ModelError: The snapshot is damaged.
    """
    path = folder / NAME
    # The numbers alone are read, not the weights.
    return _progress_of(_read_snapshot(path, mmap=True)) if path.exists() else Progress()


def save_snapshot(
    folder: Path,
    progress: Progress,
    network: torch.nn.Module,
    average: ExponentialMovingAverage,
    optimizer: torch.optim.Optimizer,
    context: DistributedContext,
) -> None:
    """Writes the snapshot of `folder`; every rank must call it, and the leading one writes."""
    state = {
        **progress._asdict(),
        "network": whole(network.state_dict()),
        "average": whole(average.network.state_dict()),
        "optimizer": whole(optimizer.state_dict()),
    }
    if context.is_main:
        with atomic_file(folder / NAME) as temporary:
            torch.save(state, temporary)


def load_snapshot(
    folder: Path,
    network: torch.nn.Module,
    average: ExponentialMovingAverage,
    optimizer: torch.optim.Optimizer,
) -> Progress:
    """Restores the state that `save_snapshot` wrote; returns its progress, else zeros.

    Raises:
        ModelError: The file is damaged or belongs to other networks.
    """
    path = folder / NAME
    if not path.exists():
        return Progress()
    state = _read_snapshot(path)
    try:
        for part, key in ((network, "network"), (average.network, "average")):
            current = part.state_dict()
            placed = {
                k: distributed.shared_like(v, current[k]) if k in current else v
                for k, v in state[key].items()
            }
            part.load_state_dict(placed)
        parameters = [p for group in optimizer.param_groups for p in group["params"]]
        for number, moments in state["optimizer"]["state"].items():
            for key in ("exp_avg", "exp_avg_sq"):
                moments[key] = distributed.shared_like(moments[key], parameters[number])
        optimizer.load_state_dict(state["optimizer"])
    except (KeyError, IndexError, RuntimeError, ValueError) as error:
        raise ModelError(
            f"{path} does not fit this network: {error}; use another folder"
        ) from error
    return _progress_of(state)


def _read_snapshot(path: Path, mmap: bool = False) -> dict[str, Any]:
    try:
        return torch.load(path, map_location="cpu", weights_only=True, mmap=mmap)
    except Exception as error:
        raise ModelError(f"{path} is damaged: {error}; delete it to start afresh") from error


def _progress_of(state: dict[str, Any]) -> Progress:
    return Progress(**{key: state[key] for key in Progress._fields})


class Stage(torch.nn.Module, ABC, Generic[Network]):
    """A training stage: losses of a step, figures on held-out data, samples."""

    network: Network  # The network that is optimized, averaged and saved.

    @abstractmethod
    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`; "total" is minimized, the others are reported."""

    @abstractmethod
    def validate(self, network: Network) -> Mapping[str, float]:
        """Figures of `network` on data it is not trained on."""

    def sample(self, network: Network) -> Sequence[Motion]:
        """A few motions to look at; none of networks that make no motions."""
        return []


def train(
    stage: Stage[Network], settings: TrainingSettings, folder: Path, context: DistributedContext
) -> tuple[Network, float]:
    """Trains `stage.network` from its last snapshot in `folder`, or from the start.

    Returns:
        The averaged network and the seconds that training took, over all resumptions.

    Raises:
        LatentMotionError: The loss is no longer finite.
    """
    sharded = distributed.is_sharded(stage.network, settings, context)
    if not sharded:
        stage.to(context.device)
    average = ExponentialMovingAverage(stage.network, settings.ema_decay)
    if sharded:  # parts go to the device one after the other
        average.shard(context)
        distributed.shard(stage, stage.network, context)
        stage.to(context.device)
    optimizer = torch.optim.AdamW(
        stage.network.parameters(),
        settings.learning_rate,
        weight_decay=settings.weight_decay,
        fused=True,  # a quarter of the time of a loop over the tensors on a CPU
    )
    done, seconds, processor = load_snapshot(folder, stage.network, average, optimizer)
    context.check_same_step(done)
    replicated = context.ranks.world > 1 and not sharded
    losses_of = DistributedDataParallel(stage) if replicated else stage
    start, processor_start = time.perf_counter() - seconds, time.process_time() - processor
    with Reporter(stage, average, settings, folder, context, done) as reporter:
        for step in range(done, settings.steps):
            losses = optimize(losses_of, optimizer, settings, step, context)
            average.update(stage.network, step)
            reporter.report(step + 1, losses)
            if is_due(step + 1, settings.snapshot_every, settings.steps):
                seconds = time.perf_counter() - start
                progress = Progress(step + 1, seconds, time.process_time() - processor_start)
                save_snapshot(folder, progress, stage.network, average, optimizer, context)
    return average.whole(context), time.perf_counter() - start


def optimize(
    losses_of: torch.nn.Module,
    optimizer: torch.optim.Optimizer,
    settings: TrainingSettings,
    step: int,
    context: DistributedContext,
) -> dict[str, torch.Tensor]:
    """Takes one step; returns its losses, "gradient" (norm) and "rate" with them."""
    losses_of.train()
    with autocast(context.device, settings.precision):
        losses = losses_of(step)
    optimizer.zero_grad(set_to_none=True)
    losses["total"].backward()
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    norm = whole(torch.nn.utils.clip_grad_norm_(parameters, settings.gradient_clip or math.inf))
    for group in optimizer.param_groups:
        group["lr"] = settings.rate(step)
    optimizer.step()
    rate = torch.tensor(settings.rate(step))
    return {**{k: v.detach() for k, v in losses.items()}, "gradient": norm, "rate": rate}


class Reporter(Generic[Network]):
    """Journal, validation and pictures of a run, each when its step has come.

    Args:
        stage: Stage to train.
        average: The averaged network, which is validated and sampled.
        settings: Intervals of reports, validations and snapshots.
        folder: The run folder.
        context: Only the leading rank writes.
        done: Steps that the snapshot holds.
    """

    def __init__(
        self,
        stage: Stage[Network],
        average: ExponentialMovingAverage[Network],
        settings: TrainingSettings,
        folder: Path,
        context: DistributedContext,
        done: int,
    ) -> None:
        self._stage, self._average, self._settings = stage, average, settings
        self._folder, self._context, self._done = folder, context, done
        self._start = time.perf_counter()
        self._journal = Journal(folder, settings.steps, done) if context.is_main else None

    def __enter__(self) -> Reporter:
        return self

    def __exit__(self, *failure: Any) -> None:
        if self._journal:
            self._journal.close()

    def report(self, step: int, losses: Mapping[str, torch.Tensor]) -> None:
        """Writes what is due after `step` steps."""
        settings = self._settings
        if is_due(step, settings.report_every, settings.steps):
            self._write(step, "train", self._context.mean(losses))
        validates, samples = (
            is_due(step, every, settings.steps)
            for every in (settings.validate_every, settings.sample_every)
        )
        percent = settings.kept_percent(step)
        due = validates or samples or percent is not None
        network = self._average.whole(self._context) if due else None
        if self._journal is None or network is None:
            return
        if percent is not None:
            write_tensors(kept_weights(self._folder, percent), network.state_dict())
        if validates:
            self._write(step, "validation", self._stage.validate(network))
        if samples:
            write_strip(self._folder / f"samples-{step:07d}.png", self._stage.sample(network))

    def _write(self, step: int, kind: str, figures: Mapping[str, float]) -> None:
        if not math.isfinite(figures.get("total", 0.0)):
            raise LatentMotionError(
                f"the loss of step {step} is {figures['total']}, expected a finite number; "
                "lower learning_rate or gradient_clip, or use precision float32"
            )
        if self._journal:
            pace = (time.perf_counter() - self._start) / (step - self._done)
            self._journal.write(step, kind, figures, pace)


def kept_weights(folder: Path, percent: int) -> Path:
    """Returns the file of the averaged weights after some percent of a run's training."""
    return folder / f"kept-{percent:03d}.safetensors"


def is_due(step: int, every: int, steps: int) -> bool:
    """Whether something done every `every` steps, and at the end, is due after `step` steps."""
    return every > 0 and (step % every == 0 or step == steps)
