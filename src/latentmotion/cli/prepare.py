"""`latentmotion data prepare …`: raw motion capture becomes a folder ready for training."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from latentmotion.cli.options import File, Folder, Fps, JointMapFile, LengthUnit, PreparedOutput
from latentmotion.data.clip import Source
from latentmotion.data.cmu import CmuTrials
from latentmotion.data.cmu_trials import CMU
from latentmotion.data.encoding import encode_all
from latentmotion.data.hdm05 import HDM05, hdm05_recordings
from latentmotion.data.humanact12 import HUMANACT12, humanact12_recordings
from latentmotion.data.humanml3d import HUMANML3D, KIT, official_normalizer, official_recordings
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.own import OwnMotions
from latentmotion.data.preparation import Preparation
from latentmotion.data.recording import Dropped, EncodedRecording
from latentmotion.data.snu import SNU, snu_recordings
from latentmotion.data.uestc import UESTC, uestc_recordings
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES, KIT_FEATURES
from latentmotion.representation.interface import Representation, representation_named
from latentmotion.representation.smpl import SMPL_FEATURES
from latentmotion.storage.files import check_replaceable

Hold = Annotated[
    int,
    arg(
        help="Frames to which a shorter clip is extended by its last frame, as in the authors' "
        "code; 0 for none."
    ),
]
Val = Annotated[float, arg(help="Share of the files for the val split, unless stated otherwise.")]
Test = Annotated[float, arg(help="Share of the files for the test split, unless stated otherwise.")]
SourceName = Annotated[str, arg(help="Name of this data source.")]
License = Annotated[
    str, arg(help="Terms under which the motions, and models trained on them, may be used.")
]
Credit = Annotated[str, arg(help="Whom to credit.")]


@dataclass(frozen=True)
class PrepareCmu:
    """Cut CMU's trials as HumanML3D did and add its captions and splits."""

    trials: Path
    """Folder of CMU trials, ASF/AMC or BVH, nested in any way."""
    humanml3d: Path
    """Folder with HumanML3D's index.csv, texts (or texts.json.xz), train.txt, val.txt, test.txt."""
    output: PreparedOutput
    fps: Path | None = None
    """JSON file of native frames per second by trial, for trials whose rate is not known yet."""
    uncaptioned: bool = False
    """Also keep the parts of each trial that the index leaves out, without captions, for training a
    VAE."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        check_replaceable(self.output, MANIFEST)
        data = CmuTrials.load(self.trials, self.humanml3d, self.fps)
        preparation = Preparation(HUMANML3D_FEATURES)
        preparation.add(encode_all(data.recordings(self.uncaptioned), HUMANML3D_FEATURES))
        notes = (
            f"HumanML3D's index has {data.missing} more CMU clips, of trials that are not in "
            f"{self.trials}; get them from {CMU.url}",
        )
        report = preparation.write(self.output, (CMU,), notes=notes if data.missing else ())
        print(report.text())
        print(f"wrote {self.output}")


@dataclass(frozen=True)
class PrepareHdm05:
    """Take HDM05's cut clips, with their classes as action labels and as plain sentences."""

    folder: Folder
    """Folder of HDM_ACTOR_CLASS_NNN_120.amc files beside their ASF files, nested in any way."""
    output: PreparedOutput

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = encode_all(hdm05_recordings(self.folder), HUMANML3D_FEATURES)
        _prepare(self.output, HUMANML3D_FEATURES, HDM05, recordings)


@dataclass(frozen=True)
class PrepareSnu:
    """Cut Seoul National University's takes into clips, with sentences from names and labels."""

    folder: Folder
    """Folder of BVH and AMC files on SNU's skeletons, nested in any way."""
    output: PreparedOutput

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = encode_all(snu_recordings(self.folder), HUMANML3D_FEATURES)
        _prepare(self.output, HUMANML3D_FEATURES, SNU, recordings)


@dataclass(frozen=True)
class PrepareHumanML3D:
    """Take the official processed HumanML3D folder, with its features and statistics."""

    folder: Folder
    """Folder with new_joint_vecs, texts, train.txt, val.txt, test.txt, Mean.npy, Std.npy."""
    output: PreparedOutput

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        _prepare_official(self.folder, self.output, HUMANML3D, HUMANML3D_FEATURES)


