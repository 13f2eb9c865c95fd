"""`latentmotion edit` and `between`: a part of a motion is generated anew, or what joins two."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cli import options
from latentmotion.cli.options import Guidance, Outputs, RuntimeChoice, Seed, Steps, Threads
from latentmotion.control.edit import ON_THE_WAY, generate_between, generate_edited
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
class _Filling(options.ReadingOptions):
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
        generate, motion = self._pipeline(), Motion.load(self.file, self.stated())
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

    def run(self) -> None:
        """Reads, generates, writes.

        Raises:
            InputError: A file or a number cannot be used, or the motions are too far apart.
            ModelError: The model cannot be loaded or cannot direct motions.
        """
        generate = self._pipeline()
        start, end = (Motion.load(file, self.stated()) for file in (self.start, self.end))
        joined = generate_between(
            generate, start, end, self.seconds, self.prompt, self.seed, self.steps, self.guidance
        )
        self._write(joined)
