"""`latentmotion data prepare|merge|check`: raw motion capture to a folder ready for training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from latentmotion.data.clip import Source
from latentmotion.data.cmu import CmuTrials
from latentmotion.data.cmu_trials import CMU
from latentmotion.data.encoding import encode_all
from latentmotion.data.hdm05 import HDM05, hdm05_recordings
from latentmotion.data.humanml3d import HUMANML3D, KIT, official_normalizer, official_recordings
from latentmotion.data.inspection import inspect_folder
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.own import OwnMotions
from latentmotion.data.preparation import Preparation, merge
from latentmotion.data.report import Report
from latentmotion.data.snu import SNU, snu_recordings
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES, KIT_FEATURES
from latentmotion.representation.interface import Representation
from latentmotion.storage.files import check_replaceable

Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]
Folder = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")]


@dataclass(frozen=True)
class PrepareCmu:
    """Cut CMU's trials as HumanML3D did and give them its captions and splits."""

    trials: Path
    """Folder of CMU trials, ASF/AMC or BVH, in any nesting."""
    humanml3d: Path
    """Folder with HumanML3D's index.csv, texts (or texts.json.xz), train.txt, val.txt, test.txt."""
    out: Out
    """The prepared folder to write."""
    fps: Path | None = None
    """JSON of native frames per second by trial, where they differ from the known ones."""
    uncaptioned: bool = False
    """Add what the index leaves of each trial, in pieces without captions, for training a VAE."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        check_replaceable(self.out, MANIFEST)
        data = CmuTrials.load(self.trials, self.humanml3d, self.fps)
        preparation = Preparation(HUMANML3D_FEATURES)
        preparation.add(encode_all(data.recordings(self.uncaptioned), HUMANML3D_FEATURES))
        notes = (
            f"HumanML3D's index has {data.missing} more CMU clips, of trials that are not in "
            f"{self.trials}; get them from {CMU.url}",
        )
        _tell(preparation.write(self.out, (CMU,), notes=notes if data.missing else ()), self.out)


@dataclass(frozen=True)
class PrepareHdm05:
    """Take HDM05's cut clips with their class as action label and as plain sentences."""

    clips: Path
    """Folder of HDM_ACTOR_CLASS_NNN_120.amc files beside their ASF files, in any nesting."""
    out: Out
    """The prepared folder to write."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        check_replaceable(self.out, MANIFEST)
        preparation = Preparation(HUMANML3D_FEATURES)
        preparation.add(encode_all(hdm05_recordings(self.clips), HUMANML3D_FEATURES))
        _tell(preparation.write(self.out, (HDM05,)), self.out)


@dataclass(frozen=True)
class PrepareSnu:
    """Cut Seoul National University's takes into pieces, with sentences from names and labels."""

    folder: Folder
    """Folder of BVH and AMC files on SNU's skeletons, in any nesting."""
    out: Out
    """The prepared folder to write."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        check_replaceable(self.out, MANIFEST)
        preparation = Preparation(HUMANML3D_FEATURES)
        preparation.add(encode_all(snu_recordings(self.folder), HUMANML3D_FEATURES))
        _tell(preparation.write(self.out, (SNU,)), self.out)


@dataclass(frozen=True)
class PrepareHumanML3D:
    """Take the official processed HumanML3D folder, with its features and statistics."""

    folder: Folder
    """Folder with new_joint_vecs, texts, train.txt, val.txt, test.txt, Mean.npy, Std.npy."""
    out: Out
    """The prepared folder to write."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        _prepare_official(self.folder, self.out, HUMANML3D, HUMANML3D_FEATURES)


@dataclass(frozen=True)
class PrepareKit:
    """Take the official processed KIT-ML folder, with its features and statistics."""

    folder: Folder
    """Folder with new_joint_vecs, texts, train.txt, val.txt, test.txt, Mean.npy, Std.npy."""
    out: Out
    """The prepared folder to write."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        _prepare_official(self.folder, self.out, KIT, KIT_FEATURES)


@dataclass(frozen=True)
class PrepareOwn:
    """Take your own BVH, AMC or NPZ files, with captions beside them or in one CSV."""

    folder: Folder
    """Folder of motion files, in any nesting."""
    out: Out
    """The prepared folder to write."""
    captions: Path | None = None
    """CSV with the columns file, caption and, if you like, from, to (seconds), split, action."""
    fps: float | None = None
    """Native frames per second, where the files say it wrongly or not at all."""
    unit: str = "centimeters"
    """Unit of length of BVH files."""
    joint_map: Path | None = None
    """JSON that says where each of HumanML3D's 22 joints is, for unknown skeletons."""
    val: float = 0.05
    """Part of the files for the val split, where the CSV has no split."""
    test: float = 0.05
    """Part of the files for the test split, where the CSV has no split."""
    name: str = "own"
    """What to call this source."""
    license: str = "unknown"
    """Terms under which the motions, and what is trained on them, may be used."""
    credit: str = ""
    """Whom to name."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        check_replaceable(self.out, MANIFEST)
        source = Source(self.name, self.license, self.credit)
        joint_map = load_joint_map(self.joint_map) if self.joint_map else None
        motions = OwnMotions(
            folder=self.folder,
            source=source,
            captions=self.captions,
            fps=self.fps,
            unit=self.unit,
            joint_map=joint_map,
            val=self.val,
            test=self.test,
        )
        preparation = Preparation(HUMANML3D_FEATURES)
        preparation.add(encode_all(motions.recordings(), HUMANML3D_FEATURES))
        _tell(preparation.write(self.out, (source,)), self.out)


@dataclass(frozen=True)
class Merge:
    """Join prepared folders into one, with one normalizer for all."""

    folders: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="FOLDERS")]
    """Prepared folders."""
    out: Out
    """The prepared folder to write."""

    def run(self) -> None:
        """Merges the folders and prints the report."""
        check_replaceable(self.out, MANIFEST)
        _tell(merge(self.folders, self.out), self.out)


@dataclass(frozen=True)
class Check:
    """Say what a folder of raw or prepared data holds, what it lacks and how to get it."""

    folder: Folder
    """The folder."""

    def run(self) -> None:
        """Prints what was found."""
        print("\n".join(inspect_folder(self.folder)))


def _prepare_official(
    folder: Path, out: Path, source: Source, representation: Representation
) -> None:
    check_replaceable(out, MANIFEST)
    normalizer = official_normalizer(folder, representation.width)
    preparation = Preparation(representation)
    preparation.add(official_recordings(folder, source, representation.width))
    _tell(preparation.write(out, (source,), normalizer), out)


def _tell(report: Report, out: Path) -> None:
    print(report.text())
    print(f"wrote {out}")
