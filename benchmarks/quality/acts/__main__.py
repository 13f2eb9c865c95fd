"""Draws acts for a judge and counts the verdicts.

    python -m benchmarks.quality.acts draw fast OUT --per-stratum 20
    python -m benchmarks.quality.acts draw recordings OUT --per-stratum 20
    python -m benchmarks.quality.acts reveal OUT.key.tsv NAMES.tsv VERDICTS.tsv
    python -m benchmarks.quality.acts table VERDICTS.tsv

1. `draw` makes motions by the command's default path and writes sheets without prompts into OUT,
   in random order, and what was asked into OUT.key.tsv. Instead of a model's motions, recordings
   of the acts: what a judge can recognize at best.
2. A judge who has seen neither prompts nor key names each motion: NAMES.tsv, with the columns
   number and named.
3. `reveal` puts both together. The judge compares the name with the prompt and fills the column
   verdict: good (whoever asked gets what the prompt says), half (part of it, or recognizable with
   the prompt at hand only) or bad.
4. `table` prints shares of good, by how many clips of the training split name the act.

`retrieve fast` needs no judge: ranks of the acts' own clips by the tower of own-clip retrieval.

`count DATA` updates clips and seconds of `acts.tsv`. Verdicts are kept in `verdicts/`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tyro.conf import Positional

from benchmarks.quality.acts import table
from benchmarks.quality.acts.retrieval import ranks
from benchmarks.quality.acts.sheets import write_sheets
from benchmarks.quality.acts.table import Judged
from benchmarks.quality.default_path import default_motion
from benchmarks.quality.own_clip.__main__ import lines_of
from latentmotion import Motion, MotionPipeline
from latentmotion.data.dataset import Dataset, items_of

RECORDINGS = "recordings"  # In place of a model's name: training clips.


@dataclass(frozen=True)
class Draw:
    """Make motions, sheets and the key."""

    model: Positional[str]  # Name or folder of a model, or `recordings`.
    out: Positional[Path]  # Folder for the sheets; the key is OUT.key.tsv beside it.
    data: Path = Path("data/starter.pack")  # Prepared folder or pack with the recordings.
    per_stratum: int | None = None  # Acts drawn at random of each stratum; by default all.
    prompts: int = 1  # Prompts drawn at random of each act.
    # Each prompt is made with each.
    seeds: Annotated[tuple[int, ...], tyro.conf.arg(aliases=["-s"])] = (0,)
    draw: int = 0  # Seed of what is drawn and of the order.
    best_of: int | None = None  # Takes of each motion; by default as many as the command makes.
    from_clips: bool | None = None  # Passed to the pipeline; by default its own choice.

    def run(self) -> None:
        """Writes all."""
        generator = np.random.default_rng(self.draw)
        asked: list[tuple[table.Act, str, int]] = []
        acts = table.read_acts()
        for stratum in table.STRATA:
            inside = [act for act in acts if act.clips and act.stratum == stratum]
            most = len(inside) if self.per_stratum is None else min(self.per_stratum, len(inside))
            for row in generator.choice(len(inside), most, replace=False):
                chosen = generator.choice(table.PROMPTS, self.prompts, replace=False)
                prompts = [inside[row].prompts[n] for n in chosen]
                asked += [(inside[row], p, s) for p in prompts for s in self.seeds]
        # A warning would name words of the prompts to a judge who looks on.
        warnings.simplefilter("ignore")
        make = self._recorded() if self.model == RECORDINGS else self._generated()
        asked = [asked[row] for row in generator.permutation(len(asked))]
        motions, key = [], []
        for number, (act, prompt, seed) in enumerate(asked):
            motion = make(act, prompt, seed)
            motions.append(motion)
            key.append(Judged(number, act.name, act.clips, prompt, seed, round(motion.seconds, 1)))
        write_sheets(motions, range(len(motions)), self.out)
        table.write_judged(key, self.out.with_name(f"{self.out.name}.key.tsv"))
        print(f"{len(motions)} motions of {len({a.name for a, _, _ in asked})} acts in {self.out}")

    def _generated(self) -> Callable[[table.Act, str, int], Motion]:
        """Returns what makes a motion of a prompt."""
        pipeline = MotionPipeline.from_pretrained(self.model)
        settings: dict[str, Any] = {}
        if self.from_clips is not None:
            settings["from_clips"] = self.from_clips
        return lambda _, prompt, seed: default_motion(
            pipeline, prompt, seed, self.best_of, **settings
        )

    def _recorded(self) -> Callable[[table.Act, str, int], Motion]:
        """Returns what draws a training clip of an act; of several the seed takes turns."""
        dataset = Dataset.load(self.data)
        space = dataset.representation
        items = items_of(dataset.clips("train"))
        texts = [" | ".join(item.captions).lower() for item in items]

        def make(act: table.Act, prompt: str, seed: int) -> Motion:
            of_act = [
                i for i, text in zip(items, texts, strict=True) if re.search(act.captions, text)
            ]
            item = of_act[np.random.default_rng(seed).integers(len(of_act))]
            features = dataset.features(item.clip)[item.start : item.start + item.frames]
            joints = space.decode(features).astype(np.float32)
            return Motion(joints, space.fps, space.skeleton, prompt)

        return make


@dataclass(frozen=True)
class Reveal:
    """Put a judge's names beside what was asked."""

    key: Positional[Path]  # What `draw` wrote.
    names: Positional[Path]  # Columns number and named.
    verdicts: Positional[Path]  # File to write, whose column verdict the judge fills.

    def run(self) -> None:
        """Writes the table."""
        named = {int(row["number"]): row["named"] for row in table.rows_of(self.names)}
        key = table.read_judged(self.key)
        missing = [each.number for each in key if not named.get(each.number)]
        if missing:
            raise SystemExit(f"{self.names} names no {missing}: name all before the key is opened")
        judged = [replace(each, named=named[each.number]) for each in key]
        table.write_judged(judged, self.verdicts)


