"""Seoul National University's motion capture: takes named by their files → pieces with sentences.

BVH at 30 frames per second, or AMC beside ASF, on four skeletons that are known by their joints.
Some takes hold two or more people, one file each: they share a split.

Basketball and martial arts takes have labeled spans. A `.lab` file holds blocks of `key:value`
lines between braces: the file, its first and last frame, and what the person does there, in the
annotators' word. The meaning of each word was checked against the motion: `'` is done to the
person (a pass received), players feint to the side that is named, `jd` leaves the floor by a meter
with the body level.

Elsewhere the file's name says what happens. The files were looked at: where a name misled (`box`
is a carton, `huddle` a hurdle, `duck` the bird, `pobok` crawling), the sentence in `snu_names.tsv`
says what is seen; where nothing can be told, there is none. A sentence goes only to pieces that
show what it says (below).

Clips held out for validation and test: fixed lists, so that figures stay comparable.

`splits/val.txt` and `splits/test.txt` name source, clip and frames of joints. HumanML3D and HDM05
have rules of their own, which the lists repeat; takes of Seoul National University are drawn by
hash and cut where the lists say, even if the rules for cutting change.
"""

from __future__ import annotations

import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import groupby
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.data.clip import Split, TaggedSentence, mirror_sentence
from latentmotion.data.quality import find_glitch, without_t_poses
from latentmotion.data.recording import FPS, Dropped, Label, Recording, files_below, joints_at
from latentmotion.data.segments import LONGEST, pieces, touching
from latentmotion.data.sources import LABELS, OWNERS
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats import asf_amc, bvh
from latentmotion.kinematics.skeleton import Joints
from latentmotion.measure.signals import JOINT
from latentmotion.progress import counted
from latentmotion.storage.reading import read_text

SNU = OWNERS["snu"]

STILL = 0.3  # Speed below which nothing moves in a take, not even a hand, m/s.
# Meters by which two files of one take may differ on average; skeletons differ in the head.
SAME = 0.04

# Frames between labeled spans of one group, taken before and after it, and of the shortest one.
GAP, MARGIN, SHORTEST_GROUP = 12, 4, 24

_MOST_ACTIONS = 4

_PERSON = re.compile(r"(?P<take>\w+_\d+_\d+)_\d+$")
_PREFIX = re.compile(r"^(\d__|multi__)?(SSBoxerMan__|hys_|mmk_)?")
_RATE = re.compile(rb":SAMPLES-PER-SECOND\s+(\d+)")


@dataclass(frozen=True)
class LabeledSpan:
    """One labeled stretch of a take."""

    start: int  # First frame.
    end: int  # One past the last frame.
    # What the person does, in the annotators' word, such as `shoot`; `'` means it is done to them.
    action: str

    def resampled(self, ratio: float) -> LabeledSpan:
        """Returns the same stretch at `ratio` times as many frames per second."""
        return LabeledSpan(round(self.start * ratio), round(self.end * ratio), self.action)


@dataclass(frozen=True)
class Group:
    """Labeled stretches that follow each other closely."""

    start: int  # First frame.
    end: int  # One past the last frame.
    actions: tuple[str, ...]  # What the person does, in order.


@dataclass(frozen=True)
class Naming:
    """One kind of file name and its sentences."""

    pattern: re.Pattern[str]  # Pattern of the whole name; its groups fill `{side}` and the like.
    needs: str  # Evidence that a piece must show, as `shows` takes it.
    sentences: tuple[str, ...]  # Captions.


