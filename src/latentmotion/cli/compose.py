"""`latentmotion data compose`: synthetic sequences of two actions from a prepared folder."""

from __future__ import annotations

from dataclasses import dataclass

from latentmotion.cli.options import Folder, Output, Seed
from latentmotion.data.compose import Composition, compose
from latentmotion.data.compose_actions import compose_actions
from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.preparation import Preparation
from latentmotion.errors import InputError
from latentmotion.evaluation.instructions.prompts import refused_captions
from latentmotion.storage.files import check_replaceable


@dataclass(frozen=True)
class Compose:
    """Join single actions of the train split in pairs: "A, then B", for training only.

    Examples:
        latentmotion data compose data -o composed --count 500
        latentmotion data merge data composed -o everything
    """

    folder: Folder
    """Prepared folder."""
    output: Output
    """Prepared folder to write; it holds the sequences only."""
    count: int = 500
    """Number of sequences."""
    single: bool = False
    """Repeat single acts ("jump three times") and pair single actions found by measuring."""
    seed: Seed = 0

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
        check_replaceable(self.output, MANIFEST)
        dataset = Dataset.load(self.folder)
        if self.single:
            wanted = Composition(
                self.count,
                self.seed,
                seconds=(1.2, 9.8),
                refused_captions=refused_captions(),
            )
            composed = compose_actions(dataset, wanted)
        else:
            composed = compose(dataset, Composition(self.count, self.seed))
        preparation = Preparation(dataset.representation)
        preparation.motions.extend(composed.motions)
        left_out = ", ".join(f"{count} {why}" for why, count in composed.refused.most_common())
        note = f"{len(composed.motions)} sequences composed; refused: {left_out or 'none'}"
        report = preparation.write(self.output, (composed.source,), notes=(note,))
        print(report.text())
        print(f"wrote {self.output}")
