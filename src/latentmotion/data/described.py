"""Sentences measured from the motions of a prepared folder, or of a folder of motion files.

In the train split each clip gets sentences about itself and about parts of random length and
place; its own captions go with the parts of which they are still true. Clips of val and test keep
their captions, and get measured ones only where they have none.
"""

from __future__ import annotations

import csv
import hashlib
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.captions import TaggedSentence, fit_sentences, mirror_words
from latentmotion.data.clip import Caption
from latentmotion.data.contradictions import contradiction, without_contradicted
from latentmotion.data.dataset import Dataset
from latentmotion.data.encoding import encode_all
from latentmotion.data.manifest import MANIFEST, CaptionRow, StoredClip
from latentmotion.data.own import FPS, OwnMotions
from latentmotion.data.recording import Dropped
from latentmotion.data.report import REPORT, Report, parts_of
from latentmotion.data.rewording import reworded_captions
from latentmotion.data.singles import Balance, balanced_singles, single_rows, with_prompts
from latentmotion.describe.prompting import plain
from latentmotion.describe.reading import describe
from latentmotion.describe.sentences import plain_action, sentences
from latentmotion.describe.windows import Row, Windows, caption_windows
from latentmotion.errors import DataError
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.storage.files import atomic_file, atomic_folder

COLUMNS = ("file", "caption", "from", "to")
"""What `data prepare own --captions` reads."""

PROMPTS = 4
"""Prompts of each window that shows a single action."""

LONGEST_FILE = 200
"""Frames of the longest motion file that is described whole; longer ones in parts."""


@dataclass(frozen=True)
class FileRow:
    """One line of a CSV of captions."""

    file: str
    """A motion file's path in its folder, or a clip's name."""
    caption: str
    """A sentence."""
    start: float
    """Seconds; zero in both means the whole motion."""
    end: float
    """Seconds."""


def describe_folder(
    folder: str | Path,
    out: str | Path,
    windows: Windows,
    seed: int = 0,
    rewordings: int = 0,
    check: bool = False,
    single: int = 0,
    refused_captions: frozenset[str] = frozenset(),
) -> Report:
    """Adds measured sentences to a prepared folder.

    Args:
        folder: A prepared folder of HumanML3D features.
        out: The folder to write; features and normalizer are copied as they are.
        windows: How many parts per clip, and how many sentences.
        seed: What draws parts and wording; each clip draws for itself.
        rewordings: How often each caption of the train split is said in other words.
        check: Whether captions of the train split that the motion contradicts are left out.
        single: Most windows of one category of single action that get prompts; zero is none.
        refused_captions: Sentences of a test set, as `prompting.plain` writes them, which no
            caption of the train split may be.

    Raises:
        DataError: The folder is not a prepared one, or of another representation.
        InputError: The folder cannot be written.
    """
    dataset, refused = _loaded(folder, check)
    clips = tuple(described_clips(dataset, windows, seed, rewordings))
    if single:
        found = balanced_singles(dataset, seed, Balance(single))
        rows = single_rows(found, seed, PROMPTS)
        clips = tuple(with_prompts(clip, rows) for clip in clips)
    clips = tuple(without_captions(clip, refused_captions) for clip in clips)
    manifest = replace(dataset.manifest, clips=clips)
    path = dataset.folder / REPORT
    old = read_json(Report, path) if path.is_file() else Report((), (), None)
    added = sum(len(clip.captions) for clip in clips)
    added -= sum(len(clip.captions) for clip in dataset.manifest.clips)
    note = f"{added} captions measured from the motion (latentmotion data describe, seed {seed})"
    report = replace(old, parts=parts_of(manifest), dropped=(*old.dropped, *refused))
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
    kept, mirrored = (
        tuple(row for row in rows if plain(row[0]) not in refused)
        for rows in (clip.captions, clip.mirrored_captions)
    )
    return replace(clip, captions=kept, mirrored_captions=mirrored)


def described_clips(
    dataset: Dataset, windows: Windows, seed: int, rewordings: int = 0
) -> Iterator[StoredClip]:
    """Yields the clips of a prepared folder of HumanML3D's features with measured sentences."""
    for clip in dataset.manifest.clips:
        if clip.split != "train" and clip.captions:
            yield clip
            continue
        joints = dataset.representation.decode(dataset.features(clip.clip()))
        generator = _generator(seed, clip.id)
        if clip.split == "train":
            own = [Caption(*row) for row in clip.captions]
            new = reworded_captions(own, generator, rewordings)
            known, reworded = (
                [(c.text, c.start_frame, c.end_frame) for c in captions] for captions in (own, new)
            )
            rows = [
                *reworded,
                *caption_windows(joints, [*known, *reworded], generator, windows),
            ]
        else:
            whole = describe(joints)
            rows = [(text, 0, clip.frames) for text in sentences(whole, generator, count=3)]
        yield _with_rows(clip, rows)


