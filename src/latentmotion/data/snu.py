"""Seoul National University's motion capture: takes named by their files → pieces with sentences.

BVH at 30 frames per second, or AMC beside ASF, on four skeletons that are known by their joints.
Some takes hold two or more people, one file each: they share a split. Basketball and martial arts
have annotations (`*.lab`) of spans; elsewhere the file's name says what happens.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.captions import TaggedSentence, mirror_sentence
from latentmotion.data.clip import Source
from latentmotion.data.evidence import floor_of
from latentmotion.data.finding import files_below
from latentmotion.data.glitches import find_glitch
from latentmotion.data.held_out import pieces_of, split_of
from latentmotion.data.joining import touching
from latentmotion.data.recording import Dropped, Label, Recording
from latentmotion.data.resampling import joints_at
from latentmotion.data.segments import pieces
from latentmotion.data.snu_actions import sentences_of
from latentmotion.data.snu_annotations import Group, Span, grouped, read_annotations
from latentmotion.data.snu_names import sentences_for
from latentmotion.data.t_pose import held_t_pose
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.formats.bvh import read_bvh
from latentmotion.kinematics.animation import Animation

SNU = Source(
    name="snu",
    license="Apache 2.0; martial arts: BSD 3-clause, (c) 2020 NCSOFT and SNU R&D Foundation",
    credit="Movement Research Lab, Seoul National University",
    url="https://github.com/snumrl",
)

FPS = 20
STILL = 0.3
"""Meters per second below which nobody moves in a take, not even a hand."""
SAME = 0.04
"""Meters by which two files of one take may differ on average; skeletons differ in the head."""
HELD = 8
"""Frames of a calibration pose in the middle of a take; arms pass through it faster."""
EDGE = 5
"""Frames from the start or end of a take within which it may be shorter."""
LOWERING = 10
"""Frames in which the arms go down from it, or up to it."""

_PERSON = re.compile(r"(?P<take>\w+_\d+_\d+)_\d+$")
_PREFIX = re.compile(r"^(\d__|multi__)?(SSBoxerMan__|hys_|mmk_)?")
_RATE = re.compile(rb":SAMPLES-PER-SECOND\s+(\d+)")


def snu_recordings(folder: Path) -> Iterator[Recording | Dropped]:
    """Yields the pieces of every take below a folder.

    Raises:
        DataError: There is no such folder, or no take in it.
    """
    annotations = read_annotations(folder)
    seen: dict[int, list[tuple[str, Float[np.ndarray, "frames joints 3"]]]] = defaultdict(list)
    for path in find_takes(folder):
        try:
            joints, native = _read(path)
            _check_new(joints, seen[len(joints)])
        except (FileFormatError, DataError) as error:
            yield Dropped(path.stem, "clip", str(error))
            continue
        seen[len(joints)].append((path.stem, joints))
        spans = [span.at(FPS / native) for span in annotations.get(path.stem, ())]
        yield from _pieces(path, joints, spans)


def find_takes(folder: Path) -> list[Path]:
    """Returns the motion files below a folder whose skeleton is one of the known four.

    Raises:
        DataError: There is no such folder, or no take in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold SNU's takes, from {SNU.url}")
    found = [path for path in files_below(folder, [".bvh", ".amc"]) if _is_known(path)]
    if not found:
        raise DataError(
            f"{folder}: expected BVH or AMC files of SNU's skeletons (LeftToes and LeftShoulder1, "
            f"or LeftToe and Spine2), found none; get them from {SNU.url}"
        )
    return found


def recording_of(stem: str) -> str:
    """Returns the name of the take that a file is one person of.

    `s_006_1_3` is the third person of `s_006_1`, `multi__hys_box_2` one of two of `box_2`. The
    sessions' numbers go as well: some takes are there twice, under two of them.
    """
    if match := _PERSON.match(stem):
        return match["take"]
    return _PREFIX.sub("", stem)


def _is_known(path: Path) -> bool:
    """Looks for the joints of the known skeletons where a file names them."""
    if path.suffix.lower() == ".bvh":
        with path.open("rb") as file:
            head = file.read(1 << 14)
    else:
        head = b"".join(asf.read_bytes() for asf in sorted(path.parent.glob("*.asf")))
    words = set(head.split())
    return {b"LeftToes", b"LeftShoulder1"} <= words or {b"LeftToe", b"Spine2"} <= words


