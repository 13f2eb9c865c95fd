"""`latentmotion evaluate`: measures a model, by metrics on a data set or by instructions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from tyro.conf import Positional, arg

from latentmotion.cli.loading import computing_options, load_generator
from latentmotion.cli.options import (
    AUTO,
    Body,
    ComputePrecision,
    Device,
    Evaluator,
    Guidance,
    LaunchMode,
    OptionalData,
    OptionalOutput,
    OptionalTextEncoder,
    ProtocolChoice,
    SamplerChoice,
    Seed,
    Steps,
)
from latentmotion.data.clip import Split
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.evaluation.instructions.answers import Asking, answers
from latentmotion.evaluation.instructions.benchmark import judge
from latentmotion.evaluation.instructions.joints_folder import read_folder
from latentmotion.evaluation.instructions.prompts import instructions, write_prompts
from latentmotion.evaluation.instructions.report import PAGE_FILE, REPORT_FILE, table, write
from latentmotion.evaluation.instructions.truth import Claimed, claimed
from latentmotion.runtime.computing import Computing
from latentmotion.storage.files import check_replaceable

Joints = Float[np.ndarray, "_ 22 3"]


@dataclass(frozen=True)
class Evaluate:
    """Measure a model beside the real motions of a prepared data set.

    A model with a denoiser is given the split's sentences, labels or lengths; a VAE reconstructs
    its motions.

    Examples:
        latentmotion evaluate my_model --data my_data --evaluator my_evaluator -o report
        latentmotion evaluate my_model --instructions -o report
    """

    model: Annotated[Positional[str | None], arg(metavar="MODEL")] = None
    """Name or folder of a model: exported, trained or converted."""
    data: OptionalData = None
    """Prepared folder, which `latentmotion data prepare` writes; with --instructions it is optional
    and its captions' claims are the ceiling."""
    evaluator: Evaluator = None
    protocol: ProtocolChoice = "clean"
    split: Split = "test"
    """Split to measure on."""
    replications: int | None = None
    """Repetitions of the measurement; by default 20, or 1 without an evaluator."""
    seed: Seed = 0
    multimodality: int | None = None
    """Captions that get many motions each, for MultiModality; by default 100; 0 for none."""
    max_frames: int | None = None
    """Longest motion in frames; by default the model's own."""
    steps: Steps = None
    guidance: Guidance = None
    sampler: SamplerChoice = None
    prior: bool = False
    """Measure motions drawn from the VAE's prior instead of the denoiser's."""
    body: Body = None
    text_encoder: OptionalTextEncoder = None
    device: Device = AUTO
    precision: ComputePrecision = "float32"
    launch: LaunchMode = "eager"
    cost: bool = False
    """Measure parameters, FLOPs and seconds, too."""
    instructions: bool = False
    """Give the model some 250 instructions (turn left, kick twice, walk and then sit down) and
    check in the motion whether it follows them (docs/guide/instructions.md); needs no PyTorch."""
    takes: int = 5
    """Instructions: motions per prompt."""
    clean: bool = True
    """Instructions: clean the motions up, as users get them."""
    joints: Path | None = None
    """Instructions: folder of any model's joint positions in place of MODEL, one file per prompt
    and take, e.g. side-01_0.npy of shape (frames, 22, 3)."""
    fps: float = 20.0
    """Instructions: frames per second of joint files that do not state it."""
    prompts: Path | None = None
    """Instructions: write the prompts, checks, lengths and seeds to this CSV file and stop."""
    output: OptionalOutput = None
    """Folder for report.json and report.md, or for instructions.json and instructions.md."""
    card: bool = False
    """Write the figures into the model's model.json."""

    def run(self) -> None:
        """Prints the report, and writes it where asked.

        Raises:
            InputError: Neither model nor joints are given, or no data.
            ModelError: The model has nothing to measure.
        """
        if self.instructions or self.joints or self.prompts:
            self._instruct()
            return
        if self.model is None or self.data is None:
            lacking = "MODEL" if self.model is None else "--data"
            raise InputError(f"{lacking} is missing; see latentmotion evaluate --help")
        # Looked up only here, so that instructions need no PyTorch.
        metrics = import_module("latentmotion.cli.evaluate_metrics")
        metrics.Measuring(self, self.model, self.data).run()

    def _instruct(self) -> None:
        """Writes the prompts, or checks the motions of a model or of a folder of joints."""
        if self.takes < 1:
            raise InputError(f"--takes {self.takes}: expected 1 or more")
        if self.prompts is not None:
            write_prompts(self.prompts, self.takes)
            print(f"wrote {self.prompts}: {len(instructions())} prompts")
            return
        if self.output is not None:
            check_replaceable(self.output, REPORT_FILE)
        real = _claims(self.data, self.split)
        subject, about, motions = self._given(self.joints) if self.joints else self._made()
        found = judge(subject, about, instructions(), motions, real)
        print(table(found))
        if self.output is not None:
            write(found, self.output)
            print(f"\nwrote {self.output / REPORT_FILE} and {PAGE_FILE}")

    @property
    def computing(self) -> Computing:
        """Where and how PyTorch computes."""
        return computing_options(self.device, self.precision, self.launch)

    def _given(self, folder: Path) -> tuple[str, dict[str, str], Sequence[Sequence[Joints]]]:
        if self.model is not None:
            raise InputError(f"give either MODEL ({self.model}) or --joints, not both")
        motions = read_folder(folder, instructions(), self.takes, self.fps)
        return folder.name or "joints", {"joints": folder.name, "takes": str(self.takes)}, motions

    def _made(self) -> tuple[str, dict[str, str], Sequence[Sequence[Joints]]]:
        if self.model is None:
            raise InputError("MODEL is missing; name one, or a folder of joints by --joints")
        generator = load_generator(
            self.model, text_encoder=self.text_encoder, computing=self.computing
        )
        card = generator.card
        sampling = card.sampling.but(self.steps, self.guidance, self.sampler)
        asking = Asking(self.takes, self.clean, sampling)
        about = {
            "model": card.name,
            "steps": str(sampling.steps),
            "guidance": f"{sampling.guidance:g}",
            "sampler": sampling.sampler,
            "takes": str(asking.takes),
            "motions": "cleaned" if asking.clean else "as the network made them",
        }
        return card.name, about, answers(generator, instructions(), asking)


def _claims(data: Path | None, split: Split) -> list[Claimed]:
    return [] if data is None else claimed(Dataset.load(data), split)
