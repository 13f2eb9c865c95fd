"""HumanML3D's folder of captions, splits and the index that says what was cut from where.

    texts/ID.txt or texts.json.xz     captions by id; `M…` are those of mirrored copies
    train.txt, val.txt, test.txt      ids, one a line
    index.csv                         source_path,start_frame,end_frame,new_name (frames at 20 fps)

https://github.com/EricGuo5513/HumanML3D (MIT, captions included)
"""

from __future__ import annotations

import csv
import json
import lzma
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from latentmotion.data.captions import TaggedSentence, parse_sentences
from latentmotion.data.clip import SPLITS, Split
from latentmotion.errors import DataError

GET_IT = "get it from https://github.com/EricGuo5513/HumanML3D"

_COLUMNS = ("source_path", "start_frame", "end_frame", "new_name")


@dataclass(frozen=True)
class IndexRow:
    """One clip of HumanML3D."""

    id: str
    """Its name there."""
    path: str
    """The recording, as HumanML3D calls it."""
    start: int
    """First frame at 20 fps."""
    end: int
    """One past the last frame at 20 fps; -1 means to the end."""


def read_index(folder: Path) -> tuple[IndexRow, ...]:
    """Reads `index.csv`.

    Raises:
        DataError: It is missing, lacks a column or has something else than a number of frames.
    """
    path = folder / "index.csv"
    with _existing(path).open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        missing = [name for name in _COLUMNS if name not in (table.fieldnames or ())]
        if missing:
            raise DataError(
                f"{path}: lacks the column {', '.join(missing)}; found "
                f"{', '.join(table.fieldnames or ()) or 'nothing'}; {GET_IT}"
            )
        return tuple(_index_row(path, table.line_num, row) for row in table)


def read_splits(folder: Path) -> dict[str, Split]:
    """Reads which id belongs to which split.

    Raises:
        DataError: One of the three lists is missing, or all are empty.
    """
    splits: dict[str, Split] = {
        name: split
        for split in SPLITS
        for name in _existing(folder / f"{split}.txt").read_text(encoding="utf-8").split()
    }
    if not splits:
        raise DataError(f"{folder}: train.txt, val.txt and test.txt are empty; {GET_IT}")
    return splits


def read_texts(folder: Path) -> Mapping[str, str]:
    """Reads all caption files, by id.

    Raises:
        DataError: There are none, or the archive is damaged.
    """
    loose, archive = folder / "texts", folder / "texts.json.xz"
    if loose.is_dir():
        texts = {p.stem: p.read_text(encoding="utf-8") for p in sorted(loose.glob("*.txt"))}
    elif archive.is_file():
        texts = _read_archive(archive)
    else:
        raise DataError(
            f"{folder}: expected captions in texts/*.txt or texts.json.xz, found neither; {GET_IT} "
            "(unpack texts.zip)"
        )
    if not texts:
        raise DataError(f"{loose}: no .txt file in it; {GET_IT} (unpack texts.zip)")
    return texts


def sentences_of(texts: Mapping[str, str], name: str) -> tuple[TaggedSentence, ...]:
    """Returns the sentences of one id; none if it has no caption file."""
    return parse_sentences(texts.get(name, ""))


def _read_archive(path: Path) -> Mapping[str, str]:
    try:
        with lzma.open(path, "rt", encoding="utf-8") as file:
            texts = json.load(file)
    except (lzma.LZMAError, ValueError, EOFError, OSError) as error:
        raise DataError(f"{path} is damaged ({error}); copy it again") from error
    if not isinstance(texts, dict):
        raise DataError(f"{path}: expected captions by id, found a {type(texts).__name__}")
    return texts


def _index_row(path: Path, line: int, row: Mapping[str, str]) -> IndexRow:
    try:
        start, end = int(row["start_frame"]), int(row["end_frame"])
    except (TypeError, ValueError) as error:
        raise DataError(f"{path}:{line}: expected numbers of frames ({error}); {GET_IT}") from error
    return IndexRow(Path(row["new_name"]).stem, row["source_path"], start, end)


def _existing(path: Path) -> Path:
    if not path.parent.is_dir():
        raise DataError(f"no folder {path.parent}; it should hold HumanML3D's captions; {GET_IT}")
    if not path.is_file():
        raise DataError(f"{path.parent}: lacks {path.name}; {GET_IT}")
    return path
