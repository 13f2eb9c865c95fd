"""Sentences as the T2M evaluator reads them: words with parts of speech, keywords with classes.

A word of one of five keyword lists has that list's class instead of its part of speech. At most
20 words count; `sos` and `eos` stand around them. The lists are those of the T2M code (MIT).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from latentmotion.data.clip import Caption

MAX_WORDS = 20
"""Words of a sentence that count."""

OTHER = "OTHER"
"""Part of speech of all that has none."""

KEYWORDS = {
    "Loc_VIP": "left right clockwise counterclockwise anticlockwise forward back backward up down "
    "straight curve",
    "Body_VIP": "arm chin foot feet face hand mouth leg waist eye knee shoulder thigh",
    "Obj_VIP": "stair dumbbell chair window floor car ball handrail baseball basketball",
    "Act_VIP": "walk run swing pick bring kick put squat throw hop dance jump turn stumble stop "
    "sit lift lower raise wash stand kneel stroll rub bend balance flap jog shuffle lean rotate "
    "spin spread climb",
    "Desc_VIP": "slowly carefully fast careful slow quickly happy angry sad happily angrily sadly",
}
"""Words by the class that they are put in."""

PARTS_OF_SPEECH = (
    *("VERB", "NOUN", "DET", "ADP", "NUM", "AUX", "PRON", "ADJ", "ADV"),
    *KEYWORDS,
    OTHER,
)
"""All classes, in the order of the network's input."""

_CLASS_OF = {word: name for name, words in KEYWORDS.items() for word in words.split()}

_WORD = re.compile(r"[a-z]+|[0-9]+")
_ENDINGS = (("s", ""), ("es", ""), ("ies", "y"), ("ing", ""), ("ing", "e"), ("ed", ""), ("ed", "e"))


@dataclass(frozen=True)
class Token:
    """A word and what kind it is."""

    word: str
    """In small letters; in its base form where it was tagged."""
    part: str
    """Its part of speech, as spaCy names it."""
    tagged: bool = True
    """Whether the data set gave it; else it was cut out of the sentence here."""


START, END = Token("sos", OTHER), Token("eos", OTHER)


def tokens_of(caption: Caption) -> list[Token]:
    """Returns the words of a caption between `sos` and `eos`.

    A caption without tags is cut into its words, each of part of speech OTHER.
    """
    words = _tagged(caption.tokens) if caption.tokens else _plain(caption.text)
    return [START, *words[:MAX_WORDS], END]


def class_of(token: Token) -> int:
    """Returns the number of a token's class in `PARTS_OF_SPEECH`."""
    name = _CLASS_OF.get(token.word, token.part)
    return PARTS_OF_SPEECH.index(name if name in PARTS_OF_SPEECH else OTHER)


def base_forms(word: str) -> list[str]:
    """Returns a word and what it may be a form of, likeliest first."""
    stems = [(word.removesuffix(end), new) for end, new in _ENDINGS if word.endswith(end)]
    return [word, *(form for stem, new in stems for form in _forms(stem, new))]


def _forms(stem: str, new: str) -> list[str]:
    doubled = not new and len(stem) > 2 and stem[-1] == stem[-2]
    return [stem + new, *([stem[:-1]] if doubled else [])]


def _tagged(tokens: str) -> list[Token]:
    pairs = (token.rpartition("/") for token in tokens.split())
    return [Token(word, part) for word, _, part in pairs if word]


def _plain(text: str) -> list[Token]:
    return [Token(word, OTHER, tagged=False) for word in _WORD.findall(text.lower())]
