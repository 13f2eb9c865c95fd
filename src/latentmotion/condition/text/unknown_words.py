"""Words that an encoder never met: it reads them by their pieces, and says so."""

from __future__ import annotations

import warnings
from collections.abc import Iterable


class UnknownWordsWarning(UserWarning):
    """A sentence has words the encoder never met; it reads them by their pieces."""


def warn_of_unknown(words: Iterable[str]) -> None:
    """Warns of the words, each named once, where there are any."""
    named = ", ".join(repr(word) for word in dict.fromkeys(words))
    if named:
        warnings.warn(
            f"unknown to the text encoder, read by their pieces: {named}; "
            "another word for it may work better",
            UnknownWordsWarning,
            stacklevel=4,
        )
