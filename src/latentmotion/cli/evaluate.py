"""`latentmotion evaluate`: measures a model, by metrics on a data set or by instructions."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.cli.instructions import measure_instructions
from latentmotion.data.clip import Split
from latentmotion.diffusion.sampler import SamplerName
from latentmotion.errors import InputError
from latentmotion.evaluation.settings import ProtocolName
from latentmotion.runtime.computing import Launch, Precision


@dataclass(frozen=True)
class Evaluate:
    """Measure a model beside the real motions of a prepared data set.

    A model with a denoiser answers the split's sentences, labels or lengths; a VAE repeats its
    motions. Without an evaluator, only joints are looked at.

    Examples:
        latentmotion evaluate my_model --data my_data --evaluator my_evaluator -o report
        latentmotion evaluate my_model --instructions -o report
    """

    model: Annotated[Positional[str | None], arg(metavar="MODEL")] = None
    """Name or folder of a model: exported, trained or converted."""
    data: Annotated[Path | None, arg(aliases=["-d"])] = None
    """Folder that `latentmotion data prepare` wrote; with --instructions its captions' claims are
    the ceiling, and it may be left out."""
    evaluator: Annotated[Path | None, arg(aliases=["-e"])] = None
    """Folder of an evaluator, for FID, R-precision, accuracy and the like."""
    protocol: ProtocolName = "clean"
    """`clean`, or `paper`: as the authors' code measures, quirk by quirk."""
    split: Split = "test"
    """Split that is asked for."""
    replications: int | None = None
    """Times that all is repeated; by default 20, and 1 without an evaluator."""
    seed: int = 0
    """All randomness derives from it."""
    multimodality: int | None = None
    """Captions that get many motions each, for MultiModality; by default 100, 0 for none."""
    max_frames: int | None = None
    """Longest motion; by default the model's own."""
    steps: int | None = None
    """Sampling steps; by default the model's own."""
    guidance: float | None = None
    """How strongly the condition steers; by default the model's own."""
    sampler: SamplerName | None = None
    """Rule of a sampling step; by default the model's own."""
    prior: bool = False
    """Measure motions drawn from the VAE's prior, in place of the denoiser's."""
    body: Path | None = None
    """SMPL model file (.npz, or .pkl of plain arrays) on whose joints HumanAct12 and UESTC are
    seen, as published figures are; without it, the skeleton that ships."""
    text_encoder: str | None = None
    """Text encoder of a model that was not exported, e.g. clip:FOLDER; by default what its folder
    or card names."""
    device: str = "cpu"
    """Where PyTorch computes: cpu, cuda or cuda:N; its networks then run exported models too."""
    precision: Precision = "float32"
    """Of PyTorch's matrix products and convolutions."""
    launch: Launch = "eager"
    """How PyTorch's work reaches the device: eager, graph (CUDA graphs) or compiled."""
    cost: bool = False
    """Measure parameters, FLOPs and seconds too."""
    instructions: bool = False
    """Ask for some 250 instructions (turn left, kick twice, walk and then sit down) and check in
    the motion whether it does them (docs/guide/instructions.md); needs no PyTorch."""
    takes: int = 5
    """Instructions: motions of each prompt."""
    clean: bool = True
    """Instructions: clean motions up, as users get them."""
    joints: Path | None = None
    """Instructions: in place of MODEL a folder of any model's joint positions, a file per prompt
    and take, e.g. side-01_0.npy of shape (frames, 22, 3)."""
    fps: float = 20.0
    """Instructions: frames per second of such files that do not say."""
    prompts: Path | None = None
    """Instructions: write the prompts, checks, lengths and seeds to this CSV file and stop."""
    output: Annotated[Path | None, arg(aliases=["-o"])] = None
    """Folder to write report.json and report.md to (instructions.json and instructions.md)."""
    card: bool = False
    """Write the figures into the model's model.json."""

    def run(self) -> None:
        """Prints the report, and writes it where asked.

        Raises:
            InputError: Neither model nor joints are given, or no data.
            ModelError: The model has nothing to measure.
        """
        if self.instructions or self.joints or self.prompts:
            measure_instructions(self)
            return
        if self.model is None or self.data is None:
            lacking = "MODEL" if self.model is None else "--data"
            raise InputError(f"{lacking} is missing; see latentmotion evaluate --help")
        # Looked up only here, so that instructions need no PyTorch.
        metrics = import_module("latentmotion.cli.evaluate_metrics")
        metrics.Measuring(self, self.model, self.data).run()
