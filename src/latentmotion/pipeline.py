"""The pipeline: prompt → condition → (noise → latents) → features → joints → motion.

This is section 3 of MLD without PyTorch, to read from top to bottom: `MotionPipeline.__call__`,
`batch`, `generate_batch` and `features_from_noise`, which training previews and exported graphs
run, too. A prompt is a sentence, an action label or nothing.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.condition.interface import Condition, Conditioning, TextEncoder
from latentmotion.condition.task import SentenceCondition
from latentmotion.describe.asked import asked_exactly
from latentmotion.diffusion.guidance import DistilledGuidance, guided
from latentmotion.diffusion.parametrization import Estimator, Noise, ParametrizedDenoiser
from latentmotion.diffusion.samplers import (
    Sampler,
    SamplerName,
    remaining_times,
    sample,
    sampler_named,
)
from latentmotion.diffusion.schedule import FewStepSchedule, StepCondition
from latentmotion.engine import request as requests
from latentmotion.engine.backend import (
    Backend,
    Batch,
    FeatureDecoder,
    FeatureEncoder,
    representation_of,
)
from latentmotion.engine.request import GenerationRequest
from latentmotion.engine.session import (
    LazySession,
    Runtime,
    Session,
    open_decoder,
    open_fused_samplers,
    open_pullback,
)
from latentmotion.errors import InputError, ModelError
from latentmotion.model import card as cards
from latentmotion.model.card import DEFAULT, ModelCard
from latentmotion.model.config import Sampling
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.representation.interface import Representation
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.retrieval.doubts import DoubtWarning, Reading
from latentmotion.text.cache import MAX_PROMPTS, CachedTextEncoder, MemoryCachedTextEncoder
from latentmotion.text.encoder import LazyTextEncoder
from latentmotion.text.lengths import LengthFile

if TYPE_CHECKING:
    from latentmotion.cleanup import CleanUp
    from latentmotion.control.goals import Goal
    from latentmotion.control.stream import MotionStream, StreamState
    from latentmotion.control.timeline import PartSpan, Span
    from latentmotion.data.clip import Source
    from latentmotion.kinematics.keypoints import Keypoints
    from latentmotion.ranking.best import Take
    from latentmotion.ranking.scorer import Scorer
    from latentmotion.retrieval.index import ClipIndex
    from latentmotion.retrieval.starts import ClipStart, ClipStarts
    from latentmotion.retrieval.teach import ShownClip

MAX_BATCH_SIZE = 32
"""Maximum number of motions that go through the networks at once, which bounds memory."""


ON_THE_WAY = "a person walks"
"""Default prompt of the motion between two others."""


@dataclass(frozen=True)
class MotionPipeline:
    """A trained model, ready to generate. Immutable, so that one serves many threads."""

    card: ModelCard
    """Description of the model."""
    condition: Condition
    """Turns prompts into words."""
    backend: Backend
    """Runs the networks."""
    max_batch_size: int = MAX_BATCH_SIZE
    """Maximum number of motions that go through the networks at once."""
    body: SmplRepresentation | None = None
    """SMPL body for the joints of motions, in place of the skeleton that ships."""
    lengths: LengthFile | None = None
    """Predicts the length of motions from their sentences, if it is not given."""
    encoder: Session | None = None
    """Network: normalized features, mask → latents; None where there is none, so that motions
    cannot start from clips."""
    moves: tuple[Path | ClipIndex, ...] = ()
    """Indexes of clips that motions of rare movements start from, or their files."""

    def __repr__(self) -> str:
        sampling, task = self.card.sampling, self.card.task
        return f"MotionPipeline({self.card.name!r}, {task}, {sampling.steps} steps)"

    @classmethod
    def from_pretrained(
        cls,
        model: str | Path = DEFAULT,
        runtime: Runtime = "auto",
        threads: int | None = None,
        cache: Path | None = None,
    ) -> MotionPipeline:
        """Opens a model by name (`fast` and `starter` ship with the package), folder or hub id.

        Networks are loaded when they are first needed. Nothing is downloaded unless `model` is an
        id, `owner/name` or `owner/name@revision`, and no folder here has that name.

        Args:
            model: Name, folder, or id on the Hugging Face Hub.
            runtime: Engine of the networks; `auto` takes ONNX Runtime.
            threads: Maximum number of threads of the engine; by default one per core.
            cache: Folder in which embeddings of prompts are kept, for example `cache_folder()`.

        Raises:
            ModelError: There is no such model, or a file of it is missing: it was not exported.
            MissingExtraError: The model is on the hub and `huggingface_hub` is not installed.
        """
        folder = cards.find_or_download(model)
        card = cards.read_card(folder)
        backend = Backend(
            LazySession(folder / "denoiser.onnx", runtime, threads),
            open_decoder(card, folder, runtime, threads),
            open_fused_samplers(card, folder, runtime, threads),
            open_pullback(folder, runtime, threads),
        )

        def text_encoder() -> TextEncoder:
            files = cards.find_text_encoder(card, folder)
            task = card.condition
            encoder = LazyTextEncoder(
                files[0].parent, task.text_encoder or "", task.condition_width
            )
            if cache is None:
                return encoder
            return CachedTextEncoder(encoder, cache / "prompts", files, MAX_PROMPTS)

        lengths = cards.lengths_file(card, folder)
        moves = cards.moves_files(card, folder)
        return cls(
            card,
            card.prompt_condition(text_encoder),
            backend,
            lengths=lengths and LengthFile(lengths, card.condition.text_encoder),
            encoder=moves and LazySession(moves[1], runtime, threads),
            moves=moves[:1] if moves else (),
        )

    def with_moves(self, *moves: str | Path | ClipIndex) -> MotionPipeline:
        """Returns the pipeline with further clips to start from.

        Args:
            moves: Folders or files that `latentmotion teach` wrote, or what `taught` returns; their
                clips come before those that ship.

        Raises:
            ModelError: A file is missing, damaged, or of another model; or this model has no
                `encoder.onnx`.
        """
        from latentmotion.retrieval.index import index_file

        if not moves:
            return self
        given = tuple(index_file(Path(m)) if isinstance(m, str | Path) else m for m in moves)
        pipeline = replace(self, moves=(*given, *self.moves))
        _ = pipeline.clip_starts  # read now, so that an error comes here
        return pipeline

    @classmethod
    def load(cls, *arguments: Any, **named: Any) -> MotionPipeline:
        """Old name of `from_pretrained`, which takes the same arguments."""
        warnings.warn(
            "MotionPipeline.load is now from_pretrained; the old name goes with the next release",
            DeprecationWarning,
            stacklevel=2,
        )
        return cls.from_pretrained(*arguments, **named)

    def __call__(
        self,
        prompt: str = "",
        seconds: float | None = None,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
        goals: Sequence[Goal] = (),
        from_clips: bool = True,
    ) -> Motion:
        """Turns a prompt into a motion.

        Args:
            prompt: What the person does, e.g. `a person walks and sits down`; for a model of
                actions one of its labels; for an unconditional model nothing.
            seconds: Length of the motion; by default the length that the model predicts for the
                sentence, or 4 s if it has no `lengths.safetensors`.
            seed: Seed of the noise; the same seed gives the same motion.
            steps: Sampling steps; more is slower and finer. By default the model's own.
            guidance: How strongly the prompt steers (paper eq. 6). By default the model's own.
            sampler: `ddim` (the same as `euler`), `heun`, `dpm++`, or `ddpm` for fresh noise at
                every step. By default the model's own.
            goals: Where joints should be and when, which way the body faces, the path it takes:
                `Reach`, `Heading`, `Path`, `Pose`. Once the motion is cleaned up, its joints are
                exactly there.
            from_clips: Whether a rare movement starts from the nearest clip of the training data
                (`retrieval/starts.py`); motions with goals never do.

        Raises:
            InputError: The prompt is not of the model's kind or a number is out of range; or no
                person could meet a goal.
            ModelError: There are goals, but the model has no `pullback.onnx`.
        """
        if not goals:
            return self.batch([prompt], seconds, [seed], steps, guidance, sampler, from_clips)[0]
        usual = self.usual_seconds([prompt]) if seconds is None else None
        (frames,) = requests.frames_of(self.card, seconds, 1, self.representation.fps, usual)
        sampling = self.card.sampling.but(steps, guidance, sampler)
        request = GenerationRequest((prompt,), (frames,), (seed,), sampling)
        request.check(self.card, self.representation.fps)
        from latentmotion.control.direct import generate_directed

        return generate_directed(self, request, goals)

    def batch(
        self,
        prompts: Sequence[str] | str,
        seconds: float | Sequence[float | None] | None = None,
        seeds: Sequence[int] | None = None,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
        from_clips: bool | Sequence[bool] = True,
    ) -> list[Motion]:
        """Turns several prompts into motions; each is what it would be alone.

        Args:
            prompts: One per motion; a single string is one prompt.
            seconds: Length of all motions, or of each; where None, as for one motion.
            seeds: One seed per motion; by default 0, 1, 2, ….
            steps: As for one motion.
            guidance: As for one motion.
            sampler: As for one motion.
            from_clips: As for one motion, or for each.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        sampling = self.card.sampling.but(steps, guidance, sampler)
        takes = self._takes(prompts, seconds, seeds, sampling, from_clips)
        return [motion for motion, _ in takes]

    def _takes(
        self,
        prompts: Sequence[str] | str,
        seconds: float | Sequence[float | None] | None,
        seeds: Sequence[int] | None,
        sampling: Sampling,
        from_clips: bool | Sequence[bool],
    ) -> list[tuple[Motion, ClipStart | None]]:
        """Returns motions and what they start from, None for pure noise."""
        captions = [prompts] if isinstance(prompts, str) else prompts
        requests.check_prompts(self.card, captions)
        readings = {caption: self.read(caption) for caption in dict.fromkeys(captions)}
        for note in dict.fromkeys(note for one in readings.values() for note in one.notes()):
            warnings.warn(note, DoubtWarning, stacklevel=3)
        prompts = [readings[caption].prompt for caption in captions]
        features = self.representation
        lengths = requests.each(seconds, len(prompts))
        free = [length is None for length in lengths]
        usual = self.usual_seconds(prompts) if any(free) else None
        frames = requests.frames_of(self.card, lengths, len(prompts), features.fps, usual)
        seeds = range(len(prompts)) if seeds is None else seeds
        request = GenerationRequest(tuple(prompts), tuple(frames), tuple(seeds), sampling)
        request.check(self.card, features.fps)
        starts = self._clip_starts(request, free, from_clips)
        frames = [start.frames if start else n for start, n in zip(starts, frames, strict=True)]
        if any(starts):
            begun = tuple(start and start.start for start in starts)
            request = replace(request, frames=tuple(frames), starts=begun)
        rows, joints = self._batches(request), []
        for batch in counted(rows, "generating batches"):
            placed = self.joints_of(self.generate_batch(request.take(batch)))
            joints.append(self.backend.to_host(placed))
        metadata = {"steps": sampling.steps, "guidance": sampling.guidance, **self.card.terms()}
        reads_text = self.card.condition.reads_text
        unpadded = requests.unpadded(joints, rows, frames)
        takes: list[tuple[Motion, ClipStart | None]] = []
        for positions, caption, seed, start, any_length in zip(
            unpadded, captions, seeds, starts, free, strict=True
        ):
            about = {"model": self.card.name, "seed": seed, **metadata}
            about |= asked_exactly(readings[caption].sentence, any_length) if reads_text else {}
            about |= readings[caption].about()
            about |= start.about() if start else {}
            placed = positions.astype(np.float32, copy=False)
            takes.append((Motion(placed, features.fps, features.skeleton, caption, about), start))
        return takes

    def read(self, prompt: str) -> Reading:
        """Returns a prompt as the model reads it: corrected, and with what it does not know of it.

        Without clips of the training data nothing is known of that, so nothing is said.
        """
        clips = self.clip_starts
        return Reading(prompt) if clips is None else clips.doubts.read(prompt)

    def _clip_starts(
        self, request: GenerationRequest, free: Sequence[bool], from_clips: bool | Sequence[bool]
    ) -> list[ClipStart | None]:
        """Returns what each motion of a request starts from, None for pure noise.

        Args:
            request: The motions.
            free: Whether nobody gave the length of each.
            from_clips: Whether they may start from clips.
        """
        count = len(request.prompts)
        wanted = [from_clips] * count if isinstance(from_clips, bool) else list(from_clips)
        if len(wanted) != count:
            raise InputError(f"{len(wanted)} values of from_clips for {count} motions")
        clips = self.clip_starts if any(wanted) else None
        if clips is None or request.sampling.steps < 2:
            return [None] * count
        choices = {prompt: clips.choices(prompt) for prompt in dict.fromkeys(request.prompts)}
        for prompt, near in choices.items():
            # Noise has the count or the turn that a sentence asks for exactly more often than a
            # clip, but for a clip that a user showed.
            if asked_exactly(prompt, True) and all(choice.support for choice in near):
                choices[prompt] = []
        return [
            clips.start(choices[prompt], None if any_length else frames, seed)
            if take and choices[prompt]
            else None
            for prompt, frames, seed, take, any_length in zip(
                request.prompts, request.frames, request.seeds, wanted, free, strict=True
            )
        ]

    @cached_property
    def clip_starts(self) -> ClipStarts | None:
        """Chooses clips to start from; None where the model has none.

        Raises:
            ModelError: A file of clips is missing, damaged, or of another model.
        """
        if not self.moves or not isinstance(self.condition, SentenceCondition):
            return None
        from latentmotion.retrieval.index import fingerprint, joined
        from latentmotion.retrieval.starts import ClipStarts

        # A sentence is read for its doubts, for its clips and for the takes of several seeds.
        text_encoder = MemoryCachedTextEncoder(self.condition.encoder, MAX_PROMPTS)
        backend = self.backend
        index = joined(self.moves, fingerprint(self.card.latents), text_encoder.name)

        def decode(latents: np.ndarray, frames: np.ndarray) -> np.ndarray:
            return backend.to_host(
                self.decoder(backend.to_device(latents), backend.to_device(frames))
            )

        return ClipStarts(
            self.card, index, text_encoder, self.feature_encoder, decode, self.representation
        )

    def taught(self, clips: Iterable[ShownClip], sources: Sequence[Source]) -> ClipIndex:
        """Returns an index of clips that motions of this model may start from.

        Args:
            clips: With sentences about them.
            sources: Their owners, with their terms.

        Raises:
            InputError: There is no clip with a sentence, or the model reads none.
            ModelError: The model has no `encoder.onnx`.
        """
        from latentmotion.retrieval.teach import build_index

        if not isinstance(self.condition, SentenceCondition):
            raise InputError(f"model {self.card.name!r} reads no sentences, so it cannot be taught")
        text_encoder = self.condition.encoder
        index = build_index(clips, sources, self.card, self.feature_encoder, text_encoder)
        return index.preferred()

    @cached_property
    def feature_encoder(self) -> FeatureEncoder:
        """The VAE's encoder with the scales of features and latents.

        Raises:
            ModelError: The model has no `encoder.onnx`.
        """
        if self.encoder is None:
            raise ModelError(
                f"model {self.card.name!r} has no encoder.onnx, so nothing starts from clips; "
                "export it again"
            )
        return FeatureEncoder.of(self.card, self.encoder)

    def ranked(
        self,
        prompt: str,
        of: int = 8,
        seconds: float | None = None,
        seed: int = 0,
        scorer: Scorer | None = None,
        goals: Sequence[Goal] = (),
        clean_up: CleanUp | None = None,
        from_clips: bool = True,
        **sampling: Any,
    ) -> list[Take]:
        """Generates several takes of a sentence, scores them and returns the best first.

        Args:
            prompt: What the person does.
            of: Number of takes.
            seconds: As for one motion.
            seed: Seed of the first take; later ones count up from it.
            scorer: Compares motions with sentences; by default the one that ships.
            goals: As for one motion; all takes have them.
            clean_up: Steps that the kept take goes through later, by default those of
                `Motion.cleaned`: claims of the sentence are measured after them.
            from_clips: Whether every other take of a rare movement starts from a near clip.
            sampling: `steps`, `guidance` and `sampler`, as for one motion.

        Raises:
            InputError: The model reads no sentences or moves another skeleton, or a number is out
                of range.
        """
        from latentmotion.ranking import best

        best.check_sentence(self.card, prompt, of)
        seeds, advantages = range(seed, seed + of), [0.0] * of
        if goals:
            takes = [self(prompt, seconds, n, goals=goals, **sampling) for n in seeds]
        else:
            every_other = [from_clips and number % 2 == 0 for number in range(of)]
            settings = self.card.sampling.but(*map(sampling.get, ("steps", "guidance", "sampler")))
            started = self._takes([prompt] * of, seconds, seeds, settings, every_other)
            takes = [motion for motion, _ in started]
            advantages = [start.advantage if start else 0.0 for _, start in started]
        scorer = scorer or best.scorer_beside(self.condition)
        return best.ranked(takes, self.read(prompt).sentence, scorer, clean_up, advantages)

    def best(self, prompt: str, of: int = 8, **settings: Any) -> Motion:
        """Returns the best of several takes; its metadata tell the scores of all.

        Args:
            prompt: What the person does.
            of: Number of takes.
            settings: As for `ranked`.

        Raises:
            InputError: As for `ranked`.
        """
        from latentmotion.ranking.best import best_of

        return best_of(self.ranked(prompt, of, **settings))

    def features(
        self,
        prompts: Sequence[str],
        frames: Sequence[int],
        seeds: Sequence[int],
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
    ) -> list[Float[np.ndarray, "_ features"]]:
        """Generates features in their own units, (frames, features), before they become joints.

        Args:
            prompts: One per motion.
            frames: Length of each motion.
            seeds: One seed per motion.
            steps: As for one motion.
            guidance: As for one motion.
            sampler: As for one motion.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        sampling = self.card.sampling.but(steps, guidance, sampler)
        return self.generate(
            GenerationRequest(tuple(prompts), tuple(frames), tuple(seeds), sampling)
        )

    def generate(self, request: GenerationRequest) -> list[Float[np.ndarray, "_ features"]]:
        """Returns features in their own units, (frames, features), for each motion of a request.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        rows = self._batches(request)
        counting = counted(rows, "generating batches")
        features = (self.generate_batch(request.take(batch)) for batch in counting)
        return requests.unpadded(map(self.backend.to_host, features), rows, request.frames)

    def generate_batch(
        self, request: GenerationRequest, condition: Conditioning | None = None
    ) -> Float[Any, "rows longest features"]:
        """Generates features of motions that go through the networks together.

        Args:
            request: The motions; all start from noise, or all have as many steps left.
            condition: Condition of the prompts; by default it is computed.

        Returns:
            Features in their own units, an array of the backend; rows and frames beyond the
            request's are padding.
        """
        sampling, backend = request.sampling, self.backend
        if condition is None:
            condition = self.condition(request.prompts)
        batch, noise = requests.padded_batch(request, condition, self.card.latents, backend)
        (remaining,) = set(request.remaining)
        if remaining is None and sampling.steps in backend.fused:
            return backend.run_fused(batch, sampling)
        sampler = self.sampler(sampling)
        if remaining is not None:
            first = remaining_times(sampler.schedule, sampling.steps, remaining)[0]
            batch = requests.with_starts(batch, request.starts, sampler.schedule, first, backend)
        chain = self.guided(sampling), sampler, sampling.steps, noise, self.decoder, remaining
        # Fresh noise at every step comes from the host, which a recording cannot read.
        if backend.launch is None or sampling.sampler == "ddpm":
            return features_from_noise(batch, *chain)
        return backend.launch(
            (sampling, remaining),
            lambda *arrays: features_from_noise(Batch(*arrays), *chain),
            *vars(batch).values(),
        )

    def joints_of(
        self, features: Float[Any, "rows longest features"]
    ) -> Float[Any, "rows longest joints 3"]:
        """Returns the joint positions of features, both arrays of the backend."""
        # SMPL's representation reads constants from the host, which a recording cannot do.
        if self.backend.launch is None or isinstance(self.representation, SmplRepresentation):
            return self.representation.decode(features)
        return self.backend.launch("joints", self.representation.decode, features)

    def usual_seconds(self, prompts: Sequence[str]) -> list[float] | None:
        """Returns the length in seconds that the model predicts for each prompt.

        Returns:
            None if the model predicts no lengths.

        Raises:
            InputError: A prompt is not of the model's kind.
        """
        requests.check_prompts(self.card, prompts)
        if self.lengths is None or not prompts or not isinstance(self.condition, SentenceCondition):
            return None
        return self.lengths.usual(self.condition.encoder(prompts).pooled)

    def edit(
        self,
        motion: Motion,
        prompt: str,
        between: tuple[float, float],
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        parts: Sequence[str] = (),
    ) -> Motion:
        """Generates a part of a motion again; all frames outside of it stay bit-identical.

        Args:
            motion: The motion, with the frame rate and skeleton of the model's.
            prompt: What the person does in that part.
            between: Its start and end, seconds.
            seed: As for one motion.
            steps: As for one motion.
            guidance: As for one motion.
            parts: Parts of the body that change, such as `left_arm`; all other joints stay
                bit-identical. By default the whole body changes.

        Raises:
            InputError: The motion is of another kind, the times are not within it, or there is no
                such part.
            ModelError: The model has no `pullback.onnx`.
        """
        from latentmotion.control.edit import generate_edited

        sampling = self.card.sampling.but(steps, guidance, None)
        return generate_edited(self, motion, prompt, between, seed, sampling, parts)

    def between(
        self,
        start: Motion,
        end: Motion,
        seconds: float,
        prompt: str = ON_THE_WAY,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
    ) -> Motion:
        """Generates what leads from one motion or pose to another; both are part of the result.

        Args:
            start: A motion, or a pose of one frame, whose frames stay the same numbers.
            end: Likewise. Where it is says where the motion has to get.
            seconds: Length of the transition.
            prompt: What the person does in between.
            seed: As for one motion.
            steps: As for one motion.
            guidance: As for one motion.

        Raises:
            InputError: The motions are of another kind or too far apart.
            ModelError: The model has no `pullback.onnx`.
        """
        from latentmotion.control.edit import generate_between

        sampling = self.card.sampling.but(steps, guidance, None)
        return generate_between(self, (start, end), seconds, prompt, seed, sampling)

    def loop(
        self,
        prompt: str,
        seconds: float,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
    ) -> Motion:
        """Generates one turn of a seamless cycle, such as a step of a walk.

        The frame after its last is its first, farther along its path; `cleaned` with `in_place`
        takes the path away, but clean-up knows nothing of the cycle and may leave a small seam.

        Args:
            prompt: What the person does.
            seconds: Length of a turn, rounded to 0.2 s.
            seed: As for one motion.
            steps: As for one motion; 2 or more.
            guidance: As for one motion.

        Raises:
            InputError: A number is out of range.
            ModelError: The model has no `pullback.onnx`.
        """
        from latentmotion.control.stream import generate_loop

        sampling = self.card.sampling.but(steps, guidance, None)
        return generate_loop(self, prompt, seconds, seed, sampling)

    def timeline(
        self,
        spans: Sequence[str | tuple[str, float] | Span],
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        parts: Sequence[tuple[str, str, float, float] | PartSpan] = (),
    ) -> Motion:
        """Generates one motion for several prompts, one after the other.

        Args:
            spans: Prompts, `(prompt, seconds)` or `Span`s; where the length is left out, it is
                predicted from the prompt.
            seed: As for one motion.
            steps: As for one motion; 2 or more.
            guidance: As for one motion.
            parts: What parts of the body do meanwhile: `(part, prompt, start, end)` or `PartSpan`s,
                such as `("right_arm", "a person waves the right hand", 1, 3)`; all other joints
                are those of the timeline without it.

        Raises:
            InputError: A prompt is not of the model's kind, a number is out of range, there is no
                such part, or two prompts move one joint at a time.
            ModelError: The model has no `pullback.onnx`.
        """
        from latentmotion.control.timeline import generate_timeline

        sampling = self.card.sampling.but(steps, guidance, None)
        return generate_timeline(self, spans, seed, sampling, parts)

    def stream(
        self,
        prompt: str,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        state: StreamState | None = None,
    ) -> MotionStream:
        """Returns an endless motion: an iterator of its next two seconds, in constant memory.

        Args:
            prompt: What the person does; `stream.say` changes it.
            seed: As for one motion.
            steps: As for one motion; 2 or more.
            guidance: As for one motion.
            state: Where an earlier stream is resumed.

        Raises:
            InputError: A number is out of range.
            ModelError: The model has no `pullback.onnx`.
        """
        from latentmotion.control.stream import generate_stream

        sampling = self.card.sampling.but(steps, guidance, None)
        return generate_stream(self, prompt, seed, sampling, state)

    def fit(
        self,
        joints: Float[np.ndarray, "frames keypoints coordinates"] | Keypoints,
        seen: np.ndarray | None = None,
        fps: float | None = None,
        names: Sequence[str] | None = None,
        noise: float | None = None,
    ) -> Motion:
        """Returns a clean motion near joints that were recorded with noise, gaps or one camera.

        Nothing is sampled: of all motions that the decoder can make, it is the likely one that
        explains what was seen. It lasts as long as the recording and is where that is, in the
        person's size.

        Args:
            joints: Meters, y up; or pixels, right and down. NaN is not seen. A `Keypoints` has
                names, frame rate and camera with it.
            seen: True, or a confidence up to 1, where a joint was seen; by default everywhere.
            fps: Frames per second of the recording; by default the model's.
            names: Of the keypoints: HumanML3D's, COCO's, OpenPose's or MediaPipe's; by default
                those of the layout with so many.
            noise: Deviation of what was recorded, meters; by default it is estimated.

        Raises:
            InputError: Shapes do not fit, a name is unknown, or hardly anything was seen.
            ModelError: The model has no `pullback.onnx`.
        """
        from latentmotion.control.fit_keypoints import generate_fitted
        from latentmotion.kinematics.keypoints import keypoints_of

        rate = self.representation.fps if fps is None else fps
        found = keypoints_of(joints, seen, rate, names)
        return generate_fitted(self, found, noise)

    def guided(self, sampling: Sampling) -> ParametrizedDenoiser:
        """Returns the denoiser with guidance around it, or inside it for a distilled model."""
        card, scale = self.card, sampling.guidance
        if card.few_step:
            return card.parametrized(DistilledGuidance(self._denoise, scale, sampling.steps))
        model = card.parametrized(self._denoise)
        return guided(sampling.guidance_rule, model, self._null, scale)

    def sampler(self, sampling: Sampling) -> Sampler:
        """Returns the rule of a sampling step; override it to use a sampler of your own."""
        return sampler_of(self.card, sampling)

    @cached_property
    def representation(self) -> Representation:
        """The motion features that the model makes."""
        return representation_of(self.card, self.body)

    @cached_property
    def decoder(self) -> FeatureDecoder:
        """The VAE's decoder with the scales of latents and features."""
        return FeatureDecoder.of(self.card, self.backend.decoder, self.backend.to_device)

    def _batches(self, request: GenerationRequest) -> list[list[int]]:
        """Checks a request; returns the motions of each batch."""
        request.check(self.card, self.representation.fps)
        return request.batches(self.max_batch_size, self.card.masks_padding)

    def _denoise(
        self,
        z: Float[Any, "batch tokens width"],
        t: Float[Any, " batch"],
        condition: Conditioning,
        mask: Bool[Any, "batch tokens"],
        step_condition: StepCondition | None = None,
    ) -> Float[Any, "batch tokens width"]:
        words, real = condition.tokens, condition.mask
        step_inputs = (
            {"guidance": step_condition.guidance, "step_size": step_condition.step_size}
            if step_condition
            else {}
        )
        return self.backend.denoiser(
            z=z, t=t, words=words, words_mask=real, mask=mask, **step_inputs
        )

    @cached_property
    def _null(self) -> Conditioning:
        null, to_device = self.condition.null(1), self.backend.to_device
        return Conditioning(to_device(null.tokens), to_device(null.mask))


def features_from_noise(
    batch: Batch,
    estimator: Estimator,
    sampler: Sampler,
    steps: int,
    noise: Noise,
    decoder: FeatureDecoder,
    remaining: int | None = None,
) -> Float[Any, "batch frames features"]:
    """Generates features: noise → latents, by the sampler → features in their own units.

    Args:
        batch: Noise (or noised latents), condition and masks, arrays of NumPy or PyTorch.
        estimator: The denoiser with its guidance, and the meaning of its output.
        sampler: The sampler.
        steps: Number of steps.
        noise: Draws further noise for samplers that need it.
        decoder: The VAE's decoder with the scales of latents and features.
        remaining: How many of the steps are left; by default all.
    """
    z = sample(
        estimator, sampler, batch.noise, batch.condition, batch.tokens, steps, noise, remaining
    )
    return decoder(z, batch.frames)


def sampler_of(card: ModelCard, sampling: Sampling) -> Sampler:
    """Returns the sampler for a model's schedule; a distilled one stops at its own few times."""
    schedule = (
        FewStepSchedule(card.schedule, card.few_step.solver_steps)
        if card.few_step
        else card.schedule
    )
    return sampler_named(sampling.sampler, schedule)
