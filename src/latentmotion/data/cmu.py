"""CMU's motion capture with HumanML3D's captions: trials on disk → cut, captioned recordings.

A trial is `SS_TT.amc` beside `SS.asf`, or `SS_TT.bvh`, anywhere below a folder. HumanML3D's index
cuts it at 20 fps: every (native/20)-th frame, then `start:end`. The BVH conversions put a T-pose
before the motion; without that frame they align with the index.
"""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.animation import Animation
from latentmotion.data.annotations import (
    IndexRow,
    read_index,
    read_splits,
    read_texts,
    sentences_of,
)
from latentmotion.data.clip import Source, Split
from latentmotion.data.cmu_rates import native_fps
from latentmotion.data.finding import files_below
from latentmotion.data.recording import Dropped, Label, Recording
from latentmotion.data.resampling import every, joints_at
from latentmotion.data.t_pose import without_blend
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.formats.bvh import read_bvh

CMU = Source(
    name="cmu",
    license=(
        "free for all uses; the data itself may not be resold, even converted; "
        "captions: HumanML3D, MIT, (c) 2022 Chuan Guo"
    ),
    credit=(
        "The data used in this project was obtained from mocap.cs.cmu.edu. The database was "
        "created with funding from NSF EIA-0196217."
    ),
    url="http://mocap.cs.cmu.edu",
)

FPS = 20
LONGEST = 200
"""Frames of the longest piece without captions, HumanML3D's own limit."""
SHORTEST = 40
"""Frames of the shortest piece without captions."""

_TRIAL = re.compile(r"(\d+_\d+)", re.ASCII)
_HUMANML3D_PATH = re.compile(r"/CMU/(?P<folder>[^/]+)/(?P<trial>\d+_\d+)_poses\.npy$")


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
            rates=_read_rates(rates) if rates else {},
            rows=rows_by_trial(humanml3d),
            splits=read_splits(humanml3d),
            texts=read_texts(humanml3d),
        )

    @property
    def missing(self) -> int:
        """Number of HumanML3D's CMU clips whose trial is not on disk."""
        return sum(len(rows) for trial, rows in self.rows.items() if trial not in self.paths)

    def recordings(self, uncaptioned: bool = False) -> Iterator[Recording | Dropped]:
        """Yields every clip that the index cuts from a trial on disk.

        Args:
            uncaptioned: Whether to yield also what the index leaves of each trial, in pieces
                without captions for training; never of a trial with a clip of val or test.
        """
        for trial in sorted(self.paths):
            rows = self.rows.get(trial, ())
            if not rows and not uncaptioned:
                continue
            try:
                joints = self._joints(trial)
            except (FileFormatError, DataError) as error:
                yield Dropped(trial, "clip", str(error))
                continue
            for row in rows:
                yield self._cut(trial, row, joints)
            if uncaptioned and all(self.splits.get(row.id, "train") == "train" for row in rows):
                yield from _pieces(trial, rows, joints)

    def _joints(self, trial: str) -> Float[np.ndarray, "frames joints 3"]:
        path = self.paths[trial]
        animation, native = read_trial(path), self.rates.get(trial, native_fps(trial))
        joints = joints_at(animation, FPS, native)
        return joints if path.suffix.lower() == ".amc" else without_blend(joints, native, FPS)

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
            split=self.splits[row.id],
            sentences=sentences_of(self.texts, row.id),
            mirrored_sentences=sentences_of(self.texts, f"M{row.id}"),
        )
        return Recording(label, joints[row.start : end])


def find_trials(folder: Path) -> dict[str, Path]:
    """Returns the file of each CMU trial below a folder; AMC where there is BVH as well.

    Raises:
        DataError: There is no such folder, or no trial in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold CMU trials, from {CMU.url}")
    found = {}
    for ending in (".bvh", ".amc"):
        for path in files_below(folder, [ending]):
            if match := _TRIAL.match(path.stem):
                found[_without_zeros(match[1])] = path
    if not found:
        raise DataError(
            f"{folder}: expected CMU trials (SS_TT.amc with SS.asf, or SS_TT.bvh), found none; "
            f"get them from {CMU.url}"
        )
    return found


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


def read_trial(path: Path) -> Animation:
    """Reads a trial, without the T-pose that the BVH conversions begin with."""
    if path.suffix.lower() == ".amc":
        return read_asf_amc(path)
    return every(read_bvh(path), step=1, start=1)


def _without_zeros(trial: str) -> str:
    """`005_08` and `5_8` are `05_08`."""
    subject, number = (int(part) for part in trial.split("_"))
    return f"{subject:02d}_{number:02d}"


def _pieces(
    trial: str, rows: Sequence[IndexRow], joints: Float[np.ndarray, "frames joints 3"]
) -> Iterator[Recording]:
    for start, end in _gaps(rows, len(joints)):
        count = math.ceil((end - start) / LONGEST)
        bounds = np.linspace(start, end, count + 1).astype(int).tolist()
        for first, last in pairwise(bounds):
            label = Label(
                id=f"cmu-{trial}-{first:05d}",
                source=CMU.name,
                origin=f"{trial}[{first}:{last}]",
                split="train",
            )
            yield Recording(label, joints[first:last])


def _gaps(rows: Sequence[IndexRow], frames: int) -> Iterator[tuple[int, int]]:
    """Yields what the rows leave of a trial and is long enough."""
    start = 0
    spans = sorted((row.start, frames if row.end < 0 else row.end) for row in rows)
    for first, last in [*spans, (frames, frames)]:
        if first - start >= SHORTEST:
            yield start, first
        start = max(start, last)


def _read_rates(path: Path) -> dict[str, float]:
    expected = 'expected frames per second by trial, such as {"05_18": 120}'
    try:
        rates = json.loads(path.read_text(encoding="utf-8"))
        return {trial: _rate(rate) for trial, rate in rates.items()}
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}; {expected}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: {expected}, found something else ({error})") from error


def _rate(rate: float) -> float:
    if isinstance(rate, bool) or not 1 <= rate <= 1000:
        raise ValueError(f"a rate of {rate}")
    return float(rate)
