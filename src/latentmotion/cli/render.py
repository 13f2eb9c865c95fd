"""`latentmotion render`: motions as pages, and with Pillow as videos and picture strips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from latentmotion import formats
from latentmotion.cli import options
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import check_fps
from latentmotion.motion import Motion
from latentmotion.render import Style, View
from latentmotion.render.mannequin import Figure, mannequin_of, sticks_of
from latentmotion.retarget.rig import read_rig
from latentmotion.retarget.transfer import CharacterFigure
from latentmotion.storage.files import check_writable
from latentmotion.viewer import page

_VIDEOS, _PICTURES, _PAGES = (".mp4", ".gif"), (".png",), (".html",)

# Figures of pictures, by name.
_DRAWN: Mapping[str, Figure] = {"mannequin": mannequin_of, "stick": sticks_of}

# Options of some files alone, by their endings.
_USED_BY = {
    _PICTURES: ("style", "figures"),
    _VIDEOS: ("camera", "output_fps"),
    _VIDEOS + _PICTURES: ("size",),
}

# Maximum frames per second of a video by default.
_SMOOTH = {".mp4": 30.0, ".gif": 15.0}

_INPUT = f"Motion files: {' '.join(formats.READABLE)}. Each motion in them is a take."


@dataclass(frozen=True)
class RenderMotions(options.MotionOptions):
    """Draw motions as a video, a GIF, a picture strip or a page, with a figure of your choice.

    Examples:
        latentmotion render walk.npz -o walk.mp4 walk.gif
        latentmotion render walk.npz run.bvh -o strip.png --style path
        latentmotion render walk.npz -o walk.html walk.mp4 --figure character.glb
    """

    files: Annotated[options.Files, arg(help=_INPUT)]
    output: options.Outputs
    """Files to write; the extension selects the format: .mp4 .gif .png .html. Takes are drawn side
    by side in videos and pages and one below the other in strips."""
    figure: str | None = None
    """Who is drawn: `mannequin`, the body of .glb and .usd files, by default; `stick`; or a
    character of yours (.glb, .gltf, .vrm, .fbx), as a surface of one color."""
    style: Style = "row"
    """Strips: figures in a row, or fading along the path."""
    figures: int = 9
    """Strips: figures per take."""
    camera: View = "follow"
    """Videos: the camera follows the person, or stands still and sees the whole path."""
    output_fps: float | None = None
    """Videos: frames per second; by default those of the first file, at most 30, of a GIF 15."""
    size: int | None = None
    """Pixels: height of videos (default 512, less for a GIF of several takes) or width of strips
    (default 1280)."""

    def run(self) -> None:
        """Reads, draws, writes.

        Raises:
            InputError: A file cannot be read, or an ending, a number or a folder cannot be used.
            FileFormatError: A file is damaged.
            MissingExtraError: Pillow or PyAV is not installed.
        """
        if not self.files:
            raise InputError("no motion file given; try: latentmotion render walk.npz -o walk.mp4")
        if self.output_fps is not None:
            check_fps(self.output_fps)
        endings = {path.suffix.lower() for path in self.output}
        for kinds, names in _USED_BY.items():
            if not endings.intersection(kinds):
                options.refuse_unused(self, f"no {' or '.join(kinds)} is written", *names)
        for path in self.output:
            if path.suffix.lower() not in _VIDEOS + _PICTURES + _PAGES:
                endings = " ".join(_VIDEOS + _PICTURES + _PAGES)
                raise InputError(f"cannot draw {path}: its ending is none of {endings}")
            if path.is_dir():
                raise InputError(f"cannot write {path}: it is a folder; name a file in it")
            check_writable(path)
            if path.suffix.lower() not in _PAGES:
                import_module("latentmotion.render.painter")  # no Pillow: told before all else
        if self.figure is None or self.figure in _DRAWN:
            figure = _DRAWN[self.figure or "mannequin"]
        elif Path(self.figure).is_file():
            figure = CharacterFigure(read_rig(self.figure, stated=self.stated()))
        else:
            raise InputError(
                f"--figure {self.figure}: there is no such file; expected mannequin, stick or "
                "the file of a character (.glb, .gltf, .vrm, .fbx)"
            )
        motions = [motion for path in self.files for motion in self.load(path)]
        for path in self.output:
            if path.suffix.lower() in _PICTURES:
                from latentmotion.render import strip

                width = strip.WIDTH if self.size is None else self.size
                strip.write(path, motions, self.style, self.figures, width, figure)
            elif path.suffix.lower() in _VIDEOS:
                from latentmotion.render import video

                usual_fps = min(motions[0].fps, _SMOOTH[path.suffix.lower()])
                fps = usual_fps if self.output_fps is None else self.output_fps
                takes = [motion.resampled(fps) for motion in motions]
                video.write(path, takes, self.size, self.camera, figure)
            elif self.figure in (None, "mannequin"):
                page.write_page(path, motions)
            elif self.figure == "stick":
                page.write_page(path, motions, figure="stick")
            else:
                page.write_page(path, motions, figure=skinned(motions, figure))
            print(f"wrote {path}")


def skinned(motions: Sequence[Motion], figure: Figure) -> page.Skinned:
    """Returns the figure of a page's takes, whose skin is that of the first.

    Raises:
        InputError: The takes have different skeletons.
    """
    names = [motion.skeleton.names for motion in motions]
    if names != names[:1] * len(names):
        raise InputError("the takes of a page with such a figure must share a skeleton")
    animations = [figure(motion) for motion in motions]
    skin = animations[0][0]
    moves = [skin.moves(animation) for _, animation in animations]
    rotations, shifts = zip(*moves, strict=True)
    return page.Skinned(
        skin.vertices, skin.normals, skin.triangles, skin.joints, skin.weights, rotations, shifts
    )