@dataclass(frozen=True)
class PrepareKit:
    """Take the official processed KIT-ML folder, with its features and statistics."""

    folder: Folder
    """Folder with new_joint_vecs, texts, train.txt, val.txt, test.txt, Mean.npy, Std.npy."""
    output: PreparedOutput

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        _prepare_official(self.folder, self.output, KIT, KIT_FEATURES)


@dataclass(frozen=True)
class PrepareHumanAct12:
    """Take HumanAct12's poses as ACTOR distributes them: 12 actions, one split."""

    file: File
    """ACTOR's humanact12poses.pkl."""
    output: PreparedOutput
    hold: Hold = 60

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = humanact12_recordings(self.file, self.hold)
        _prepare(self.output, SMPL_FEATURES, HUMANACT12, recordings)


@dataclass(frozen=True)
class PrepareUestc:
    """Take UESTC's poses as ACTOR distributes them: 40 actions, split by subject."""

    folder: Folder
    """Folder with vibe_cache_refined.pkl and info: names, num_frames_min, action_classes (.txt)."""
    output: PreparedOutput
    hold: Hold = 60

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = uestc_recordings(self.folder, self.hold)
        _prepare(self.output, SMPL_FEATURES, UESTC, recordings)


@dataclass(frozen=True)
class PrepareLabelled:
    """Take motion files in folders named after their actions: LABEL/take.bvh."""

    folder: Folder
    """Folder with one folder per action, of BVH, ASF+AMC or NPZ files; the folders above may be
    train, val and test."""
    output: PreparedOutput
    representation: Literal["humanml3d", "smpl"] = "humanml3d"
    """Features of the motions: HumanML3D's 263 or SMPL's 150."""
    fps: Fps = None
    unit: LengthUnit = "centimeters"
    joint_map: JointMapFile = None
    val: Val = 0.05
    test: Test = 0.05
    name: SourceName = "labelled"
    license: License = "unknown"
    credit: Credit = ""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        source = Source(self.name, self.license, self.credit)
        motions = OwnMotions(
            folder=self.folder,
            source=source,
            fps=self.fps,
            unit=self.unit,
            joint_map=load_joint_map(self.joint_map) if self.joint_map else None,
            val=self.val,
            test=self.test,
            labelled=True,
        )
        representation = representation_named(self.representation)
        encoded = encode_all(motions.recordings(), representation)
        _prepare(self.output, representation, source, encoded)


@dataclass(frozen=True)
class PrepareOwn:
    """Take your own BVH, AMC or NPZ files, with captions beside them or in one CSV file."""

    folder: Folder
    """Folder of motion files, nested in any way."""
    output: PreparedOutput
    captions: Path | None = None
    """CSV file with the columns file and caption, and optionally from, to (seconds), split,
    action."""
    fps: Fps = None
    unit: LengthUnit = "centimeters"
    joint_map: JointMapFile = None
    val: Val = 0.05
    test: Test = 0.05
    name: SourceName = "own"
    license: License = "unknown"
    credit: Credit = ""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        source = Source(self.name, self.license, self.credit)
        motions = OwnMotions(
            folder=self.folder,
            source=source,
            captions=self.captions,
            fps=self.fps,
            unit=self.unit,
            joint_map=load_joint_map(self.joint_map) if self.joint_map else None,
            val=self.val,
            test=self.test,
        )
        encoded = encode_all(motions.recordings(), HUMANML3D_FEATURES)
        _prepare(self.output, HUMANML3D_FEATURES, source, encoded)


def _prepare_official(
    folder: Path, output: Path, source: Source, representation: Representation
) -> None:
    check_replaceable(output, MANIFEST)
    normalizer = official_normalizer(folder, representation.width)
    preparation = Preparation(representation)
    preparation.add(official_recordings(folder, source, representation.width))
    print(preparation.write(output, (source,), normalizer).text())
    print(f"wrote {output}")


def _prepare(
    output: Path,
    representation: Representation,
    source: Source,
    recordings: Iterable[EncodedRecording | Dropped],
) -> None:
    check_replaceable(output, MANIFEST)
    preparation = Preparation(representation)
    preparation.add(recordings)
    print(preparation.write(output, (source,)).text())
    print(f"wrote {output}")