@dataclass(frozen=True)
class Table:
    """Print the verdicts by stratum."""

    verdicts: Positional[tuple[Path, ...]]  # Files that `reveal` wrote and a judge filled.

    def run(self) -> None:
        """Prints."""
        print(table.report([each for path in self.verdicts for each in table.read_judged(path)]))


@dataclass(frozen=True)
class Retrieve:
    """Print how far up clips of the act are that a prompt asks for."""

    model: Positional[str] = "fast"  # Name or folder of a model.
    data: Path = Path("data/starter.pack")  # Prepared folder or pack with the clips.
    from_clips: bool = True  # Passed to the pipeline.
    seed: int = 0  # Seed of clips and noise.

    def run(self) -> None:
        """Prints."""
        warnings.simplefilter("ignore")
        by_stratum = ranks(self.model, self.data, self.seed, self.from_clips)
        every = [rank for each in by_stratum.values() for rank in each]
        strata = np.repeat([*by_stratum], [len(each) for each in by_stratum.values()])
        print("| motions | clips of the act | prompts | median rank | first | in ten |")
        print("|---" * 6 + "|")
        print("\n".join(lines_of(self.model, np.array(every), strata, tuple(table.STRATA))))


@dataclass(frozen=True)
class Count:
    """Count clips and seconds of the acts anew."""

    data: Positional[Path]  # Prepared folder or pack.

    def run(self) -> None:
        """Updates the table."""
        acts = table.counted(table.read_acts(), self.data)
        table.write_acts(acts)
        for stratum in table.STRATA:
            print(f"{stratum}: {sum(bool(a.clips) and a.stratum == stratum for a in acts)} acts")


if __name__ == "__main__":
    tyro.cli(Draw | Reveal | Table | Retrieve | Count).run()
