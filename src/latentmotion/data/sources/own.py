"""Your own motion capture: files with captions beside them, in a CSV, or labels.

    walk.bvh + walk.txt     one sentence a line; HumanML3D's `sentence#tokens#from#to` works too
    captions.csv            columns file, caption; also: from, to (seconds; by default the end),
                            split, action
    train.json              BABEL's labels of AMASS's files (Punnakkal et al., CVPR 2021)
    semantic_labels/        a folder of texts by the same paths as the motions, as Motion-X has it;
                            lists in it, train.txt, val.txt and test.txt, are the splits
    LABEL/take.bvh          where folders are labels: each file is of that action
    test/LABEL/take.bvh     and of that split, if the first folder is train, val or test

Files are BVH, FBX (through Blender), GLB, AMC, USD, NPZ, Motion-X's NPY or of a plugin's format.
Each animation becomes one clip; where it jumps, it is cut, and the longest part keeps the name.
Mirrored copies get the same sentences with left and right swapped.

Hands of AMASS's and Motion-X's files, as 30 joints more than the body's 22.

    .npz   poses (frames, 156) of SMPL-H: body, hands; (frames, 165) of SMPL-X: body, jaw and eyes,
           hands; z up
    .npy   Motion-X's (frames, 322): body, hands, jaw, expression and more; y up

Rotations are put on our own bones, fingers straight at rest; the mean hand of SMPL is not added.
Mahmood et al., "AMASS", ICCV 2019; Romero et al., "Embodied Hands", 2017; Lin et al., "Motion-X",
2023.
"""

from __future__ import annotations

import hashlib
import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from latentmotion import formats
from latentmotion.data import clip, quality
from latentmotion.data import recording as recordings
from latentmotion.data.prepare import MIN_FRAMES
from latentmotion.data.recording import FPS, Dropped, FileGroup, Label, Recording
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.formats import fbx
from latentmotion.formats.smpl import MOTIONX_NUMBERS
from latentmotion.formats.takes import SkeletonTake
from latentmotion.kinematics.humanoid import find_humanoid
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY, HANDS, HUMANML3D, Joints, Skeleton
from latentmotion.kinematics.standing import Stated
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.storage.array_files import holds_objects, read_array, read_arrays
from latentmotion.storage.limits import MOST_NUMBER
from latentmotion.storage.reading import blamed_on, read_json_file, read_table, read_text

# Endings that `formats` reads, but that are captions and checkpoints in such a folder.
_NO_MOTION = (".csv", ".pkl", ".pt")

# Least degrees between a T-pose that was put before a motion and the motion itself.
_LEAST_MOVED = 6.0

_NEEDED, _OPTIONAL = ("file", "caption"), ("from", "to", "split", "action")


@dataclass
class _Annotations:
    """What a CSV or a file's folder states about one file."""

    sentences: list[clip.TaggedSentence] = field(default_factory=list)
    split: clip.Split | None = None
    action: str | None = None


