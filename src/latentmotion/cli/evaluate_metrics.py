"""The part of `latentmotion evaluate` that measures by metrics, which needs PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from latentmotion.checkpoint import FirstStageModel, load_stages
from latentmotion.cli.evaluate import Evaluate
from latentmotion.cli.loading import load_generator, located
from latentmotion.cli.train import text_encoder_named
from latentmotion.condition.interface import TextEncoder
from latentmotion.data.dataset import Dataset
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
from latentmotion.evaluation.trials import Trial
from latentmotion.kinematics.smpl import load_smpl
from latentmotion.model.card import read_card
from latentmotion.model.folder import find_model
from latentmotion.runtime.eager import torch_prior
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import check_replaceable


@dataclass(frozen=True)
class Measuring:
    """A measurement by metrics, as the command line asks for it."""

    options: Evaluate
    """What was typed."""
    model: str
    """Name or folder of the model."""
    data: Path
    """Folder of the prepared data set."""

    def run(self) -> None:
        """Prints the report, and writes it where asked.

        Raises:
            ModelError: The model has nothing to measure.
        """
        if self.options.output is not None:
            check_replaceable(self.options.output, REPORT_FILE)
        folder, dataset = find_model(self.model), Dataset.load(self.data)
        extractor = load_extractor(self.options.evaluator) if self.options.evaluator else None
        if self.options.body is not None:
            dataset, extractor = seen_on(load_smpl(self.options.body), dataset, extractor)
        subjects = self._subjects(folder)
        protocol = self._protocol()
        report = compare(subjects, dataset, extractor, protocol)
        if self.options.cost:
            trial = plan_of(subjects, dataset, extractor, protocol).trial(0)
            report = replace(report, cost=self._cost(folder, subjects[0], trial))
        print(report.markdown(), end="")
        self._keep(folder, report)

    def _protocol(self) -> Protocol:
        protocol, repeats = (
            PROTOCOLS[self.options.protocol],
            PROTOCOLS[self.options.protocol].repeats,
        )
        if self.options.multimodality is not None:
            repeats = replace(repeats, texts=self.options.multimodality)
        usual = protocol.replications if self.options.evaluator else 1
        return replace(
            protocol,
            split=self.options.split,
            replications=usual if self.options.replications is None else self.options.replications,
            seed=self.options.seed,
            repeats=repeats,
            max_frames=self.options.max_frames,
        )

    def _subjects(self, folder: Path) -> list[Subject]:
        model, weights = load_stages(folder), weights_hash(folder)
        rebuilt = self._rebuilt(model, weights)
        if self.options.prior:
            return [Prior(torch_prior(folder, located(self.options.computing)), weights), *rebuilt]
        if model.card.denoiser is None and not rebuilt:
            raise ModelError(f"{folder} has neither a denoiser nor a VAE to measure")
        if model.card.denoiser is None:
            return rebuilt
        generator = load_generator(
            folder, text_encoder=self.options.text_encoder, computing=self.options.computing
        )
        options = self.options
        sampling = generator.card.sampling.but(options.steps, options.guidance, options.sampler)
        return [Generated(generator, sampling, weights), *rebuilt]

    def _rebuilt(self, model: FirstStageModel, weights: str) -> list[Subject]:
        if not model.card.vae.has_weights:
            return []
        usual, other = (
            ("mean", "sampled") if self.options.protocol == "clean" else ("sampled", "mean")
        )
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
        return text_encoder_named(self.options.text_encoder) if self.options.text_encoder else None

    def _keep(self, folder: Path, report: Report) -> None:
        if self.options.output is not None:
            report.write(self.options.output)
            print(f"\nwrote {self.options.output / 'report.json'} and report.md")
        if self.options.card:
            card = read_card(folder)
            figures = {**card.figures, "evaluation": card_figures(report)}
            replace(card, figures=to_json(figures)).write(folder)
            print(f"\nwrote the figures into {folder / 'model.json'}")
