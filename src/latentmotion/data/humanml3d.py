"""Official processed folders of HumanML3D and KIT-ML: features that their authors computed.

    new_joint_vecs/ID.npy   features (frames, 263 or 251); `M…` are mirrored copies
    texts/ID.txt            captions
    train.txt …             splits
    Mean.npy, Std.npy       statistics by which published models normalize

Only the recorded half is stored; mirrored copies are computed, and take their captions from here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from latentmotion.data.annotations import read_splits, read_texts, sentences_of
from latentmotion.data.captions import TaggedSentence, mirror_sentence
from latentmotion.data.clip import Source, Split
from latentmotion.data.manifest import StoredNormalizer
from latentmotion.data.recording import Dropped, EncodedRecording, Label
from latentmotion.data.store import stored_normalizer
from latentmotion.errors import DataError, InputError
from latentmotion.representation.normalizer import Normalizer

HUMANML3D = Source(
    name="humanml3d",
    license=(
        "captions: MIT, (c) 2022 Chuan Guo; motion: AMASS (non-commercial research) and "
        "HumanAct12, their owners' terms"
    ),
    credit=(
        "C. Guo et al.: Generating Diverse and Natural 3D Human Motions from Text, CVPR 2022; "
        "N. Mahmood et al.: AMASS, ICCV 2019"
    ),
    url="https://github.com/EricGuo5513/HumanML3D",
)

KIT = Source(
    name="kit",
    license="KIT Motion-Language dataset: its owners' terms",
    credit="M. Plappert, C. Mandery, T. Asfour: The KIT Motion-Language Dataset, Big Data 2016",
    url="https://motion-annotation.humanoids.kit.edu/dataset",
)

FEATURES = "new_joint_vecs"


def official_recordings(
    folder: Path, source: Source, width: int
) -> Iterator[EncodedRecording | Dropped]:
    """Yields every clip that is listed in a split; mirrored copies give only their captions.

    Args:
        folder: The processed folder.
        source: Which of the two it is.
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
    for name, split in sorted(splits.items()):
        if not name.startswith("M"):
            label = _label(name, split, source, texts)
            yield _read(folder / FEATURES / f"{name}.npy", label, width)


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
        normalizer = Normalizer(mean.astype(np.float32), std.astype(np.float32))
    except InputError as error:
        raise DataError(f"{folder}: Mean.npy and Std.npy hold {error}") from error
    return stored_normalizer(normalizer, "Mean.npy and Std.npy of the official folder")


def _label(name: str, split: Split, source: Source, texts: Mapping[str, str]) -> Label:
    sentences = sentences_of(texts, name)
    return Label(
        id=name,
        source=source.name,
        origin=f"{FEATURES}/{name}.npy",
        split=split,
        sentences=sentences,
        mirrored_sentences=_mirrored(texts, name, sentences),
    )


def _mirrored(
    texts: Mapping[str, str], name: str, sentences: tuple[TaggedSentence, ...]
) -> tuple[TaggedSentence, ...]:
    own = sentences_of(texts, f"M{name}")
    return own or tuple(mirror_sentence(sentence) for sentence in sentences)


def _read(path: Path, label: Label, width: int) -> EncodedRecording | Dropped:
    if not path.is_file():
        return Dropped(
            label.id, "clip", f"listed in {label.split}.txt, but there is no {path.name}"
        )
    features = _array(path)
    if features.ndim != 2 or features.shape[1] != width:
        raise DataError(
            f"{path}: features of the shape {features.shape}, expected (frames, {width}); "
            "HumanML3D has 263 and KIT-ML 251"
        )
    if not np.isfinite(features).all():
        return Dropped(label.id, "clip", "features that are not finite")
    return EncodedRecording(label, features.astype(np.float32))


def _array(path: Path) -> np.ndarray:
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"{path}: expected a NumPy array, found {error}; copy it again") from error
