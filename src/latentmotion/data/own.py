"""Your own motion capture: BVH, AMC or NPZ files with captions beside them, in a CSV, or labels.

    walk.bvh + walk.txt     one sentence a line; HumanML3D's `sentence#tokens#from#to` works too
    captions.csv            columns file, caption; also: from, to (seconds), split, action
    LABEL/take.bvh          where folders are labels: each file is of that action
    test/LABEL/take.bvh     and of that split, if the first folder is train, val or test

Each file becomes one clip. Mirrored copies get the same sentences with left and right swapped.
"""

from __future__ import annotations

import csv
import hashlib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.captions import (
    TaggedSentence,
    mirror_sentence,
    mirror_words,
    parse_sentences,
)
from latentmotion.data.clip import SPLITS, Source, Split
from latentmotion.data.finding import files_below
from latentmotion.data.recording import Dropped, Label, Recording
from latentmotion.data.resampling import interpolate, joints_at, whole_step
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats import npz
from latentmotion.formats.asf_amc import find_asf, read_asf_amc
from latentmotion.formats.bvh import read_bvh
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.humanoid import JointMap
from latentmotion.kinematics.skeleton import HUMANML3D

ENDINGS = (".bvh", ".amc", ".npz")
FPS = 20

_NEEDED, _OPTIONAL = ("file", "caption"), ("from", "to", "split", "action")


@dataclass
class _Known:
    """What a CSV says about one file."""

    sentences: list[TaggedSentence] = field(default_factory=list)
    split: Split | None = None
    action: str | None = None


@dataclass(frozen=True)
class OwnMotions:
    """A folder of motion files and how to read them."""

    folder: Path
    """Where the files lie, in any nesting."""
    source: Source
    """What to write down about where they come from."""
    captions: Path | None = None
    """A CSV; without it captions are taken from `.txt` files beside the motions."""
    fps: float | None = None
    """Native frame rate where files say it wrongly or, as AMC, not at all."""
    unit: str = "centimeters"
    """Unit of length of BVH files."""
    joint_map: JointMap | None = None
    """Where HumanML3D's joints are found; by default found by the skeleton's names."""
    val: float = 0.05
    """Part of the files that goes to the val split, where the CSV does not say."""
    test: float = 0.05
    """Part of the files that goes to the test split, where the CSV does not say."""
    labelled: bool = False
    """Whether the name of the folder that a file lies in is its action."""

    def recordings(self) -> Iterator[Recording | Dropped]:
        """Yields every motion file.

        Raises:
            DataError: There is no such folder, no motion file in it, or the CSV cannot be used.
        """
        paths = find_motions(self.folder)
        known = _read_csv(self.captions) if self.captions else {}
        yield from self._strangers(paths, known)
        for name, path in paths.items():
            try:
                yield self._recording(name, path, known.get(name))
            except (FileFormatError, DataError) as error:
                yield Dropped(name, "clip", str(error))

    def _strangers(
        self, paths: Mapping[str, Path], known: Mapping[str, _Known]
    ) -> Iterator[Dropped]:
        for name, about in known.items():
            if name not in paths:
                for sentence in about.sentences:
                    reason = f"{self.captions} names a file that is not there: {sentence.text}"
                    yield Dropped(name, "caption", reason)

    def _recording(self, name: str, path: Path, known: _Known | None) -> Recording:
        known = known or self._unlisted(path)
        label = Label(
            id=name.replace("/", "-"),
            source=self.source.name,
            origin=f"{name}{path.suffix}",
            split=known.split or self._split(name),
            sentences=tuple(known.sentences),
            mirrored_sentences=tuple(map(mirror_sentence, known.sentences)),
            action=known.action,
            mirrored_action=mirror_words(known.action) if known.action else None,
        )
        return Recording(label, self._joints(path))

    def _unlisted(self, path: Path) -> _Known:
        """Returns what a file's place and the sentences beside it say."""
        sentences = list(_beside(path))
        if not self.labelled:
            return _Known(sentences)
        above = path.relative_to(self.folder).parts[:-1]
        split: Split | None = next((s for s in SPLITS if above[:1] == (s,)), None)
        folders = above[1:] if split else above
        if not folders:
            raise DataError("lies in no folder whose name is its action")
        return _Known(sentences, split, folders[-1])

    def _joints(self, path: Path) -> Float[np.ndarray, "frames joints 3"]:
        ending = path.suffix.lower()
        if ending == ".npz":
            return _joints_of_npz(path, self.fps)
        animation = read_bvh(path, self.unit) if ending == ".bvh" else self._read_amc(path)
        return joints_at(animation, FPS, self.fps or animation.fps, self.joint_map)

    def _read_amc(self, path: Path) -> Animation:
        """Reads a motion whose skeleton lies beside it or at the top."""
        beside = any(other.suffix.lower() == ".asf" for other in path.parent.iterdir())
        return read_asf_amc(path, find_asf(path if beside else self.folder / path.name))

    def _split(self, name: str) -> Split:
        """Draws by hash, so that more files never move a file to another split."""
        part = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big") / 2**32
        if part < self.val:
            return "val"
        return "test" if part < self.val + self.test else "train"


