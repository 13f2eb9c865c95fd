"""`latentmotion train length`: how long a sentence's movement takes, where no length is given."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.cli.train import Output, text_encoder_named


@dataclass(frozen=True)
class TrainLength:
    """Trains on captions and the lengths of their motions, a minute or two on one core.

    `latentmotion export --length FILE` takes the result into a model's folder.
    """

    captions: Path
    """HumanML3D's folder, with texts, index.csv, train.txt, val.txt and test.txt."""
    output: Output
    """File to write, e.g. lengths.safetensors."""
    data: Path | None = None
    """Prepared folder whose training captions and spans are learned from as well."""
    text_encoder: str = "starter"
    """As for `latentmotion train denoiser`: the one that the model reads sentences with."""
    seed: int = 0
    """The same seed, the same file."""

    def run(self) -> None:
        """Trains, writes the file and says how well it does on the split `test`.

        Raises:
            DataError: A file of the captions or of the prepared folder is missing or damaged.
            InputError: The output cannot be written.
            ModelError: The text encoder cannot be loaded.
        """
        import warnings

        import numpy as np

        from latentmotion.condition.text.lengths import LengthModel
        from latentmotion.condition.text.unknown_words import UnknownWordsWarning
        from latentmotion.data.dataset import Dataset
        from latentmotion.data.lengths import (
            joined,
            prepared_caption_lengths,
            read_caption_lengths,
        )
        from latentmotion.errors import InputError
        from latentmotion.storage.files import check_writable
        from latentmotion.training.lengths import LengthRecipe, measured, train_lengths

        if self.output.is_dir():
            raise InputError(f"cannot write {self.output}: it is a folder; name a file")
        check_writable(self.output)
        warnings.simplefilter("ignore", UnknownWordsWarning)  # captions have typing errors
        encoder = text_encoder_named(self.text_encoder)
        train, test = (read_caption_lengths(self.captions, name) for name in ("train", "test"))
        if self.data:
            train = joined([train, prepared_caption_lengths(Dataset.load(self.data), "train")])
        train_lengths(train, encoder, LengthRecipe(seed=self.seed)).write(self.output)
        model = LengthModel.read(self.output)  # as it was rounded
        told = measured(model, test, encoder, float(np.median(train.seconds)))
        print(
            f"wrote {self.output}: learned from {len(train.sentences):,} sentences; off by "
            f"{told.mae:.2f} s on {told.sentences:,} of the test split ({told.constant_mae:.2f} s, "
            f"had all the same length), {told.inside:.0%} between the outer quantiles"
        )
