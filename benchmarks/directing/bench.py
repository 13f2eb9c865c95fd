"""Bench: what experiments of directing share, recordings, embeddings, intervals and their page."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.control.direct import sliding_in_contact
from latentmotion.data.dataset import Dataset, items_of
from latentmotion.errors import DataError
from latentmotion.evaluation.metrics import fid
from latentmotion.evaluation.report import table_line
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.ranking.scorer import Scorer
from latentmotion.reproduce.markdown import cell
from latentmotion.storage.configuration import write_json
from latentmotion.storage.files import atomic_file

# Values of a row by column, one per motion: numbers; embeddings (width) for FID; and for ratios,
# `FID / …`, both rows' (2, width) or (2). `CLIP` says of which clip each motion is.
Values = Mapping[str, np.ndarray]

# Key of the clips of a row's motions, where several are of one: the bootstrap draws clips.
CLIP = "clip"

T = TypeVar("T")

Rows = Mapping[str, Values]  # Measured figures, by row.

# Columns that rows of most experiments have; they come last.
USUAL = ("FID", "R@3", "Sliding, cm/s", "Jitter, m/s³")

DRAWS, FID_DRAWS = 1000, 40  # Bootstrap samples of a figure, and of FID.

OTHERS = 31  # Sentences beside the right one among which R@3 ranks.


@dataclass(frozen=True, eq=False)
class Recording:
    """A part of a test clip with a sentence about it."""

    motion: Motion  # From the origin, facing +z.
    text: str  # The sentence.


@dataclass(frozen=True)
class Bench:
    """A model, a data set and the towers that judge motions."""

    generate: MotionPipeline  # The model.
    data: Dataset  # Its test split has the sentences and the real motions.
    towers: Scorer  # Embeds motions and sentences; nothing here is selected by it.
    count: int = 40  # Clips of a row; fewer where motions are long.
    seeds: int = 3  # Motions of each clip, of another seed each.

    def repeated(self, clips: Sequence[T]) -> tuple[list[T], Int[np.ndarray, " motions"]]:
        """Returns each clip once for each seed, and which one it is."""
        numbers = np.repeat(np.arange(len(clips)), self.seeds)
        return [clip for clip in clips for _ in range(self.seeds)], numbers

    def recordings(self, shortest: float = 2.0, longest: float = 4.0) -> list[Recording]:
        """Returns test clips with sentences, each of another recording, in a fixed random order.

        Args:
            shortest: Fewest seconds.
            longest: Seconds after which a clip is cut off.

        Raises:
            DataError: There are none.
        """
        space, found = self.data.representation, dict[str, Recording]()
        items = items_of(self.data.clips("test"))
        for number in np.random.default_rng(0).permutation(len(items)):
            item = items[number]
            trial = item.clip.origin.split("[")[0]
            if not item.captions or item.frames < shortest * space.fps or trial in found:
                continue
            end = min(item.end, item.start + round(longest * space.fps) // 4 * 4)
            features = space.restart(self.data.features(item.clip)[item.start : end])
            joints = space.decode(features.astype(np.float64)).astype(np.float32)
            found[trial] = Recording(Motion(joints, space.fps, space.skeleton), item.captions[0])
            if len(found) == self.count:
                break
        if not found:
            raise DataError(
                f"{self.data.folder}: no clip of {shortest:g} s or more with a sentence in its "
                "test split; take another data set"
            )
        return list(found.values())

    def usual_columns(self, motions: Sequence[Motion], texts: Sequence[str] = ()) -> Values:
        """Returns FID, R@3, sliding and jitter of motions, cleaned or real.

        Args:
            motions: The motions.
            texts: The sentence of each; without them there is no R@3.
        """
        embedded = self.towers.motions(motions)
        found = {"R@3": self.hits(embedded, texts)} if texts else {}
        return {
            "FID": embedded,
            **found,
            "Sliding, cm/s": np.array([100 * sliding_in_contact(motion) for motion in motions]),
            "Jitter, m/s³": np.array([jitter(motion) for motion in motions]),
        }

    def hits(
        self, embedded: Float[np.ndarray, "motions width"], texts: Sequence[str], best: int = 3
    ) -> Bool[np.ndarray, " motions"]:
        """Returns whether the sentence of a motion is among the nearest of 32."""
        sentences, vectors = self._sentences
        own, draw = self.towers.texts(texts), np.random.default_rng(1)
        found = []
        for vector, text, target in zip(embedded, texts, own, strict=True):
            others = [number for number, other in enumerate(sentences) if other != text]
            rivals = vectors[draw.permutation(others)[:OTHERS]]
            found.append(int((rivals @ vector > target @ vector).sum()) < best)
        return np.array(found)

    @cached_property
    def _sentences(self) -> tuple[list[str], Float[np.ndarray, "sentences width"]]:
        """Some sentences of the test split, each once, and their vectors."""
        every = sorted(
            {text for item in items_of(self.data.clips("test")) for text in item.captions}
        )
        drawn = np.random.default_rng(2).permutation(len(every))[:200]
        texts = [every[number] for number in drawn]
        return texts, self.towers.texts(texts)

    @cached_property
    def real(self) -> Float[np.ndarray, "clips width"]:
        """Vectors of real motions: test clips of half a second or more, 4 s of each at most."""
        clips = [clip for clip in self.data.clips("test") if clip.frames >= 12]
        return self.towers.embed([self.data.features(clip)[:80] for clip in clips])

    def figure(
        self, column: str, values: np.ndarray, clips: Int[np.ndarray, " motions"] | None = None
    ) -> list[float | None]:
        """Returns a figure and half of its 95 % interval, by bootstrap over clips.

        Args:
            column: Name of the figure.
            values: One for each motion, or so many for each.
            clips: The clip of each motion; by default another one.
        """
        statistic = self._statistic(column)
        every = np.arange(len(values)) if clips is None else clips
        every = np.repeat(every, len(values) // len(every))
        clip_of = np.unique(every, return_inverse=True)[1]
        count = int(clip_of.max(initial=-1)) + 1
        if count < 2 or not np.isfinite(values.astype(float)).all():
            return [None, None]
        draw, own = np.random.default_rng(3), [np.flatnonzero(clip_of == n) for n in range(count)]
        drawn = []
        for _ in range(FID_DRAWS if column.startswith("FID") else DRAWS):
            chosen = np.concatenate([own[n] for n in draw.integers(count, size=count)])
            drawn.append(statistic(values[chosen]))
        return [statistic(values), 1.96 * float(np.std(drawn))]

    def _statistic(self, column: str) -> Callable[[np.ndarray], float]:
        if column == "FID":
            return lambda values: fid(values, self.real)
        if column.startswith("FID /"):
            return lambda values: fid(values[:, 0], self.real) / fid(values[:, 1], self.real)
        if column.startswith(("Sliding", "R@3")) and " / " in column:
            return lambda values: float(values[:, 0].mean() / max(values[:, 1].mean(), 1e-9))
        if column.endswith("worst"):
            return lambda values: float(values.max())
        if column.endswith("median"):
            return lambda values: float(np.median(values))
        if column == "Correlation":
            return _correlation
        return lambda values: float(values.mean())


def write_results(name: str, title: str, rows: Rows, bench: Bench, folder: Path) -> Path:
    """Writes NAME.json and NAME.md; returns the page."""
    figures = {
        row: {
            column: bench.figure(column, found, values.get(CLIP))
            for column, found in values.items()
            if column != CLIP
        }
        for row, values in rows.items()
    }
    counts = {row: max(map(len, values.values())) for row, values in rows.items()}
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    made = {
        "model": bench.generate.card.name,
        "data": bench.data.fingerprint,
        "towers": bench.towers.card.fingerprint,
        "seeds": f"{bench.seeds}",
        "load": f"{load:.0f}",
    }
    every = dict.fromkeys(column for values in figures.values() for column in values)
    columns = sorted(every, key=lambda column: USUAL.index(column) if column in USUAL else -1)
    lines = [table_line(["", "n", *columns]), table_line(["---", *["--:"] * (len(columns) + 1)])]
    lines += [
        table_line([row, str(counts[row]), *(cell(f[c]) if c in f else "–" for c in columns)])
        for row, f in figures.items()
    ]
    about = ", ".join(f"{key} {value[:12]}" for key, value in made.items())
    note = "± is half of a 95 % interval, by bootstrap over clips."
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / f"{name}.md"
    write_json(page.with_suffix(".json"), {"made": made, "motions": counts, "figures": figures})
    with atomic_file(page) as temporary:
        text = "\n".join([f"### {name}: {title}", "", *lines, "", f"{about}. {note}"]) + "\n"
        temporary.write_text(text, encoding="utf-8")
    return page


def _correlation(values: Float[np.ndarray, "items 2"]) -> float:
    spread = np.cov(values.T)
    return float(spread[0, 1] / max(np.sqrt(spread[0, 0] * spread[1, 1]), 1e-12))


def beside(row: Values, other: Values, name: str, columns: Sequence[str]) -> Values:
    """Returns a row with ratios of its figures to those of the same motions in another.

    Args:
        row: The row.
        other: The other one, motion by motion.
        name: Name of the other one.
        columns: Columns of which there are ratios.
    """
    pairs = {f"{c} / {name}": np.stack([row[c], other[c]], axis=1) for c in columns}
    return {**row, **{key.replace(", cm/s", ""): values for key, values in pairs.items()}}


def jerk(joints: Float[np.ndarray, "frames joints 3"]) -> Float[np.ndarray, " _"]:
    """Returns the third difference of the joint that has the largest (L1), meters a frame³."""
    third = np.abs(np.diff(joints.astype(np.float64), n=3, axis=0)).sum(axis=-1)
    return third.max(axis=-1)


def jitter(motion: Motion) -> float:
    """Returns the mean third difference of joints, meters a second³."""
    third = np.diff(motion.joints.astype(np.float64), n=3, axis=0) * motion.fps**3
    return float(np.linalg.norm(third, axis=-1).mean())


def blended(
    joints: Float[np.ndarray, "frames joints 3"], start: int, end: int
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns joints that go straight from the frame before start to the one at end."""
    made, u = joints.copy(), np.linspace(0, 1, end - start + 2)[1:-1, None, None]
    made[start:end] = (1 - u) * joints[start - 1] + u * joints[min(end, len(joints) - 1)]
    return made
