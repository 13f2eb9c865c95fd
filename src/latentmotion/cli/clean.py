"""`latentmotion clean IN.npz -o OUT.bvh`: cleans up the motions of a file."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from latentmotion import formats
from latentmotion.cleanup import CleanUp, clean_batch
from latentmotion.cleanup.pipeline import Changes, CleanUpWarning
from latentmotion.cli import options
from latentmotion.errors import ReadingWarning
from latentmotion.motion import Motion
from latentmotion.retarget import read_rig, transfer
from latentmotion.storage.files import check_writable

_INPUT = f"Motion file: {' '.join(formats.READABLE)}."


@dataclass(frozen=True)
class Clean(options.MotionOptions):
    """Clean up a motion: hold standing feet, remove jitter, put the figure on the floor.

    A BVH file that is cleaned into a BVH file keeps its skeleton, its unit and its axes.

    Example: latentmotion clean walk.npz -o walk.bvh --no-smooth
    """

    file: Annotated[options.File, arg(help=_INPUT)]
    output: options.Outputs
    """Files to write; the extension selects the format."""
    skeleton: Literal["own", "ours"] = "own"
    """Skeleton of a BVH file that is written: the file's own with all its joints, or our 22."""
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
        if not self.smooth:
            options.refuse_unused(self, "--no-smooth leaves jitter as it is", "cutoff")
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
        before = self.load(self.file)
        motions = clean_batch(before, steps)
        written = [target for path in self.output for target in self._write(path, motions)]
        print("\n".join(f"wrote {path}" for path in written))
        for old, new in zip(before, motions, strict=True):
            tell(Changes.of(old, new), in_place=self.in_place)

    def _write(self, path: Path, motions: list[Motion]) -> list[Path]:
        if self.skeleton == "ours":
            return formats.save(path, [motion.with_recorded(None) for motion in motions])
        if {path.suffix.lower(), self.file.suffix.lower()} == {".bvh"}:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ReadingWarning)  # told when it was read
                rig = read_rig(self.file, stated=self.stated())
            return transfer.write(path, replace(rig, floor=0.0), motions)
        return formats.save(path, motions)


def tell(changes: Changes, in_place: bool = False) -> None:
    """Prints what a clean-up did; a warning where that is much."""
    print(changes.text)
    if changes.problem and not in_place:
        warnings.warn(changes.problem, CleanUpWarning, stacklevel=2)
