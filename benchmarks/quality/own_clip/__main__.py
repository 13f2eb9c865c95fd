"""Own-clip retrieval: how far up a caption's own clip is among 240, judged by a tower of its own.

    python -m benchmarks.quality.own_clip fast
    python -m benchmarks.quality.own_clip my_model --best-of 4 --from-clips

Captions of training and of test clips, that the tower was not trained on, are generated at their
own clip's length. All 240 clips of a split are ordered by the cosine of their vector to that of the
motion; the rank of the caption's own clip is 1 at best. Strata are by how many training clips name
the caption's rarest content word, a quarter of the captions from each as far as they go. The row
"real" asks with the last 85 % of the clip itself: what the tower can tell apart at all.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from benchmarks.quality.default_path import default_motion
from benchmarks.quality.own_clip.tower import LONGEST, Tower
from benchmarks.quality.own_clip.words import clips_naming, is_trained_on, rarest
from latentmotion import Motion, MotionPipeline
from latentmotion.data.dataset import Dataset, items_of
from latentmotion.progress import counted
from latentmotion.storage.files import atomic_file

# Training clips that name the rarest content word: lowest and highest.
STRATA = {"< 10": (0, 9), "10 to 50": (10, 50), "50 to 300": (51, 300), "more": (301, 10**9)}

SHORTEST = 30  # Frames of the shortest clip.

# Model, caption, seconds and seed to a motion.
Source = Callable[[MotionPipeline, str, float, int], Motion]


@dataclass(frozen=True)
class OwnClip:
    """Settings."""

    model: tyro.conf.Positional[str] = "fast"  # Name or folder of a model.
    data: Path = Path("data/starter.pack")  # Prepared folder or pack.
    clips: int = 240  # Clips of each split.
    splits: tuple[str, ...] = ("train", "test")  # Which splits.
    best_of: int = 1  # Takes, of which the best is asked with; 4 is what the command makes.
    from_clips: bool | None = None  # Passed to the pipeline; by default its own choice.
    # MODULE:FUNCTION instead, from pipeline, caption, seconds and seed to a motion.
    source: str | None = None
    seed: int = 0  # Seed of clips and noise.
    # File for caption, stratum and rank of each motion.
    json: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None


@dataclass(frozen=True)
class Asked:
    """A caption with its clip."""

    clip: str
    caption: str
    stratum: str
    start: int
    frames: int


def asked_of(dataset: Dataset, split: str, clips: int, seed: int) -> list[Asked]:
    """Draws captions of different clips, evenly from the strata as far as they go."""
    counts = clips_naming(dataset.clips("train"))
    by_stratum: dict[str, list[Asked]] = {name: [] for name in STRATA}
    for item in items_of(dataset.clips(split)):
        for caption in item.captions:
            if item.frames < SHORTEST or is_trained_on(caption):
                continue
            number = rarest(caption, counts)
            stratum = next(name for name, (low, high) in STRATA.items() if low <= number <= high)
            frames = min(item.frames, LONGEST - 4) // 4 * 4
            by_stratum[stratum].append(Asked(item.clip.id, caption, stratum, item.start, frames))
    generator = np.random.default_rng([seed, len(split)])
    chosen: dict[str, Asked] = {}
    for number, stratum in enumerate(sorted(by_stratum, key=lambda name: len(by_stratum[name]))):
        most = (clips - len(chosen)) // (len(STRATA) - number)
        for row in generator.permutation(len(by_stratum[stratum])):
            if not most:
                break
            one = by_stratum[stratum][row]
            if one.clip not in chosen:
                chosen[one.clip], most = one, most - 1
    return list(chosen.values())


def ranks_of(
    queries: Sequence[np.ndarray], gallery: Sequence[np.ndarray], tower: Tower
) -> np.ndarray:
    """Returns the rank of each query's own clip, which has its place in the gallery."""
    scores = tower.embed(queries) @ tower.embed(gallery).T
    return 1 + (scores > np.diag(scores)[:, None]).sum(axis=1)


def lines_of(
    name: str, ranks: np.ndarray, strata: np.ndarray, names: tuple[str, ...] = tuple(STRATA)
) -> list[str]:
    """Returns a line for each stratum: median rank, first, in ten, with bootstrapped intervals."""
    lines = []
    for stratum in (*names, "all"):
        chosen = ranks if stratum == "all" else ranks[strata == stratum]
        if not len(chosen):
            continue
        drawn = np.random.default_rng(0).choice(chosen, (2000, len(chosen)))
        cells = [name, stratum, len(chosen)]
        for figure, unit in ((np.median, 1), (_first, 100), (_in_ten, 100)):
            low, high = np.percentile(figure(drawn, axis=1) * unit, (2.5, 97.5))
            sign = " %" if unit == 100 else ""
            cells.append(f"{figure(chosen, axis=0) * unit:.0f}{sign} ({low:.0f} to {high:.0f})")
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def _first(ranks: np.ndarray, axis: int) -> np.ndarray:
    return (ranks == 1).mean(axis=axis)


def _in_ten(ranks: np.ndarray, axis: int) -> np.ndarray:
    return (ranks <= 10).mean(axis=axis)


def source_of(settings: OwnClip) -> Source:
    """Returns what makes the motions."""
    if settings.source:
        module, _, function = settings.source.partition(":")
        return getattr(import_module(module), function)
    extra: dict[str, Any] = {}
    if settings.from_clips is not None:
        extra["from_clips"] = settings.from_clips
    return lambda pipeline, caption, seconds, seed: default_motion(
        pipeline, caption, seed, settings.best_of, seconds=seconds, **extra
    )


def main(settings: OwnClip) -> None:
    """Prints the table."""
    warnings.simplefilter("ignore")
    dataset, tower = Dataset.load(settings.data), Tower.load()
    pipeline = MotionPipeline.from_pretrained(settings.model)
    make, fps = source_of(settings), dataset.representation.fps
    print("| motions | rarest word's clips | captions | median rank | first | in ten |")
    print("|---" * 6 + "|")
    kept = []
    for split in settings.splits:
        asked = asked_of(dataset, split, settings.clips, settings.seed)
        clips = {clip.id: clip for clip in dataset.clips(split)}
        real = [dataset.features(clips[a.clip])[a.start : a.start + a.frames] for a in asked]
        made = []
        for number, one in enumerate(counted(asked, f"captions of {split} clips")):
            seconds = one.frames / fps
            motion = make(pipeline, one.caption, seconds, 1000 * settings.seed + number)
            made.append(dataset.representation.encode(motion.joints.astype(np.float64)))
        strata = np.array([one.stratum for one in asked])
        ranks = ranks_of(made, real, tower)
        print("\n".join(lines_of(f"{split}, {settings.model}", ranks, strata)))
        cut = [features[len(features) * 15 // 100 :] for features in real]
        print("\n".join(lines_of(f"{split}, real", ranks_of(cut, real, tower), strata)))
        sys.stdout.flush()
        for one, rank in zip(asked, ranks.tolist(), strict=True):
            kept.append({"split": split, **asdict(one), "rank": rank})
    if settings.json:
        with atomic_file(settings.json) as temporary:
            temporary.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(tyro.cli(OwnClip))
