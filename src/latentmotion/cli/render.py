"""`latentmotion render WALK.npz -o WALK.mp4`: pictures and videos without a GPU or a display."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.kinematics.animation import check_fps
from latentmotion.motion import Motion
from latentmotion.render import strip, video
from latentmotion.storage.files import check_writable

_VIDEOS, _PICTURES = (".mp4", ".gif"), (".png",)

_SMOOTH = 30.0
"""Frames per second that a video has at most, if nothing else is said."""

_INPUT = f"Motion files: {' '.join(formats.READABLE)}. Each motion in them is a take."


@dataclass(frozen=True)
class Render:
    """Draw motions as a video, a GIF or a picture strip.

    Examples:
        latentmotion render walk.npz -o walk.mp4 walk.gif
        latentmotion render walk.npz run.bvh -o strip.png --style path
    """

    files: Annotated[Positional[tuple[Path, ...]], arg(metavar="FILES", help=_INPUT)]
    output: Annotated[tuple[Path, ...], arg(aliases=["-o"])]
    """Files to write, the ending picks the format: .mp4 .gif .png. Takes stand side by side in
    videos, under each other in strips."""
    style: strip.Style = "row"
    """Strips: figures in a row, or fading along the path."""
    figures: int = 9
    """Strips: figures of each take."""
    camera: video.View = "follow"
    """Videos: the camera follows the person, or stays where it sees all of the path."""
    fps: float | None = None
    """Videos: frames per second; by default the first file's own, at most 30."""
    size: int | None = None
    """Pixels: the height of videos, 512 by default, and the width of strips, 1280 by default."""

    def run(self) -> None:
        """Reads, draws, writes.

        Raises:
            InputError: A file cannot be read, or an ending, a number or a folder cannot be used.
            FileFormatError: A file is damaged.
            MissingExtraError: Pillow or PyAV is not installed.
        """
        self._check()
        motions = [motion for path in self.files for motion in formats.load(path)]
        for path in self.output:
            self._draw(path, motions)
            print(f"wrote {path}")

    def _check(self) -> None:
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

    def _draw(self, path: Path, motions: Sequence[Motion]) -> None:
        if path.suffix.lower() in _PICTURES:
            width = strip.WIDTH if self.size is None else self.size
            strip.write(path, motions, self.style, self.figures, width)
            return
        fps = min(motions[0].fps, _SMOOTH) if self.fps is None else self.fps
        takes = [motion.resampled(fps) for motion in motions]
        video.write(path, takes, 512 if self.size is None else self.size, self.camera)
