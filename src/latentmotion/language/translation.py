"""Prompts in other languages: short ones about known acts, by the table `languages.tsv`.

A sentence is read from left to right, the longest entry of a language first; `*` stands for any
ending. Each act takes the way, manner, count and part of the body that are told with it, and
becomes an English clause. What no entry has is reported. Languages are named as ISO 639-1 does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files

from latentmotion.language.acts import mentions
from latentmotion.language.words import tokens_of

# Languages whose entries are found within words.
_WITHOUT_SPACES = ("zh", "ja", "ko")

# Languages in which what is told of an act comes before it.
_VERB_LAST = ("ja", "ko")

# Share of a sentence that a language's entries cover, from which the sentence is of it.
_LEAST = 0.6

# Characters of a sentence beyond which it is not read.
_LONGEST = 300

# Acts that move a part of the body; others are done with it.
_TAKES_OBJECT = ("raises", "waves")


# What ends a clause.
_STOPS = ",;，、；"

# What stands between words; the empty text, after the last one, too.
_BETWEEN = f" '-{_STOPS}"


@dataclass(frozen=True)
class Translation:
    """A sentence of another language as it was understood."""

    english: str  # What was understood.
    language: str  # ISO 639-1.
    left: tuple[str, ...]  # What was not understood.

    def __str__(self) -> str:
        note = f'understood: "{self.english}"'
        return f"{note}; not understood: {', '.join(self.left)}" if self.left else note


@dataclass(frozen=True)
class _Piece:
    role: str
    english: str
    length: int


_Entries = dict[str, list[tuple[str, str, str]]]


@cache
def _table() -> dict[str, _Entries]:
    """Returns entries with their role and English, by language and first letter, longest first."""
    text = files("latentmotion.language").joinpath("languages.tsv").read_text(encoding="utf-8")
    header, *rows = [line.split("\t") for line in text.splitlines()]
    tables: dict[str, _Entries] = {language: {} for language in header[2:]}
    for english, role, *cells in rows:
        for entries, cell in zip(tables.values(), cells, strict=True):
            for entry in filter(None, cell.split("|")):
                entries.setdefault(entry[0], []).append((entry, role, english))
    for entries in tables.values():
        for same in entries.values():
            same.sort(key=lambda entry: len(entry[0]), reverse=True)
    return tables


@lru_cache(maxsize=1024)
def in_english(sentence: str) -> Translation | None:
    """Returns a sentence of another language in English; None where it is English, or unknown."""
    if len(sentence) > _LONGEST or mentions(tokens_of(sentence)):
        return None
    plain = " ".join(sentence.lower().replace("’", "'").split()).strip(" .!?。！？")
    best: tuple[float, Translation] | None = None
    for language in _table():
        pieces = list(_pieces(plain, language))
        clauses = _clauses(pieces, language in _VERB_LAST)
        left = tuple(piece.english for piece in pieces if piece.role == "left")
        covered = sum(piece.length for piece in pieces if piece.role != "left")
        share = covered / max(sum(piece.length for piece in pieces), 1)
        if clauses and share >= _LEAST and (best is None or share > best[0]):
            best = share, Translation(f"a person {', then '.join(clauses)}", language, left)
    return best and best[1]


def _pieces(text: str, language: str) -> Iterator[_Piece]:
    """Yields the entries of a sentence in order, and the words between them."""
    inside, at = language in _WITHOUT_SPACES, 0
    while at < len(text):
        if text[at] in _BETWEEN:
            if text[at] in _STOPS:
                yield _Piece("link", "then", 0)
            at += 1
            continue
        for entry, role, english in _table()[language].get(text[at], ()):
            end = _end(entry, text, at, inside)
            if end:
                yield _Piece(role, english, end - at)
                at = end
                break
        else:
            end = at + 1 if inside else _word_end(text, at)
            word = text[at:end]
            # Endings of verbs, and particles, which are written in these letters.
            ending = inside and ("ぁ" <= word <= "ん" or "가" <= word <= "힣")
            yield _Piece("filler" if ending else "left", word, end - at)
            at = end


def _end(entry: str, text: str, at: int, inside: bool) -> int:
    """Returns where an entry that begins at a place ends; 0 where another text is."""
    for number, word in enumerate(entry.split()):
        if number:
            at += len(text[at:]) - len(text[at:].lstrip(" '"))
        stem = word.rstrip("*")
        if not text.startswith(stem, at):
            return 0
        end = at + len(stem)
        if word.endswith("*"):
            end = _word_end(text, end)
        elif not (inside or stem.endswith("'") or text[end : end + 1] in _BETWEEN):
            return 0
        at = end
    return at


def _word_end(text: str, at: int) -> int:
    while at < len(text) and text[at] not in _BETWEEN:
        at += 1
    return at


def _clauses(pieces: list[_Piece], verb_last: bool) -> list[str]:
    """Returns an English clause for each act."""
    groups: list[dict[str, str]] = [{}]
    for piece in pieces:
        group = groups[-1]
        new = piece.role == "act" and "act" in group
        new |= piece.role == "link" and "act" in group
        new |= verb_last and "act" in group and piece.role in ("way", "manner", "count", "object")
        if new:
            groups.append(group := {})
        if piece.role == "way" and piece.english not in group.get("way", ""):
            group["way"] = f"{group.get('way', '')} {piece.english}".strip()  # sideways to the left
        elif piece.role in ("act", "manner", "count", "object"):
            group.setdefault(piece.role, piece.english)
    clauses = []
    for group in groups:
        if "act" not in group:
            if clauses and group:  # what is told after a comma
                clauses[-1] += " " + " ".join(group.values())
            continue
        act, part = group["act"], group.get("object", "")
        if part and act not in _TAKES_OBJECT:
            part = f"with {part}"
        words = (act, part, group.get("way"), group.get("manner"), group.get("count"))
        clauses.append(" ".join(word for word in words if word))
    return clauses
