"""The part of `latentmotion evaluate` that measures by metrics, which needs PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from latentmotion.cli.evaluate import Evaluate
from latentmotion.cli.generate import load_generator, located
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation import cost, evaluate, position_scores, report
from latentmotion.evaluation.candidates import Candidate
from latentmotion.evaluation.evaluators.interface import load_evaluator
from latentmotion.evaluation.protocol import Protocol
from latentmotion.evaluation.report import REPORT_FILE, Report, card_figures
from latentmotion.gpu.backend import text_encoder_named, torch_prior
from latentmotion.kinematics.smpl import load_smpl
from latentmotion.model.card import find_model, read_card
from latentmotion.networks.checkpoint import load_stages
from latentmotion.storage import shards
from latentmotion.storage.address import folder_at
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import check_replaceable
from latentmotion.storage.shards import Share


@dataclass(frozen=True)
class MetricsCommand:
    """A measurement by metrics with the options of the command line."""

    options: Evaluate
    """Options of the command."""
    model: str
    """Name or folder of the model."""
    data: Path
    """Folder of the prepared data set."""

    def run(self) -> None:
        """Prints the report, and writes it into the output folder, if there is one.

        Raises:
            ModelError: The model has nothing to measure.
        """
        options = self.options
        if options.output is not None:
            check_replaceable(options.output, REPORT_FILE)
        folder, dataset = find_model(self.model), Dataset.load(self.data)
        evaluator = load_evaluator(options.evaluator) if options.evaluator else None
        if options.body is not None:
            body = load_smpl(options.body)
            dataset, evaluator = position_scores.with_smpl_joints(body, dataset, evaluator)
        candidates, protocol = self.candidates(folder), self.protocol()
        comparison = evaluate.Comparison(tuple(candidates), dataset, evaluator, protocol)
        report = self.shared(comparison, options.shard) if options.shard else comparison()
        if report is None:
            print(f"shard {options.shard} is finished, others are not")
            return
        if options.cost:
            replication = comparison.test_set.replication(0)
            first = candidates[0]
            generated = first if isinstance(first, evaluate.Generated) else None
            encoder = text_encoder_named(options.text_encoder) if options.text_encoder else None
            timed = cost.timed_prompts(replication.prompts)
            report = replace(report, cost=cost.cost_of(folder, generated, timed, encoder))
        print(report.markdown(), end="")
        if options.output is not None:
            report.write(options.output)
            print(f"\nwrote {options.output / 'report.json'} and report.md")
        if options.card:
            card = read_card(folder)
            figures = {**card.figures, "evaluation": card_figures(report)}
            replace(card, figures=to_json(figures)).write(folder)
            print(f"\nwrote the figures into {folder / 'model.json'}")

    def shared(self, comparison: evaluate.Comparison, shard: str) -> Report | None:
        """Measures the replications of a share; returns the report if all are finished.

        Raises:
            InputError: There is no output folder, or the scores beside it are of another run.
        """
        share, output = Share.parse(shard), self.options.output
        if output is None:
            raise InputError("--shard keeps scores beside the report; name its folder by --output")
        folder = folder_at(str(output.with_name(f"{output.name}.replications")), create=True)
        manifest = shards.make(comparison.work(), folder, share)
        return manifest and comparison.report_of(folder, manifest)

    def protocol(self) -> Protocol:
        """Returns the protocol that the options name, changed as they say."""
        options, protocol = self.options, evaluate.PROTOCOLS[self.options.protocol]
        repeats, replications = protocol.repeats, options.replications
        if options.multimodality is not None:
            repeats = replace(repeats, texts=options.multimodality)
        if replications is None:
            replications = protocol.replications if options.evaluator else 1
        return replace(
            protocol,
            split=options.split,
            replications=replications,
            seed=options.seed,
            repeats=repeats,
            max_frames=options.max_frames,
        )

    def candidates(self, folder: Path) -> list[Candidate]:
        """Returns the rows of the report: generated motions, and reconstructions of a VAE."""
        options, model = self.options, load_stages(folder)
        card, vae, weights = model.card, model.vae, report.weights_hash(folder)
        kinds = ("mean", "sampled") if options.protocol == "clean" else ("sampled", "mean")
        rebuilt: list[Candidate] = [
            evaluate.Reconstructed(
                vae, card, kind == "sampled", weights, f"reconstruction ({kind} z)"
            )
            for kind in kinds
            if card.vae.has_weights
        ]
        if options.prior:
            prior = torch_prior(folder, located(options.execution))
            return [evaluate.Prior(prior, weights), *rebuilt]
        if card.denoiser is None and not rebuilt:
            raise ModelError(f"{folder} has neither a denoiser nor a VAE to measure")
        if card.denoiser is None:
            return rebuilt
        generator = load_generator(
            folder, text_encoder=options.text_encoder, execution=options.execution
        )
        sampling = generator.card.sampling.but(options.steps, options.guidance, options.sampler)
        return [evaluate.Generated(generator, sampling, weights), *rebuilt]
