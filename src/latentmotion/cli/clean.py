"""`latentmotion clean IN.npz -o OUT.bvh`: a motion file in, the same motion cleaned up out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cleanup import CleanUp
from latentmotion.storage.files import check_writable

_INPUT = f"Motion file: {' '.join(formats.READABLE)}."


@dataclass(frozen=True)
class Clean:
    """Hold the feet of a motion where they stand, steady it, put it on the floor.

    Example: latentmotion clean walk.npz -o walk.bvh --no-smooth
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help=_INPUT)]
    output: Annotated[tuple[Path, ...], arg(aliases=["-o"])]
    """Files to write, the ending picks the format."""
    smooth: bool = True
    """Take out shaking."""
    bones: bool = True
    """Give every bone one length."""
    floor: bool = True
    """Put the figure on the floor."""
    feet: bool = True
    """Hold feet that stand."""
    in_place: bool = False
    """Take away the path along the floor, as game engines like it."""
    cutoff: float = 5.0
    """Hertz up to which movement counts as meant and not as shaking."""

    def run(self) -> None:
        """Reads, cleans, writes.

        Raises:
            InputError: The file cannot be read, or an ending or a folder cannot be used.
        """
        steps = CleanUp(
            smooth=self.smooth,
            bones=self.bones,
            floor=self.floor,
            feet=self.feet,
            in_place=self.in_place,
            cutoff=self.cutoff,
        )
        for path in self.output:
            formats.check_ending(path)
            check_writable(path)
        motions = [motion.cleaned(steps) for motion in formats.load(self.file)]
        written = [target for path in self.output for target in formats.save(path, motions)]
        print("\n".join(f"wrote {path}" for path in written))