@dataclass(frozen=True)
class OwnMotions:
    """A folder of motion files and how to read them."""

    folder: Path  # Folder of the files, in any nesting.
    source: clip.Source  # Origin and terms to record.
    # A CSV, BABEL's JSON, or a folder of `.txt` files by the paths of the motions; without it they
    # are beside the motions.
    captions: Path | None = None
    # Unit, up axis, frame rate and joint maps of all files, where these say them wrongly or not at
    # all; by default found for each by itself.
    stated: Stated | None = None
    # Fraction of the files that goes to the val split, unless the CSV says otherwise.
    val: float = 0.05
    # Fraction of the files that goes to the test split, unless the CSV says otherwise.
    test: float = 0.05
    labelled: bool = False  # Whether the name of a file's folder is its action.
    # Whether fingers are kept as further joints; files without their poses are left out then.
    hands: bool = False
    generated: bool = True  # Whether NPZ files of motions that a model generated count, too.

    def recordings(self) -> Iterator[Recording | Dropped]:
        """Yields every motion file.

        Raises:
            DataError, MissingProgramError: As for `groups`.
        """
        for group in self.groups():
            yield from group.read()

    def groups(self, size: int | None = None) -> list[FileGroup]:
        """Returns the motion files in groups.

        Args:
            size: Files in a group; by default there is one group.

        Raises:
            DataError: There is no such folder, no motion file in it, or the CSV cannot be used.
            MissingProgramError: There are FBX files, and no Blender.
        """
        paths = find_motions(self.folder)
        if any(path.suffix.lower() == ".fbx" for path in paths.values()):
            fbx.check_ready()
        listed: dict[str, _Annotations] = {}
        if self.captions and self.captions.is_dir():  # lists in it are the splits
            for split in clip.SPLITS:
                if (path := self.captions / f"{split}.txt").is_file():
                    names = map(str.strip, read_text(path).splitlines())
                    listed |= {name: _Annotations(split=split) for name in names}
        elif self.captions:
            babel = self.captions.suffix.lower() == ".json"
            listed = _read_babel(self.captions, paths) if babel else _read_csv(self.captions)
        # Captions of files that are not there belong to the first group, which tells of them.
        unmatched = {name: entry for name, entry in listed.items() if name not in paths}
        groups = []
        for some in recordings.in_groups(list(paths.items()), size):
            unmatched |= {name: listed[name] for name, _ in some if name in listed}
            beside = [self._texts(path) for _, path in some]
            files = (*(path for _, path in some), *(text for text in beside if text.is_file()))
            groups.append(FileGroup(files, partial(self._read, dict(some), unmatched)))
            unmatched = {}
        return groups

    def _read(
        self, paths: Mapping[str, Path], listed: Mapping[str, _Annotations]
    ) -> Iterator[Recording | Dropped]:
        """Yields some motion files, and the captions of files that are not there."""
        for name, entry in listed.items():
            if name not in paths:
                for sentence in entry.sentences:
                    reason = f"{self.captions} names a file that is not there: {sentence.text}"
                    yield Dropped(name, "caption", reason)
        for name, path in counted(paths.items(), "motion files"):
            try:
                entry = listed.get(name) or self._annotations_beside(path)
                if self.captions and self.captions.is_dir():  # which lists splits, no sentences
                    entry = replace(self._annotations_beside(path), split=entry.split)
                body = whole_body(path)
                takes = self._takes(path, body)
            except (FileFormatError, DataError, InputError) as error:
                yield Dropped(name, "clip", str(error))
                continue
            if body and body.hands is not None and not self.hands:
                yield Dropped(name, "part", "the poses of its fingers; --hands keeps them")
            if body and body.face_moves:
                yield Dropped(name, "part", "the poses of its face: jaw, eyes, expression")
            action = entry.action
            # By hash, so that more files never move a file to another split.
            draw = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big") / 2**32
            rest: clip.Split = "test" if draw < self.val + self.test else "train"
            split: clip.Split = "val" if draw < self.val else rest
            for number, joints in enumerate(takes, 1):
                end = len(joints) / FPS  # of sentences that state none
                sentences = tuple(
                    replace(each, end=end) if math.isinf(each.end) else each
                    for each in entry.sentences
                )
                label = Label(
                    id=name.replace("/", "-") + (f"-{number}" if len(takes) > 1 else ""),
                    source=self.source.name,
                    origin=f"{name}{path.suffix}",
                    split=entry.split or split,
                    sentences=sentences,
                    mirrored_sentences=tuple(map(clip.mirror_sentence, sentences)),
                    action=action,
                    mirrored_action=clip.mirror_words(action) if action else None,
                )
                yield from _without_glitches(Recording(label, joints))

    def unknown_skeleton(self) -> Skeleton | None:
        """Returns the skeleton of the first file whose names of joints are unknown.

        Raises:
            DataError: There is no such folder, or no motion file in it.
        """
        for path in counted(find_motions(self.folder).values(), "motion files"):
            try:
                takes = formats.read(path)
            except (FileFormatError, DataError, InputError):
                continue
            for take in takes[:1]:
                if isinstance(take, SkeletonTake):
                    try:
                        find_humanoid(take.animation.skeleton, take.declared)
                    except DataError:
                        return take.animation.skeleton
        return None

    def _annotations_beside(self, path: Path) -> _Annotations:
        """Returns the sentences beside a file, and the labels that its folders are."""
        texts = self._texts(path)
        sentences = clip.parse_sentences(read_text(texts)) if texts.is_file() else ()
        if not self.labelled:
            return _Annotations(list(sentences))
        folders = path.relative_to(self.folder).parts[:-1]
        split: clip.Split | None = next((s for s in clip.SPLITS if folders[:1] == (s,)), None)
        labels = folders[1:] if split else folders
        if not labels:
            raise DataError("lies in no folder whose name is its action")
        return _Annotations(list(sentences), split, labels[-1])

    def _texts(self, path: Path) -> Path:
        """Returns where the sentences of a motion file are, if they are in a file of its name."""
        if self.captions and self.captions.is_dir():
            path = self.captions / path.relative_to(self.folder)
        return path.with_suffix(".txt")

    def _takes(self, path: Path, body: WholeBody | None) -> list[Joints]:
        """Reads the joints of each animation, without a T-pose that was put before it."""
        if self.hands:
            if body is None or body.hands is None:
                expected = "expected AMASS's SMPL-H or SMPL-X, or Motion-X's"
                raise FileFormatError(path, f"has no poses of fingers, {expected}")
            (motion,) = formats.load(path)
            fps = self.stated.fps if self.stated and self.stated.fps else motion.fps
            return [recordings.at_rate(body.joints(motion), FPS, fps)]
        takes, count = [], len(HUMANML3D)
        for motion in formats.load(path, self.stated):
            if not self.generated and "model" in motion.metadata:
                problem = f"generated by the model {motion.metadata['model']!r}"
                raise DataError(f"{problem}, which learns nothing from it; else add --generated")
            if motion.skeleton.names[:count] != HUMANML3D.names:
                problem = f"found the joints of {motion.skeleton.name!r}"
                raise FileFormatError(path, f"{problem}, expected HumanML3D's {count}")
            joints, recorded = motion.joints[:, :count], motion.recorded
            if recorded and quality.begins_with_t_pose(recorded.animation, _LEAST_MOVED):
                joints = joints[1:]
            takes.append(recordings.at_rate(joints, FPS, motion.fps))
        return takes


