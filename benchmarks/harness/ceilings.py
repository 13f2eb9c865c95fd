"""The two ceilings of a machine, measured: how fast it multiplies matrices and moves bytes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median

import torch
import torch.nn.functional as F
from torch import Tensor

from latentmotion.engine.backend import ExecutionOptions
from latentmotion.networks.device import arithmetic

LARGEST = {"cpu": 2**28, "cuda": 2**31}  # Bytes of a buffer that fits no cache.
SIDE = {"cpu": 1024, "cuda": 8192}  # Rows and columns of the matrices.
# Shape of what is convolved, by a kernel of 3.
ROWS, CHANNELS, LENGTH = {"cpu": 8, "cuda": 256}, {"cpu": 256, "cuda": 1024}, 1024
SECONDS = 0.3  # How long one measurement takes at least.


@dataclass
class Ceilings:
    """What a device does at best, in the precision that is asked for."""

    execution: ExecutionOptions  # Where and how.
    # Bytes a second by the size of the buffer, as far as measured.
    rates: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.kind = self.execution.device.partition(":")[0]
        alone = self.kind == "cpu" and torch.get_num_threads() == 1
        # What others do on a shared machine is not in a thread's own time.
        self.clock = time.thread_time if alone else time.perf_counter
        with torch.no_grad(), arithmetic(self.execution):
            # They are different libraries', of which either may be the better.
            self.flops = max(self._products(), self._convolutions())

    def bandwidth(self, size: int = 2**40) -> float:
        """Returns bytes a second, read and written, of a copy of so many bytes in all.

        Half of them are read, half written. What fits a cache is copied there.
        """
        # Powers of two, so that few are measured.
        size = min(max(1 << (size - 1).bit_length(), 2**16), LARGEST[self.kind])
        if size not in self.rates:
            source = torch.randn(size // 8, device=self.execution.device)
            target = torch.empty_like(source)
            self.rates[size] = size / self.seconds(lambda: target.copy_(source))
        return self.rates[size]

    def seconds(self, action: Callable[[], object], least: float = SECONDS) -> float:
        """Returns the median seconds of an action, run again and again for `least` seconds."""
        action()
        times: list[float] = []
        end = time.perf_counter() + least
        while time.perf_counter() < end or len(times) < 3:
            self._wait()
            start = self.clock()
            action()
            self._wait()
            times.append(self.clock() - start)
        return median(times)

    def _products(self) -> float:
        side = SIDE[self.kind]
        a, b = self._random(side, side), self._random(side, side)
        return 2 * side**3 / self.seconds(lambda: a @ b)

    def _convolutions(self) -> float:
        rows, channels = ROWS[self.kind], CHANNELS[self.kind]
        x, weights = self._random(rows, channels, LENGTH), self._random(channels, channels, 3)
        operations = 2 * rows * LENGTH * 3 * channels**2
        return operations / self.seconds(lambda: F.conv1d(x, weights, padding=1))

    def _random(self, *shape: int) -> Tensor:
        # Products of zeros can run faster than real ones.
        numbers = torch.randn(shape, device=self.execution.device)
        return numbers.bfloat16() if self.execution.precision == "bfloat16" else numbers

    def _wait(self) -> None:
        if self.kind == "cuda":
            torch.cuda.synchronize()

    def __str__(self) -> str:
        rate = self.bandwidth()
        found = f"{self.flops / 1e9:,.0f} GFLOP/s, {rate / 1e9:,.1f} GB/s beyond caches"
        clock = "its thread's own time" if self.clock is time.thread_time else "wall clock"
        return f"{self.execution}: {found}; {clock}"
