"""Captions measured from the motions of a prepared folder, or of a folder of motion files.

In the train split each clip gets sentences about itself and about windows of it, parts of random
length and position; its own captions go with the parts of which they are still true, and are also
said in other words. Captions that the motion contradicts can be left out. Clips of val and test
keep their captions, and get measured ones only where they have none.
"""

from __future__ import annotations

import csv
import hashlib
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path, PurePath

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Caption, fit_sentences
from latentmotion.data.dataset import Dataset
from latentmotion.data.prepare import encode_all
from latentmotion.data.recording import FPS, Dropped
from latentmotion.data.report import REPORT, PreparationReport, parts_of, read_report
from latentmotion.data.sources.own import OwnMotions, find_motions
from latentmotion.data.store import MANIFEST, CaptionRow, StoredClip
from latentmotion.errors import DataError
from latentmotion.language.reading import claims_of
from latentmotion.language.words import inflect, plain
from latentmotion.measure.facts import Description
from latentmotion.measure.scene import describe
from latentmotion.ranking.agreement import check as check_agreement
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.storage.configuration import write_json
from latentmotion.storage.files import atomic_file, atomic_folder
from latentmotion.training.captioning import clauses
from latentmotion.training.captioning.rewording import rewordings as reworded_texts
from latentmotion.training.captioning.sentences import sentences

COLUMNS = ("file", "caption", "from", "to")  # Columns that `data prepare own --captions` reads.

# Frames of the longest motion file that is described whole; longer ones are in parts.
LONGEST_FILE = 200

Joints = Float[np.ndarray, "frames 22 3"]

# Frames of the shortest motion that can be described.
_SHORTEST = 4


@dataclass(frozen=True)
class FileRow:
    """One line of a CSV of captions."""

    file: str  # A motion file's path in its folder, or a clip's name.
    caption: str  # A sentence.
    start: float  # Seconds; zero in both means the whole motion.
    end: float  # Seconds.


def clip_generator(seed: int, clip: str) -> np.random.Generator:
    """Returns the random generator of a clip, which depends on its name and a seed alone."""
    number = int.from_bytes(hashlib.sha256(clip.encode()).digest()[:8], "big")
    return np.random.default_rng([seed, number])


def describe_folder(
    folder: str | Path,
    out: str | Path,
    windows: Windows,
    seed: int = 0,
    rewordings: int = 0,
    check: bool = False,
    refused_captions: frozenset[str] = frozenset(),
) -> PreparationReport:
    """Adds measured sentences to a prepared folder.

    Args:
        folder: A prepared folder of HumanML3D features.
        out: The folder to write; features and normalizer are copied as they are.
        windows: Numbers of parts per clip, and of sentences.
        seed: Seed of parts and wording; each clip draws for itself.
        rewordings: Number of paraphrases of each caption of the train split.
        check: Whether captions of the train split that the motion contradicts are left out.
        refused_captions: Sentences of a test set, as `language.words.plain` writes them, which no
            caption of the train split may be.

    Raises:
        DataError: The folder is not a prepared one, or of another representation.
        InputError: The folder cannot be written.
    """
    dataset, dropped = _load(folder, check)
    clips = tuple(described_clips(dataset, windows, seed, rewordings))
    clips = tuple(without_captions(clip, refused_captions) for clip in clips)
    manifest = replace(dataset.manifest, clips=clips)
    old = read_report(dataset.folder) or PreparationReport((), (), None)
    added = sum(len(clip.captions) for clip in clips)
    added -= sum(len(clip.captions) for clip in dataset.manifest.clips)
    note = f"{added} captions measured from the motion (latentmotion data describe, seed {seed})"
    report = replace(old, parts=parts_of(manifest), dropped=(*old.dropped, *dropped))
    report = replace(report, notes=(*old.notes, note))
    with atomic_folder(out, MANIFEST) as temporary:
        for shard in manifest.shards:
            shutil.copyfile(dataset.folder / shard.file, temporary / shard.file)
        write_json(temporary / REPORT, report)
        write_json(temporary / MANIFEST, manifest)
    return report


def without_captions(clip: StoredClip, refused: frozenset[str]) -> StoredClip:
    """Returns a clip, in the train split without captions that are refused sentences."""
    if clip.split != "train" or not refused:
        return clip
    allowed, mirrored = (
        tuple(row for row in rows if plain(row[0]) not in refused)
        for rows in (clip.captions, clip.mirrored_captions)
    )
    return replace(clip, captions=allowed, mirrored_captions=mirrored)


