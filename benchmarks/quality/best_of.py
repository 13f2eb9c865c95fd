"""Best of N: whether the scorer's choice obeys more often, what feet do, and what search finds.

    python -m benchmarks.quality.best_of takes runs/takes --model fast --takes 8
    python -m benchmarks.quality.best_of obedience runs/takes
    python -m benchmarks.quality.best_of takes runs/drawn --drawn 800
    python -m benchmarks.quality.best_of retrieval --data data/starter
    python -m benchmarks.quality.best_of speed --model fast

Takes are generated for the instruction benchmark's prompts, or for others that are drawn by its
grammar, with their seeds, cleaned and judged by its detectors, which share no network with the
scorer, but signals with its claims; a killed run is resumed. Of 8 takes, "best of
4" is the best of the first four and of the last four.
Beside the scorer stand its parts alone and any take that obeys (an oracle).
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from jaxtyping import Bool, Float

from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup import CleanUp
from latentmotion.data.dataset import Dataset
from latentmotion.data.instructions import GROUPS, Instruction, instructions
from latentmotion.evaluation.instructions.benchmark import OVERALL, Share
from latentmotion.kinematics.plausibility import foot_sliding, jitter, penetration
from latentmotion.language.reading import asked_exactly
from latentmotion.measure.scene import describe
from latentmotion.pipeline import cleaned_up
from latentmotion.ranking.best import Take, ranked
from latentmotion.ranking.scorer import Scorer
from latentmotion.training.checking import fulfills
from latentmotion.training.drawn_instructions import drawn_instructions

SEED = 77  # What draws prompts.

Choose = Callable[[Sequence[Take]], Take]  # Which of some takes is kept.


@dataclass(frozen=True, eq=False)
class Judged:
    """The takes of a prompt."""

    instruction: Instruction  # The prompt.
    fulfilled: Bool[np.ndarray, " takes"]  # Whether each fulfills it, cleaned.
    takes: tuple[Take, ...]  # The scored takes, as they were generated.
    feet: Float[np.ndarray, "takes 3"]  # Sliding, penetration and jerk of each, cleaned.


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", choices=["takes", "obedience", "retrieval", "speed"])
    parser.add_argument("folder", nargs="?", type=Path, help="of takes")
    parser.add_argument("--model", default="fast")
    parser.add_argument("--takes", type=int, default=8)
    parser.add_argument("--data", type=Path, help="prepared data, for retrieval")
    parser.add_argument("--scorer", type=Path)
    parser.add_argument("--turns", type=int, default=15)
    parser.add_argument("--drawn", type=int, default=0, help="prompts drawn, not the benchmark's")
    options = parser.parse_args()
    if options.table in ("takes", "obedience") and options.folder is None:
        parser.error("name a folder of takes")
    if options.table == "retrieval" and options.data is None:
        parser.error("name prepared data by --data")
    warnings.simplefilter("ignore")
    prompts = drawn_instructions(options.drawn, SEED) if options.drawn else instructions()
    if options.table == "takes":
        write_takes(options.folder, options.model, options.takes, prompts)
        return
    scorer = Scorer.load(options.scorer)
    if options.table == "obedience":
        lines = obedience_table(read_takes(options.folder, scorer, prompts))
    elif options.table == "retrieval":
        lines = retrieval_table(Dataset.load(options.data), scorer)
    else:
        lines = speed_table(options.model, options.turns, scorer)
    print("\n".join(lines))


def write_takes(folder: Path, name: str, takes: int, prompts: Sequence[Instruction]) -> None:
    """Generates, cleans and judges the takes of every prompt that the folder lacks."""
    folder.mkdir(parents=True, exist_ok=True)
    model = MotionPipeline.from_pretrained(name, threads=1)
    shortest, longest = (frames / model.representation.fps for frames in model.card.frames)
    for one in prompts:
        path = folder / f"{one.id}.npz"
        if path.exists():
            continue
        seconds = None if one.seconds is None else min(max(one.seconds, shortest), longest)
        raw = model.raw_motions([one.prompt] * takes, seconds, one.seeds(takes))
        cleaned = cleaned_up(raw, CleanUp())
        temporary = folder / f".{one.id}.npz"
        np.savez(
            temporary,
            raw=np.stack([take.motion.joints for take in raw]),
            ok=[fulfills(describe(m.joints.astype(np.float64)), one.check) for m in cleaned],
            phys=[
                [foot_sliding(m.joints, m.fps), penetration(m.joints), jitter(m.joints, m.fps)]
                for m in cleaned
            ],
        )
        temporary.rename(path)


def read_takes(folder: Path, scorer: Scorer, prompts: Sequence[Instruction]) -> list[Judged]:
    """Reads the takes of every prompt and scores them."""
    every = []
    for one in prompts:
        arrays = np.load(folder / f"{one.id}.npz")
        corrections = [asked_exactly(one.prompt, one.seconds is None)] * len(arrays["raw"])
        motions = [Motion(joints, metadata={"seed": n}) for n, joints in enumerate(arrays["raw"])]
        takes = sorted(
            ranked(motions, one.prompt, scorer, CleanUp(), corrections),
            key=lambda take: take.motion.metadata["seed"],
        )
        every.append(Judged(one, arrays["ok"].astype(bool), tuple(takes), arrays["phys"]))
    return every


CHOICES: dict[str, Choose | None] = {
    "score": lambda takes: max(takes, key=lambda take: take.score),
    "without claims": lambda takes: max(takes, key=lambda take: take.score - 2 * take.claims),
    "text alone": lambda takes: max(takes, key=lambda take: take.text),
    "feet and floor alone": lambda takes: max(
        takes, key=lambda take: take.score - take.text - 2 * take.claims
    ),
    "any (oracle)": None,
}


def chosen(one: Judged, of: int, choose: Choose | None) -> list[int]:
    """Returns the take that is kept of every `of` takes; an oracle keeps one that fulfills."""
    kept = []
    for first in range(0, len(one.takes) - of + 1, of):
        rows = range(first, first + of)
        if choose is None:
            kept.append(max(rows, key=lambda row: bool(one.fulfilled[row])))
        else:
            best = choose([one.takes[row] for row in rows])
            kept.append(int(best.motion.metadata["seed"]))
    return kept


def obedience_table(every: Sequence[Judged]) -> list[str]:
    """Returns the shares of prompts fulfilled by group, and the feet of what is kept."""
    most = len(every[0].takes)
    columns = ["one take", *(f"best of {of}" for of in (4, 8) if of <= most), "any of 8 (oracle)"]
    lines = [f"| group | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for group in (*GROUPS, OVERALL):
        rows = [one for one in every if group in (one.instruction.group, OVERALL)]
        ways = [*((of, CHOICES["score"]) for of in (1, 4, 8)), (most, None)]
        cells = [
            str(Share.of([one.fulfilled[chosen(one, *way)].tolist() for one in rows]))
            for way in ways
        ]
        lines.append(f"| {group} | {' | '.join(cells)} |")
    lines += ["", "| choice | obeys, 4 | obeys, 8 | sliding mm/s | penetration mm | jerk m/s³ |"]
    lines.append("|---|---|---|---|---|---|")
    for name, choose in CHOICES.items():
        cells = [
            str(Share.of([one.fulfilled[chosen(one, of, choose)].tolist() for one in every]))
            for of in (4, 8)
        ]
        kept = np.concatenate([one.feet[chosen(one, most, choose)] for one in every]).mean(axis=0)
        cells += [f"{1e3 * kept[0]:.1f}", f"{1e3 * kept[1]:.1f}", f"{kept[2]:.0f}"]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    feet = np.concatenate([one.feet for one in every]).mean(axis=0)
    verdicts = [one.fulfilled.tolist() for one in every]
    lines.append(
        f"| none: every take | {Share.of(verdicts)} | | {1e3 * feet[0]:.1f} | {1e3 * feet[1]:.1f} "
        f"| {feet[2]:.0f} |"
    )
    return [*lines, "", *paired(every)]


def paired(every: Sequence[Judged]) -> list[str]:
    """Returns the gain over the mean take with a 95 % interval over prompts."""
    lines, generator = [], np.random.default_rng(0)
    for of in (4, 8):
        gains = np.array(
            [
                one.fulfilled[chosen(one, of, CHOICES["score"])].mean() - one.fulfilled.mean()
                for one in every
            ]
        )
        draws = generator.integers(len(gains), size=(2000, len(gains)))
        low, high = np.percentile(gains[draws].mean(axis=1), [2.5, 97.5])
        lines.append(
            f"best of {of} less every take: {100 * gains.mean():+.1f} points "
            f"({100 * low:+.1f} to {100 * high:+.1f}, bootstrap over prompts)"
        )
    mixed = [one for one in every if 0 < one.fulfilled.sum() < len(one.fulfilled)]
    wins = []
    for one in mixed:
        text = np.array([take.text for take in one.takes])
        wins.append(float((text[one.fulfilled][:, None] > text[~one.fulfilled]).mean()))
    lines.append(
        f"of two takes of a prompt, one of which obeys, text alone prefers it in "
        f"{100 * np.mean(wins):.0f} % ({len(mixed)} prompts)"
    )
    return lines


def retrieval_table(data: Dataset, scorer: Scorer) -> list[str]:
    """Returns how often a test clip is among the nearest to its captions."""
    lines = ["| split | captions | clips | R@1 | R@5 | R@10 | chance R@1 |", "|---" * 7 + "|"]
    for source in (None, *(one.name for one in data.sources)):
        clips = [
            clip
            for clip in data.clips("test")
            if clip.captions and clip.frames >= 4 and source in (None, clip.source)
        ]
        if not clips:
            continue
        motions = scorer.embed([data.features(clip) for clip in clips])
        pairs = [(n, caption.text) for n, clip in enumerate(clips) for caption in clip.captions]
        near = scorer.texts([text for _, text in pairs]) @ motions.T
        told = np.array(
            [[any(c.text == text for c in clip.captions) for clip in clips] for _, text in pairs]
        )
        best = np.where(told, near, -np.inf).max(axis=1)
        before = ((near > best[:, None]) & ~told).sum(axis=1)
        hits = " | ".join(f"{100 * (before < k).mean():.0f} %" for k in (1, 5, 10))
        chance = f"{100 * told.mean():.1f} %"
        name = source or "all"
        lines.append(f"| test, {name} | {len(pairs)} | {len(clips)} | {hits} | {chance} |")
    return lines


def speed_table(name: str, turns: int, scorer: Scorer) -> list[str]:
    """Returns milliseconds of 4 s motions, one thread: one, eight, and the scoring of eight."""
    model, prompt = MotionPipeline.from_pretrained(name, threads=1), "a person kicks twice"
    laps: dict[str, list[tuple[float, float]]] = {"one": [], "eight": [], "scoring of eight": []}
    takes = model.batch([prompt] * 8, 4.0)
    parts: dict[str, Callable[[], object]] = {
        "one": lambda: model.batch([prompt], 4.0),
        "eight": lambda: model.batch([prompt] * 8, 4.0),
        "scoring of eight": lambda: ranked(takes, prompt, scorer),
    }
    for turn in range(turns + 1):
        for part, run in parts.items():
            wall, spent = time.perf_counter(), time.process_time()
            run()
            lap = 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - spent)
            if turn:
                laps[part].append(lap)
    lines = ["| part | ms, median | ms of processor time, median |", "|---|---|---|"]
    for part, each in laps.items():
        wall, spent = (median(column) for column in zip(*each, strict=True))
        lines.append(f"| {part} | {wall:.0f} | {spent:.0f} |")
    return lines


if __name__ == "__main__":
    main()