def describe_files(
    motions: OwnMotions, seed: int = 0, check: bool = False, names: bool = False
) -> list[FileRow | Dropped]:
    """Describes motion files; what `data prepare` would drop comes with the reason.

    Sentences in text files beside the motions stay, before the measured ones.

    Args:
        motions: The files.
        seed: What draws the wording.
        check: Whether sentences beside a motion that it contradicts are left out.
        names: Whether a file's name (`wave_hello_02.bvh`) says what it shows; a name that the
            motion contradicts is left out.

    Raises:
        DataError: There is no such folder or no motion file in it.
    """
    out: list[FileRow | Dropped] = []
    for item in encode_all(motions.recordings(), HUMANML3D_FEATURES):
        if isinstance(item, Dropped):
            out.append(item)
            continue
        joints = HUMANML3D_FEATURES.decode(item.features)
        file = item.label.origin
        out += _known_rows(file, joints, item.label.sentences, check)
        action = plain_action(Path(file).stem) if names else ""
        if action and (reason := contradiction(action, joints)):
            out.append(Dropped(item.label.id, "caption", f"name {action!r}, but {reason}"))
            action = ""
        out += _file_rows(file, joints, _generator(seed, item.label.id), action)
    return out


def write_captions(path: str | Path, rows: Iterable[FileRow]) -> None:
    """Writes a CSV that `data prepare own --captions` reads.

    Raises:
        InputError: The file cannot be written.
    """
    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for row in rows:
            part = ("", "") if row.start == row.end == 0 else (f"{row.start:g}", f"{row.end:g}")
            table.writerow((row.file, row.caption, *part))


def folder_rows(
    folder: str | Path, windows: Windows, seed: int, rewordings: int = 0, check: bool = False
) -> list[FileRow | Dropped]:
    """Returns the captions that `describe_folder` would write, and what it would leave out."""
    dataset, refused = _loaded(folder, check)
    rows = [
        FileRow(clip.id, text, *_span(start, end, clip.frames))
        for clip in described_clips(dataset, windows, seed, rewordings)
        for text, start, end, _ in clip.captions
    ]
    return [*refused, *rows]


def _loaded(folder: str | Path, check: bool) -> tuple[Dataset, tuple[Dropped, ...]]:
    """Opens a prepared folder of HumanML3D's features, without contradicted captions if asked.

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


def _known_rows(
    file: str,
    joints: Float[np.ndarray, "frames 22 3"],
    known: tuple[TaggedSentence, ...],
    check: bool,
) -> Iterator[FileRow | Dropped]:
    """Yields the sentences that lie beside a motion, or why one is left out."""
    captions, reasons = fit_sentences(known, len(joints))
    yield from (Dropped(file, "caption", reason) for reason in reasons)
    for caption in captions:
        start, end = caption.start_frame, caption.end_frame
        if check and (reason := contradiction(caption.text, joints[start:end])):
            yield Dropped(file, "caption", f"{caption.text!r}, but {reason}")
        else:
            yield FileRow(file, caption.text, *_span(start, end, len(joints)))


def _file_rows(
    file: str,
    joints: Float[np.ndarray, "frames 22 3"],
    generator: np.random.Generator,
    action: str = "",
) -> list[FileRow]:
    """Files longer than a clip are described in parts of equal length."""
    frames = len(joints)
    parts = -(-frames // LONGEST_FILE)
    edges = np.linspace(0, frames, parts + 1).astype(int).tolist()
    out = []
    for start, end in pairwise(edges):
        texts = sentences(describe(joints[start:end]), generator, action or None, count=3)
        out += [FileRow(file, text, *_span(start, end, frames)) for text in texts]
    return out


def _span(start: int, end: int, frames: int) -> tuple[float, float]:
    """Returns seconds as a CSV has them: zero in both for the whole motion."""
    return (0.0, 0.0) if end - start == frames else (start / FPS, end / FPS)


def _with_rows(clip: StoredClip, rows: list[Row]) -> StoredClip:
    added: tuple[CaptionRow, ...] = tuple((*row, "") for row in rows)
    mirrored = tuple((mirror_words(text), start, end, "") for text, start, end in rows)
    return replace(
        clip,
        captions=(*clip.captions, *added),
        mirrored_captions=(*clip.mirrored_captions, *mirrored),
    )


def _generator(seed: int, name: str) -> np.random.Generator:
    number = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
    return np.random.default_rng([seed, number])
