"""`latentmotion data describe`: sentences measured from motions, for training or to correct."""

from __future__ import annotations

from dataclasses import dataclass

from latentmotion.cli.options import Folder, Fps, JointMapFile, LengthUnit, Output, Seed
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
from latentmotion.evaluation.instructions.prompts import refused_captions
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.storage.files import check_replaceable

_FEW_ACTS = 3
"""Acts of a part that is told of beside single actions."""


@dataclass(frozen=True)
class Describe:
    """Measure what motions do and write it as captions.

    A prepared folder becomes a prepared folder with more captions. A folder of BVH, AMC or NPZ
    files becomes a CSV that `latentmotion data prepare own --captions` reads.
    """

    folder: Folder
    """Prepared folder or pack, or folder of motion files."""
    output: Output
    """Prepared folder, or CSV file, to write."""
    edit: bool = False
    """Write a CSV file for a prepared folder, too, to read and correct by hand."""
    check: bool = False
    """Drop captions of the train split that the motion contradicts, and print why."""
    names: bool = False
    """Use the names of motion files (`wave_hello_02.bvh`) as captions, unless contradicted."""
    windows: int = 3
    """Random excerpts per clip of the train split that get captions."""
    sentences: int = 2
    """Measured sentences per clip and per excerpt."""
    rewordings: int = 2
    """Paraphrases of each existing caption of the train split."""
    single: int = 0
    """Most windows of each category of single action ("kick with the left leg") that get prompts.
    With any, whole clips get no measured sentences, and parts only if they show few acts."""
    seed: Seed = 0
    fps: Fps = None
    unit: LengthUnit = "centimeters"
    joint_map: JointMapFile = None

    def run(self) -> None:
        """Writes the captions."""
        if min(self.windows, self.rewordings, self.single) < 0 or self.sentences < 1:
            raise InputError(
                "expected --windows, --rewordings and --single of 0 or more and --sentences of 1 "
                "or more"
            )
        windows = Windows(
            self.windows,
            sentences=self.sentences,
            whole=0 if self.single else self.sentences,
            acts=_FEW_ACTS if self.single else 0,
        )
        if not (self.folder.is_file() or (self.folder / MANIFEST).is_file()):
            self._write_csv(self._files())
            return
        if self.names:
            raise InputError(f"{self.folder}: --names is for motion files, not for prepared ones")
        options = (windows, self.seed, self.rewordings, self.check)
        if self.edit:
            self._write_csv(folder_rows(self.folder, *options))
            return
        if self.output.suffix.lower() == ".csv":
            raise InputError(f"{self.output}: a prepared folder becomes one; add --edit for a CSV")
        check_replaceable(self.output, MANIFEST)
        report = describe_folder(
            self.folder, self.output, *options, self.single, refused_captions()
        )
        print(report.text() if self.check else report.table())
        print(f"wrote {self.output}")

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
        write_captions(self.output, rows)
        files = len({row.file for row in rows})
        print(f"wrote {self.output}: {len(rows)} captions of {files} motions")
        print("Correct it, then: latentmotion data prepare own FOLDER --captions CSV -o OUT")
