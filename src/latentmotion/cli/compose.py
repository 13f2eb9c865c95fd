"""`latentmotion data compose`: synthetic sequences of two actions from a prepared folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from latentmotion.data.compose import Composition, compose
from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.preparation import Preparation
from latentmotion.errors import InputError
from latentmotion.storage.files import check_replaceable


@dataclass(frozen=True)
class Compose:
    """Join single actions of the train split in pairs: "A, then B", for training only.

    Examples:
        latentmotion data compose data -o composed --count 500
        latentmotion data merge data composed -o everything
    """

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")]
    """A prepared folder."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """The prepared folder to write; it holds the sequences alone."""
    count: int = 500
    """How many sequences are wanted."""
    seed: int = 0
    """Seed of every choice."""

    def run(self) -> None:
        """Composes, writes the folder and prints what came of it.

        Raises:
            DataError: The folder holds no clips that could be joined.
            InputError: The count or the seed is no number to count with.
        """
        if self.count < 1 or self.seed < 0:
            raise InputError(
                f"count {self.count}, seed {self.seed}; expected at least 1 and at least 0"
            )
        check_replaceable(self.out, MANIFEST)
        dataset = Dataset.load(self.folder)
        composed = compose(dataset, Composition(self.count, self.seed))
        preparation = Preparation(dataset.representation)
        preparation.motions.extend(composed.motions)
        left_out = ", ".join(f"{count} {why}" for why, count in composed.refused.most_common())
        note = f"{len(composed.motions)} sequences composed; refused: {left_out or 'none'}"
        report = preparation.write(self.out, (composed.source,), notes=(note,))
        print(report.text())
        print(f"wrote {self.out}")
