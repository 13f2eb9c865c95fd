"""`latentmotion edit`, `between`, `join`: makes a part of a motion anew, or what joins several."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cli import options
from latentmotion.cli.options import Guidance, Outputs, RuntimeChoice, Seed, Steps, Threads
from latentmotion.control.edit import (
    ON_THE_WAY,
    generate_between,
    generate_edited,
    generate_joined,
    put_after,
)
from latentmotion.errors import InputError
from latentmotion.model.card import DEFAULT
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import check_writable

PartName = Literal[
    "left_arm", "right_arm", "arms", "left_leg", "right_leg", "legs", "head", "upper_body"
]
_MOTION = f"Motion file: {' '.join(formats.READABLE)}."


@dataclass(frozen=True, kw_only=True)
class _Filling(options.MotionOptions):
    """Options of both verbs."""

    output: Outputs = (Path("motion.npz"),)
    """Files to write; the extension selects the format."""
    model: str = DEFAULT
    """Name or folder of the model."""
    seed: Seed = 0
    steps: Steps = None
    guidance: Guidance = None
    runtime: RuntimeChoice = "auto"
    threads: Threads = None

    def _pipeline(self) -> MotionPipeline:
        for path in self.output:
            formats.check_ending(path)
            check_writable(path)
        if self.runtime == "pytorch":
            raise InputError("--runtime pytorch: motions are directed on onnxruntime or openvino")
        return MotionPipeline.from_pretrained(self.model, self.runtime, self.threads)

    def _load(self, path: Path, pipeline: MotionPipeline) -> list[Motion]:
        """Reads motions at the model's frame rate."""
        motions, fps = self.load(path), pipeline.representation.fps
        if motions[0].fps != fps:
            print(f"{path}: {motions[0].fps:g} frames per second become the model's {fps:g}")
        return [motion.resampled(fps) for motion in motions]

    def _write(self, motion: Motion) -> None:
        written = [file for path in self.output for file in formats.save(path, [motion])]
        print("\n".join(f"wrote {path}" for path in written))


@dataclass(frozen=True)
class EditMotion(_Filling):
    """Generate a part of a motion anew; all other frames stay as they are.

    Example: latentmotion edit walk.npz "a person jumps" --between 1.2 2.4 -o jump.bvh
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help=_MOTION)]
    prompt: Annotated[Positional[str], arg(metavar="PROMPT")]
    """What the person does in that part."""
    between: tuple[float, float]
    """Its start and end, seconds."""
    parts: tuple[PartName, ...] = ()
    """Parts of the body that change; by default all."""

    def run(self) -> None:
        """Reads, generates, writes.

        Raises:
            InputError: A file, a time or a number cannot be used.
            ModelError: The model cannot be loaded or cannot direct motions.
        """
        generate = self._pipeline()
        motion = self._load(self.file, generate)[0]
        edited = generate_edited(
            generate,
            motion,
            self.prompt,
            self.between,
            self.seed,
            self.steps,
            self.guidance,
            self.parts,
        )
        self._write(edited)


@dataclass(frozen=True)
class Between(_Filling):
    """Generate what leads from one motion to another; both stay as they are.

    Example: latentmotion between walk.npz sit.npz --seconds 1.5 -o walk_and_sit.bvh
    """

    start: Annotated[Positional[Path], arg(metavar="START", help=_MOTION)]
    end: Annotated[Positional[Path], arg(metavar="END", help=_MOTION)]
    seconds: float = 1.0
    """How long the way from the last frame of the first to the first of the second takes."""
    prompt: str = ON_THE_WAY
    """What the person does on the way."""
    align: bool = False
    """Put the second motion where the first one leads, facing its way; by default it stays."""

    def run(self) -> None:
        """Reads, generates, writes.

        Raises:
            InputError: A file or a number cannot be used, or the motions are too far apart.
            ModelError: The model cannot be loaded or cannot direct motions.
        """
        generate = self._pipeline()
        start, end = (self._load(file, generate)[0] for file in (self.start, self.end))
        end = put_after(start, end, self.seconds) if self.align else end
        joined = generate_between(
            generate, start, end, self.seconds, self.prompt, self.seed, self.steps, self.guidance
        )
        self._write(joined)


@dataclass(frozen=True)
class Join(_Filling):
    """Join motions one after the other, each where the one before leads, with transitions.

    Example: latentmotion join walk.bvh wave.bvh sit.bvh -o day.bvh
    """

    files: options.Files = ()
    """Motion files in their order; each motion in them is a part."""
    seconds: float = 0.6
    """How long each transition takes; 0 joins by cuts, without the model."""
    prompt: str = ON_THE_WAY
    """What the person does on the way."""

    def run(self) -> None:
        """Reads, generates, writes.

        Raises:
            InputError: A file or a number cannot be used.
            ModelError: The model cannot be loaded or cannot direct motions.
        """
        if not self.files:
            raise InputError("no motion file given; try: latentmotion join a.bvh b.bvh -o ab.bvh")
        if self.seconds == 0:
            unused = ("prompt", "seed", "steps", "guidance")
            options.refuse_unused(self, "--seconds 0 joins by cuts", *unused)
        generate = self._pipeline()
        parts = [part for path in self.files for part in self._load(path, generate)]
        seconds, choice = self.seconds, (self.seed, self.steps, self.guidance)
        self._write(generate_joined(generate, parts, seconds, self.prompt, *choice))
