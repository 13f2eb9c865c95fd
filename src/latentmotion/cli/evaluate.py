"""`latentmotion evaluate`: measures a model, by metrics on a data set or by instructions.

Metrics need PyTorch and are imported where they are measured, so that instructions need none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from jaxtyping import Float
from tyro.conf import Positional, arg

from latentmotion.cli import loading, options
from latentmotion.data import instructions as held_out
from latentmotion.data.clip import Split
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.instructions import benchmark, motions
from latentmotion.evaluation.instructions.benchmark import instructions, write_prompts
from latentmotion.evaluation.protocol import PROTOCOLS, Protocol
from latentmotion.kinematics.smpl import load_smpl
from latentmotion.model.card import CARD_FILE, find_model, read_card
from latentmotion.storage import configuration, files, shards
from latentmotion.training import checking

if TYPE_CHECKING:
    from latentmotion.evaluation.candidates import Candidate
    from latentmotion.model.config import Sampling
    from latentmotion.pipeline import MotionPipeline

Joints = Float[np.ndarray, "_ 22 3"]

# Options of sampling by a denoiser.
_SAMPLING = ("steps", "guidance", "sampler", "text_encoder")

# Options of the metrics alone.
_METRICS = (
    *("evaluator", "protocol", "replications", "shard", "seed", "multimodality"),
    *("max_frames", "prior", "body", "cost"),
)


@dataclass(frozen=True)
class Evaluate(options.SamplingOptions, options.ComputingOptions):
    """Measure a model beside the real motions of a prepared data set.

    A model with a denoiser is given the split's sentences, labels or lengths; a VAE reconstructs
    its motions.

    Examples:
        latentmotion evaluate my_model --data my_data --evaluator my_evaluator -o report
        latentmotion evaluate my_model --instructions -o report
        latentmotion evaluate my_model --data my_data --evaluator my_evaluator -o report --shard 1/4
    """

    model: Annotated[Positional[str | None], arg(metavar="MODEL")] = None
    """Name or folder of a model: exported, trained or converted."""
    data: options.OptionalData = None
    """Prepared folder, which `latentmotion data prepare` writes; with --instructions it is optional
    and its captions' claims are the ceiling."""
    evaluator: options.Evaluator = None
    protocol: options.ProtocolChoice = "clean"
    split: Split = "test"
    """Split to measure on."""
    replications: int | None = None
    """Repetitions of the measurement; by default 20, or 1 without an evaluator."""
    shard: str | None = None
    """Measure only a part of the replications, such as 3/16: the third of sixteen processes. Scores
    are kept beside the output folder (report.replications), where a killed run is resumed; whoever
    finds all of them finished writes the report."""
    seed: options.Seed = 0
    multimodality: int | None = None
    """Captions that get many motions each, for MultiModality; by default 100; 0 for none."""
    max_frames: int | None = None
    """Longest motion in frames; by default the model's own."""
    prior: bool = False
    """Measure motions drawn from the VAE's prior instead of the denoiser's."""
    body: options.Body = None
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
    output: options.OptionalOutput = None
    """Folder for report.json and report.md, or for instructions.json and instructions.md."""
    card: bool = False
    """Write the figures into the model's model.json."""

    def run(self) -> None:
        """Prints the report, and writes it into the output folder, if there is one.

        Raises:
            InputError: Neither model nor joints are given, or no data.
            ModelError: The model has nothing to measure.
        """
        if self.prompts is not None or self.instructions or self.joints:
            refuse = partial(options.refuse_unused, self)
            if self.prompts is not None:
                others = {field.name for field in fields(self)}
                others -= {"instructions", "prompts", "takes"}
                refuse("--prompts writes the list of prompts alone", *others)
            refuse("instructions have prompts, lengths, seeds and checks of their own", *_METRICS)
            if self.data is None:
                refuse("without --data no captions are read", "split")
            if self.joints:
                names = ("clean", "device", "precision", "launch")
                refuse("--joints measures motions that are there", *_SAMPLING, *names)
            else:
                refuse("without --joints no joint files are read", "fps")
            self.measure_instructions()
            return
        reason = "without --instructions, metrics are measured"
        options.refuse_unused(self, reason, "takes", "clean", "fps")
        if self.model is None or self.data is None:
            lacking = "MODEL" if self.model is None else "--data"
            raise InputError(f"{lacking} is missing; see latentmotion evaluate --help")
        if self.prior:
            options.refuse_unused(self, "--prior decodes random latents", *_SAMPLING)
        self.measure_metrics(self.model, self.data)

    def measure_metrics(self, model: str, data: Path) -> None:
        """Prints the report of the metrics on a prepared data set, and writes it.

        Raises:
            InputError: `--shard` without an output folder, or the scores beside it are of another
                run.
            ModelError: The model has nothing to measure.
        """
        from latentmotion.evaluation import cost, evaluate, scores
        from latentmotion.evaluation.evaluators.interface import load_evaluator
        from latentmotion.evaluation.report import REPORT_FILE, card_figures
        from latentmotion.networks.backend import text_encoder_named

        if self.output is not None:
            files.check_replaceable(self.output, REPORT_FILE)
        folder, dataset = find_model(model), Dataset.load(data)
        evaluator = load_evaluator(self.evaluator) if self.evaluator else None
        if self.body is not None:
            dataset, evaluator = scores.with_smpl_joints(load_smpl(self.body), dataset, evaluator)
        candidates, protocol = self.candidates(folder), self.changed_protocol()
        comparison = evaluate.Comparison(tuple(candidates), dataset, evaluator, protocol)
        if self.shard:
            share, output = shards.ShardSubset.parse(self.shard), self.output
            if output is None:
                problem = "--shard keeps scores beside the report; name its folder by --output"
                raise InputError(problem)
            beside = shards.folder_at(output.with_name(f"{output.name}.replications"), create=True)
            manifest = shards.make(comparison.work(), beside, share)
            if manifest is None:
                print(f"shard {self.shard} is finished, others are not")
                return
            report = comparison.report_of(beside, manifest)
        else:
            report = comparison()
        if self.cost:
            replication = comparison.test_set.replication(0)
            first = candidates[0]
            generated = first if isinstance(first, evaluate.Generated) else None
            encoder = text_encoder_named(self.text_encoder) if self.text_encoder else None
            timed = cost.timed_prompts(replication.prompts)
            report = replace(report, cost=cost.cost_of(folder, generated, timed, encoder))
        print(report.markdown(), end="")
        if self.output is not None:
            report.write(self.output)
            print(f"\nwrote {self.output / 'report.json'} and report.md")
        if self.card:
            _write_figures(folder, evaluation=configuration.to_json(card_figures(report)))

    def changed_protocol(self) -> Protocol:
        """Returns the protocol that the options name, changed as they say."""
        protocol, replications = PROTOCOLS[self.protocol], self.replications
        repeats = protocol.repeats
        if self.multimodality is not None:
            repeats = replace(repeats, texts=self.multimodality)
        if replications is None:
            replications = protocol.replications if self.evaluator else 1
        return replace(
            protocol,
            split=self.split,
            replications=replications,
            seed=self.seed,
            repeats=repeats,
            max_frames=self.max_frames,
        )

    def candidates(self, folder: Path) -> list[Candidate]:
        """Returns the rows of the report: generated motions, and reconstructions of a VAE."""
        from latentmotion.evaluation import candidates, report
        from latentmotion.networks.backend import torch_prior
        from latentmotion.networks.checkpoint import load_stages

        model = load_stages(folder)
        card, vae, weights = model.card, model.vae, report.weights_hash(folder)
        kinds = ("mean", "sampled") if self.protocol == "clean" else ("sampled", "mean")
        rebuilt: list[Candidate] = [
            candidates.Reconstructed(
                vae, card, kind == "sampled", weights, f"reconstruction ({kind} z)"
            )
            for kind in kinds
            if card.vae.has_weights
        ]
        if self.prior:
            prior = torch_prior(folder, loading.located(self.execution))
            return [candidates.Prior(prior, weights), *rebuilt]
        if card.denoiser is None and not rebuilt:
            raise ModelError(f"{folder} has neither a denoiser nor a VAE to measure")
        if card.denoiser is None:
            options.refuse_unused(self, f"{folder} has no denoiser", *_SAMPLING)
            return rebuilt
        return [candidates.Generated(*self._generator(folder), weights), *rebuilt]

    def _generator(self, model: str | Path) -> tuple[MotionPipeline, Sampling]:
        """Returns a model, and its sampling changed as the options say."""
        generator = loading.load_generator(
            model, text_encoder=self.text_encoder, execution=self.execution
        )
        return generator, generator.card.sampling.but(self.steps, self.guidance, self.sampler)

    def measure_instructions(self) -> None:
        """Writes the prompts, or checks the motions of a model or of a folder of joints."""
        if self.takes < 1:
            raise InputError(f"--takes {self.takes}: expected 1 or more")
        if self.prompts is not None:
            write_prompts(self.prompts, self.takes)
            print(f"wrote {self.prompts}: {len(instructions())} prompts")
            return
        if self.output is not None:
            files.check_replaceable(self.output, benchmark.REPORT_FILE)
        if self.card and self.model is None:
            raise InputError("--card is for a model; name one instead of --joints")
        claims = benchmark.claims_of(Dataset.load(self.data), self.split) if self.data else []
        if self.joints and self.model is not None:
            raise InputError(f"give either MODEL ({self.model}) or --joints, not both")
        if self.joints:
            name, takes = self.joints.name, {"takes": str(self.takes)}
            takes_of = motions.read_joints_folder(self.joints, instructions(), self.takes, self.fps)
            answers = name or "joints", {"joints": name, **takes}, takes_of
        else:
            answers = self.generated()
        name, settings, takes_of = answers
        trained = {item.id: partial(checking.meets, item.check) for item in held_out.instructions()}
        result = benchmark.judge(name, settings, instructions(), takes_of, claims, trained)
        print(benchmark.table(result))
        if self.output is not None:
            benchmark.write(result, self.output)
            print(f"\nwrote {self.output / benchmark.REPORT_FILE} and {benchmark.PAGE_FILE}")
        if self.card and self.model is not None:
            obeyed = {group: round(item.share, 4) for group, item in result.model.items()}
            _write_figures(find_model(self.model), instructions=obeyed)

    def generated(self) -> tuple[str, dict[str, str], Sequence[Sequence[Joints]]]:
        """Returns the model's name, the settings, and its motions for the instructions."""
        if self.model is None:
            raise InputError("MODEL is missing; name one, or a folder of joints by --joints")
        generator, sampling = self._generator(self.model)
        name = generator.card.name
        described = {
            "model": name,
            "steps": str(sampling.steps),
            "guidance": f"{sampling.guidance:g}",
            "sampler": sampling.sampler,
            "takes": str(self.takes),
            "motions": "cleaned" if self.clean else "as the network made them",
        }
        settings = self.takes, self.clean, sampling
        return name, described, motions.generate_motions(generator, instructions(), *settings)


def _write_figures(folder: Path, **figures: Any) -> None:
    """Writes figures into the card of a model, beside those that it has."""
    card = read_card(folder)
    replace(card, figures={**card.figures, **figures}).write(folder)
    print(f"\nwrote the figures into {folder / CARD_FILE}")
