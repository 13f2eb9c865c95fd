"""`latentmotion edit`, `between`, `join`, `fit`: a model fills in frames and follows keypoints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from latentmotion.cleanup.pipeline import Changes
from latentmotion.cli import options
from latentmotion.cli.motions import print_changes
from latentmotion.control import edit, fit_keypoints
from latentmotion.errors import InputError
from latentmotion.formats.keypoints import ENDINGS, KeypointOptions, read_keypoints
from latentmotion.model.card import DEFAULT
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline

PartName = Literal[
    "left_arm", "right_arm", "arms", "left_leg", "right_leg", "legs", "head", "upper_body"
]
Layout = Literal[
    *("humanml3d", "coco_17", "coco_18", "coco_133", "body_25", "halpe_26", "halpe_136"),
    *("h36m", "mediapipe_33"),
]
_KEYPOINTS = f"Keypoints: {' '.join(ENDINGS)}, or a folder with a .json for each frame."


@dataclass(frozen=True, kw_only=True)
class _Directed:
    """Options of every command that runs a model towards given frames."""

    output: options.Outputs = (Path("motion.npz"),)
    """Files to write; the extension selects the format."""
    model: str = DEFAULT
    """Name or folder of the model."""
    runtime: options.RuntimeChoice = "auto"
    threads: options.Threads = None

    def _opened(self) -> MotionPipeline:
        """Opens the model, once outputs and runtime are checked; it loads networks when used."""
        options.check_outputs(self.output)
        runtime = self.runtime
        if runtime == "pytorch":
            raise InputError("--runtime pytorch: motions are directed on onnxruntime or openvino")
        return MotionPipeline.from_pretrained(self.model, runtime, self.threads)


@dataclass(frozen=True, kw_only=True)
class _Filling(options.MotionOptions, _Directed):
    """Options of the commands that generate the frames between others."""

    seed: options.Seed = 0
    steps: options.Steps = None
    guidance: options.Guidance = None

    def _load(self, path: Path, pipeline: MotionPipeline) -> list[Motion]:
        """Reads motions at the model's frame rate."""
        motions, fps = self.load(path), pipeline.representation.fps
        if motions[0].fps != fps:
            print(f"{path}: {motions[0].fps:g} frames per second become the model's {fps:g}")
        return [motion.resampled(fps) for motion in motions]


@dataclass(frozen=True)
class EditMotion(_Filling):
    """Generate a part of a motion anew; all other frames stay as they are.

    Example: latentmotion edit walk.npz "a person jumps" --between 1.2 2.4 -o jump.bvh
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help=options.MOTION_FILE)]
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
        pipeline = self._opened()
        motion = self._load(self.file, pipeline)[0]
        sampling = self.seed, self.steps, self.guidance
        edited = edit.generate_edited(
            pipeline, motion, self.prompt, self.between, *sampling, self.parts
        )
        options.save(self.output, [edited])


@dataclass(frozen=True)
class Between(_Filling):
    """Generate what leads from one motion to another; both stay as they are.

    Example: latentmotion between walk.npz sit.npz --seconds 1.5 -o walk_and_sit.bvh
    """

    start: Annotated[Positional[Path], arg(metavar="START", help=options.MOTION_FILE)]
    end: Annotated[Positional[Path], arg(metavar="END", help=options.MOTION_FILE)]
    seconds: float = 1.0
    """How long the way from the last frame of the first to the first of the second takes."""
    prompt: str = edit.ON_THE_WAY
    """What the person does on the way."""
    align: bool = False
    """Put the second motion where the first one leads, facing its way; by default only where it
    begins too far away to walk there in the time."""

    def run(self) -> None:
        """Reads, generates, writes.

        Raises:
            InputError: A file or a number cannot be used.
            ModelError: The model cannot be loaded or cannot direct motions.
        """
        pipeline = self._opened()
        start, end = (self._load(file, pipeline)[0] for file in (self.start, self.end))
        sampling = self.seed, self.steps, self.guidance, self.align
        joined = edit.generate_between(pipeline, start, end, self.seconds, self.prompt, *sampling)
        options.save(self.output, [joined])


@dataclass(frozen=True)
class Join(_Filling):
    """Join motions one after the other, each where the one before leads, with transitions.

    Example: latentmotion join walk.bvh wave.bvh sit.bvh -o day.bvh
    """

    files: options.Files = ()
    """Motion files in their order; each motion in them is a part."""
    seconds: float = 0.6
    """How long each transition takes; 0 joins by cuts, without the model."""
    prompt: str = edit.ON_THE_WAY
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
        pipeline = self._opened()
        parts = [part for path in self.files for part in self._load(path, pipeline)]
        sampling = self.seed, self.steps, self.guidance
        joined = edit.generate_joined(pipeline, parts, self.seconds, self.prompt, *sampling)
        options.save(self.output, [joined])


@dataclass(frozen=True)
class FitKeypoints(_Directed):
    """Turn noisy or partial keypoints, 3D or 2D, into a clean motion.

    Example: latentmotion fit tracked.npz -o clean.bvh
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help=_KEYPOINTS)]
    fps: float | None = None
    """Frames per second of the recording, if the file does not say."""
    layout: Layout | None = None
    """Layout of the keypoints, if the file has no names."""
    unit: str | None = None
    """Unit of length of points in 3D, a name or meters per unit; by default by the limbs."""
    up: Literal["y", "-y", "z", "-z", "x", "-x"] | None = None
    """Axis that points up, of points in 3D; by default y, if the figure stands so."""
    size: tuple[float, float] | None = None
    """Width and height of the picture, pixels."""
    focal: float | None = None
    """Focal length of the camera, pixels; by default that of a picture of 60 degrees."""
    noise: float | None = None
    """Deviation of what was recorded, meters; by default estimated."""
    clean: bool = True
    """Hold feet, smooth and give bones one length."""

    def run(self) -> None:
        """Reads, fits, writes.

        Raises:
            InputError: A file, an ending or a number cannot be used.
            ModelError: The model cannot be loaded or cannot direct motions.
        """
        pipeline = self._opened()
        stated = KeypointOptions(self.fps, self.layout, self.size, self.focal, self.up, self.unit)
        keypoints = read_keypoints(self.file, stated)
        if keypoints.points.shape[2] == 3:
            reason, names = f"{self.file} has points in 3D", ("size", "focal")
        else:
            reason, names = f"{self.file} has points in a picture", ("unit", "up")
        options.refuse_unused(self, reason, *names)
        fitted = fit_keypoints.fit_motion(pipeline, keypoints, noise=self.noise)
        motion = fitted.cleaned() if self.clean else fitted
        fit = motion.metadata["fit"]
        print(
            f"noise {100 * fit['noise']:.1f} cm, {100 * fit['dropped']:.1f} % of the points "
            f"dropped as mistakes, body {1 / fit['scale']:.2f} times the model's"
        )
        options.save(self.output, [motion])
        print_changes(Changes.of(fitted, motion))
