"""Action labels as a condition: label k of n is the k-th unit vector, null is zero.

A denoiser's linear map without bias (`condition_projection="table"`) makes of it row k of a
learned table, and zero of null, as MLD's action embedding with its masked labels.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from latentmotion.condition.interface import Conditioning
from latentmotion.errors import InputError


@dataclass(frozen=True)
class ActionCondition:
    """The labels that a model knows."""

    labels: tuple[str, ...]
    """Names, in the order of the table's rows."""

    def __call__(self, inputs: Sequence[str]) -> Conditioning:
        """Returns one unit vector per label.

        Raises:
            InputError: A label is unknown.
        """
        rows = np.eye(len(self.labels), dtype=np.float32)[[self._place(label) for label in inputs]]
        return Conditioning(rows[:, None], np.ones((len(inputs), 1), dtype=bool))

    def null(self, count: int) -> Conditioning:
        """Returns `count` zero vectors."""
        tokens = np.zeros((count, 1, len(self.labels)), np.float32)
        return Conditioning(tokens, np.ones((count, 1), dtype=bool))

    def _place(self, label: str) -> int:
        if label not in self.labels:
            near = difflib.get_close_matches(label, self.labels, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(f"unknown action {label!r}; {hint}known are {', '.join(self.labels)}")
        return self.labels.index(label)
