"""HumanML3D and KIT-ML: captions, splits and index, and official processed folders.

    texts/ID.txt or texts.json.xz     captions by id; `M…` are those of mirrored copies
    train.txt, val.txt, test.txt      ids, one a line
    index.csv                         source_path,start_frame,end_frame,new_name (frames at 20 fps)

An official processed folder also has features that the authors computed:

    new_joint_vecs/ID.npy   features (frames, 263 or 251); `M…` are mirrored copies
    Mean.npy, Std.npy       statistics by which published models normalize

Of the train split only the recorded half is stored; mirrored copies are computed, and take their
captions from here. Mirrored ids of val and test are stored with the authors' own features, since
the papers' test sets have them.

https://github.com/EricGuo5513/HumanML3D (MIT, captions included)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from latentmotion.data import clip
from latentmotion.data.recording import Dropped, EncodedRecording, Label
from latentmotion.data.sources import OWNERS
from latentmotion.data.store import OFFICIAL_FEATURES, StoredNormalizer, stored_normalizer
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.progress import counted
from latentmotion.representation.interface import Normalizer
from latentmotion.storage.array_files import read_array
from latentmotion.storage.reading import parse_json, read_table, read_text, unpack_xz

GET_IT = "get it from https://github.com/EricGuo5513/HumanML3D"

HUMANML3D = OWNERS["humanml3d"]

KIT = OWNERS["kit"]

FEATURES = OFFICIAL_FEATURES

_COLUMNS = ("source_path", "start_frame", "end_frame", "new_name")


@dataclass(frozen=True)
class IndexRow:
    """One clip of HumanML3D."""

    id: str  # Its name there.
    path: str  # The recording, as HumanML3D calls it.
    start: int  # First frame at 20 fps.
    end: int  # One past the last frame at 20 fps; -1 means to the end.


def read_index(folder: Path) -> tuple[IndexRow, ...]:
    """Reads `index.csv`.

    Raises:
        DataError: It is missing, lacks a column or has something else than a number of frames.
    """
    path = folder / "index.csv"
    rows = []
    try:
        table = read_table(_existing(path), _COLUMNS)
    except FileFormatError as error:
        raise DataError(f"{error}; {GET_IT}") from error
    for line, row in table:
        try:
            start, end = int(row["start_frame"]), int(row["end_frame"])
        except ValueError as error:
            raise DataError(
                f"{path}:{line}: expected numbers of frames ({error!s:.80}); {GET_IT}"
            ) from error
        rows.append(IndexRow(Path(row["new_name"]).stem, row["source_path"], start, end))
    return tuple(rows)


def read_splits(folder: Path) -> dict[str, clip.Split]:
    """Reads which id belongs to which split.

    Raises:
        DataError: One of the three lists is missing, or all are empty.
    """
    splits: dict[str, clip.Split] = {
        name: split
        for split in clip.SPLITS
        for name in read_text(_existing(folder / f"{split}.txt")).split()
    }
    if not splits:
        raise DataError(f"{folder}: train.txt, val.txt and test.txt are empty; {GET_IT}")
    return splits


def read_texts(folder: Path) -> Mapping[str, str]:
    """Reads all caption files, by id.

    Raises:
        DataError: There are none, or the archive holds something else.
        FileFormatError: A file is damaged.
    """
    loose, archive = folder / "texts", folder / "texts.json.xz"
    if loose.is_dir():
        texts = {p.stem: read_text(p) for p in sorted(loose.glob("*.txt"))}
    elif archive.is_file():
        texts = parse_json(unpack_xz(archive), archive)
        is_texts = isinstance(texts, dict) and all(isinstance(t, str) for t in texts.values())
        if not is_texts:
            kind = type(texts).__name__
            raise DataError(f"{archive}: expected captions by id, found a {kind} of others")
    else:
        raise DataError(
            f"{folder}: expected captions in texts/*.txt or texts.json.xz, found neither; {GET_IT} "
            "(unpack texts.zip)"
        )
    if not texts:
        raise DataError(f"{loose}: no .txt file in it; {GET_IT} (unpack texts.zip)")
    return texts


def sentences_of(texts: Mapping[str, str], name: str) -> tuple[clip.TaggedSentence, ...]:
    """Returns the sentences of one id; none if it has no caption file."""
    return clip.parse_sentences(texts.get(name, ""))


def official_recordings(
    folder: Path, source: clip.Source, width: int
) -> Iterator[EncodedRecording | Dropped]:
    """Yields every clip that is listed in a split; mirrored ones of `train` only as captions.

    Args:
        folder: The processed folder.
        source: HumanML3D or KIT-ML.
        width: Features per frame.

    Raises:
        DataError: The folder lacks something, or its features are of another width.
    """
    if not (folder / FEATURES).is_dir():
        raise DataError(
            f"{folder}: expected {FEATURES}, texts, train.txt, val.txt, test.txt, Mean.npy and "
            f"Std.npy, found no {FEATURES}; follow {source.url}"
        )
    splits, texts = read_splits(folder), read_texts(folder)
    for name, split in counted(sorted(splits.items()), "clips"):
        if name.startswith("M") and split == "train":
            continue
        sentences = sentences_of(texts, name)
        label = Label(
            id=name,
            source=source.name,
            origin=f"{FEATURES}/{name}.npy",
            split=split,
            sentences=sentences,
            mirrored_sentences=sentences_of(texts, f"M{name}")
            or tuple(map(clip.mirror_sentence, sentences)),
        )
        path = folder / FEATURES / f"{name}.npy"
        if not path.is_file():
            yield Dropped(name, "clip", f"listed in {split}.txt, but there is no {path.name}")
            continue
        features = _array(path)
        if features.ndim != 2 or features.shape[1] != width:
            raise DataError(
                f"{path}: features of the shape {features.shape}, expected (frames, {width}); "
                "HumanML3D has 263 and KIT-ML 251"
            )
        with np.errstate(over="ignore"):
            features = features.astype(np.float32)
        if np.isfinite(features).all():
            yield EncodedRecording(label, features)
        else:
            yield Dropped(name, "clip", "features that are not finite")


def official_normalizer(folder: Path, width: int) -> StoredNormalizer:
    """Returns the statistics that come with a processed folder.

    Raises:
        DataError: They are missing, damaged or of another width.
    """
    mean, std = (_array(folder / name) for name in ("Mean.npy", "Std.npy"))
    if mean.shape != (width,) or std.shape != (width,):
        raise DataError(
            f"{folder}: Mean.npy and Std.npy have the shapes {mean.shape} and {std.shape}, "
            f"expected ({width},); is it the other data set's?"
        )
    try:
        with np.errstate(over="ignore"):
            normalizer = Normalizer(mean.astype(np.float32), std.astype(np.float32))
    except InputError as error:
        raise DataError(f"{folder}: Mean.npy and Std.npy hold {error}") from error
    return stored_normalizer(normalizer, "Mean.npy and Std.npy of the official folder")


def _existing(path: Path) -> Path:
    if not path.parent.is_dir():
        raise DataError(f"no folder {path.parent}; it should hold HumanML3D's captions; {GET_IT}")
    if not path.is_file():
        raise DataError(f"{path.parent}: lacks {path.name}; {GET_IT}")
    return path


def _array(path: Path) -> np.ndarray:
    try:
        array = read_array(path)
    except FileFormatError as error:
        raise DataError(f"{path}: expected a NumPy array, found {error}; copy it again") from error
    if array.dtype.kind not in "fiu":
        raise DataError(f"{path}: expected numbers, found {array.dtype}; copy it again")
    return array
