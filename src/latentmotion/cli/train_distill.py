"""`latentmotion train distill`: a model of few steps from a trained one, resumable."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.cli.train import Changes, Output, text_encoder_named
from latentmotion.condition.interface import TextEncoder
from latentmotion.distillation import Distillation
from latentmotion.experiment import with_changes
from latentmotion.model.card import read_card


@dataclass(frozen=True)
class TrainDistill:
    """Distills a trained model to 1, 2 and 4 steps without a second pass for guidance.

    Example: latentmotion train distill --teacher starter --data my_data -o runs/fast
    """

    teacher: str
    """Name, run folder or model folder of the model to distill."""
    data: Path
    """Folder that `latentmotion data prepare` made: prompts and lengths are taken from it."""
    output: Output
    """Run folder; one that exists is gone on with."""
    set: Changes = ()
    """Change one setting, e.g. training.steps=1000 or leaps.steps='[1,2,4,8]'; may be given several
    times."""
    start: Path | None = None
    """Run or model folder of an earlier student of the same teacher, to begin as that."""
    text_encoder: str | None = None
    """The teacher's text encoder, where it is neither in its folder nor found by its name."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""

    def run(self) -> None:
        """Trains until done."""
        from latentmotion.model.folder import find_model
        from latentmotion.training.devices import training_place
        from latentmotion.training.distill import distill, model_folder

        settings = with_changes(Distillation(), self.set)
        teacher = model_folder(find_model(self.teacher))
        encoder = self._encoder(teacher)
        start = model_folder(self.start) if self.start else None
        with training_place(self.device) as place:
            print(distill(settings, self.data, teacher, encoder, self.output, place, start))

    def _encoder(self, teacher: Path) -> TextEncoder | None:
        from latentmotion.condition.text.cache import CachedTextEncoder
        from latentmotion.runtime.eager import find_encoder

        card = read_card(teacher)
        if not card.condition.reads_text:
            return None
        named = text_encoder_named(self.text_encoder) if self.text_encoder else None
        return CachedTextEncoder(named or find_encoder(card, teacher), self.output / "text")