def snu_recordings(folder: Path) -> Iterator[Recording | Dropped]:
    """Yields the pieces of every take below a folder.

    Takes in which nothing moves, or that were there under another name, are dropped.

    Raises:
        DataError: There is no such folder, or no take in it.
    """
    annotations = read_annotations(folder)
    takes_by_length: dict[int, list[tuple[str, Joints]]] = defaultdict(list)
    for path in counted(find_takes(folder), "takes"):
        try:
            if path.suffix.lower() == ".bvh":
                # In inches if it has joints of length 0 called …Dummy.
                inches = b"LeftUpLegDummy" in _head(path, 1 << 14)
                animation = bvh.read_bvh(path, "inches" if inches else "centimeters")
            else:
                rate = _RATE.search(_head(path, 1 << 10))
                animation = asf_amc.read_asf_amc(path, fps=float(rate[1]) if rate else 30.0)
            joints = joints_at(animation, FPS, animation.fps)
            fastest = np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() * FPS
            if fastest < STILL:
                raise DataError(
                    f"nothing moves faster than {fastest:.2g} m/s in {len(joints)} frames"
                )
            for name, other in takes_by_length[len(joints)]:
                if np.abs(joints - other).mean() < SAME:
                    raise DataError(f"the same motion as {name}")
        except (FileFormatError, DataError) as error:
            yield Dropped(path.stem, "clip", str(error))
            continue
        takes_by_length[len(joints)].append((path.stem, joints))
        spans = [span.resampled(FPS / animation.fps) for span in annotations.get(path.stem, ())]
        yield from _pieces_of_take(path, joints, spans)