def _without_glitches(recording: Recording) -> Iterator[Recording | Dropped]:
    """Yields the parts of a motion between its glitches; the longest first, with its sentences.

    One in which nothing is left is yielded whole, to be dropped with the reason.
    """
    joints, label = recording.joints, recording.label
    body = joints[:, : len(HUMANML3D)]  # fingers, where there are any, come after it
    reason = quality.find_glitch(body, FPS) if len(joints) >= MIN_FRAMES else None
    clean = quality.clean_spans(body, FPS) if reason else []
    spans = [span for span in clean if span[1] - span[0] >= MIN_FRAMES]
    spans = [span for span in spans if not quality.held_t_pose(body[slice(*span)]).all()] or spans
    if reason is None or not spans:
        yield recording
        return
    lost = len(joints) - sum(end - start for start, end in spans)
    yield Dropped(label.id, "part", f"{lost} of {len(joints)} frames: {reason}")
    spans.sort(key=lambda span: span[0] - span[1])
    for number, (start, end) in enumerate(spans, 1):
        whole = number == 1 and end - start >= len(joints) / 2
        cut = replace(
            label,
            id=label.id if number == 1 else f"{label.id}-part{number}",
            sentences=_sentences_of(label.sentences, start / FPS, end / FPS, whole),
            mirrored_sentences=_sentences_of(
                label.mirrored_sentences, start / FPS, end / FPS, whole
            ),
            start=start / FPS,
        )
        if label.sentences and not cut.sentences:
            yield Dropped(
                cut.id, "caption", "says what the whole file shows, of which this is less"
            )
        yield Recording(cut, joints[start:end])


