"""Fine-tuning: a trained model learns the movements of a few clips and keeps what it knew.

It is trained on the clips and on motions of its own that obey their prompts (rehearsal), then
distilled to few steps and packaged. The student learns the clips' prompts from the trained model,
and all other prompts from itself as it was before, so that it keeps its answers to them (Li & Hoiem
2016, learning without forgetting). The VAE stays as it is. Every stage is resumed where it was.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from latentmotion.data.clip import Source, TaggedSentence, mirror_sentence
from latentmotion.data.prepare import Preparation, encode_all, merge
from latentmotion.data.recording import Label, Recording
from latentmotion.data.sources.own import OwnMotions, find_motions
from latentmotion.data.store import MANIFEST, read_manifest
from latentmotion.engine.encoder import CachedTextEncoder, UnknownWordsWarning
from latentmotion.errors import DataError, ModelError
from latentmotion.export import package
from latentmotion.measure.scene import describe
from latentmotion.model import card as cards
from latentmotion.model.card import LENGTHS_FILE, file_beside, find_model, read_card
from latentmotion.model.config import FewStepConfig
from latentmotion.networks.backend import find_encoder, torch_pipeline
from latentmotion.networks.checkpoint import WEIGHTS_FILE
from latentmotion.progress import counted
from latentmotion.representation import representation_named
from latentmotion.retrieval.doubts import DoubtWarning
from latentmotion.storage.files import sha256
from latentmotion.training import stages
from latentmotion.training.captioning import described
from latentmotion.training.checking import fulfills
from latentmotion.training.distillation.data import Distillation, TrajectoryRegression
from latentmotion.training.distillation.stage import distill
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.drawn_instructions import drawn_instructions
from latentmotion.training.experiment import TrainingSettings, optimization, preset_named
from latentmotion.training.run_folder import open_run

REHEARSAL = "rehearsal"  # Name of the source of the model's own motions.

SOLVER_STEPS = 12  # Sampling steps of rehearsed motions, by DPM-Solver++.

AT_ONCE = 64  # Motions of a batch that are generated for rehearsal.


@dataclass(frozen=True)
class FineTuning:
    """Settings of `latentmotion finetune`; the defaults are for some twenty clips and two cores."""

    # Drawn prompts whose motions the model rehearses, as far as they do what was asked.
    rehearsal: int = 400
    # Optimization of the denoiser.
    training: TrainingSettings = field(default_factory=partial(optimization, "finetune"))
    # Training of the few-step student.
    distillation: Distillation = field(
        default_factory=lambda: Distillation(
            few_step=FewStepConfig(guidance=(1.0, 9.0), solver_steps=12),  # as `fast` has
            objective=TrajectoryRegression(256, asked=2_048),
            training=optimization("finetune_distill"),
        )
    )
    few_steps: bool = True  # Whether the result is distilled to few steps, as the default model is.


def finetune(
    settings: FineTuning, clips: OwnMotions, model: Path, output: Path, context: DistributedContext
) -> Path:
    """Prepares, trains and distills, resuming finished parts; returns the run's folder.

    Args:
        settings: Amounts of data and training.
        clips: The folder of motion files. Where no sentences come with them, the names of the
            files and what is measured in the motions become captions.
        model: Folder of the model to train on; not a distilled one.
        output: Model folder to write.
        context: Device and rank.

    Raises:
        DataError: No clip can be used.
        InputError: The run's folder holds another run.
        ModelError: The model reads no sentences, or was distilled.
    """
    if clips.captions and not clips.captions.is_file():
        raise DataError(f"no file {clips.captions}; expected a CSV with the columns file, caption")
    card = read_card(model)
    if not card.condition.reads_text:
        raise ModelError(f"model {card.name!r} reads no sentences, so none can be taught")
    if card.few_step:
        raise ModelError(
            f"--model {card.name}: it is distilled to few steps; use the model that it is of, "
            f"{card.figures.get('teacher', 'starter')}, and it is distilled again"
        )
    named = replace(preset_named("starter"), name=output.name, sampling=card.sampling)
    named = replace(named, denoiser_training=settings.training)
    experiment = stages.with_networks_of(model, named)
    work = output.with_name(f"{output.name}.run")
    paths = [*find_motions(clips.folder).values(), *sorted(clips.folder.rglob("*.txt"))]
    files = {path.relative_to(clips.folder).as_posix(): sha256(path) for path in paths}
    files |= {"captions": sha256(clips.captions)} if clips.captions else {}
    run = {"kind": "FineTuningRun", "files": files, "model": sha256(model / WEIGHTS_FILE)}
    open_run(work, {**run, "settings": settings}, context)
    encoder = CachedTextEncoder(find_encoder(card, model), work / "text")
    if context.is_main:
        _prepare(settings, clips, model, work)
    context.wait()
    trained = stages.train_denoiser(
        experiment, work / "data", model, encoder, work / "denoiser", context, model
    )
    if settings.few_steps:
        student, distillation = student_of(model), settings.distillation
        objective = distillation.objective
        knows_lengths = file_beside(read_card(trained), trained, LENGTHS_FILE) is not None
        if isinstance(objective, TrajectoryRegression) and not knows_lengths:
            distillation = replace(distillation, objective=replace(objective, asked=0))
        trained = distill(
            replace(distillation, name=output.name),
            work / ("own" if knows_lengths else "data"),
            trained,
            encoder,
            work / "student",
            context,
            student,
            student or model,
        )
    if context.is_main:
        folder = cards.text_encoder_folder(card, model)
        text = package.copied(folder) if folder else None
        package.package_model(trained, replace(read_card(trained), name=output.name), text, output)
    context.wait()
    return work


def _prepare(settings: FineTuning, clips: OwnMotions, model: Path, work: Path) -> None:
    """Prepares clips and rehearsal, each unless it is there, and joins them as `data`."""
    own_folder, rehearsal, joined = work / "own", work / REHEARSAL, work / "data"
    representation = representation_named(read_card(model).representation)
    if not (own_folder / MANIFEST).is_file():
        preparation = Preparation(representation)
        if not clips.captions and not any(clips.folder.rglob("*.txt")):
            rows = described.describe_files(clips, 0, names=True)
            path = work / "captions.csv"
            files = [row for row in rows if isinstance(row, described.FileRow)]
            described.write_captions(path, files)
            print(f"wrote {path}: captions from names of files and from the motions, to correct")
            clips = replace(clips, captions=path)
        preparation.add(encode_all(clips.recordings(), representation))
        print(preparation.write(own_folder, (clips.source,)).text())
    if not any(clip.captions for clip in read_manifest(own_folder).clips if clip.split == "train"):
        raise DataError(
            f"no training clip of {clips.folder} has a caption; write NAME.txt beside NAME.bvh, or "
            "a CSV with the columns file and caption, and pass it by --captions"
        )
    if settings.rehearsal and not (rehearsal / MANIFEST).is_file():
        preparation = Preparation(representation)
        recordings, card = _rehearsed(settings, model), read_card(model)
        preparation.add(encode_all(recordings, representation))
        credit = "; ".join(card.provenance.data)
        source = Source(REHEARSAL, card.provenance.license, f"motions of {card.name}; {credit}")
        if preparation.motions:
            preparation.write(rehearsal, (source,))
    if not (joined / MANIFEST).is_file():
        merge([part for part in [own_folder, rehearsal] if (part / MANIFEST).is_file()], joined)


def _rehearsed(settings: FineTuning, model: Path) -> list[Recording]:
    """Returns motions of the model that do what was asked, one in twenty to validate with."""
    pipeline = torch_pipeline(model)
    instructions = drawn_instructions(settings.rehearsal, settings.training.seed + 1)
    blocks = [instructions[i : i + AT_ONCE] for i in range(0, len(instructions), AT_ONCE)]
    recordings: list[Recording] = []
    for number, block in enumerate(counted(blocks, "rehearsing")):
        seeds = range(number * AT_ONCE, number * AT_ONCE + len(block))
        prompts = [instruction.prompt for instruction in block]
        with warnings.catch_warnings():
            for category in (UnknownWordsWarning, DoubtWarning):
                warnings.simplefilter("ignore", category)  # nobody typed these prompts
            motions = pipeline.batch(
                prompts, seeds=seeds, steps=SOLVER_STEPS, sampler="dpm++", from_clips=False
            )
        for instruction, motion in zip(block, motions, strict=True):
            if not fulfills(describe(motion.joints), instruction.check):
                continue
            sentences = (TaggedSentence(instruction.prompt),)
            label = Label(
                id=f"{REHEARSAL}-{len(recordings):04d}",
                source=REHEARSAL,
                origin=instruction.prompt,
                # One in twenty, in order, so that the same prompts validate every run.
                split="val" if len(recordings) % 20 == 19 else "train",
                sentences=sentences,
                mirrored_sentences=tuple(map(mirror_sentence, sentences)),
            )
            recordings.append(Recording(label, motion.joints))
    return recordings


def student_of(model: Path) -> Path | None:
    """Returns the distilled model that ships, where its teacher is the model to train on."""
    return find_model(cards.DEFAULT) if model == find_model("starter") else None
