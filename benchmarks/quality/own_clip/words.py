"""Content words of captions, and the number of clips that name them."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterable

from latentmotion.data.clip import Clip

_FUNCTION_WORDS = """
a an the this that these those someone somebody person persons people man woman human figure
individual subject sim he she they his her hers their its it him them himself herself themselves
themself you your yourself who which what i my is are was be been being am has have had do does
did doing done appears appear seems seem looks like as if to of in on at by for from with
without into onto over up down off out about and or but then after before while finally again
also there all both each other another one s t very just so whilst when where some same than not
n't they're perosn make makes making made way
"""

# Words that name no act, manner, side or thing.
FUNCTION_WORDS = frozenset(_FUNCTION_WORDS.split())


def content_words(caption: str) -> list[str]:
    """Returns the words of a caption that name something, in its order."""
    return [word for word in re.findall(r"[a-z']+", caption.lower()) if word not in FUNCTION_WORDS]


def clips_naming(clips: Iterable[Clip]) -> Counter[str]:
    """Returns how many clips have a caption with each content word."""
    return Counter(
        word
        for clip in clips
        for word in {w for caption in clip.captions for w in content_words(caption.text)}
    )


def rarest(caption: str, clips_of: Counter[str]) -> int:
    """Returns how many clips name the rarest content word of a caption; 0 for an unknown one."""
    return min((clips_of[word] for word in content_words(caption)), default=max(clips_of.values()))


def is_trained_on(caption: str) -> bool:
    """Returns whether a caption is in the half that the tower is trained on; the other is asked."""
    return hashlib.sha256(caption.lower().rstrip(".").encode()).digest()[0] % 2 == 0
