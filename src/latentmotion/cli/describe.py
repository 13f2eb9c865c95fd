"""`latentmotion data describe`: sentences measured from motions, for training or to correct."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from latentmotion.data.clip import Source
from latentmotion.data.described import (
    FileRow,
    describe_files,
    describe_folder,
    folder_rows,
    write_captions,
)
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.own import OwnMotions
from latentmotion.data.recording import Dropped
from latentmotion.describe.windows import Windows
from latentmotion.errors import InputError
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.storage.files import check_replaceable


@dataclass(frozen=True)
class Describe:
    """Measure what motions do and write it as captions.

    A prepared folder becomes a prepared folder with more captions. A folder of BVH, AMC or NPZ
    files becomes a CSV that `latentmotion data prepare own --captions` reads.
    """

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")]
    """A prepared folder or a pack, or a folder of motion files."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """The prepared folder, or the CSV, to write."""
    edit: bool = False
    """Of a prepared folder, too, write a CSV, to read and correct by hand."""
    check: bool = False
    """Leave out captions that the motion contradicts, and say why; of the train split alone."""
    names: bool = False
    """Take motion files' names (`wave_hello_02.bvh`) for what they show, unless contradicted."""
    windows: int = 3
    """Parts of random length and place per clip of the train split that get captions."""
    sentences: int = 2
    """Measured sentences per clip and per part."""
    rewordings: int = 2
    """How often each caption that the train split has is said in other words."""
    seed: int = 0
    """What draws parts and wording."""
    fps: float | None = None
    """Native frames per second of motion files, where they say it wrongly or not at all."""
    unit: str = "centimeters"
    """Unit of length of BVH files."""
    joint_map: Path | None = None
    """JSON that says where each of HumanML3D's 22 joints is, for unknown skeletons."""

    def run(self) -> None:
        """Writes the captions."""
        if min(self.windows, self.rewordings) < 0 or self.sentences < 1:
            raise InputError(
                "expected --windows and --rewordings of 0 or more and --sentences of 1 or more"
            )
        windows = Windows(self.windows, sentences=self.sentences, whole=self.sentences)
        if not (self.folder.is_file() or (self.folder / MANIFEST).is_file()):
            self._write_csv(self._files())
            return
        if self.names:
            raise InputError(f"{self.folder}: --names is for motion files, not for prepared ones")
        options = (windows, self.seed, self.rewordings, self.check)
        if self.edit:
            self._write_csv(folder_rows(self.folder, *options))
            return
        if self.out.suffix.lower() == ".csv":
            raise InputError(f"{self.out}: a prepared folder becomes one; add --edit for a CSV")
        check_replaceable(self.out, MANIFEST)
        report = describe_folder(self.folder, self.out, *options)
        print(report.text() if self.check else report.table())
        print(f"wrote {self.out}")

    def _files(self) -> list[FileRow | Dropped]:
        joint_map = load_joint_map(self.joint_map) if self.joint_map else None
        source = Source("own", "unknown", "")
        motions = OwnMotions(self.folder, source, fps=self.fps, unit=self.unit, joint_map=joint_map)
        return describe_files(motions, self.seed, self.check, self.names)

    def _write_csv(self, found: list[FileRow | Dropped]) -> None:
        """Writes the captions and tells what was left out."""
        for item in found:
            if isinstance(item, Dropped):
                print(f"{item.id}: {item.reason}")
        rows = [item for item in found if isinstance(item, FileRow)]
        if not rows:
            raise InputError(f"{self.folder}: no motion in it can be described")
        write_captions(self.out, rows)
        files = len({row.file for row in rows})
        print(f"wrote {self.out}: {len(rows)} captions of {files} motions")
        print("Correct it, then: latentmotion data prepare own FOLDER --captions CSV -o OUT")
