"""`latentmotion clean IN.npz -o OUT.bvh`: cleans up the motions of a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import arg

from latentmotion import formats
from latentmotion.cleanup import CleanUp
from latentmotion.cli import options
from latentmotion.motion import cleaned
from latentmotion.storage.files import check_writable

_INPUT = f"Motion file: {' '.join(formats.READABLE)}."


@dataclass(frozen=True)
class Clean(options.Reading):
    """Clean up a motion: hold standing feet, remove jitter, put the figure on the floor.

    Example: latentmotion clean walk.npz -o walk.bvh --no-smooth
    """

    file: Annotated[options.File, arg(help=_INPUT)]
    output: options.Outputs
    """Files to write; the extension selects the format."""
    exact_count: bool = True
    """Make a motion that was written raw do an act as often as its sentence says, unless its
    length was given."""
    exact_turn: bool = True
    """Make a motion that was written raw turn by the degrees that its sentence names."""
    smooth: bool = True
    """Remove jitter."""
    bones: bool = True
    """Keep the length of every bone constant."""
    floor: bool = True
    """Put the figure on the floor."""
    feet: bool = True
    """Hold feet in place while they stand."""
    in_place: bool = False
    """Remove the root's path along the floor, as game engines expect."""
    cutoff: float = 5.0
    """Cutoff frequency of the smoothing in hertz: faster movement counts as jitter."""

    def run(self) -> None:
        """Reads, cleans, writes.

        Raises:
            InputError: The file cannot be read, or an ending or a folder cannot be used.
        """
        steps = CleanUp(
            exact_count=self.exact_count,
            exact_turn=self.exact_turn,
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
        motions = cleaned(formats.load(self.file, self.stated()), steps)
        written = [target for path in self.output for target in formats.save(path, motions)]
        print("\n".join(f"wrote {path}" for path in written))
