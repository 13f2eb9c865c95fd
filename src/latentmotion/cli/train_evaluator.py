"""`latentmotion train evaluator`: the networks that FID and R-precision look through.

The same command again goes on where a killed run was.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from latentmotion.cli.train import Changes, Output, text_encoder_named
from latentmotion.errors import InputError

if TYPE_CHECKING:
    from latentmotion.evaluation.extractors.word_vectors import WordVectors


@dataclass(frozen=True)
class TrainEvaluator:
    """Trains an evaluator of text and motion and writes it to OUTPUT/model.

    Words are read as GloVe vectors (--glove), or through a text encoder (--text-encoder).
    """

    data: Path
    """Folder that `latentmotion data prepare` made, with captions."""
    output: Output
    """Run folder; one that exists is gone on with."""
    glove: Path | None = None
    """Folder of the T2M code's our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl."""
    text_encoder: str | None = None
    """Folder of a text encoder, name of a model whose encoder is used, or minilm, clip_hidden,
    distilbert, sentence_t5 or t5; starter where nothing is said."""
    preset: str = "t2m"
    """Sizes to start from: t2m (the official ones) or small (for some hundred clips)."""
    set: Changes = ()
    """Change one value of it, e.g. training.steps=1000; may be given several times."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""

    def run(self) -> None:
        """Trains until done."""
        from latentmotion.evaluation.extractors.recipe import recipe_named
        from latentmotion.experiment import with_changes
        from latentmotion.training.devices import training_place
        from latentmotion.training.evaluators import train_evaluator

        experiment = with_changes(recipe_named(self.preset), self.set)
        vectors, encoder = self._words()
        with training_place(self.device) as place:
            print(train_evaluator(experiment, self.data, vectors, self.output, place, encoder))

    def _words(self) -> tuple[WordVectors, Path | None]:
        """Returns the word vectors, and the folder of the text encoder where it can be copied."""
        from latentmotion.condition.text.cache import CachedTextEncoder
        from latentmotion.condition.text.student import StudentTextEncoder
        from latentmotion.evaluation.extractors.glove import read_glove
        from latentmotion.evaluation.extractors.word_vectors import EncodedWords
        from latentmotion.model.folder import find_model

        if self.glove and self.text_encoder:
            raise InputError("--glove and --text-encoder exclude each other: pass one of them")
        if self.glove:
            return read_glove(self.glove), None
        name = self.text_encoder or "starter"
        encoder = text_encoder_named(name)
        small = isinstance(encoder, StudentTextEncoder)
        cached = CachedTextEncoder(encoder, self.output / "text")
        return EncodedWords(cached), find_model(name) if small else None