def described_clips(
    dataset: Dataset, windows: Windows, seed: int, rewordings: int = 0
) -> Iterator[StoredClip]:
    """Yields the clips of a prepared folder of HumanML3D's features with measured sentences."""
    for clip in dataset.manifest.clips:
        if clip.split != "train" and clip.captions:
            yield clip
            continue
        joints = dataset.representation.decode(dataset.features(clip.clip()))
        generator = clip_generator(seed, clip.id)
        if clip.split == "train":
            captions = [Caption(*row) for row in clip.captions]
            existing = [(c.text, c.start_frame, c.end_frame) for c in captions]
            reworded = [
                (c.text, c.start_frame, c.end_frame)
                for c in reworded_captions(captions, generator, rewordings)
            ]
            measured = caption_windows(joints, [*existing, *reworded], generator, windows)
            rows = [*reworded, *measured]
        else:
            texts = sentences(describe(joints), generator, count=3)
            rows = [(text, 0, clip.frames) for text in texts]
        yield clip.with_captions(rows)


def reworded_captions(
    captions: Sequence[Caption], generator: np.random.Generator, count: int
) -> tuple[Caption, ...]:
    """Returns captions that say the same of the same frames in other words.

    Only for clips of the train split: a test set keeps the words that people wrote.

    Args:
        captions: Captions of a clip.
        generator: Source of every choice.
        count: Number of wordings to try for each caption.

    Returns:
        The new captions alone, without tokens; none that the clip has already.
    """
    existing = {(c.text.rstrip(". "), c.start_frame, c.end_frame) for c in captions}
    reworded: list[Caption] = []
    for caption in captions:
        for text in reworded_texts(caption.text, generator, count):
            key = (text.rstrip(". "), caption.start_frame, caption.end_frame)
            if key not in existing:
                existing.add(key)
                reworded.append(Caption(text, caption.start_frame, caption.end_frame))
    return tuple(reworded)


def contradiction(caption: str, joints: Joints) -> str:
    """Returns what a motion does that a caption of it denies; empty if there is nothing.

    Args:
        caption: A sentence, or the name of an action.
        joints: Positions, meters, 20 frames per second.
    """
    if len(joints) < _SHORTEST:
        return ""
    agreement = check_agreement(caption, describe(joints))
    pairs = zip(agreement.verdicts, agreement.reasons, strict=True)
    return "; ".join(reason for verdict, reason in pairs if verdict == "contradicts")


def without_contradicted(dataset: Dataset) -> tuple[Dataset, tuple[Dropped, ...]]:
    """Removes captions that the motion contradicts from the train split.

    Val and test keep the captions that people wrote.

    Returns:
        The data set with the other captions, and the removed ones with the reason.
    """
    dropped: list[Dropped] = []
    clips = []
    for clip in dataset.manifest.clips:
        if clip.split == "train":
            captions = _agreeing_rows(dataset, clip, False, dropped)
            mirrored = _agreeing_rows(dataset, clip, True, dropped)
            clip = replace(clip, captions=captions, mirrored_captions=mirrored)
        clips.append(clip)
    return replace(dataset, manifest=replace(dataset.manifest, clips=tuple(clips))), tuple(dropped)