def _sentences_of(
    sentences: Iterable[clip.TaggedSentence], start: float, end: float, whole: bool
) -> tuple[clip.TaggedSentence, ...]:
    """Returns the sentences that hold of a part of a motion, in the part's own seconds.

    Args:
        sentences: Sentences about the whole motion.
        start: Seconds.
        end: Seconds.
        whole: Whether the part is enough for sentences about the whole motion.
    """
    clipped = []
    for sentence in sentences:
        if sentence.start == sentence.end == 0:
            clipped += [sentence] if whole else []
            continue
        first, last = max(sentence.start, start), min(sentence.end, end)
        if last - first >= (sentence.end - sentence.start) / 2 > 0:
            clipped.append(replace(sentence, start=first - start, end=last - start))
    return tuple(clipped)


def find_motions(folder: Path) -> dict[str, Path]:
    """Returns the motion files below a folder by their path in it, without ending.

    Raises:
        DataError: There is no such folder, or no motion file in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold your motion files")
    endings = _endings()
    # Arrays give way to a motion of the same name, of which they may be features.
    paths = sorted(
        recordings.files_below(folder, endings), key=lambda path: path.suffix.lower() != ".npy"
    )
    if not paths:
        raise DataError(f"{folder}: expected motion files ({', '.join(endings)}), found none")
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in paths}


def _endings() -> tuple[str, ...]:
    return tuple(ending for ending in formats.readable() if ending not in _NO_MOTION)


def _read_csv(path: Path) -> dict[str, _Annotations]:
    """Reads captions, splits and actions by the path of a file in its folder, without ending."""
    if not path.is_file():
        raise DataError(f"no file {path}; expected a CSV with the columns {', '.join(_NEEDED)}")
    by_file: dict[str, _Annotations] = defaultdict(_Annotations)
    try:
        table = read_table(path, _NEEDED)
    except FileFormatError as error:
        columns = f"{', '.join(_NEEDED)} and, if you like, {', '.join(_OPTIONAL)}"
        raise DataError(f"{error}; expected a CSV with the columns {columns}") from error
    endings = _endings()
    for line, row in table:
        where = f"{path}:{line}"
        cells = {name: row.get(name, "").strip() for name in (*_NEEDED, *_OPTIONAL)}
        motion = Path(cells["file"])
        is_motion = motion.suffix.lower() in endings
        entry = by_file[(motion.with_suffix("") if is_motion else motion).as_posix()]
        if cells["caption"]:
            start, end = (_seconds(cells[name], where) for name in ("from", "to"))
            if start > 0 and not cells["to"]:  # until the end, once that is known
                end = math.inf
            entry.sentences.append(clip.TaggedSentence(cells["caption"], "", start, end))
        entry.action = cells["action"] or entry.action
        if cells["split"]:
            split: clip.Split | None = next((s for s in clip.SPLITS if s == cells["split"]), None)
            if split is None:
                expected = f"expected one of {', '.join(clip.SPLITS)}"
                raise DataError(f"{where}: split {cells['split']!r}; {expected}")
            entry.split = split
    return dict(by_file)


def _read_babel(path: Path, names: Collection[str]) -> dict[str, _Annotations]:
    """Reads BABEL's raw labels of whole takes and of their parts; the split is the file's name.

    Its classes of actions (`act_cat`) are not read: a take has several, a clip here one.

    Args:
        path: BABEL's train.json, val.json or test.json.
        names: Motion files; AMASS's archives lack the first folder of BABEL's paths.
    """
    split: clip.Split | None = next((s for s in clip.SPLITS if s == path.stem), None)
    by_file: dict[str, _Annotations] = {}
    with blamed_on(path, KeyError, TypeError, AttributeError, ValueError, problem=_NO_BABEL):
        for take in read_json_file(path).values():
            name = Path(take["feat_p"]).with_suffix("").as_posix()
            name = name if name in names else name.partition("/")[2]
            by_file[name] = entry = _Annotations(split=split)
            whole, parts = take.get("seq_ann") or {}, take.get("frame_ann") or {}
            for label in (*whole.get("labels", ()), *parts.get("labels", ())):
                span = [_seconds(label.get(key), f"{path}: {name}") for key in ("start_t", "end_t")]
                if label["raw_label"] != "transition":  # which says nothing of the motion
                    entry.sentences.append(clip.TaggedSentence(str(label["raw_label"]), "", *span))
    return by_file


_NO_BABEL = "no labels of BABEL ({error}); expected its train.json, val.json or test.json"


def _seconds(text: str | float | None, where: str) -> float:
    try:
        seconds = float(text or 0)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise DataError(f"{where}: expected seconds in from and to, found {text!r:.40}")
    return seconds


BODY_JOINTS, HAND_JOINTS = len(HUMANML3D), len(HANDS) - len(HUMANML3D)

_BODY = 3 * BODY_JOINTS

# Where hands and face are among the numbers of a frame.
_PLACES = {
    156: (slice(_BODY, 156), slice(0)),
    165: (slice(75, 165), slice(_BODY, 75)),
    MOTIONX_NUMBERS: (slice(_BODY, 156), slice(156, 209)),  # jaw and expression
}

# Radians up to which hands count as resting.
_MOVED = 1e-3


class WholeBody(NamedTuple):
    """Poses of body, hands and face, as rotation vectors in the axes of their file."""

    body: Float[np.ndarray, "frames 22 3"]  # Of HumanML3D's joints.
    hands: Float[np.ndarray, "frames 30 3"] | None  # None if they rest.
    face_moves: bool  # Whether jaw, eyes or expression move, which are never kept.
    z_up: bool  # Whether z is up, else y.

    def joints(self, motion: Motion) -> Float[np.ndarray, "frames 52 3"]:
        """Returns positions of body and fingers, meters, y up.

        Args:
            motion: The body, as it was read from the same file.
        """
        hands = self.hands if self.hands is not None else np.zeros((len(motion), HAND_JOINTS, 3))
        rotations = matrix_from_axis_angle(np.concatenate([self.body, hands], axis=1))
        turned = _REST.forward_kinematics(rotations, np.zeros((len(motion), 3)))
        if self.z_up:
            turned = turned @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        fingers = turned[:, BODY_JOINTS:] - turned[:, :1] + motion.joints[:, :1]
        return np.concatenate([motion.joints, fingers], axis=1)


def whole_body(path: Path) -> WholeBody | None:
    """Returns the poses of a file; None if it has no places for hands.

    Raises:
        FileFormatError: The file is damaged, or holds NaN.
    """
    ending, poses = path.suffix.lower(), None
    if ending == ".npz":
        poses = read_arrays(path, lambda name, *_: name == "poses").get("poses")
    elif ending == ".npy" and not holds_objects(path):
        poses = read_array(path)
    # Only SMPL-H and SMPL-X are in an .npz, only Motion-X is in an .npy.
    if poses is None or poses.ndim != 2 or poses.shape[1] not in _PLACES:
        return None
    if (poses.shape[1] == MOTIONX_NUMBERS) != (ending == ".npy"):
        return None
    numbers = poses.dtype.kind in "fiu"
    if not numbers or not (np.abs(poses := poses.astype(np.float64)) < MOST_NUMBER).all():
        raise FileFormatError(path, "holds poses that are not finite numbers")
    at_hands, at_face = _PLACES[poses.shape[1]]
    body, hands = poses[:, :_BODY], poses[:, at_hands]
    rests = np.abs(hands).max(initial=0.0) <= _MOVED
    return WholeBody(
        body.reshape(-1, BODY_JOINTS, 3),
        None if rests else hands.reshape(-1, HAND_JOINTS, 3),
        bool(np.abs(poses[:, at_face]).max(initial=0.0) > _MOVED),
        z_up=ending == ".npz",
    )


# Our T-pose with fingers that continue the arms; thumbs point ahead.
_LENGTHS = np.linalg.norm(HANDS.offsets[BODY_JOINTS:], axis=1, keepdims=True)
_OUTWARD = np.repeat([[1.0, 0, 0], [-1.0, 0, 0]], HAND_JOINTS // 2, axis=0)
_WAYS = np.where(HANDS.offsets[BODY_JOINTS:, 2:] > 0, (0.0, 0.0, 1.0), _OUTWARD)
_OFFSETS = np.concatenate([BODY.offsets[:BODY_JOINTS], _LENGTHS * _WAYS])
_REST = Skeleton("hands at rest", HANDS.names, HANDS.parents, _OFFSETS)
