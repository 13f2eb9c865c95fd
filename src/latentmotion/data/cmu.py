"""CMU's motion capture with HumanML3D's captions: trials on disk → cut, captioned recordings.

A trial is `SS_TT.amc` beside `SS.asf`, or `SS_TT.bvh`, anywhere below a folder. HumanML3D's index
cuts it at 20 fps: every (native/20)-th frame, then `start:end`. The BVH conversions put a T-pose
before the motion; without that frame they align with the index.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.annotations import IndexRow, read_splits, read_texts, sentences_of
from latentmotion.data.captions import TaggedSentence, mirror_sentence
from latentmotion.data.clip import Split
from latentmotion.data.cmu_trials import (
    CMU,
    FPS,
    find_trials,
    read_rates,
    rows_by_trial,
    trial_joints,
)
from latentmotion.data.glitches import find_glitch
from latentmotion.data.joining import touching
from latentmotion.data.mocap6 import read_exercises
from latentmotion.data.recording import Dropped, Label, Recording
from latentmotion.data.segments import pieces
from latentmotion.errors import DataError, FileFormatError

SHORTEST = 40
"""Frames of the shortest stretch without captions that is used."""


@dataclass(frozen=True)
class CmuTrials:
    """CMU trials on disk and what HumanML3D says about them."""

    paths: Mapping[str, Path]
    """File of each trial, by name (`05_18`)."""
    rates: Mapping[str, float]
    """Frame rates that differ from the known ones."""
    rows: Mapping[str, Sequence[IndexRow]]
    """HumanML3D's clips of each trial, also of trials that are not on disk."""
    splits: Mapping[str, Split]
    """Split of each id."""
    texts: Mapping[str, str]
    """Caption file of each id."""
    exercises: Mapping[str, Sequence[tuple[int, int, str]]]
    """Labeled stretches of a few trials: first frame, one past the last, what the person does."""

    @classmethod
    def load(cls, trials: Path, humanml3d: Path, rates: Path | None = None) -> CmuTrials:
        """Looks for trials below a folder and reads HumanML3D's captions.

        Args:
            trials: Folder of AMC and ASF files, BVH files, or both; any nesting.
            humanml3d: Folder of captions, splits and index.
            rates: JSON of frames per second by trial; without it the known rates count.

        Raises:
            DataError: A folder or file is missing or wrong.
        """
        return cls(
            paths=find_trials(trials),
            rates=read_rates(rates) if rates else {},
            rows=rows_by_trial(humanml3d),
            splits=read_splits(humanml3d),
            texts=read_texts(humanml3d),
            exercises=read_exercises(trials, FPS),
        )

    @property
    def missing(self) -> int:
        """Number of HumanML3D's CMU clips whose trial is not on disk."""
        return sum(len(rows) for trial, rows in self.rows.items() if trial not in self.paths)

    def recordings(self, uncaptioned: bool = False) -> Iterator[Recording | Dropped]:
        """Yields every clip that the index cuts from a trial on disk.

        Two train clips that touch come also as one, where it is no longer than `LONGEST`.

        Args:
            uncaptioned: Whether to yield also what the index leaves of each trial, in pieces
                without captions for training; never of a trial with a clip of val or test.
        """
        for trial in sorted(self.paths):
            rows = self.rows.get(trial, ())
            if not rows and not uncaptioned:
                continue
            try:
                joints = trial_joints(trial, self.paths[trial], self.rates.get(trial))
            except (FileFormatError, DataError) as error:
                yield Dropped(trial, "clip", str(error))
                continue
            found = [(row.start, row.end, self._cut(trial, row, joints)) for row in rows]
            if uncaptioned and all(self.splits.get(row.id, "train") == "train" for row in rows):
                found += _rest(trial, rows, joints, self.exercises.get(trial, ()))
            yield from (item for _, _, item in found)
            yield from touching([(a, b, it) for a, b, it in found if isinstance(it, Recording)])

    def _cut(
        self, trial: str, row: IndexRow, joints: Float[np.ndarray, "frames joints 3"]
    ) -> Recording | Dropped:
        end = len(joints) if row.end < 0 else row.end
        if row.id not in self.splits:
            return Dropped(row.id, "clip", "in none of train.txt, val.txt and test.txt")
        # A frame or two of difference is how another tool rounds; more is another recording.
        if end > len(joints) + 2:
            return Dropped(
                row.id, "clip", f"{trial} has {len(joints)} frames at 20 fps, index wants {end}"
            )
        label = Label(
            id=row.id,
            source=CMU.name,
            origin=f"{trial}[{row.start}:{end}]",
            split=self._split(trial, row),
            sentences=sentences_of(self.texts, row.id),
            mirrored_sentences=sentences_of(self.texts, f"M{row.id}"),
        )
        return Recording(label, joints[row.start : end])

    def _split(self, trial: str, row: IndexRow) -> Split:
        """Keeps training apart by recording: HumanML3D cuts 47 recordings into both.

        Some of its train clips even overlap a test clip of the same trial; they become val here,
        so that test is HumanML3D's to the clip.
        """
        others = {self.splits.get(other.id, "train") for other in self.rows[trial]}
        split = self.splits[row.id]
        return "val" if split == "train" and others != {"train"} else split


def _rest(
    trial: str,
    rows: Sequence[IndexRow],
    joints: Float[np.ndarray, "frames joints 3"],
    exercises: Sequence[tuple[int, int, str]],
) -> Iterator[tuple[int, int, Recording | Dropped]]:
    """Yields what the rows leave of a trial, with sentences where somebody labeled exercises."""
    gaps = list(_gaps(rows, len(joints)))
    found = list(pieces(joints, FPS, gaps, [start for start, _, _ in exercises]))
    lost = sum(end - start for start, end in gaps) - sum(end - start for start, end in found)
    if lost:
        reason = find_glitch(joints, FPS) or "shorter than a second"
        told = f"{lost} uncaptioned frames: {reason}"
        yield 0, 0, Dropped(f"cmu-{trial}", "part", told)
    for first, last in found:
        done = [t for start, end, t in exercises if start - 4 <= first and last <= end + 4]
        sentences = tuple(TaggedSentence(f"a person {text}.") for text in done)
        label = Label(
            id=f"cmu-{trial}-{first:05d}",
            source=CMU.name,
            origin=f"{trial}[{first}:{last}]",
            split="train",
            sentences=sentences,
            mirrored_sentences=tuple(map(mirror_sentence, sentences)),
        )
        yield first, last, Recording(label, joints[first:last])


def _gaps(rows: Sequence[IndexRow], frames: int) -> Iterator[tuple[int, int]]:
    """Yields what the rows leave of a trial and is long enough."""
    start = 0
    spans = sorted((row.start, frames if row.end < 0 else row.end) for row in rows)
    for first, last in [*spans, (frames, frames)]:
        if first - start >= SHORTEST:
            yield start, first
        start = max(start, last)
