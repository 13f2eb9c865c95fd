"""The T2M code's word vectors: `our_vab_data.npy`, and two pickles that say which row is whose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, ModelError
from latentmotion.evaluation.extractors.tokens import END, START
from latentmotion.evaluation.extractors.word_vectors import UNKNOWN, GloveWords
from latentmotion.storage import pickles

VECTORS, WORDS, NUMBERS = "our_vab_data.npy", "our_vab_words.pkl", "our_vab_idx.pkl"


def read_glove(folder: str | Path) -> GloveWords:
    """Reads the three files of the T2M code's `glove` folder.

    Raises:
        ModelError: A file is missing.
        FileFormatError: A file is damaged, holds more than words, or does not fit the others.
    """
    folder = Path(folder)
    missing = [name for name in (VECTORS, WORDS, NUMBERS) if not (folder / name).is_file()]
    if missing:
        raise ModelError(
            f"{folder} lacks {', '.join(missing)}; pass the `glove` folder that the T2M code "
            "distributes"
        )
    vectors = _vectors(folder / VECTORS)
    words, numbers = _plain(folder / WORDS, list), _plain(folder / NUMBERS, dict)
    _check(folder, words, numbers, vectors)
    return GloveWords(tuple(words), vectors[[numbers[word] for word in words]])


def _vectors(path: Path) -> Float[np.ndarray, "words width"]:
    try:
        vectors = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise FileFormatError(path, f"no readable array: {error}; download it again") from error
    if vectors.ndim != 2 or not np.issubdtype(vectors.dtype, np.floating):
        found = f"{vectors.dtype} of shape {vectors.shape}"
        raise FileFormatError(path, f"found {found}, expected one vector of numbers per word")
    return vectors.astype(np.float32)


def _plain(path: Path, kind: type) -> Any:
    content = pickles.load(path)
    if not isinstance(content, kind):
        raise FileFormatError(path, f"found a {type(content).__name__}, expected {kind.__name__}")
    return content


def _check(
    folder: Path, words: list[Any], numbers: dict[Any, Any], vectors: Float[np.ndarray, "_ _"]
) -> None:
    if not all(isinstance(word, str) for word in words):
        raise FileFormatError(folder / WORDS, "something that is no word; download it again")
    lacking = [word for word in (START.word, END.word, UNKNOWN) if word not in words]
    if lacking:
        raise FileFormatError(folder / WORDS, f"lacks the words {', '.join(lacking)}")
    rows = range(len(vectors))
    lost = next((word for word in words if numbers.get(word) not in rows), None)
    if lost is not None:
        raise FileFormatError(
            folder / NUMBERS,
            f"{lost!r} has no row among the {len(vectors)} of {VECTORS}; the three files "
            "belong together: download them again",
        )
