"""`latentmotion data prepare humanact12|uestc|labelled`: motions whose label is an action."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from latentmotion.data.clip import Source
from latentmotion.data.encoding import encode_all
from latentmotion.data.humanact12 import HUMANACT12, humanact12_recordings
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.own import OwnMotions
from latentmotion.data.preparation import Preparation
from latentmotion.data.recording import Dropped, EncodedRecording
from latentmotion.data.uestc import UESTC, uestc_recordings
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.representation.interface import Representation, representation_named
from latentmotion.representation.smpl import SMPL_FEATURES
from latentmotion.storage.files import check_replaceable

Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]


@dataclass(frozen=True)
class PrepareHumanAct12:
    """Take HumanAct12's poses as ACTOR distributes them; 12 actions, one split."""

    poses: Path
    """ACTOR's humanact12poses.pkl."""
    out: Out
    """The prepared folder to write."""
    hold: int = 60
    """Frames up to which a shorter clip keeps still in its last frame, as the authors'; 0 for
    none."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = humanact12_recordings(self.poses, self.hold)
        _prepare(self.out, SMPL_FEATURES, HUMANACT12, recordings)


@dataclass(frozen=True)
class PrepareUestc:
    """Take UESTC's poses as ACTOR distributes them; 40 actions, split by subject."""

    folder: Path
    """Folder with vibe_cache_refined.pkl and info: names, num_frames_min, action_classes (.txt)."""
    out: Out
    """The prepared folder to write."""
    hold: int = 60
    """Frames up to which a shorter clip keeps still in its last frame, as the authors'; 0 for
    none."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = uestc_recordings(self.folder, self.hold)
        _prepare(self.out, SMPL_FEATURES, UESTC, recordings)


@dataclass(frozen=True)
class PrepareLabelled:
    """Take motion files in folders whose names are their actions: LABEL/take.bvh."""

    folder: Path
    """Folder of a folder per action, with BVH, ASF+AMC or NPZ files; train, val and test may be
    folders above."""
    out: Out
    """The prepared folder to write."""
    representation: Literal["humanml3d", "smpl"] = "humanml3d"
    """How motions are described: with HumanML3D's 263 features or with SMPL's 150."""
    fps: float | None = None
    """Native frames per second, where the files say it wrongly or not at all."""
    unit: str = "centimeters"
    """Unit of length of BVH files."""
    joint_map: Path | None = None
    """JSON that says where each of HumanML3D's 22 joints is, for unknown skeletons."""
    val: float = 0.05
    """Part of the files for the val split, where no folder says it."""
    test: float = 0.05
    """Part of the files for the test split, where no folder says it."""
    name: str = "labelled"
    """What to call this source."""
    license: str = "unknown"
    """Terms under which the motions, and what is trained on them, may be used."""
    credit: str = ""
    """Whom to name."""

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
        _prepare(self.out, representation, source, encoded)


def _prepare(
    out: Path,
    representation: Representation,
    source: Source,
    recordings: Iterable[EncodedRecording | Dropped],
) -> None:
    check_replaceable(out, MANIFEST)
    preparation = Preparation(representation)
    preparation.add(recordings)
    print(preparation.write(out, (source,)).text())
    print(f"wrote {out}")
