"""Our models as contenders: one on one engine, asked for motions as a user asks for them.

Every turn asks for sentences that were not asked before, so that nothing remembered is measured.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.harness.stopwatch import Laps, Stopwatch
from latentmotion.cli.options import Runtime
from latentmotion.diffusion.condition import Condition
from latentmotion.model.card import ModelCard, find_model, read_card
from latentmotion.pipeline import MotionPipeline

ENGINES: dict[Runtime, str] = {
    "pytorch": "PyTorch eager",
    "onnxruntime": "ONNX Runtime",
    "openvino": "OpenVINO",
}


@dataclass(frozen=True)
class Model:
    """A model by the name that tables give it."""

    name: str  # As tables call it.
    folder: Path  # Where it is.

    @classmethod
    def of(cls, argument: str) -> Model:
        """Reads a name, a folder or `NAME=FOLDER`."""
        name, equals, folder = argument.partition("=")
        return cls(name if equals else Path(name).name, find_model(folder or name))

    @property
    def card(self) -> ModelCard:
        """What it is."""
        return read_card(self.folder)

    def steps(self, most: int) -> tuple[int, ...]:
        """Returns the numbers of steps that it knows; `most` alone, if it takes any number."""
        return self.card.few_step.steps if self.card.few_step else (most,)


def options_parser(about: str | None) -> argparse.ArgumentParser:
    """Returns what all programs that time generating can be told."""
    parser = argparse.ArgumentParser(description=about)
    models = {"nargs": "*", "type": Model.of, "metavar": "NAME[=FOLDER]"}
    parser.add_argument("--models", default=[Model.of("starter")], **models)
    parser.add_argument("--int8", default=[], help="not for PyTorch", **models)
    parser.add_argument("--engines", nargs="*", choices=list(ENGINES), default=list(ENGINES))
    parser.add_argument("--threads", nargs="*", type=int, default=[2])
    parser.add_argument("--seconds", type=float, default=4.0, help="of a motion")
    parser.add_argument("--steps", type=int, default=50, help="of models that take any number")
    parser.add_argument("--turns", type=int, default=10)
    return parser


def entries(options: argparse.Namespace) -> list[tuple[Model, Runtime]]:
    """Returns which model shall run on which engine."""
    graphs = [engine for engine in options.engines if engine != "pytorch"]
    every = [(model, options.engines) for model in options.models]
    every += [(model, graphs) for model in options.int8]
    return [(model, engine) for model, engines in every for engine in engines]


def label(model: Model, engine: Runtime, steps: int) -> str:
    """Returns what tables call it."""
    return f"{model.name}, {steps} step{'s'[: steps > 1]}, {ENGINES[engine]}"


class Watched:
    """Something that is called, and counts calls and milliseconds."""

    def __init__(self, action: Callable[..., Any]) -> None:
        self._action = action
        self.calls, self.spent = 0, 0.0

    def __call__(self, *args: Any, **inputs: Any) -> Any:
        """Calls it."""
        start = time.perf_counter()
        result = self._action(*args, **inputs)
        self.spent += 1e3 * (time.perf_counter() - start)
        self.calls += 1
        return result


class WatchedCondition(Watched):
    """A condition, watched; its null is not."""

    def __init__(self, condition: Condition) -> None:
        super().__init__(condition)
        self.null = condition.null


class Generation:
    """Motions of one length from sentences; whatever is neither text nor decoder is the denoiser's.

    Where one graph holds all steps and the decoder, nothing is said of the decoder alone.

    Args:
        generator: The model on an engine.
        batch: Motions asked for together.
        seconds: Their length.
        steps: Sampling steps.
    """

    def __init__(self, generator: MotionPipeline, batch: int, seconds: float, steps: int) -> None:
        self._text = WatchedCondition(generator.condition)
        self._decoder = Watched(generator.backend.decoder)
        backend = replace(generator.backend, decoder=self._decoder)
        self._generator = replace(generator, condition=self._text, backend=backend)
        self._frames = [round(seconds * generator.representation.fps)] * batch
        self._steps, self._sentences = steps, sentences()

    def __call__(self) -> Laps:
        """Makes them once."""
        prompts = list(itertools.islice(self._sentences, len(self._frames)))
        self._text.spent = self._decoder.spent = 0.0
        watch = Stopwatch()
        seeds = range(len(prompts))
        features = self._generator.features(prompts, self._frames, seeds, self._steps)
        watch.lap("features")
        for each in features:
            self._generator.representation.decode(each)
        watch.lap("joints")
        return self._split(watch.laps)

    def _split(self, laps: Laps) -> Laps:
        text, decoder = self._text.spent, self._decoder.spent
        rest = {"denoiser": laps["features"] - text - decoder, "joints": laps["joints"]}
        return {"text": text, **rest, **({"decoder": decoder} if self._decoder.calls else {})}


def sentences() -> Iterator[str]:
    """Yields sentences of usual length, all different, over and over."""
    ways = itertools.product(ENDS, SIDES, PACES, DEEDS)
    said = (f"a person {deed} {pace} {side} and {end}" for end, side, pace, deed in ways)
    return itertools.cycle(said)


DEEDS = ("walks", "runs", "jumps", "kicks", "turns", "steps", "dances", "jogs", "punches", "squats")
PACES = ("slowly", "quickly", "carefully", "fast")
SIDES = ("forward", "backwards", "to the left", "to the right", "in a circle")
ENDS = ("stops", "turns around", "sits down", "jumps", "waves", "runs", "squats", "walks back")
