"""`latentmotion fit FILE -o OUT`: keypoints of a tracker become a clean motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cleanup.pipeline import Changes
from latentmotion.cli import options
from latentmotion.cli.clean import tell
from latentmotion.cli.options import Outputs, RuntimeChoice, Threads
from latentmotion.control.fit_keypoints import fit_motion
from latentmotion.errors import InputError
from latentmotion.formats.keypoints import ENDINGS, KeypointOptions, read_keypoints
from latentmotion.model.card import DEFAULT
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import check_writable

_INPUT = f"Keypoints: {' '.join(ENDINGS)}, or a folder with a .json for each frame."
Layout = Literal[
    *("humanml3d", "coco_17", "coco_18", "coco_133", "body_25", "halpe_26", "halpe_136"),
    *("h36m", "mediapipe_33"),
]


@dataclass(frozen=True)
class Fit:
    """Turn noisy or partial keypoints, 3D or 2D, into a clean motion.

    Example: latentmotion fit tracked.npz -o clean.bvh
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help=_INPUT)]
    output: Outputs = (Path("motion.npz"),)
    """Files to write; the extension selects the format."""
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
    model: str = DEFAULT
    """Name or folder of the model."""
    runtime: RuntimeChoice = "auto"
    threads: Threads = None

    def run(self) -> None:
        """Reads, fits, writes.

        Raises:
            InputError: A file, an ending or a number cannot be used.
            ModelError: The model cannot be loaded or cannot direct motions.
        """
        for path in self.output:
            formats.check_ending(path)
            check_writable(path)
        if self.runtime == "pytorch":
            raise InputError("--runtime pytorch: motions are fitted on onnxruntime or openvino")
        stated = KeypointOptions(self.fps, self.layout, self.size, self.focal, self.up, self.unit)
        keypoints = read_keypoints(self.file, stated)
        if keypoints.points.shape[2] == 3:
            reason, names = f"{self.file} has points in 3D", ("size", "focal")
        else:
            reason, names = f"{self.file} has points in a picture", ("unit", "up")
        options.refuse_unused(self, reason, *names)
        generate = MotionPipeline.from_pretrained(self.model, self.runtime, self.threads)
        motion = fit_motion(generate, keypoints, noise=self.noise)
        fitted = motion
        if self.clean:
            motion = motion.cleaned()
        fit = motion.metadata["fit"]
        print(
            f"noise {100 * fit['noise']:.1f} cm, {100 * fit['dropped']:.1f} % of the points "
            f"dropped as mistakes, body {1 / fit['scale']:.2f} times the model's"
        )
        written = [file for path in self.output for file in formats.save(path, [motion])]
        print("\n".join(f"wrote {path}" for path in written))
        tell(Changes.of(fitted, motion))
