"""`latentmotion data pack|unpack`: a prepared folder as one small file, and back."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Annotated

import tyro

from latentmotion.data.pack.packing import QUANTUM, pack, unpack
from latentmotion.data.report import Report, parts_of

Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]


@dataclass(frozen=True)
class PackData:
    """Write a prepared folder as one small file, with captions, sources and terms.

    Example: latentmotion data pack data/starter -o starter.pack
    """

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")]
    """Folder that `latentmotion data prepare` made."""
    out: Out
    """The file to write."""
    quantum: float = 1000 * QUANTUM
    """Step of positions, millimeters; joints come back within some four thirds of it."""

    def run(self) -> None:
        """Writes the file and says how large and how exact it is."""
        found = pack(self.folder, self.out, self.quantum / 1000)
        size = self.out.stat().st_size
        print(
            f"wrote {self.out} ({size / 1e6:.2f} MB, {8 * size / found.frames:.0f} bits per frame)"
        )
        print(f"joints within {found.joints_mm:.3f} mm, {found.contacts} contact labels differ")
        squares = found.squares.items()
        errors = (f"{name} {sqrt(total / found.frames):.4f}" for name, total in squares)
        print(f"normalized features off by (RMS): {', '.join(errors)}")


@dataclass(frozen=True)
class UnpackData:
    """Write the prepared folder that a pack holds.

    Example: latentmotion data unpack starter.pack -o data/starter
    """

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """File that `latentmotion data pack` wrote."""
    out: Out
    """The prepared folder to write."""

    def run(self) -> None:
        """Writes the folder and prints what is in it."""
        manifest = unpack(self.file, self.out)
        print(Report(parts_of(manifest), (), None).table())
        print(f"wrote {self.out}")