def _read(path: Path) -> tuple[Float[np.ndarray, "frames joints 3"], float]:
    """Returns joints at 20 frames per second, and the file's own rate."""
    animation = _read_bvh(path) if path.suffix.lower() == ".bvh" else _read_amc(path)
    return joints_at(animation, FPS, animation.fps), animation.fps


def _read_bvh(path: Path) -> Animation:
    """Reads BVH in centimeters, or in inches if it has joints of length 0 called `…Dummy`."""
    with path.open("rb") as file:
        inches = b"LeftUpLegDummy" in file.read(1 << 14)
    return read_bvh(path, "inches" if inches else "centimeters")


def _read_amc(path: Path) -> Animation:
    with path.open("rb") as file:
        rate = _RATE.search(file.read(1 << 10))
    return read_asf_amc(path, fps=float(rate[1]) if rate else 30.0)


def _check_new(
    joints: Float[np.ndarray, "frames joints 3"],
    seen: Sequence[tuple[str, Float[np.ndarray, "frames joints 3"]]],
) -> None:
    """Refuses a take in which nothing moves, or that was there under another name."""
    fastest = np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() * FPS
    if fastest < STILL:
        raise DataError(f"nothing moves faster than {fastest:.2g} m/s in {len(joints)} frames")
    for name, other in seen:
        if np.abs(joints - other).mean() < SAME:
            raise DataError(f"the same motion as {name}")


def _pieces(
    path: Path, joints: Float[np.ndarray, "frames joints 3"], spans: Sequence[Span]
) -> Iterator[Recording | Dropped]:
    stretches = _without_t_poses(joints)
    told = [group for group in grouped(spans, len(joints)) if _inside(group, stretches)]
    cuts = [edge for group in told for edge in (group.start, group.end)]
    found = pieces_of(f"{SNU.name}-{path.stem}") or list(pieces(joints, FPS, stretches, cuts))
    kept = sum(end - start for start, end in stretches)
    lost = kept - sum(end - start for start, end in found)
    if kept < len(joints):
        posed = f"{len(joints) - kept} of {len(joints)} frames: calibration pose"
        yield Dropped(path.stem, "part", posed)
    if lost:
        reason = find_glitch(joints, FPS) or "shorter than a second"
        yield Dropped(path.stem, "part", f"{lost} of {len(joints)} frames: {reason}")
    floor, groups = floor_of(joints), {(group.start, group.end): group for group in told}
    clips = []
    for first, last in found:
        if last > len(joints):
            reason = f"{len(joints)} frames at 20 fps, the list of held-out clips wants {last}"
            yield Dropped(f"{SNU.name}-{path.stem}-{first:05d}", "clip", reason)
            continue
        piece = joints[first:last]
        if (first, last) in groups:
            sentences = sentences_of(groups[first, last].actions)
        else:
            name, whole = recording_of(path.stem), last - first > 0.8 * kept
            sentences = sentences_for(name, piece, floor, whole)
        clips.append((first, last, Recording(_label(path, first, last, sentences), piece)))
    yield from (clip for _, _, clip in clips)
    yield from touching(clips)


def _label(path: Path, first: int, last: int, texts: Sequence[str]) -> Label:
    sentences = tuple(map(TaggedSentence, texts))
    return Label(
        id=f"snu-{path.stem}-{first:05d}",
        source=SNU.name,
        origin=f"{path.parent.name}/{path.name}[{first}:{last}]",
        split=split_of(SNU.name, recording_of(path.stem)),
        sentences=sentences,
        mirrored_sentences=tuple(map(mirror_sentence, sentences)),
    )


def _inside(group: Group, stretches: Sequence[tuple[int, int]]) -> bool:
    return any(first <= group.start and group.end <= last for first, last in stretches)


def _without_t_poses(joints: Float[np.ndarray, "frames joints 3"]) -> list[tuple[int, int]]:
    """Returns the stretches between calibration poses, and what leads to and from these."""
    held = held_t_pose(joints)
    runs = np.flatnonzero(np.diff(np.concatenate([[0], held.astype(int), [0]]))).reshape(-1, 2)
    posed = np.zeros(len(joints), bool)
    for first, last in runs.tolist():
        at_edge = first < EDGE or last > len(joints) - EDGE
        if last - first >= HELD or at_edge:
            posed[max(0, first - LOWERING) : last + LOWERING] = True
    edges = np.diff(np.concatenate([[1], posed.astype(int), [1]]))
    return list(zip(*(np.flatnonzero(edges == way).tolist() for way in (-1, 1)), strict=True))
