"""Contenders take turns in one run, so that a machine whose pace drifts is unfair to none.

In every turn each contender runs once; the first turn warms up and is not counted. Tables have the
medians of the turns. A ratio is the median of the ratios of single turns: what the first contender
took by what this one took a moment later.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan, nan
from statistics import median

from benchmarks.harness.stopwatch import Laps, Stopwatch
from latentmotion.networks.device import describe_machine

Contender = Callable[[], Laps]  # Does the whole work once and says how long its parts took.


def whole(action: Callable[[], object]) -> Contender:
    """Returns an action as a contender of one part."""

    def run() -> Laps:
        watch = Stopwatch()
        action()
        watch.lap("whole")
        return watch.laps

    return run


@dataclass(frozen=True)
class Turn:
    """What a contender took once."""

    laps: Laps  # Milliseconds by part.
    # How many cores it had on average: less than it has threads, where others had them too.
    cores: float

    @property
    def whole(self) -> float:
        """Milliseconds of all parts."""
        return sum(self.laps.values())


@dataclass(frozen=True)
class Times:
    """What the turns of all contenders took."""

    # By the contender's name; one that is slow may have fewer turns.
    turns: Mapping[str, Sequence[Turn]]
    # Processes that wanted a core, in the minute before and in the last; this run included.
    load: tuple[float, float]

    def part(self, name: str, part: str) -> float:
        """Returns the median milliseconds of one part; not a number, if it has no such part."""
        return median(turn.laps.get(part, nan) for turn in self.turns[name])

    def whole(self, name: str) -> float:
        """Returns the median milliseconds of all parts together."""
        return median(turn.whole for turn in self.turns[name])

    def processor(self, name: str) -> float:
        """Returns the median milliseconds of processor time, of all threads together."""
        return median(turn.whole * turn.cores for turn in self.turns[name])

    def ratio(self, name: str, first: str | None = None) -> float:
        """Returns how many times as fast as the first contender, or one named, this one is."""
        reference = self.turns[first or next(iter(self.turns))]
        pairs = zip(reference, self.turns[name], strict=False)
        return median(before.whole / turn.whole for before, turn in pairs)

    def __str__(self) -> str:
        """Says on what and how was measured, and whether other work was in the way."""
        counts = sorted(len(turns) for turns in self.turns.values())
        span = " to ".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
        busy = ", a **busy machine**" if _busy(self.load) else ""
        load = f"load {self.load[0]:.1f} before, {self.load[1]:.1f} at the end{busy}"
        return f"{describe_machine()}, {_cores()} cores, {load}; medians of turns: {span}"


def take_turns(contenders: Mapping[str, Contender], turns: int, patience: float = inf) -> Times:
    """Lets each contender run once to warm up, then again and again in turn.

    Args:
        contenders: By name, in the order of their turns.
        turns: Turns that count.
        patience: Seconds after which a contender sits out; each has one turn that counts.
    """
    load, spent = os.getloadavg()[0], dict.fromkeys(contenders, 0.0)
    taken: dict[str, list[Turn]] = {name: [] for name in contenders}
    for number in range(turns + 1):
        for name, contender in contenders.items():
            if number < 2 or spent[name] < patience:
                turn, seconds = _turn(contender)
                spent[name] += seconds
                taken[name].append(turn)
    loads = load, os.getloadavg()[0]
    if _busy(loads):
        print(f"load {max(loads):.1f}: other work shares the cores; trust ratios", file=sys.stderr)
    return Times({name: found[1:] for name, found in taken.items()}, loads)


def _turn(contender: Contender) -> tuple[Turn, float]:
    start, before = time.perf_counter(), time.process_time()
    laps = contender()
    seconds = time.perf_counter() - start
    return Turn(laps, (time.process_time() - before) / seconds), seconds


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a Markdown table."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def figure(value: float) -> str:
    """Returns a number with three digits that count; nothing for what was not measured."""
    if isnan(value):
        return ""
    return f"{value:.0f}" if value >= 99.95 else f"{value:#.3g}".rstrip(".")


def _busy(load: tuple[float, float]) -> bool:
    return max(load) > _cores() + 0.5


def _cores() -> int:
    return os.cpu_count() or 1