def find_takes(folder: Path) -> list[Path]:
    """Returns the motion files below a folder whose skeleton is one of the known four.

    Raises:
        DataError: There is no such folder, or no take in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold SNU's takes, from {SNU.url}")
    takes = []
    for path in files_below(folder, [".bvh", ".amc"]):
        if path.suffix.lower() == ".bvh":
            head = _head(path, 1 << 14)
        else:
            head = b"".join(asf.read_bytes() for asf in sorted(path.parent.glob("*.asf")))
        words = set(head.split())
        if {b"LeftToes", b"LeftShoulder1"} <= words or {b"LeftToe", b"Spine2"} <= words:
            takes.append(path)
    if not takes:
        raise DataError(
            f"{folder}: expected BVH or AMC files of SNU's skeletons (LeftToes and LeftShoulder1, "
            f"or LeftToe and Spine2), found none; get them from {SNU.url}"
        )
    return takes


def recording_of(stem: str) -> str:
    """Returns the name of the take that a file is one person of.

    `s_006_1_3` is the third person of `s_006_1`, `multi__hys_box_2` one of two of `box_2`. The
    sessions' numbers go as well: some takes are there twice, under two of them.
    """
    if match := _PERSON.match(stem):
        return match["take"]
    return _PREFIX.sub("", stem)


def sentences_of(actions: Sequence[str]) -> tuple[str, ...]:
    """Returns sentences for actions in this order; none for more than four, or unknown ones."""
    sentences = LABELS["snu"]["actions"]
    phrases = [phrase for phrase, _ in groupby(sentences.get(action, "") for action in actions)]
    if not phrases or "" in phrases or len(phrases) > _MOST_ACTIONS:
        return ()
    text = ", then ".join(phrases)
    return (f"a person {text}.", f"someone {text.replace(', then ', ' and then ')}.")


def sentences_for(name: str, joints: Joints, floor: float, whole: bool) -> tuple[str, ...]:
    """Returns sentences for a piece of a file; none where the name or the piece does not say.

    Args:
        name: The file's name without ending, person and session.
        joints: The piece at 20 frames per second, meters.
        floor: Height of the floor.
        whole: Whether the piece is nearly all of its take.
    """
    for naming in namings():
        if match := naming.pattern.fullmatch(name):
            groups = {key: text or "" for key, text in match.groupdict().items()}
            words = {key: LABELS["snu"]["paces"].get(text, text) for key, text in groups.items()}
            if shows(naming.needs.format(**words), joints, floor, whole):
                # A word that is empty takes its space along.
                filled = (" ".join(text.format(**words).split()) for text in naming.sentences)
                return tuple(text.replace(" .", ".").replace(" ,", ",") for text in filled)
    return ()


@cache
def namings() -> tuple[Naming, ...]:
    """Returns the table, in the order in which its rows are tried."""
    file = resources.files("latentmotion.data").joinpath("snu_names.tsv")
    lines = file.read_text(encoding="utf-8").splitlines()
    rows = [line.split("\t") for line in lines if line and line[0] != "#"]
    return tuple(
        Naming(re.compile(pattern), needs, tuple(sentences.split("|")))
        for pattern, needs, sentences in rows
    )


def grouped(spans: Sequence[LabeledSpan], frames: int) -> list[Group]:
    """Joins spans that are less than `GAP` apart, and widens each group to `SHORTEST_GROUP`.

    Args:
        spans: Stretches at 20 frames per second, in order.
        frames: Length of the take.
    """
    groups: list[Group] = []
    for span in spans:
        last = groups[-1] if groups else None
        if last and span.start - last.end < GAP and span.end - last.start + 2 * MARGIN <= LONGEST:
            groups[-1] = Group(last.start, max(last.end, span.end), (*last.actions, span.action))
        else:
            groups.append(Group(span.start, span.end, (span.action,)))
    widened = []
    for group in groups:
        margin = max(MARGIN, (SHORTEST_GROUP - group.end + group.start + 1) // 2)
        start, end = max(0, group.start - margin), min(frames, group.end + margin)
        widened.append(Group(start, end, group.actions))
    return widened


def read_annotations(folder: Path) -> dict[str, list[LabeledSpan]]:
    """Returns the labeled stretches of each file, by its name without ending, in order.

    Raises:
        FileFormatError: A label file is damaged.
    """
    spans: dict[str, list[LabeledSpan]] = defaultdict(list)
    for path in files_below(folder, [".lab"]):
        if path.parent.name != "annotation":  # The others mark where takes may be joined.
            continue
        text = read_text(path, "latin-1")
        for block in text.split("{")[1:]:
            pairs = (line.partition(":") for line in block.partition("}")[0].splitlines())
            values = {key.strip(): value.strip() for key, _, value in pairs if key.strip()}
            try:
                start, end = int(values["startFrame"]), int(values["endFrame"])
            except (KeyError, ValueError) as error:
                problem = f"expected frames in startFrame and endFrame, found {error}"
                raise FileFormatError(path, problem) from error
            action = values.get("type", "").lower()
            if values.get("include", "").lower() != "false" and action:
                spans[Path(values.get("file", "")).stem].append(LabeledSpan(start, end + 1, action))
    return {name: sorted(file, key=lambda span: span.start) for name, file in spans.items()}


def _head(path: Path, size: int) -> bytes:
    with path.open("rb") as file:
        return file.read(size)


def _pieces_of_take(
    path: Path, joints: Joints, spans: Sequence[LabeledSpan]
) -> Iterator[Recording | Dropped]:
    stretches = without_t_poses(joints)
    groups = {
        (group.start, group.end): group
        for group in grouped(spans, len(joints))
        if any(first <= group.start and group.end <= last for first, last in stretches)
    }
    cuts = [edge for span in groups for edge in span]
    bounds = pieces_of(f"{SNU.name}-{path.stem}") or list(pieces(joints, FPS, stretches, cuts))
    posed_frames = sum(end - start for start, end in stretches)
    lost = posed_frames - sum(end - start for start, end in bounds)
    if posed_frames < len(joints):
        posed = f"{len(joints) - posed_frames} of {len(joints)} frames: calibration pose"
        yield Dropped(path.stem, "part", posed)
    if lost:
        reason = find_glitch(joints, FPS) or "shorter than a second"
        yield Dropped(path.stem, "part", f"{lost} of {len(joints)} frames: {reason}")
    floor, take = floor_of(joints), recording_of(path.stem)
    clips = []
    for first, last in bounds:
        name = f"{SNU.name}-{path.stem}-{first:05d}"
        if last > len(joints):
            reason = f"{len(joints)} frames at 20 fps, the list of held-out clips wants {last}"
            yield Dropped(name, "clip", reason)
            continue
        piece = joints[first:last]
        if group := groups.get((first, last)):
            texts = sentences_of(group.actions)
        else:
            texts = sentences_for(take, piece, floor, whole=last - first > 0.8 * posed_frames)
        sentences = tuple(map(TaggedSentence, texts))
        label = Label(
            id=name,
            source=SNU.name,
            origin=f"{path.parent.name}/{path.name}[{first}:{last}]",
            split=split_of(SNU.name, take),
            sentences=sentences,
            mirrored_sentences=tuple(map(mirror_sentence, sentences)),
        )
        clips.append((first, last, Recording(label, piece)))
    yield from (clip for _, _, clip in clips)
    yield from touching(clips)


VAL, TEST = 0.05, 0.10  # Fractions of the recordings that are held out where no list names them.


@dataclass(frozen=True)
class HeldOut:
    """One clip that never trains."""

    source: str  # Name of its source.
    split: Split  # `val` or `test`.
    frames: int  # Its length in joints, one more than in features.


@cache
def held_out() -> Mapping[str, HeldOut]:
    """Returns the fixed clips of val and test, by id."""
    clips = {}
    splits: tuple[Split, ...] = ("val", "test")
    for split in splits:
        file = resources.files("latentmotion.data").joinpath(f"splits/{split}.txt")
        for line in file.read_text(encoding="utf-8").splitlines():
            source, name, frames = line.split()
            clips[name] = HeldOut(source, split, int(frames))
    return clips


def pieces_of(prefix: str) -> list[tuple[int, int]]:
    """Returns the fixed pieces of a take whose clips are called `{prefix}-{first frame}`."""
    clips = ((name.rpartition("-"), clip.frames) for name, clip in held_out().items())
    starts = [(int(start), frames) for (take, _, start), frames in clips if take == prefix]
    return sorted((start, start + frames) for start, frames in starts)


def split_of(source: str, recording: str) -> Split:
    """Returns the split of a recording, the same on every machine."""
    digest = hashlib.sha256(f"{source}/{recording}".encode()).digest()
    draw = int.from_bytes(digest[:4], "big") / 2**32
    if draw < TEST:
        return "test"
    return "val" if draw < TEST + VAL else "train"


_WRISTS = [JOINT["left_wrist"], JOINT["right_wrist"]]
_ANKLES = [JOINT["left_ankle"], JOINT["right_ankle"]]
_FEET = [JOINT["left_foot"], JOINT["right_foot"]]
_BENT = np.cos(np.radians(50))
_SECOND = np.full(FPS, 1 / FPS)


def shows(evidence: str, joints: Joints, floor: float, whole: bool) -> bool:
    """Returns whether a piece shows something.

    Args:
        evidence: Names of `EVIDENCE`, separated by spaces, all of which must hold; `whole` asks
            for a piece that is nearly all of its take.
        joints: The piece at 20 frames per second, meters.
        floor: Height of the floor.
        whole: Whether the piece is nearly all of its take.
    """
    joints = joints - np.array([0.0, floor, 0.0])
    return all(whole if name == "whole" else EVIDENCE[name](joints) for name in evidence.split())


def floor_of(joints: Joints) -> float:
    """Returns the height that the lower foot of a take is at most of the time, meters."""
    return float(np.percentile(joints[:, _FEET, 1].min(1), 10))


def _height(joints: Joints) -> Float[np.ndarray, " frames"]:
    """Height of the pelvis relative to the legs' length: 1 when standing upright."""
    bones = [("left_hip", "left_knee"), ("left_knee", "left_ankle")]
    leg = sum(np.linalg.norm(joints[0, JOINT[a]] - joints[0, JOINT[b]]) for a, b in bones)
    # The pelvis is about 12 cm above the hips' and ankles' distance: hip offset and ankle height.
    return joints[:, 0, 1] / (leg + 0.12)


