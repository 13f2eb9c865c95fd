"""An experiment names one of each part, and how both stages are trained.

A run folder keeps it as `experiment.json`, which is read back strictly. `presets.toml` holds those
that are ready to train; a file of settings says how one differs from a preset.

Draws by rarity: sentences with few supporting clips are drawn more often, frequent ones less.

    weight(s) = min(most, (usual / support(s))^power)

Sentences of composed sequences name two acts, which makes them all rare; their weights are scaled
so that no more than a share of the draws are of them.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.data.dataset import Cropping, Item
from latentmotion.data.store import COMPOSED
from latentmotion.diffusion.condition import TaskName, TextConditioning
from latentmotion.errors import InputError, named
from latentmotion.model.config import DenoiserConfig, Sampling, VAEConfig
from latentmotion.networks.vae.interface import VAEObjective
from latentmotion.retrieval.teach import support
from latentmotion.storage.configuration import from_json, read_plain, to_json
from latentmotion.storage.reading import packaged_toml, read_text
from latentmotion.training.denoiser_loss import DenoiserObjective

# Sentences to their pooled embeddings, of any length.
Embed = Callable[[Sequence[str]], Float[np.ndarray, "sentences width"]]

# Sentences that are embedded together.
_AT_ONCE = 512


@dataclass(frozen=True)
class RarityDraws:
    """How strongly draws depend on the support of sentences; the trial in retrieval.md chose it."""

    power: float = 0.0  # 0 draws all items equally often, 1 all movements.
    usual: float = 300.0  # Support of a sentence of weight 1, clips.
    most: float = 12.0  # Highest weight.
    composed: float = 1 / 3  # Largest share of draws that are of composed sequences.

    def weigh(self, items: Sequence[Item], embed: Embed) -> list[Item]:
        """Returns items with weights of their sentences.

        Args:
            items: Recorded and composed ones, mirrored copies too.
            embed: Embeds the sentences.
        """
        if self.power == 0:
            return list(items)
        texts = sorted({caption for item in items for caption in item.captions})
        row = {text: number for number, text in enumerate(texts)}
        parts = [embed(texts[n : n + _AT_ONCE]) for n in range(0, len(texts), _AT_ONCE)]
        vectors = unit(np.concatenate(parts))
        clips: dict[str, set[int]] = {}
        for item in items:
            if item.clip.source != COMPOSED and item.captions:
                name = item.clip.id.removeprefix("M") if item.clip.mirrored else item.clip.id
                clips.setdefault(name, set()).update(row[text] for text in item.captions)
        counts = support(vectors, vectors, [sorted(rows) for rows in clips.values()])
        weights = np.minimum((self.usual / counts.clip(1)) ** self.power, self.most).tolist()
        weighed = [
            replace(item, weights=tuple(weights[row[text]] for text in item.captions))
            for item in items
        ]
        # The weights of composed sequences are scaled down to their share.
        composed = sum(item.weight for item in weighed if item.clip.source == COMPOSED)
        others = sum(item.weight for item in weighed) - composed
        allowed = others * self.composed / (1 - self.composed) if self.composed < 1 else composed
        if composed <= allowed:
            return weighed
        scale = allowed / composed
        return [
            replace(item, weights=tuple(scale * weight for weight in item.weights))
            if item.clip.source == COMPOSED
            else item
            for item in weighed
        ]


# Precision of a network's arithmetic; `auto` is bfloat16 on devices that multiply it, else float32.
Precision = Literal["float32", "bfloat16", "auto"]

# Whether each rank holds all weights or a part of them; `auto` decides by size.
Parallel = Literal["auto", "replicated", "sharded"]


@dataclass(frozen=True)
class TrainingSettings:
    """Optimization of one stage."""

    # Optimizer steps of the whole run; the learning rate falls to zero at the last.
    steps: int = 10_000
    batch_size: int = 32  # Samples of a step, over all ranks.
    learning_rate: float = 1e-3  # The highest learning rate.
    warm_up: int = 100  # Steps in which the learning rate rises from zero.
    # Cosine to zero after the warm-up, or constant.
    schedule: Literal["cosine", "constant"] = "cosine"
    weight_decay: float = 0.01  # AdamW's weight decay.
    # Highest norm of the gradient; None (null in JSON) for no clipping.
    gradient_clip: float | None = 1.0
    ema_decay: float = 0.999  # Decay of the moving average of the weights; 0 for none.
    # Precision of the networks' arithmetic; weights and losses stay in float32.
    precision: Precision = "float32"
    # Under torchrun: each rank holds all weights, or a part; by default as many as fit.
    parallel: Parallel = "auto"
    seed: int = 0  # Seed of weights, batches and noise.
    report_every: int = 50  # Steps between lines of progress and journal.
    validate_every: int = 500  # Steps between validations.
    snapshot_every: int = 200  # Steps between snapshots.
    sample_every: int = 1000  # Steps between picture strips of samples; 0 for none.
    # Number of times that the averaged weights are kept, evenly spread over the training.
    keep: int = 0

    def __post_init__(self) -> None:
        for name in ("steps", "batch_size", "report_every", "validate_every", "snapshot_every"):
            if getattr(self, name) < 1:
                raise InputError(f"training with {name} {getattr(self, name)}: expected 1 or more")

    def kept_percent(self, step: int) -> int | None:
        """Returns the percentage of the training after `step` steps if the weights are kept."""
        due = {round(self.steps * n / self.keep): 100 * n // self.keep for n in range(1, self.keep)}
        return due.get(step)

    def rate(self, step: int) -> float:
        """The learning rate of step number `step`, from 0."""
        rise = min(1.0, (step + 1) / max(self.warm_up, 1))
        if self.schedule == "constant":
            return self.learning_rate * rise
        done = max(0, step - self.warm_up) / max(self.steps - self.warm_up, 1)
        return self.learning_rate * rise * (1 + math.cos(math.pi * min(done, 1.0))) / 2


_OPTIMIZATIONS = packaged_toml(__file__, "optimizations.toml")


def optimization(name: str) -> TrainingSettings:
    """Returns the settings of a training that has no preset, by its name in the table."""
    return from_json(TrainingSettings, _OPTIMIZATIONS[name])


@dataclass(frozen=True)
class LatentSettings:
    """Storage of the first stage's latents for the second."""

    cropping: Cropping = field(default_factory=Cropping)  # Which parts of clips are encoded.
    # Crops kept of each clip, or part of a clip with sentences of its own; 0 encodes fresh crops at
    # every step, as the authors do, which takes most of the time of a step.
    per_item: int = 4
    # Whether the denoiser sees them with mean 0 and deviation 1 per channel.
    normalized: bool = True
    # Whether latents are drawn from the posterior at every step, or are its mean.
    sampled: bool = True