def find_motions(folder: Path) -> dict[str, Path]:
    """Returns the motion files below a folder by their path in it, without ending.

    Raises:
        DataError: There is no such folder, or no motion file in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold your motion files")
    paths = files_below(folder, ENDINGS)
    if not paths:
        raise DataError(f"{folder}: expected motion files ({', '.join(ENDINGS)}), found none")
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in paths}


def _joints_of_npz(path: Path, fps: float | None) -> Float[np.ndarray, "frames joints 3"]:
    motions = npz.read(path)
    if len(motions) != 1 or motions[0].skeleton.names[: len(HUMANML3D)] != HUMANML3D.names:
        found = f"{len(motions)} takes of {motions[0].skeleton.name!r}"
        raise FileFormatError(path, f"{found}, expected one of HumanML3D's {len(HUMANML3D)} joints")
    joints, rate = motions[0].joints[:, : len(HUMANML3D)], fps or motions[0].fps
    step = whole_step(FPS, rate)
    return joints[::step] if step else interpolate(joints, rate / FPS)


def _beside(path: Path) -> tuple[TaggedSentence, ...]:
    texts = path.with_suffix(".txt")
    return parse_sentences(texts.read_text(encoding="utf-8")) if texts.is_file() else ()


def _read_csv(path: Path) -> dict[str, _Known]:
    if not path.is_file():
        raise DataError(f"no file {path}; expected a CSV with the columns {', '.join(_NEEDED)}")
    known: dict[str, _Known] = defaultdict(_Known)
    with path.open(newline="", encoding="utf-8-sig") as file:
        table = csv.DictReader(file)
        missing = [name for name in _NEEDED if name not in (table.fieldnames or ())]
        if missing:
            raise DataError(
                f"{path}: lacks the column {', '.join(missing)}; found "
                f"{', '.join(table.fieldnames or ()) or 'nothing'}; expected "
                f"{', '.join(_NEEDED)} and, if you like, {', '.join(_OPTIONAL)}"
            )
        for row in table:
            _learn(known[_name(row["file"] or "")], row, f"{path}:{table.line_num}")
    return dict(known)


def _learn(known: _Known, row: Mapping[str, str | None], where: str) -> None:
    text = (row["caption"] or "").strip()
    if text:
        start, end = (_seconds(row.get(name), where) for name in ("from", "to"))
        known.sentences.append(TaggedSentence(text, "", start, end))
    known.action = (row.get("action") or "").strip() or known.action
    split = (row.get("split") or "").strip()
    if split:
        known.split = _checked_split(split, where)


def _checked_split(text: str, where: str) -> Split:
    for split in SPLITS:
        if text == split:
            return split
    raise DataError(f"{where}: split {text!r}; expected one of {', '.join(SPLITS)}")


def _seconds(text: str | None, where: str) -> float:
    try:
        return float(text) if text and text.strip() else 0.0
    except ValueError as error:
        raise DataError(f"{where}: expected seconds in from and to, found {text!r}") from error


def _name(file: str) -> str:
    path = Path(file.strip())
    return (path.with_suffix("") if path.suffix.lower() in ENDINGS else path).as_posix()