def _speed(joints: Joints, which: list[int]) -> Float[np.ndarray, " frames_less_one"]:
    return np.asarray(np.linalg.norm(np.diff(joints[:, which], axis=0), axis=-1).max(1) * FPS)


def _path_speed(joints: Joints) -> Float[np.ndarray, " frames_less_one"]:
    """Speed of the pelvis over the floor, smoothed over a fifth of a second."""
    speed = np.linalg.norm(np.diff(joints[:, 0, ::2], axis=0), axis=-1) * FPS
    return np.convolve(speed, np.full(5, 0.2), "same")


def _turn(joints: Joints) -> float:
    """Degrees by which the hips turn from the first to the last frame, to the left."""
    across = joints[:, JOINT["left_hip"]] - joints[:, JOINT["right_hip"]]
    heading = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
    return float(np.degrees(heading[-1] - heading[0]))


def _swing(side: str, other: str) -> Callable[[Joints], bool]:
    def swings(joints: Joints) -> bool:
        speed = _speed(joints, [JOINT[f"{side}_wrist"]]).max()
        return bool(speed > 3 and speed > _speed(joints, [JOINT[f"{other}_wrist"]]).max())

    return swings


def _halts(joints: Joints) -> bool:
    """Walks, stands for half a second, walks on."""
    walking = _path_speed(joints) > 0.5
    standing = np.convolve(_path_speed(joints) < 0.15, np.ones(10), "same") > 9
    stops = np.flatnonzero(standing)
    return len(stops) > 0 and bool(walking[: stops[0]].any() and walking[stops[-1] :].any())


