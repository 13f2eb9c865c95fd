"""`latentmotion render`: motions as videos and picture strips, which needs Pillow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import arg

from latentmotion import formats
from latentmotion.cli import options
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import check_fps
from latentmotion.render import strip, video
from latentmotion.storage.files import check_writable

_VIDEOS, _PICTURES = (".mp4", ".gif"), (".png",)

_SMOOTH = 30.0
"""Maximum frames per second of a video by default."""

_INPUT = f"Motion files: {' '.join(formats.READABLE)}. Each motion in them is a take."


@dataclass(frozen=True)
class Render:
    """Draw motions as a video, a GIF or a picture strip.

    Examples:
        latentmotion render walk.npz -o walk.mp4 walk.gif
        latentmotion render walk.npz run.bvh -o strip.png --style path
    """

    files: Annotated[options.Files, arg(help=_INPUT)]
    output: options.Outputs
    """Files to write; the extension selects the format: .mp4 .gif .png. Takes are drawn side by
    side in videos and one below the other in strips."""
    style: strip.Style = "row"
    """Strips: figures in a row, or fading along the path."""
    figures: int = 9
    """Strips: figures per take."""
    camera: video.View = "follow"
    """Videos: the camera follows the person, or stands still and sees the whole path."""
    fps: float | None = None
    """Videos: frames per second; by default those of the first file, at most 30."""
    size: int | None = None
    """Pixels: height of videos (default 512) or width of strips (default 1280)."""

    def run(self) -> None:
        """Reads, draws, writes.

        Raises:
            InputError: A file cannot be read, or an ending, a number or a folder cannot be used.
            FileFormatError: A file is damaged.
            MissingExtraError: Pillow or PyAV is not installed.
        """
        if not self.files:
            raise InputError("no motion file given; try: latentmotion render walk.npz -o walk.mp4")
        if self.fps is not None:
            check_fps(self.fps)
        for path in self.output:
            if path.suffix.lower() not in _VIDEOS + _PICTURES:
                known = " ".join(_VIDEOS + _PICTURES)
                raise InputError(f"cannot draw {path}: its ending is none of {known}")
            if path.is_dir():
                raise InputError(f"cannot write {path}: it is a folder; name a file in it")
            check_writable(path)
        motions = [motion for path in self.files for motion in formats.load(path)]
        for path in self.output:
            if path.suffix.lower() in _PICTURES:
                width = strip.WIDTH if self.size is None else self.size
                strip.write(path, motions, self.style, self.figures, width)
            else:
                fps = min(motions[0].fps, _SMOOTH) if self.fps is None else self.fps
                takes = [motion.resampled(fps) for motion in motions]
                video.write(path, takes, 512 if self.size is None else self.size, self.camera)
            print(f"wrote {path}")