def describe_files(
    motions: OwnMotions, seed: int = 0, check: bool = False, names: bool = False
) -> list[FileRow | Dropped]:
    """Describes motion files; those that `data prepare` would drop come with the reason.

    Sentences in text files beside the motions stay, before the measured ones. Files longer than a
    clip are described in parts of equal length.

    Args:
        motions: The files.
        seed: Seed of the wording.
        check: Whether sentences beside a motion that it contradicts are left out.
        names: Whether a file's name (`wave_hello_02.bvh`) says what it shows; a name that the
            motion contradicts is left out.

    Raises:
        DataError: There is no such folder or no motion file in it.
    """
    rows: list[FileRow | Dropped] = []
    files = [f"{name}{path.suffix}" for name, path in find_motions(motions.folder).items()]
    named = captions_of_names(files) if names else {}
    for item in encode_all(motions.recordings(), HUMANML3D_FEATURES):
        if isinstance(item, Dropped):
            rows.append(item)
            continue
        joints = HUMANML3D_FEATURES.decode(item.features)
        file, frames = item.label.origin, len(joints)
        captions, reasons = fit_sentences(item.label.sentences, frames)
        rows += [Dropped(file, "caption", reason) for reason in reasons]
        for caption in captions:
            start, end, text = caption.start_frame, caption.end_frame, caption.text
            if check and (reason := contradiction(text, joints[start:end])):
                rows.append(Dropped(file, "caption", f"{text!r}, but {reason}"))
            else:
                rows.append(FileRow(file, text, *_seconds(start, end, frames, item.label.start)))
        action = named.get(file, "")
        if action and (reason := contradiction(action, joints)):
            rows.append(Dropped(item.label.id, "caption", f"name {action!r}, but {reason}"))
            action = ""
        generator = clip_generator(seed, item.label.id)
        # Parts of equal length, as few as keep each below the longest.
        edges = np.linspace(0, frames, -(-frames // LONGEST_FILE) + 1).astype(int).tolist()
        for start, end in pairwise(edges):
            texts = sentences(describe(joints[start:end]), generator, action or None, count=3)
            span = _seconds(start, end, frames, item.label.start)
            rows += [FileRow(file, text, *span) for text in texts]
    return rows


def write_captions(path: str | Path, rows: Iterable[FileRow]) -> None:
    """Writes a CSV that `data prepare own --captions` reads.

    Raises:
        InputError: The file cannot be written.
    """
    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for row in rows:
            span = ("", "") if row.start == row.end == 0 else (f"{row.start:g}", f"{row.end:g}")
            table.writerow((row.file, row.caption, *span))


def folder_rows(
    folder: str | Path, windows: Windows, seed: int, rewordings: int = 0, check: bool = False
) -> list[FileRow | Dropped]:
    """Returns the captions that `describe_folder` would write, and those it would leave out."""
    dataset, dropped = _load(folder, check)
    rows = [
        FileRow(clip.id, text, *_seconds(start, end, clip.frames))
        for clip in described_clips(dataset, windows, seed, rewordings)
        for text, start, end, _ in clip.captions
    ]
    return [*dropped, *rows]


def _load(folder: str | Path, check: bool) -> tuple[Dataset, tuple[Dropped, ...]]:
    """Opens a prepared folder of HumanML3D's features, without contradicted captions if `check`.

    Raises:
        DataError: The folder is not a prepared one, or of another representation.
    """
    dataset = Dataset.load(folder)
    if dataset.representation.name != HUMANML3D_FEATURES.name:
        raise DataError(
            f"{dataset.folder}: found {dataset.representation.name!r} features; only "
            f"{HUMANML3D_FEATURES.name!r} can be described, as they are of its 22 joints"
        )
    return without_contradicted(dataset) if check else (dataset, ())


def _agreeing_rows(
    dataset: Dataset, clip: StoredClip, mirrored: bool, dropped: list[Dropped]
) -> tuple[CaptionRow, ...]:
    """Returns the captions of one side that hold, and adds the others to those dropped."""
    rows = clip.mirrored_captions if mirrored else clip.captions
    if not rows:
        return rows
    joints = dataset.representation.decode(dataset.features(clip.clip(mirrored)))
    agreeing = []
    for row in rows:
        text, start, end, _ = row
        if reason := contradiction(text, joints[start:end]):
            side = "mirrored: " if mirrored else ""
            dropped.append(Dropped(clip.id, "caption", f"{side}{text!r}, but {reason}"))
        else:
            agreeing.append(row)
    return tuple(agreeing)


def _seconds(start: int, end: int, frames: int, before: float = 0.0) -> tuple[float, float]:
    """Returns seconds for a CSV: zero in both for a motion that begins its file and is whole."""
    whole = end - start == frames and before == 0
    return (0.0, 0.0) if whole else (before + start / FPS, before + end / FPS)


_FILLING, _DIRECTIONS = clauses.word_set("filling"), clauses.word_set("directions")
_MANNERS: Mapping[str, str] = clauses.TABLE["manners"]

# Base forms by forms of a verb.
_VERBS: Mapping[str, str] = {
    **dict(zip(clauses.VERBS, clauses.VERBS, strict=True)),
    **clauses.BASE_OF_THIRD,
    **clauses.BASE_OF_PARTICIPLE,
}


def captions_of_names(files: Iterable[str]) -> dict[str, str]:
    """Returns a caption for each file, by its path; empty where its name says nothing.

    `dataset-1_bow_angry_001` becomes "a person bows angrily". What all names share says nothing,
    nor do numbers and words such as `take`. The first verb makes a sentence; manners and
    directions follow it. Names without a verb stay words.

    Args:
        files: Paths of all files of a folder.
    """
    words: dict[str, list[str]] = {}
    for file in files:
        spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", PurePath(file).stem)
        parts = re.split(r"[\W\d_]+", spaced.lower())
        words[file] = [word for word in parts if len(word) > 1]
    shared = set.intersection(*map(set, words.values())) if len(words) > 1 else set()
    shared -= _VERBS.keys()  # of turn_left and turn_right, both turn
    if any(not set(row) - shared - _FILLING for row in words.values()):
        shared = set()  # names that differ by their numbers alone
    return {
        file: _sentence_of([word for word in row if word not in shared | _FILLING])
        for file, row in words.items()
    }


def _sentence_of(words: list[str]) -> str:
    at = next((number for number, word in enumerate(words) if word in _VERBS), None)
    if at is None:
        return " ".join(words)
    manners = [_MANNERS[word] for word in words if word in _MANNERS]
    behind = [word for word in words[:at] if word in _DIRECTIONS]
    behind += [word for word in words[at + 1 :] if word not in _MANNERS]
    for number, word in enumerate(behind[1:], 1):
        if behind[number - 1] in ("and", "then") and word in _VERBS:
            behind[number] = inflect(_VERBS[word], "third")
    return " ".join(
        filter(None, ["a person", inflect(_VERBS[words[at]], "third"), *behind, *manners])
    )


Row = tuple[str, int, int]  # A sentence, the first frame that it describes, and one past the last.

NEARLY_ALL = 0.8  # Share of a caption's frames that counts as all of them.

LONG_ENOUGH = 2.5  # Seconds in which a repeating movement can be recognized.

_REPEATING = re.compile(
    r"\b(?:danc|box(?:es|ing)|fight|karate|martial|swim|dribbl|exercis|play|wash|wip|stir|mop|sweep"
    r"|conduct|direct|juggl|swing(?:s|ing) (?:his|her|their|both|the)|sway|laugh|talk|row|paddl"
    r"|cycl|skat|march|jumping jack|stretch|practic|pretend|imitat"
    r"|act(?:s|ing)|wander|pac(?:es|ing)"
    r"|limp|stagger|sneak|strut|drum|guitar|violin|chop|saw|hammer"
    r"|cheer|protest|gestur)"
)
_CLAUSES = re.compile(r",|;|\. |\bthen\b|\band\b|\bbefore\b|\bafter\b|\bfollowed by\b|\bwhile\b")


@dataclass(frozen=True)
class Windows:
    """Number and length of the windows of a motion, and the number of their sentences."""

    count: int = 3  # Windows per motion.
    shortest: int = 20  # Frames of the shortest window.
    longest: int = 196  # Frames of the longest window.
    sentences: int = 2  # Measured sentences per window.
    whole: int = 2  # Measured sentences about the whole motion.


def caption_windows(
    joints: Float[np.ndarray, "frames 22 3"],
    captions: Sequence[Row],
    generator: np.random.Generator,
    windows: Windows = Windows(),
) -> list[Row]:
    """Returns sentences about a motion and about windows of it.

    Args:
        joints: As `describe` takes them.
        captions: Captions that it already has; these rows are not repeated.
        generator: Draws windows and wording.
        windows: Number and length of the windows.
    """
    frames = len(joints)
    rows: list[Row] = []
    if frames <= windows.longest and windows.whole:
        whole = describe(joints)
        rows += [(text, 0, frames) for text in sentences(whole, generator, count=windows.whole)]
    descriptions: dict[tuple[int, int], Description] = {}
    for start, end in draw_windows(frames, generator, windows):
        window = describe(joints[start:end])
        texts = sentences(window, generator, count=windows.sentences)
        for text, first, last in captions:
            if first <= start and end <= last and text not in texts:
                if (first, last) not in descriptions:
                    descriptions[first, last] = describe(joints[first:last])
                if holds(text, descriptions[first, last], window):
                    texts.append(text)
        rows += [(text, start, end) for text in texts]
    return rows


def draw_windows(
    frames: int, generator: np.random.Generator, windows: Windows
) -> list[tuple[int, int]]:
    """Draws different windows; the logarithm of their length is uniform."""
    longest = min(windows.longest, frames)
    if frames < 1.25 * windows.shortest:
        return []
    drawn: list[tuple[int, int]] = []
    for _ in range(windows.count):
        low, high = np.log(windows.shortest), np.log(longest)
        length = min(int(np.exp(generator.uniform(low, high)) + 0.5), longest)
        start = int(generator.integers(frames - length + 1))
        if (start, start + length) not in drawn and length < frames:
            drawn.append((start, start + length))
    return drawn


def holds(caption: str, whole: Description, part: Description) -> bool:
    """Says whether a caption of a motion is true of a part of it.

    Everything that the motion is found to do must be found in the part as well, with side, count
    and order. Words that cannot be measured are taken to hold if they describe a movement that
    repeats and the part is long enough, or if the part is nearly all of the motion.

    Args:
        caption: The sentence.
        whole: Description of the frames that the sentence is about.
        part: Description of some of them.
    """
    claims = claims_of(caption)
    of_whole, of_part = check_agreement(claims, whole), check_agreement(claims, part)
    if of_part.verdict == "contradicts":
        return False
    pairs = list(zip(of_whole.verdicts, of_part.verdicts, strict=True))
    if any(before == "agrees" and now != "agrees" for before, now in pairs):
        return False
    if part.frames >= NEARLY_ALL * whole.frames:
        return True
    if any(now != "agrees" for _, now in pairs):
        return False
    long_enough = part.seconds >= LONG_ENOUGH
    return all(
        long_enough if _REPEATING.search(clause) else len(clause.split()) < 3 or claims_of(clause)
        for clause in _CLAUSES.split(caption.lower())
    )
