"""`latentmotion evaluate`: measures a model on a prepared data set and reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.body.smpl_model import load_smpl
from latentmotion.checkpoint import TrainedModel, load_model
from latentmotion.cli.loading import load_generator
from latentmotion.cli.train import text_encoder_named
from latentmotion.condition.interface import TextEncoder
from latentmotion.configuration import to_json
from latentmotion.data.clip import Split
from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.sampler import SamplerName
from latentmotion.errors import ModelError
from latentmotion.evaluation.bodies import seen_on
from latentmotion.evaluation.card import card_figures
from latentmotion.evaluation.cost import Cost, cost_of, some_of
from latentmotion.evaluation.extractors.interface import load_extractor
from latentmotion.evaluation.origin import weights_hash
from latentmotion.evaluation.protocol import (
    PROTOCOLS,
    Generated,
    Prior,
    Protocol,
    Reconstructed,
    Report,
    Subject,
    compare,
    plan_of,
)
from latentmotion.evaluation.report import REPORT_FILE
from latentmotion.evaluation.settings import ProtocolName
from latentmotion.evaluation.trials import Trial
from latentmotion.files import check_replaceable
from latentmotion.model_card import read_card
from latentmotion.models import find_model
from latentmotion.runtime.computing import Computing, Launch, Precision
from latentmotion.runtime.eager import eager_prior
from latentmotion.vae.identity import IdentityVAE


@dataclass(frozen=True)
class Evaluate:
    """Measure a model beside the real motions of a prepared data set.

    A model with a denoiser answers the split's sentences, labels or lengths; a VAE repeats its
    motions. Without an evaluator, only joints are looked at.

    Example: latentmotion evaluate my_model --data my_data --evaluator my_evaluator -o report
    """

    model: Annotated[Positional[str], arg(metavar="MODEL")]
    """Name or folder of a model: exported, trained or converted."""
    data: Annotated[Path, arg(aliases=["-d"])]
    """Folder that `latentmotion data prepare` wrote."""
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
    output: Annotated[Path | None, arg(aliases=["-o"])] = None
    """Folder to write report.json and report.md to."""
    card: bool = False
    """Write the figures into the model's model.json."""

    def run(self) -> None:
        """Prints the report, and writes it where asked.

        Raises:
            ModelError: The model has nothing to measure.
        """
        if self.output is not None:
            check_replaceable(self.output, REPORT_FILE)
        folder, dataset = find_model(self.model), Dataset.load(self.data)
        extractor = load_extractor(self.evaluator) if self.evaluator else None
        if self.body is not None:
            dataset, extractor = seen_on(load_smpl(self.body), dataset, extractor)
        subjects = self._subjects(folder)
        protocol = self._protocol()
        report = compare(subjects, dataset, extractor, protocol)
        if self.cost:
            trial = plan_of(subjects, dataset, extractor, protocol).trial(0)
            report = replace(report, cost=self._cost(folder, subjects[0], trial))
        print(report.markdown(), end="")
        self._keep(folder, report)

    def _protocol(self) -> Protocol:
        protocol, repeats = PROTOCOLS[self.protocol], PROTOCOLS[self.protocol].repeats
        if self.multimodality is not None:
            repeats = replace(repeats, texts=self.multimodality)
        usual = protocol.replications if self.evaluator else 1
        return replace(
            protocol,
            split=self.split,
            replications=usual if self.replications is None else self.replications,
            seed=self.seed,
            repeats=repeats,
            max_frames=self.max_frames,
        )

    def _subjects(self, folder: Path) -> list[Subject]:
        model, weights = load_model(folder), weights_hash(folder)
        rebuilt = self._rebuilt(model, weights)
        if self.prior:
            return [Prior(eager_prior(folder, self._computing()), weights), *rebuilt]
        if model.denoiser is None and not rebuilt:
            raise ModelError(f"{folder} has neither a denoiser nor a VAE to measure")
        if model.denoiser is None:
            return rebuilt
        generator = load_generator(
            folder, text_encoder=self.text_encoder, computing=self._computing()
        )
        made = Generated(generator, self.steps, self.guidance, self.sampler, weights)
        return [made, *rebuilt]

    def _computing(self) -> Computing:
        return Computing(self.device, self.precision, self.launch)

    def _rebuilt(self, model: TrainedModel, weights: str) -> list[Subject]:
        if model.vae is None or isinstance(model.vae, IdentityVAE):
            return []
        usual, other = ("mean", "sampled") if self.protocol == "clean" else ("sampled", "mean")
        row = f"reconstruction ({usual} z)", f"reconstruction ({other} z)"
        vae, card = model.vae, model.card
        return [
            Reconstructed(vae, card, usual == "sampled", weights, row[0]),
            Reconstructed(vae, card, other == "sampled", weights, row[1]),
        ]

    def _cost(self, folder: Path, subject: Subject, trial: Trial) -> Cost:
        generated = subject if isinstance(subject, Generated) else None
        return cost_of(folder, generated, some_of(trial.questions), self._encoder())

    def _encoder(self) -> TextEncoder | None:
        return text_encoder_named(self.text_encoder) if self.text_encoder else None

    def _keep(self, folder: Path, report: Report) -> None:
        if self.output is not None:
            report.write(self.output)
            print(f"\nwrote {self.output / 'report.json'} and report.md")
        if self.card:
            card = read_card(folder)
            figures = {**card.figures, "evaluation": card_figures(report)}
            replace(card, figures=to_json(figures)).write(folder)
            print(f"\nwrote the figures into {folder / 'model.json'}")
