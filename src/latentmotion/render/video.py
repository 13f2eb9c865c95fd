"""Videos and GIFs of a mannequin with volume, drawn without a GPU; the camera follows or stays.

Takes stand side by side, each in its own panel. `.mp4` is H.264 through PyAV, `.gif` is Pillow's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from latentmotion.errors import InputError, MissingExtraError
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.render import View, mannequin, painter
from latentmotion.render.painter import Camera, camera_around, camera_of_all, half_front
from latentmotion.storage.files import atomic_file

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

MOST_TAKES = 6  # Panels that fit beside each other.

SIZE = 512  # Usual height of a video, pixels.

SIZES = (96, 4096)  # The smallest and the largest height of a video, pixels.

# Greatest rate of a GIF: programs slow down faster ones.
_GIF_FPS = 50

# Pixels that a GIF of several takes is wide at most: four takes of 9 s have 3 MB.
_GIF_WIDTH = 1024

# Colors of a GIF.
_GIF_COLORS = 64

# Height of the line with the caption, pixels.
_CAPTION = 44

# Standard deviation, seconds, of the Gaussian that smooths the camera's path.
_FOLLOWING = 0.5

_X264 = {"crf": "18", "preset": "veryfast"}


def write(
    path: str | Path,
    motions: Sequence[Motion],
    size: int | None = None,
    view: View = "follow",
    figure: mannequin.Figure = mannequin.mannequin_of,
) -> list[Path]:
    """Writes a `.gif` or `.mp4` of one or more takes side by side.

    Args:
        path: The file; its ending chooses the format.
        motions: Takes of one frame rate; the shorter ones wait at their last frame.
        size: Height of the picture, pixels; an even number. None for 512, or less for a GIF of
            several takes.
        view: Whether each take's camera follows its person, or stays where it sees all.
        figure: Kind of figure.

    Raises:
        InputError: Too many takes, different frame rates, a size that makes no video, or a folder
            that cannot be written.
        MissingExtraError: Pillow or PyAV is not installed.
    """
    if len(motions) > MOST_TAKES:
        raise InputError(f"{len(motions)} takes in one video; expected at most {MOST_TAKES}")
    is_gif = Path(path).suffix.lower() == ".gif"
    if size is None:
        size = SIZE
        if is_gif and len(motions) > 1:
            # Panels of several takes are three quarters as wide as high, and heights are even.
            size = min(SIZE, max(SIZES[0], _GIF_WIDTH // len(motions) * 4 // 3 // 2 * 2))
    if len({motion.fps for motion in motions}) > 1:
        raise InputError("the takes of one video must share a frame rate; write several files")
    if size % 2 or not SIZES[0] <= size <= SIZES[1]:
        raise InputError(
            f"a video of size {size}; expected an even number {SIZES[0]} to {SIZES[1]}"
        )
    if not is_gif:
        check_ready(".mp4")
        import av

        rate, stream = Fraction(motions[0].fps).limit_denominator(1000), None
        with atomic_file(path) as temporary, av.open(str(temporary), "w", format="mp4") as film:
            for picture in frames(motions, size, view, figure):
                if stream is None:
                    stream = film.add_stream("libx264", rate=rate, options=_X264)
                    stream.width, stream.height = picture.width // 2 * 2, picture.height // 2 * 2
                    stream.pix_fmt = "yuv420p"
                film.mux(stream.encode(av.VideoFrame.from_image(picture)))
            if stream is not None:
                film.mux(stream.encode())
        return [Path(path)]
    fps = min(motions[0].fps, _GIF_FPS)
    pictures = frames([motion.resampled(fps) for motion in motions], size, view, figure)
    with atomic_file(path) as temporary:
        # Not by how often colors occur, so that a small figure keeps that of its take.
        first = next(pictures).quantize(_GIF_COLORS, painter.Image.Quantize.MAXCOVERAGE)
        plain = painter.Image.Dither.NONE
        rest = [picture.quantize(palette=first, dither=plain) for picture in pictures]
        # GIF counts hundredths of a second: durations differ by one, so that the whole is exact.
        ends = [round(100 * frame / fps) * 10 for frame in range(len(rest) + 2)]
        durations = [end - start for start, end in pairwise(ends)]
        options = {"save_all": True, "append_images": rest, "duration": durations, "loop": 0}
        first.save(temporary, format="GIF", **options)
    return [Path(path)]


def frames(
    motions: Sequence[Motion],
    size: int = SIZE,
    view: View = "follow",
    figure: mannequin.Figure = mannequin.mannequin_of,
) -> Iterator[Picture]:
    """Yields the pictures of a video, drawn on demand."""
    width = size if len(motions) == 1 else size * 3 // 8 * 2
    panels = [
        _Panel(
            painter.make_bodies(motion, figure=figure),
            motion,
            (width, size - _CAPTION),
            painter.COLORS[number % len(painter.COLORS)],
            view,
        )
        for number, motion in enumerate(motions)
    ]
    captions = [motion.caption for motion in motions]
    captions = captions[:1] if len(set(captions)) == 1 else captions
    for frame in counted(range(max(len(motion) for motion in motions)), "drawing frames"):
        whole = painter.Image.new("RGB", (width * len(panels), size), painter.BACKGROUND)
        for number, panel in enumerate(panels):
            whole.paste(panel.draw(frame), (number * width, 0))
        columns = whole.width / len(captions)
        for number, caption in enumerate(captions):
            position = ((number + 0.5) * columns, size - _CAPTION / 2)
            painter.paint_text(whole, caption, position, 17, "mm", room=0.94 * columns)
        yield whole


class _Panel:
    """One take with its camera."""

    def __init__(
        self,
        bodies: painter.Bodies,
        motion: Motion,
        size: tuple[int, int],
        color: tuple[int, int, int],
        view: View,
    ) -> None:
        self.bodies, self.size, self.color = bodies, size, color
        deviation = _FOLLOWING * motion.fps
        radius = int(3 * deviation)
        kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / deviation) ** 2)
        path = self.bodies.joints[:, 0] * (1, 0, 1)  # of the camera's target, smoothed
        path = np.pad(path, ((radius, radius), (0, 0)), mode="reflect", reflect_type="odd")
        columns = [np.convolve(column, kernel / kernel.sum(), mode="valid") for column in path.T]
        self.path = np.stack(columns, axis=-1)
        self.azimuth = half_front(motion)
        above = self.bodies.vertices[..., 1].max() - self.bodies.floor
        # At least as high as an adult, so that a crouching person looks small; 0.35 m are the
        # margins.
        self.height = max(1.75, float(above)) + 0.35
        self.still: Camera | None = None
        if view == "still":
            self.still, self.height = camera_of_all(
                motion, self.bodies.vertices, painter.oversampled(size)
            )

    def draw(self, frame: int) -> Picture:
        frame = min(frame, len(self.path) - 1)
        floor, camera = self.bodies.floor, self.still
        if camera is None:  # it follows the person
            target = self.path[frame] + (0, floor + self.height / 2 - 0.17, 0)
            pixels = painter.oversampled(self.size)
            camera = camera_around(target, self.azimuth, np.radians(14), 6.5, pixels, self.height)
        reach = max(3.2, 1.3 * self.height)
        return painter.painted(camera, [self.bodies], frame, floor, reach, [self.color])


def check_ready(ending: str) -> None:
    """Raises MissingExtraError where there is no PyAV for an .mp4; called before work begins."""
    if ending == ".mp4" and find_spec("av") is None:
        raise MissingExtraError("writing .mp4", "PyAV (av)", "video")
