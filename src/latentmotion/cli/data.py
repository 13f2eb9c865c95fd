"""`latentmotion data merge|pack|unpack|check`: prepared folders, joined, packed and inspected."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion.cli.options import File, Folder, Output, PreparedOutput
from latentmotion.data.inspection import inspect_folder
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.pack.packing import QUANTUM, pack, unpack
from latentmotion.data.preparation import merge
from latentmotion.data.report import Report, parts_of
from latentmotion.storage.files import check_replaceable


@dataclass(frozen=True)
class Merge:
    """Join prepared folders into one, with a common normalizer."""

    folders: Annotated[Positional[tuple[Path, ...]], arg(metavar="FOLDERS")]
    """Prepared folders."""
    output: PreparedOutput

    def run(self) -> None:
        """Merges the folders and prints the report."""
        check_replaceable(self.output, MANIFEST)
        print(merge(self.folders, self.output).text())
        print(f"wrote {self.output}")


@dataclass(frozen=True)
class PackData:
    """Write a prepared folder as one small file, with captions, sources and terms.

    Example: latentmotion data pack data/starter -o starter.pack
    """

    folder: Folder
    """Prepared folder."""
    output: Output
    """File to write."""
    quantum: float = 1000 * QUANTUM
    """Quantization step of positions in millimeters; joints return within about four thirds of
    it."""

    def run(self) -> None:
        """Writes the file and prints its size and accuracy."""
        found = pack(self.folder, self.output, self.quantum / 1000)
        size = self.output.stat().st_size
        bits = 8 * size / found.frames
        print(f"wrote {self.output} ({size / 1e6:.2f} MB, {bits:.0f} bits per frame)")
        print(f"joints within {found.joints_mm:.3f} mm, {found.contacts} contact labels differ")
        squares = found.squares.items()
        errors = (f"{name} {sqrt(total / found.frames):.4f}" for name, total in squares)
        print(f"normalized features off by (RMS): {', '.join(errors)}")


@dataclass(frozen=True)
class UnpackData:
    """Write the prepared folder that a pack holds.

    Example: latentmotion data unpack starter.pack -o data/starter
    """

    file: File
    """File that `latentmotion data pack` wrote."""
    output: PreparedOutput

    def run(self) -> None:
        """Writes the folder and prints what is in it."""
        manifest = unpack(self.file, self.output)
        print(Report(parts_of(manifest), (), None).table())
        print(f"wrote {self.output}")


@dataclass(frozen=True)
class Check:
    """List what a folder of raw or prepared data holds, what it lacks and how to get it."""

    folder: Folder
    """Folder of raw or prepared data."""

    def run(self) -> None:
        """Prints what was found."""
        print("\n".join(inspect_folder(self.folder)))
