"""CMU's motion capture with HumanML3D's captions: trials on disk → cut, captioned recordings.

A trial is `SS_TT.amc` beside `SS.asf`, or `SS_TT.bvh`, anywhere below a folder. HumanML3D's index
cuts it at 20 fps: every (native/20)-th frame, then `start:end`. The BVH conversions put a T-pose
before the motion; without that frame they align with the index.

AMC files do not state the native frame rate: it is 120, and 60 for a list of trials.

Six trials have labels of exercises, ten a second, by Fox and Hughes (BSD 2-clause): a file
`mocap6_labels/SS_TT.txt` holds a number for each tenth of a second, from 1, in the order of
`labels.toml`. Where HumanML3D has captions of the same trials, they name the same exercises.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TypeVar

from latentmotion.data import quality, recording
from latentmotion.data.clip import Split, TaggedSentence, mirror_sentence
from latentmotion.data.recording import FPS, Dropped, FileGroup, Label, Recording
from latentmotion.data.segments import pieces, touching
from latentmotion.data.sources import LABELS, OWNERS
from latentmotion.data.sources.humanml3d import (
    IndexRow,
    read_index,
    read_splits,
    read_texts,
    sentences_of,
)
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats import asf_amc, bvh
from latentmotion.kinematics.skeleton import Joints
from latentmotion.progress import counted
from latentmotion.storage.reading import read_text

CMU = OWNERS["cmu"]

Value = TypeVar("Value")

# Native frames per second of most trials, and of those that `labels.toml` lists.
USUAL_RATE, SLOW_RATE = 120.0, 60.0

# Rate that conversions to BVH write into the file, whatever the trial's own.
_STATED_RATE = 120.0

SHORTEST = 40  # Frames of the shortest stretch without captions that is used.

_TRIAL = re.compile(r"(\d+)_(\d+)", re.ASCII)
_HUMANML3D_PATH = re.compile(r"/CMU/(?P<folder>[^/]+)/(?P<trial>\d+_\d+)_poses\.npy$")

_LABEL_FOLDER, _LABEL_RATE = "mocap6_labels", 10


@dataclass(frozen=True)
class CmuTrials:
    """CMU trials on disk and HumanML3D's annotations of them."""

    paths: Mapping[str, Path]  # File of each trial, by name (`05_18`).
    # HumanML3D's clips of each trial, also of trials that are not on disk.
    rows: Mapping[str, Sequence[IndexRow]]
    splits: Mapping[str, Split]  # Split of each id.
    texts: Mapping[str, str]  # Caption file of each id.
    # Labeled stretches of a few trials: first frame, one past the last, what the person does.
    exercises: Mapping[str, Sequence[tuple[int, int, str]]]

    @classmethod
    def load(cls, trials: Path, humanml3d: Path) -> CmuTrials:
        """Finds the trials below a folder and reads HumanML3D's captions.

        Args:
            trials: Folder of AMC and ASF files, BVH files, or both; any nesting.
            humanml3d: Folder of captions, splits and index.

        Raises:
            DataError: A folder or file is missing or wrong.
        """
        return cls(
            paths=find_trials(trials),
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
            uncaptioned: Whether to yield also the rest of each trial, in pieces without captions
                for training; never of a trial with a clip of val or test.
        """
        for trial in counted(sorted(self.paths), "trials"):
            rows = self.rows.get(trial, ())
            if not rows and not uncaptioned:
                continue
            try:
                joints = trial_joints(trial, self.paths[trial])
            except (FileFormatError, DataError) as error:
                yield Dropped(trial, "clip", str(error))
                continue
            items = [(row.start, row.end, self._cut(trial, row, joints)) for row in rows]
            if uncaptioned and all(self.splits.get(row.id, "train") == "train" for row in rows):
                items += _uncaptioned(trial, rows, joints, self.exercises.get(trial, ()))
            yield from (item for _, _, item in items)
            clips = [(a, b, item) for a, b, item in items if isinstance(item, Recording)]
            yield from touching(clips)

    def groups(self, size: int | None = None, uncaptioned: bool = False) -> list[FileGroup]:
        """Returns the trials in groups, each with its own annotations only.

        Args:
            size: Trials in a group; by default there is one group.
            uncaptioned: Whether to keep parts without captions, as in `recordings`.
        """
        groups = []
        for trials in recording.in_groups(sorted(self.paths), size):
            rows = _only(self.rows, trials)
            ids = [row.id for of_trial in rows.values() for row in of_trial]
            some = CmuTrials(
                paths=_only(self.paths, trials),
                rows=rows,
                splits=_only(self.splits, ids),
                texts=_only(self.texts, [name for trial in ids for name in (trial, f"M{trial}")]),
                exercises=_only(self.exercises, trials),
            )
            read = partial(some.recordings, uncaptioned)
            groups.append(FileGroup(tuple(some.paths.values()), read))
        return groups

    def _cut(self, trial: str, row: IndexRow, joints: Joints) -> Recording | Dropped:
        """Returns a clip of the index.

        Training is kept apart by recording. HumanML3D cuts 47 recordings into train and test
        clips, some of which even overlap: such train clips become val here, so that test is
        HumanML3D's to the clip.
        """
        end = len(joints) if row.end < 0 else row.end
        if row.id not in self.splits:
            return Dropped(row.id, "clip", "in none of train.txt, val.txt and test.txt")
        # A frame or two of difference is how another tool rounds; more is another recording.
        if end > len(joints) + 2:
            return Dropped(
                row.id, "clip", f"{trial} has {len(joints)} frames at 20 fps, index wants {end}"
            )
        split = self.splits[row.id]
        all_splits = {self.splits.get(other.id, "train") for other in self.rows[trial]}
        label = Label(
            id=row.id,
            source=CMU.name,
            origin=f"{trial}[{row.start}:{end}]",
            split="val" if split == "train" and all_splits != {"train"} else split,
            sentences=sentences_of(self.texts, row.id),
            mirrored_sentences=sentences_of(self.texts, f"M{row.id}"),
        )
        return Recording(label, joints[row.start : end])


def _only(values: Mapping[str, Value], names: Iterable[str]) -> dict[str, Value]:
    return {name: values[name] for name in names if name in values}


def find_trials(folder: Path) -> dict[str, Path]:
    """Returns the file of each CMU trial below a folder; AMC where there is BVH as well.

    `005_08` and `5_8` are `05_08`.

    Raises:
        DataError: There is no such folder, or no trial in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold CMU trials, from {CMU.url}")
    trials = {}
    for ending in (".bvh", ".amc"):
        for path in recording.files_below(folder, [ending]):
            if match := _TRIAL.match(path.stem):
                subject, number = map(int, match.groups())
                trials[f"{subject:02d}_{number:02d}"] = path
    if not trials:
        raise DataError(
            f"{folder}: expected CMU trials (SS_TT.amc with SS.asf, or SS_TT.bvh), found none; "
            f"get them from {CMU.url}"
        )
    return trials


def rows_by_trial(humanml3d: Path) -> dict[str, list[IndexRow]]:
    """Returns HumanML3D's clips of each CMU trial.

    Raises:
        DataError: The index is missing or wrong.
    """
    rows = defaultdict(list)
    for row in read_index(humanml3d):
        if trial := trial_of(row.path):
            rows[trial].append(row)
    return dict(rows)


def trial_of(path: str) -> str | None:
    """Returns CMU's name of the trial behind a path in HumanML3D's index; None if not CMU's.

    Trials of two people are there twice under the first one's number, in folders such as
    `18_19_Justin` and `18_19_rory`; captions such as "is pulled" of "A pulls B" show that Rory is
    the second one, whom CMU numbers 19, 21 and 23.
    """
    match = _HUMANML3D_PATH.search(path)
    if match is None:
        return None
    subject, number = match["trial"].split("_")
    second = "rory" in match["folder"].lower()
    return f"{int(subject) + second:02d}_{number}"


def native_fps(trial: str) -> float:
    """Returns the native frames per second of a trial such as `05_18`."""
    labels = LABELS["cmu"]
    is_slow = int(trial.split("_")[0]) in labels["slow_subjects"]
    is_slow = (is_slow and trial not in labels["fast_trials"]) or trial in labels["slow_trials"]
    return SLOW_RATE if is_slow else USUAL_RATE


def trial_joints(trial: str, path: Path) -> Joints:
    """Reads a trial at 20 frames per second, without a T-pose that a conversion put before it.

    A BVH file is believed if it states another rate than the 120 that all conversions claim.

    Args:
        trial: Name of the trial, such as `05_18`.
        path: File of the trial.

    Raises:
        FileFormatError: The file is damaged.
        DataError: The skeleton is unknown, or the rate too low.
    """
    if path.suffix.lower() == ".amc":
        return recording.joints_at(asf_amc.read_asf_amc(path), FPS, native_fps(trial))
    animation = bvh.read_bvh(path)
    native = native_fps(trial) if animation.fps == _STATED_RATE else animation.fps
    if not quality.begins_with_t_pose(animation):
        return recording.joints_at(animation, FPS, native)
    joints = recording.joints_at(recording.every(animation, step=1, start=1), FPS, native)
    return quality.without_blend(joints, native, FPS) if quality.is_blended(animation) else joints


def read_exercises(folder: Path, fps: int) -> dict[str, list[tuple[int, int, str]]]:
    """Returns the labeled stretches of each trial: first frame, one past the last, the exercise.

    Args:
        folder: Folder in which `mocap6_labels` lies, at any depth.
        fps: Frames per second to count in.

    Raises:
        FileFormatError: A file holds something else.
    """
    texts = {str(number): text for number, text in enumerate(LABELS["cmu"]["exercises"], 1)}
    exercises: dict[str, list[tuple[int, int, str]]] = {}
    for path in recording.files_below(folder, [".txt"]):
        if path.parent.name != _LABEL_FOLDER:
            continue
        labels = read_text(path, "latin-1").split()
        if unknown := sorted(set(labels) - set(texts)):
            raise FileFormatError(path, f"found {unknown[0][:40]!r}, expected numbers from 1 to 12")
        stretches, start = [], 0
        for label, group in groupby(labels):
            end = start + fps // _LABEL_RATE * len(list(group))
            stretches.append((start, end, texts[label]))
            start = end
        exercises[path.stem] = stretches
    return exercises


def _uncaptioned(
    trial: str, rows: Sequence[IndexRow], joints: Joints, exercises: Sequence[tuple[int, int, str]]
) -> Iterator[tuple[int, int, Recording | Dropped]]:
    """Yields what the index leaves of a trial; labels of exercises become sentences."""
    gaps, start = [], 0
    captioned = sorted((row.start, len(joints) if row.end < 0 else row.end) for row in rows)
    for first, last in [*captioned, (len(joints), len(joints))]:
        if first - start >= SHORTEST:
            gaps.append((start, first))
        start = max(start, last)
    spans = list(pieces(joints, FPS, gaps, [start for start, _, _ in exercises]))
    lost = sum(end - start for start, end in gaps) - sum(end - start for start, end in spans)
    if lost:
        reason = quality.find_glitch(joints, FPS) or "shorter than a second"
        yield 0, 0, Dropped(f"cmu-{trial}", "part", f"{lost} uncaptioned frames: {reason}")
    for first, last in spans:
        sentences = tuple(
            TaggedSentence(f"a person {text}.")
            for start, end, text in exercises
            if start - 4 <= first and last <= end + 4
        )
        label = Label(
            id=f"cmu-{trial}-{first:05d}",
            source=CMU.name,
            origin=f"{trial}[{first}:{last}]",
            split="train",
            sentences=sentences,
            mirrored_sentences=tuple(map(mirror_sentence, sentences)),
        )
        yield first, last, Recording(label, joints[first:last])