@dataclass(frozen=True)
class Experiment:
    """Everything that decides what a training run yields, but the data."""

    name: str  # Name of the model.
    vae: VAEConfig  # Motion to latents and back.
    vae_objective: VAEObjective  # Loss of stage 1.
    vae_cropping: Cropping  # Which parts of clips stage 1 sees.
    vae_training: TrainingSettings  # Optimization of stage 1.
    latents: LatentSettings  # Latents of stage 1 for stage 2.
    denoiser: DenoiserConfig  # Noise to latents.
    denoiser_objective: DenoiserObjective  # Loss of stage 2.
    denoiser_training: TrainingSettings  # Optimization of stage 2.
    sampling: Sampling  # Sampling settings.
    # Sentence embeddings that the denoiser reads.
    conditioning: TextConditioning = field(default_factory=TextConditioning)
    mirrored: bool = True  # Whether mirrored copies of the clips are trained on too.
    # Condition of the motion: a sentence, the label of an action, or nothing.
    task: TaskName = "text"
    # How often stage 2 sees rare sentences.
    draws: RarityDraws = field(default_factory=RarityDraws)


Settings = TypeVar("Settings")


def with_changes(experiment: Settings, changes: Sequence[str]) -> Settings:
    """Returns an experiment, or settings like it, with some values replaced.

    Args:
        experiment: Settings to change, a frozen dataclass.
        changes: Each `part.key=value` with a JSON value, e.g. `vae_training.steps=1000`.

    Raises:
        InputError: A key is unknown (the nearest is named) or a value is not of its kind.
    """
    data = to_json(experiment)
    for change in changes:
        path, equals, text = change.partition("=")
        if not equals:
            raise InputError(f"{change!r}: expected KEY=VALUE, e.g. vae_training.steps=1000")
        try:
            value = json.loads(text)
        except ValueError:
            value = text
        *parents, key = path.split(".")
        part = data
        for parent in parents:
            # An unknown part is made here, so that reading the whole back can name the nearest.
            part = part.setdefault(parent, {})
            if not isinstance(part, dict):
                raise InputError(f"{path}: {parent} is a plain value and has no {key!r}")
        part[key] = value
    return from_json(type(experiment), data)