# Names and their thresholds: m/s, meters, degrees; heights relative to the legs' length.
EVIDENCE: Mapping[str, Callable[[Joints], bool]] = {
    "moves": lambda j: bool((_path_speed(j) > 0.3).mean() > 0.5),
    "stays": lambda j: bool((_path_speed(j) > 0.3).mean() < 0.3),
    "runs": lambda j: bool((_path_speed(j) > 1.6).mean() > 0.2),
    "steps": lambda j: bool(_path_speed(j).max() > 0.35),
    "stirs": lambda j: bool(_speed(j, [*_WRISTS, *_ANKLES]).max() > 1.5),
    "swings": lambda j: bool(_speed(j, _WRISTS).max() > 3),
    "left_swings": _swing("left", "right"),
    "right_swings": _swing("right", "left"),
    # Distance of a wrist from the pelvis over the floor.
    "reaches": lambda j: (
        float(np.linalg.norm(j[:, _WRISTS][..., ::2] - j[:, :1, ::2], axis=-1).max()) > 0.5
    ),
    "hands_up": lambda j: bool((j[:, _WRISTS, 1].max(1) > j[:, JOINT["neck"], 1]).sum() > 6),
    "kicks": lambda j: bool(j[:, _ANKLES, 1].max() > 0.55),
    "one_leg": lambda j: bool((j[:, _ANKLES, 1].max(1) > 0.35).mean() > 0.5),
    "jumps": lambda j: bool(j[:, _FEET, 1].min(1).max() > 0.1),
    # Angle between the trunk and the vertical.
    "bends": lambda j: bool(unit(j[:, JOINT["neck"]] - j[:, 0])[:, 1].min() < _BENT),
    "lowers": lambda j: bool(_height(j).min() < 0.75),
    "low": lambda j: bool(np.median(_height(j)) < 0.75),
    "down": lambda j: bool(_height(j)[:5].max() > 0.85 and _height(j)[-5:].min() < 0.6),
    "up": lambda j: bool(_height(j)[:5].min() < 0.6 and _height(j)[-5:].max() > 0.85),
    "down_up": lambda j: bool(min(_height(j)[0], _height(j)[-1]) > 0.85 and _height(j).min() < 0.6),
    "climbs": lambda j: float(j[-5:, 0, 1].mean() - j[:5, 0, 1].mean()) > 0.2,
    "descends": lambda j: float(j[-5:, 0, 1].mean() - j[:5, 0, 1].mean()) < -0.2,
    # Means over a second, which steps do not change.
    "slopes": lambda j: float(np.ptp(np.convolve(j[:, 0, 1], _SECOND, "valid"))) > 0.2,
    "turns": lambda j: abs(_turn(j)) > 120,
    "turns_left": lambda j: _turn(j) > 30,
    "turns_right": lambda j: _turn(j) < -30,
    "halts": _halts,
}
