"""`latentmotion fit FILE -o OUT`: keypoints of a tracker become a clean motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cleanup import CleanUp
from latentmotion.cli.options import Outputs, RuntimeChoice, Threads
from latentmotion.errors import InputError
from latentmotion.formats.keypoints import ENDINGS, Stated, read_keypoints
from latentmotion.model.card import DEFAULT
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import check_writable

_INPUT = f"Keypoints, meters or pixels: {' '.join(ENDINGS)}."
Layout = Literal["humanml3d", "coco_17", "body_25", "mediapipe_33"]


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
    names: Layout | None = None
    """Layout of the keypoints, if the file has no names."""
    up: Literal["y", "-y", "z"] = "y"
    """Axis that points up in the file; MediaPipe's world landmarks have -y."""
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
        stated = Stated(self.fps, self.names, self.size, self.focal, self.up)
        keypoints = read_keypoints(self.file, stated)
        generate = MotionPipeline.from_pretrained(self.model, self.runtime, self.threads)
        motion = generate.fit(keypoints, noise=self.noise)
        if self.clean:
            motion = motion.cleaned(CleanUp(floor=keypoints.flat))
        found = motion.metadata["fit"]
        print(
            f"noise {100 * found['noise']:.1f} cm, {100 * found['dropped']:.1f} % of the points "
            f"dropped as mistakes, body {1 / found['scale']:.2f} times the model's"
        )
        written = [file for path in self.output for file in formats.save(path, [motion])]
        print("\n".join(f"wrote {path}" for path in written))
