"""The pipeline: prompt → condition → (noise → latents) → features → joints → motion.

This is section 3 of MLD without PyTorch, to read from top to bottom:

    __call__             the best of several takes, cleaned up: what the command writes
    raw_motions          prompts → readings, lengths, starts → joints, a take for each prompt
    generate_batch       prompts → condition; noise → features
    features_from_noise  noise → latents, by the sampler → features, by the VAE's decoder

Training previews run `features_from_noise`, too. Of a model of few steps it was traced into one
graph (`export/onnx.py`), which `generate_batch` runs in its place. A prompt is a sentence, an
action label or nothing.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup import USUAL, CleanUp, CleanUpWarning, clean_batch
from latentmotion.cleanup.floor import land_walkers
from latentmotion.diffusion.condition import Condition, Conditioning, SentenceCondition, TextEncoder
from latentmotion.diffusion.guidance import DistilledGuidance, guided
from latentmotion.diffusion.parametrization import (
    Estimator,
    Latents,
    Mask,
    Noise,
    ParametrizedDenoiser,
    Times,
)
from latentmotion.diffusion.samplers import (
    Sampler,
    SamplerName,
    remaining_times,
    sample,
    sampler_named,
)
from latentmotion.diffusion.schedule import FewStepSchedule, StepCondition
from latentmotion.engine import encoder as encoders
from latentmotion.engine import request as requests
from latentmotion.engine.backend import (
    Backend,
    Batch,
    FeatureDecoder,
    FeatureEncoder,
    representation_of,
)
from latentmotion.engine.lengths import TAKE_QUANTILES, LengthFile, within
from latentmotion.engine.request import GenerationRequest
from latentmotion.engine.session import LazySession, PickledByFields, Runtime, Session
from latentmotion.errors import InputError, ModelError
from latentmotion.language.claims import NO_CORRECTIONS, Corrections
from latentmotion.language.reading import (
    asked_exactly,
    counted_range,
    request_of,
    stays_on_floor,
    usual_range,
)
from latentmotion.language.translation import in_english
from latentmotion.model import card as cards
from latentmotion.model.config import Sampling
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.representation.interface import ClipFeatures, Representation
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.retrieval.doubts import DoubtWarning, Reading

if TYPE_CHECKING:
    from latentmotion.control.goals import Directed, Goal
    from latentmotion.ranking.best import Take
    from latentmotion.ranking.scorer import Scorer
    from latentmotion.retrieval.index import ClipIndex
    from latentmotion.retrieval.starts import ClipStart, ClipStarts

# Maximum number of motions that go through the networks at once, which bounds memory.
MAX_BATCH_SIZE = 32


Item = TypeVar("Item")

# Takes after which goals that none meets are refused.
_MOST_TAKES = 12


@dataclass(frozen=True, eq=False)
class RawMotion:
    """A motion as the networks make it, and what its clean-up has to know."""

    motion: Motion  # The motion.
    corrections: Corrections = NO_CORRECTIONS  # Degrees and repetitions that its sentence names.
    goals: tuple[Directed, ...] = ()  # Goals at which its joints are put in the end.
    start: ClipStart | None = None  # What it starts from; None for pure noise.
    # Its prompt as it was read; None where sampling was directed to goals.
    reading: Reading | None = None


def cleaned_up(raw: Sequence[RawMotion], steps: CleanUp) -> list[Motion]:
    """Returns motions cleaned up, with their corrections, and their joints at their goals."""
    landed = [_landed(take) if steps.floor else take.motion for take in raw]
    motions = clean_batch(landed, steps, [take.corrections for take in raw])
    return [_at_goals(motion, take, steps) for motion, take in zip(motions, raw, strict=True)]


def _landed(raw: RawMotion) -> Motion:
    """Returns a motion whose body its goals do not raise off the floor; whole poses may fly."""
    if not raw.goals:
        return raw.motion
    from latentmotion.control.goals import Pose

    if any(isinstance(goal, Pose) for goal in raw.goals):
        return raw.motion
    motion = raw.motion
    joints = land_walkers(motion.joints.astype(np.float64), motion.fps, motion.skeleton)
    return replace(motion, joints=joints.astype(np.float32))


def _at_goals(cleaned: Motion, raw: RawMotion, steps: CleanUp) -> Motion:
    if not raw.goals:
        return cleaned
    if steps.in_place:  # goals, and what `goal_report` says of them, have places of the path
        of_goals = ("goals", "foot_sliding")
        about = {name: value for name, value in cleaned.metadata.items() if name not in of_goals}
        return replace(cleaned, metadata=about)
    from latentmotion.control.direct import at_goals

    return at_goals(cleaned, raw.goals)


@dataclass(frozen=True)
class MotionPipeline(PickledByFields):
    """A trained model, ready to generate. Immutable, so that one serves many threads.

    Pickles of it name the model's files and hold no weights, so that worker processes open them.
    """

    card: cards.ModelCard
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
        model: str | Path = cards.DEFAULT,
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

        def text_encoder() -> TextEncoder:
            files = cards.find_text_encoder(card, folder)
            task = card.condition
            encoder = encoders.LazyTextEncoder(
                files[0].parent, task.encoder or "", task.condition_width
            )
            if cache is None:
                return encoder
            return encoders.CachedTextEncoder(
                encoder, cache / "prompts", files, encoders.MAX_PROMPTS
            )

        lengths = cards.file_beside(card, folder, cards.LENGTHS_FILE)
        moves = cards.moves_files(card, folder)
        return cls(
            card,
            card.prompt_condition(text_encoder),
            Backend.of_folder(card, folder, runtime, threads),
            lengths=lengths and LengthFile(lengths, card.condition.encoder),
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
                `encoder.onnx`, or reads no sentences.
        """
        from latentmotion.retrieval.index import index_file

        if not moves:
            return self
        further = tuple(index_file(Path(m)) if isinstance(m, str | Path) else m for m in moves)
        pipeline = replace(self, moves=(*further, *self.moves))
        if pipeline.clip_starts is None:  # read now, so that an error comes here
            raise ModelError(
                f"model {self.card.name!r} reads no sentences: it starts from no clips"
            )
        return pipeline

    @overload
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
        takes: int | None = None,
        clean_up: CleanUp | None = USUAL,
        scorer: Scorer | None = None,
        force: bool = False,
    ) -> Motion: ...

    @overload
    def __call__(
        self,
        prompt: Sequence[str],
        seconds: float | Sequence[float | None] | None = None,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
        goals: Sequence[Goal] = (),
        from_clips: bool = True,
        takes: int | None = None,
        clean_up: CleanUp | None = USUAL,
        scorer: Scorer | None = None,
        force: bool = False,
    ) -> list[Motion]: ...

    def __call__(
        self,
        prompt: str | Sequence[str] = "",
        seconds: float | Sequence[float | None] | None = None,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
        goals: Sequence[Goal] = (),
        from_clips: bool = True,
        takes: int | None = None,
        clean_up: CleanUp | None = USUAL,
        scorer: Scorer | None = None,
        force: bool = False,
        **unknown: Any,
    ) -> Motion | list[Motion]:
        """Turns a prompt into a motion: the best of several takes, cleaned up.

        A list of prompts gives a list of motions, each as it would be alone.

        Args:
            prompt: What the person does, e.g. `a person walks and sits down`; for a model of
                actions one of its labels; for an unconditional model nothing. Or several prompts.
            seconds: Length of the motion, or of each; by default the length that the model predicts
                for the sentence, or 4 s if it has no `lengths.safetensors`.
            seed: Seed of the first take's noise, later ones count up from it; the same seed gives
                the same motion.
            steps: Sampling steps; more is slower and finer. By default the model's own.
            guidance: How strongly the prompt steers (paper eq. 6). By default the model's own.
            sampler: `ddim` (the same as `euler`), `heun`, `dpm++`, or `ddpm` for fresh noise at
                every step. By default the model's own.
            goals: Where joints should be and when, which way body and head face, the path it takes:
                `Reach`, `Heading`, `LookAt`, `RootPath`, `Pose`. The joints of a cleaned motion are
                exactly there.
            from_clips: Whether a rare movement starts from the nearest clip of the training data
                (`retrieval/starts.py`), of several takes every other one; with goals, whether takes
                do that are made because the first ones did not meet them.
            takes: Takes of which the best is returned; its metadata tell the scores of all. By
                default 4 of a sentence if the model samples in few steps, otherwise 1.
            clean_up: Steps of the clean-up; None for the motion as the networks make it.
            scorer: Compares takes with the sentence; by default the one that ships.
            force: Return the first take, with a warning, where none meets the goals as a person
                would; its `metadata["violation"]` says what is wrong with it.
            **unknown: None; names of other libraries are answered by the name here.

        Raises:
            InputError: The prompt is not of the model's kind, an argument is unknown, or a number
                is none or out of range; no person could meet a goal, or no take of twelve meets it
                as a person would.
            ModelError: There are goals, but the model has no `pullback.onnx`.
        """
        from latentmotion.ranking.best import best_of, usual_takes

        requests.check_arguments(unknown, seed=seed, steps=steps, takes=takes, guidance=guidance)
        if not isinstance(prompt, str):
            if not isinstance(prompt, Sequence):
                raise InputError(f"a prompt is {prompt!r}; expected words, or a list of prompts")
            options: dict[str, Any] = {"seed": seed, "steps": steps, "guidance": guidance}
            options |= {"sampler": sampler, "goals": goals, "from_clips": from_clips}
            options |= {"takes": takes, "clean_up": clean_up, "scorer": scorer, "force": force}
            lengths = requests.each(seconds, len(prompt))
            return [self(text, s, **options) for text, s in zip(prompt, lengths, strict=True)]
        (length,) = requests.each(seconds, 1)
        if takes is None:
            requests.check_prompts(self.card, [prompt])
        of = usual_takes(self.card, prompt) if takes is None else takes
        settings = (steps, guidance, sampler, goals, from_clips, clean_up)
        if of != 1:
            return best_of(self.ranked(prompt, of, length, seed, *settings, scorer, force))

        def take(seed: int, from_clips: bool) -> Motion:
            raw = self.raw_motions([prompt], length, [seed], *settings[:3], from_clips, goals)
            return cleaned_up(raw, clean_up)[0] if clean_up else raw[0].motion

        # The limits of what is refused are those of people's motions that a sentence describes.
        checked = goals and clean_up and not clean_up.in_place and self.card.condition.reads_text
        if not checked:
            return take(seed, from_clips)
        return self._meeting(
            lambda number: [take(seed + number, from_clips and number % 2 == 1)],
            lambda motion: motion,
            _MOST_TAKES,
            force,
        )

    def _meeting(
        self,
        takes: Callable[[int], Iterable[Item]],
        motion: Callable[[Item], Motion],
        rounds: int,
        force: bool,
    ) -> Item:
        """Returns the first take that meets its goals and moves as people do.

        Args:
            takes: Takes of a round, by its number, the best first.
            motion: The motion of a take, cleaned up and at its goals.
            rounds: Number of rounds.
            force: Return the first one where none does.

        Raises:
            InputError: None does; the message names the goal.
        """
        every: list[Item] = []
        with warnings.catch_warnings(record=True) as notes:
            warnings.simplefilter("always")
            for take in (take for number in range(rounds) for take in takes(number)):
                if "violation" not in motion(take).metadata:
                    break
                every.append(take)
                # Of takes that are not kept nobody needs to know how they were cleaned up.
                notes[:] = [note for note in notes if not isinstance(note.message, CleanUpWarning)]
            else:
                take = every[0]
                problem = (
                    f"none of {len(every)} takes meets the goals as a person would; in the first "
                    f"one {motion(take).metadata['violation']}"
                )
                if not force:
                    raise InputError(
                        f"{problem}. Set that goal nearer or later, give the motion more time, or "
                        "say in the sentence what it needs, such as turning around; --force writes "
                        "it anyway"
                    )
                warnings.warn(problem, CleanUpWarning, stacklevel=3)
        for text, note in {str(raised.message): raised.message for raised in notes}.items():
            warnings.warn(note if isinstance(note, Warning) else text, stacklevel=3)
        return take

    def ranked(
        self,
        prompt: str,
        takes: int,
        seconds: float | None = None,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
        goals: Sequence[Goal] = (),
        from_clips: bool = True,
        clean_up: CleanUp | None = USUAL,
        scorer: Scorer | None = None,
        force: bool = False,
    ) -> list[Take]:
        """Returns several takes of a sentence with their scores, the best first.

        Where no length is given, takes are of several lengths that are likely for the sentence.

        Args:
            prompt: What the person does.
            takes: Number of takes.
            seconds: As for one motion; so are all further arguments.
            seed: Seed of the first take.
            steps: Sampling steps.
            guidance: Guidance scale.
            sampler: Sampler.
            goals: Of all takes.
            from_clips: Whether every other take may start from a clip.
            clean_up: Steps after which claims of the sentence are measured.
            scorer: Compares takes with the sentence.
            force: Keep a take that does not meet the goals as a person would where all are so.

        Raises:
            InputError: The model reads no sentences or moves another skeleton, or a number is out
                of range.
        """
        from latentmotion.ranking import best

        best.check_sentence(self.card, prompt, takes)
        compared = scorer or best.scorer_beside(self.condition)

        def ranked(number: int) -> tuple[list[RawMotion], list[Take]]:
            every_other = [from_clips and take % 2 == 0 for take in range(takes)]
            raw = self.raw_motions(
                [prompt] * takes,
                seconds,
                range(seed + number * takes, seed + (number + 1) * takes),
                *(steps, guidance, sampler, every_other if number or not goals else False, goals),
                [TAKE_QUANTILES[take % len(TAKE_QUANTILES)] for take in range(takes)],
            )
            if goals and clean_up is not None and clean_up.floor:
                raw = [replace(take, motion=_landed(take)) for take in raw]
            return raw, best.ranked(
                [take.motion for take in raw],
                (raw[0].reading or self.read(prompt)).prompt,
                compared,
                clean_up,
                [take.corrections for take in raw],
                [take.start.advantage if take.start and not goals else 0.0 for take in raw],
            )

        def finished(raw: Sequence[RawMotion], take: Take) -> Take:
            assert clean_up is not None
            chosen = next(candidate for candidate in raw if candidate.motion is take.motion)
            if take.cleaned is None or clean_up.in_place:  # claims are measured on the path
                (cleaned,) = cleaned_up([chosen], clean_up)
            else:
                cleaned = _at_goals(take.cleaned, chosen, clean_up)
            return replace(take, cleaned=cleaned)

        if not goals or clean_up is None or clean_up.in_place:
            raw, every = ranked(0)
            return [finished(raw, every[0]), *every[1:]] if clean_up else every

        def rounds(number: int) -> Iterator[tuple[Take, list[Take]]]:
            raw, every = ranked(number)
            for take in every:
                yield finished(raw, take), [other for other in every if other is not take]

        best_take, others = self._meeting(
            rounds,
            lambda pair: pair[0].cleaned or pair[0].motion,
            max(1, _MOST_TAKES // takes),
            force,
        )
        return [best_take, *others]

    def batch(
        self,
        prompts: Sequence[str] | str,
        seconds: float | Sequence[float | None] | None = None,
        seeds: Sequence[int] | None = None,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
        from_clips: bool | Sequence[bool] = True,
        clean_up: CleanUp | None = None,
        quantiles: Sequence[float] = (),
    ) -> list[Motion]:
        """Turns several prompts into motions, one take of each; each is what it would be alone.

        Args:
            prompts: One per motion; a single string is one prompt.
            seconds: Length of all motions, or of each; where None, as for one motion.
            seeds: One seed per motion; by default 0, 1, 2, ….
            steps: As for one motion.
            guidance: As for one motion.
            sampler: As for one motion.
            from_clips: As for one motion, or for each.
            clean_up: Steps of the clean-up; by default motions stay as the networks make them.
            quantiles: Of predicted lengths (`engine.lengths.QUANTILES`), for each; by default the
                median.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        texts = [prompts] if isinstance(prompts, str) else prompts
        settings = (steps, guidance, sampler, from_clips)
        raw = self.raw_motions(texts, seconds, seeds, *settings, quantiles=quantiles)
        return cleaned_up(raw, clean_up) if clean_up else [take.motion for take in raw]

    def raw_motions(
        self,
        prompts: Sequence[str],
        seconds: float | Sequence[float | None] | None = None,
        seeds: Sequence[int] | None = None,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
        from_clips: bool | Sequence[bool] = True,
        goals: Sequence[Goal] = (),
        quantiles: Sequence[float] = (),
    ) -> list[RawMotion]:
        """Returns one take for each prompt, with what its clean-up has to know.

        Args:
            prompts: One per motion.
            seconds: As for `batch`; so are all further arguments.
            seeds: One seed per motion.
            steps: Sampling steps.
            guidance: Guidance scale.
            sampler: Sampler.
            from_clips: Whether they may start from clips.
            goals: Of each motion.
            quantiles: As for `batch`; motions with goals have the median.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        sampling, count = self.card.sampling.but(steps, guidance, sampler), len(prompts)
        seeds = range(count) if seeds is None else seeds
        requests.check_prompts(self.card, prompts)
        lengths = requests.each(seconds, count)
        starting = [from_clips] * count if isinstance(from_clips, bool) else list(from_clips)
        if len(starting) != count:
            raise InputError(f"{len(starting)} values of from_clips for {count} motions")
        if goals:
            takes = zip(prompts, lengths, seeds, starting, strict=True)
            return [self._directed(*take, sampling, goals) for take in takes]
        readings = {prompt: self.read(prompt) for prompt in dict.fromkeys(prompts)}
        said = [note for reading in readings.values() for note in reading.notes()]
        for note in dict.fromkeys(said):
            warnings.warn(note, DoubtWarning, stacklevel=3)
        sentences = [readings[prompt].prompt for prompt in prompts]
        free = [length is None for length in lengths]
        usual = self.usual_seconds(sentences, quantiles) if any(free) else None
        space, card = self.representation, self.card
        frames = requests.frames_of(card, lengths, count, space.fps, usual)
        request = GenerationRequest(tuple(sentences), tuple(frames), tuple(seeds), sampling)
        request.check(card, space.fps)
        starts: list[ClipStart | None] = [None] * count
        if any(starting) and sampling.steps > 1 and self.clip_starts is not None:
            read = [readings[prompt] for prompt in prompts]
            starts = self.clip_starts.starts(read, request, free, starting)
        if any(starts):
            frames = [s.frames if s else n for s, n in zip(starts, frames, strict=True)]
            begun = tuple(start and start.start for start in starts)
            request = replace(request, frames=tuple(frames), starts=begun)
        joints = self._in_batches(request, lambda part: self.joints_of(self.generate_batch(part)))
        settings = {"steps": sampling.steps, "guidance": sampling.guidance, **card.terms()}
        raw = []
        for positions, prompt, seed, start, any_length in zip(
            joints, prompts, seeds, starts, free, strict=True
        ):
            correction = self._corrections(readings[prompt].sentence, any_length, start)
            about = {"model": card.name, "seed": seed, **settings, **correction.about()}
            about |= readings[prompt].about() | (start.about() if start else {})
            positions = positions.astype(np.float32, copy=False)
            motion = Motion(positions, space.fps, space.skeleton, prompt, about)
            raw.append(RawMotion(motion, correction, start=start, reading=readings[prompt]))
        return raw

    def _corrections(self, sentence: str, any_length: bool, start: ClipStart | None) -> Corrections:
        reads = self.card.condition.reads_text
        _, most = (usual_range(sentence) if reads else None) or (0.0, np.inf)
        longest = min(self.card.frames[1], most * self.representation.fps)
        # A count is of one of several movements; others that claim nothing may look like it.
        named = len(request_of(sentence).claims) if reads else 0
        counted = any_length and (start is None or start.movements <= max(named, 1))
        return replace(
            asked_exactly(sentence, counted) if reads else NO_CORRECTIONS,
            sharpens=True,
            # A clip has its own timing; slowed down where it is calm, it would lack its end.
            settles=start is None,
            longest=int(longest) if any_length else 0,
            on_floor=start is None and stays_on_floor(sentence),
        )

    def _directed(
        self,
        prompt: str,
        seconds: float | None,
        seed: int,
        from_clip: bool,
        sampling: Sampling,
        goals: Sequence[Goal],
    ) -> RawMotion:
        """Returns a motion whose sampling is directed to goals, from a near clip if wanted."""
        from latentmotion.control.direct import generate_directed
        from latentmotion.control.goals import RootPath
        from latentmotion.control.path import path_seconds

        if (translation := in_english(prompt)) is not None:
            warnings.warn(str(translation), DoubtWarning, stacklevel=4)
            prompt = translation.english
        fps = self.representation.fps
        if seconds is None:
            ends = [path_seconds(goal) for goal in goals if isinstance(goal, RootPath)]
            seconds = next((end + 1 / fps for end in ends if end is not None), None)
        usual = self.usual_seconds([prompt]) if seconds is None else None
        (frames,) = requests.frames_of(self.card, seconds, 1, fps, usual)
        request = GenerationRequest((prompt,), (frames,), (seed,), sampling)
        request.check(self.card, fps)
        start, clips = None, self.clip_starts if from_clip and sampling.steps > 1 else None
        if clips is not None:
            start = clips.nearest_start(self.read(prompt), frames, request)
            request = replace(request, starts=(start.start,))
        motion, places = generate_directed(self, request, goals)
        if start is not None:
            motion = replace(motion, metadata={**motion.metadata, **start.about()})
        return RawMotion(motion, goals=places, start=start)

    def read(self, prompt: str) -> Reading:
        """Returns a prompt as the model reads it: in English, corrected, and with its doubts.

        Without clips of the training data nothing is known of that, so nothing is said.
        """
        clips = self.clip_starts
        if not self.card.condition.reads_text:
            return Reading(prompt)
        translation = in_english(prompt)
        sentence = translation.english if translation else prompt
        with encoders.silent_of_unknown():  # words that the denoiser need not read
            reading = clips.chooser.read(sentence) if clips else Reading.of(sentence)
        return replace(reading, translation=str(translation)) if translation else reading

    @cached_property
    def clip_starts(self) -> ClipStarts | None:
        """Chooses clips to start from; None where the model has none.

        Raises:
            ModelError: A file of clips is missing, damaged, or of another model.
        """
        if not self.moves or not isinstance(self.condition, SentenceCondition):
            return None
        from latentmotion.retrieval.choices import Chooser
        from latentmotion.retrieval.index import fingerprint, joined
        from latentmotion.retrieval.starts import LONGEST_SAMPLED, ClipStarts

        # A sentence is read for its doubts, for its clips and for the takes of several seeds.
        text_encoder = encoders.MemoryCachedTextEncoder(
            self.condition.encoder, encoders.MAX_PROMPTS
        )
        backend = self.backend
        index = joined(self.moves, fingerprint(self.card.latents), text_encoder.name)

        def decode(latents: np.ndarray, frames: np.ndarray) -> np.ndarray:
            return backend.to_host(
                self.decoder(backend.to_device(latents), backend.to_device(frames))
            )

        def sample(
            sentence: str, request: GenerationRequest, frames: int | None = None
        ) -> list[np.ndarray]:
            usual = [
                min(seconds, LONGEST_SAMPLED) for seconds in self.usual_seconds([sentence]) or ()
            ]
            lengths = requests.frames_of(self.card, None, 1, self.representation.fps, usual or None)
            seeds, (length,) = request.seeds, [frames] if frames else lengths
            sentences, each = (sentence,) * len(seeds), (length,) * len(seeds)
            return self.generate(GenerationRequest(sentences, each, seeds, request.sampling))

        space = self.representation
        chooser = Chooser(index, text_encoder)
        return ClipStarts(self.card, chooser, self.feature_encoder, decode, space, sample)

    @property
    def text_encoder(self) -> TextEncoder:
        """The encoder of the model's sentences.

        Raises:
            InputError: It reads none.
        """
        if not isinstance(self.condition, SentenceCondition):
            raise InputError(f"model {self.card.name!r} reads no sentences, so it has no encoder")
        return self.condition.encoder

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

    def features(
        self,
        prompts: Sequence[str],
        frames: Sequence[int],
        seeds: Sequence[int],
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
    ) -> list[ClipFeatures]:
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

    def generate(self, request: GenerationRequest) -> list[ClipFeatures]:
        """Returns features in their own units, (frames, features), for each motion of a request.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        request.check(self.card, self.representation.fps)
        return self._in_batches(request, self.generate_batch)

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
            return backend.fused[sampling.steps](
                noise=batch.noise,
                words=batch.words,
                words_mask=batch.words_mask,
                mask=batch.tokens,
                frames=batch.frames,
                guidance=backend.to_device(
                    np.full(len(batch.noise), sampling.guidance, np.float32)
                ),
            )
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
            *(array for array in vars(batch).values() if array is not None),
        )

    def joints_of(
        self, features: Float[Any, "rows longest features"]
    ) -> Float[Any, "rows longest joints 3"]:
        """Returns the joint positions of features, both arrays of the backend."""
        # SMPL's representation reads constants from the host, which a recording cannot do.
        if self.backend.launch is None or isinstance(self.representation, SmplRepresentation):
            return self.representation.decode(features)
        return self.backend.launch("joints", self.representation.decode, features)

    def usual_seconds(
        self, prompts: Sequence[str], quantiles: Sequence[float] = ()
    ) -> list[float] | None:
        """Returns the length in seconds that the model predicts for each prompt.

        It is no shorter or longer than a single act, or as many repetitions as the prompt asks
        for, usually last (`language.reading`).

        Args:
            prompts: The prompts.
            quantiles: Of the lengths, for each; by default the median.

        Returns:
            None if the model predicts no lengths.

        Raises:
            InputError: A prompt is not of the model's kind.
        """
        requests.check_prompts(self.card, prompts)
        if self.lengths is None or not prompts or not isinstance(self.condition, SentenceCondition):
            return None
        shares = quantiles or [0.5] * len(prompts)
        lengths = self.lengths.usual(self.condition.encoder(prompts).pooled, shares)
        ranges = [usual_range(prompt) or counted_range(prompt) for prompt in prompts]
        every = zip(lengths, shares, ranges, strict=True)
        return [within(length, share, limits) for length, share, limits in every]

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

    def _in_batches(
        self, request: GenerationRequest, function: Callable[[GenerationRequest], Any]
    ) -> list[np.ndarray]:
        """Returns what a function makes of a request's batches, for each motion without padding."""
        batches = request.batches(self.max_batch_size, self.card.masks_padding)
        outputs = (function(request.take(rows)) for rows in counted(batches, "generating batches"))
        return requests.unpadded(map(self.backend.to_host, outputs), batches, request.frames)

    def _denoise(
        self,
        z: Latents,
        t: Times,
        condition: Conditioning,
        mask: Mask,
        step_condition: StepCondition | None = None,
    ) -> Latents:
        further = vars(step_condition) if step_condition else {}
        words = {"words": condition.tokens, "words_mask": condition.mask}
        return self.backend.denoiser(z=z, t=t, **words, mask=mask, **further)

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
        batch: Noise (or noised latents of clips), condition and masks, arrays of NumPy or PyTorch.
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
    if batch.start is not None and batch.start_share is not None:
        z = z + batch.start_share * (batch.start - z)
    return decoder(z, batch.frames)


def sampler_of(card: cards.ModelCard, sampling: Sampling) -> Sampler:
    """Returns the sampler for a model's schedule; a distilled one stops at its own few times."""
    schedule = (
        FewStepSchedule(card.schedule, card.few_step.solver_steps)
        if card.few_step
        else card.schedule
    )
    return sampler_named(sampling.sampler, schedule)