def differences(first: Any, second: Any, where: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yields the values in which two experiments, or parts of them, differ: key, first, second."""
    if isinstance(first, dict) and isinstance(second, dict):
        for key in first | second:
            path = f"{where}.{key}" if where else key
            yield from differences(first.get(key), second.get(key), path)
    elif first != second:
        yield where, first, second


def differing_keys(first: Any, second: Any, where: str = "") -> Iterator[str]:
    """Names the values in which two experiments, or parts of them, differ."""
    for key, before, after in differences(first, second, where):
        yield f"{key} ({before!r} → {after!r})"


_TABLE = packaged_toml(__file__, "presets.toml")

PRESETS = tuple(_TABLE)  # Names of the presets.


def preset_named(name: str) -> Experiment:
    """Returns a preset, or what a file of settings says.

    Args:
        name: Name of a preset; or a file that ends with .json or .toml: the settings that differ
            from those of a preset, which it names as `preset` (by default starter). The
            `experiment.json` of a run folder is such a file.

    Raises:
        InputError: There is none of this name; the nearest is named. Or the file cannot be read,
            or does not fit.
    """
    if not name.lower().endswith((".json", ".toml")):
        return _with_base({"name": name, **named("preset", name, _TABLE)})
    path = Path(name)
    if path.suffix.lower() == ".json":
        data = read_plain(path)
    else:
        try:
            data = tomllib.loads(read_text(path))
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{path}: {error}") from error
    if isinstance(data, dict) and isinstance(data.get("experiment"), dict):
        data = data["experiment"]  # of a run folder
    if not isinstance(data, dict):
        raise InputError(f'{path}: expected an object of settings, e.g. {{"mirrored": false}}')
    preset_named(str(data.setdefault("preset", "starter")))  # its errors do not name this file
    try:
        return _with_base(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def with_settings(experiment: Experiment, settings: Mapping[str, Any]) -> Experiment:
    """Returns an experiment with those of nested settings in the place of its own.

    Raises:
        InputError: A key is unknown (the nearest is named) or a value is not of its kind.
    """
    return from_json(Experiment, _changed(to_json(experiment), settings))


def _with_base(data: Mapping[str, Any]) -> Experiment:
    settings = {key: value for key, value in data.items() if key != "preset"}
    if "preset" in data:
        return with_settings(preset_named(str(data["preset"])), settings)
    return from_json(Experiment, _changed({}, settings))


def _changed(before: Any, after: Any) -> Any:
    """Returns settings with those of another object in their place; other kinds replace them."""
    if not isinstance(after, Mapping):
        return None if after == "null" else after  # TOML has no null
    base = dict(before) if isinstance(before, Mapping) else {}
    if after.get("kind", base.get("kind")) != base.get("kind"):
        base = {}
    return base | {key: _changed(base.get(key), value) for key, value in after.items()}
