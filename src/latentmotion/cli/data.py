"""`latentmotion data …`: raw motion capture to prepared folders, and work on those."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from math import sqrt
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from tyro.conf import Positional, arg

from latentmotion import __version__
from latentmotion.cli import options
from latentmotion.cli.motions import write_draft
from latentmotion.data import inspection, instructions, pack_file, packing, prepare
from latentmotion.data.clip import Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.recording import Dropped, EncodedRecording, FileGroup
from latentmotion.data.report import PreparationReport, parts_of
from latentmotion.data.sources import actor, cmu, hdm05, humanml3d, snu
from latentmotion.data.sources.own import OwnMotions
from latentmotion.data.store import MANIFEST, StoredNormalizer
from latentmotion.errors import InputError
from latentmotion.representation import representation_named
from latentmotion.representation.humanml3d import HANDS_FEATURES, HUMANML3D_FEATURES, KIT_FEATURES
from latentmotion.representation.interface import Representation
from latentmotion.representation.smpl import SMPL_FEATURES
from latentmotion.storage import configuration, shards
from latentmotion.storage.files import check_replaceable, sha256
from latentmotion.training.captioning import described
from latentmotion.training.captioning.compose import Composition, compose

Hold = Annotated[
    int,
    arg(
        help="Frames to which a shorter clip is extended by its last frame, as in the authors' "
        "code; 0 for none."
    ),
]


@dataclass(frozen=True, kw_only=True)
class _Prepare:
    """Options of every command that writes a prepared folder."""

    output: options.PreparedOutput

    def _write(
        self,
        representation: Representation,
        source: Source,
        recordings: Iterable[EncodedRecording | Dropped],
        normalizer: StoredNormalizer | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        """Writes the folder and prints its report."""
        check_replaceable(self.output, MANIFEST)
        preparation = prepare.Preparation(representation)
        preparation.add(recordings)
        print(preparation.write(self.output, (source,), normalizer, notes).text())
        print(f"wrote {self.output}")


@dataclass(frozen=True, kw_only=True)
class _PrepareInParts(_Prepare):
    """Options of commands whose files several processes can read."""

    shard: str | None = None
    """Read only a part of the files, such as 3/16: the third of sixteen processes. What is read is
    kept beside the output folder (OUTPUT.recordings), where a killed run is resumed; whoever finds
    all of it finished writes the folder."""

    def _prepare(
        self,
        source: Source,
        groups: Callable[[int | None], Sequence[FileGroup]],
        settings: Mapping[str, Any],
        representation: Representation = HUMANML3D_FEATURES,
        notes: tuple[str, ...] = (),
    ) -> None:
        """Prepares the folder and prints the report; or reads a part of the files.

        Raises:
            InputError: There is no such part, or what is kept beside the folder is of other files.
        """
        share = options.share_of(self.shard)
        # Before the files are read, which takes minutes to hours.
        check_replaceable(self.output, MANIFEST)
        if not self.shard:
            read = chain.from_iterable(group.read() for group in groups(None))
            recordings = prepare.encode_all(read, representation)
        else:
            # Another version may read the same files otherwise: what is kept beside is not its.
            versioned = {"version": __version__, **settings}
            work = packing.work_of(groups(packing.FILES), representation, versioned)
            beside = self.output.with_name(f"{self.output.name}.recordings")
            folder = shards.folder_at(beside, create=True)

            def report(record: shards.Record) -> None:
                print(f"{record.name}: {record.items} files", file=sys.stderr, flush=True)

            if shards.make(work, folder, share, report) is None:
                print(f"shard {self.shard} is finished, others are not")
                return
            recordings = packing.recordings_of(folder)
        self._write(representation, source, recordings, notes=notes)


@dataclass(frozen=True, kw_only=True)
class _PrepareOwnFiles(options.ReadingOptions, _PrepareInParts):
    """Options of commands that read motion files of the user's."""

    draft_map: options.DraftMapFile = None
    val: float = 0.05
    """Share of the files for the val split, unless stated otherwise."""
    test: float = 0.05
    """Share of the files for the test split, unless stated otherwise."""
    name: str = "own"
    """Name of this data source."""
    license: str = "unknown"
    """Terms under which the motions, and models trained on them, may be used."""
    credit: str = ""
    """Whom to credit."""

    def _prepare_files(self, folder: Path, representation: Representation, **choices: Any) -> None:
        """Prepares the files of a folder, or drafts a joint map of them."""
        source = Source(self.name, self.license, self.credit)
        motions = OwnMotions(
            folder, source, stated=self.stated(), val=self.val, test=self.test, **choices
        )
        if self.draft_map:
            skeleton = motions.unknown_skeleton()
            if skeleton is None:
                raise InputError(f"{folder}: all names of joints are known, so no map is needed")
            write_draft(self.draft_map, skeleton)
            return
        captions = [motions.captions] if motions.captions else []
        if motions.captions and motions.captions.is_dir():  # its texts are files of the groups
            captions = sorted(motions.captions.glob("*.txt"))
        # What decides how motion files are read: other files are no part of the same run.
        settings = {
            "source": self.name,
            "captions": [sha256(path) for path in captions],
            "map": [sha256(path) for path in self.map],
            **{name: getattr(self, name) for name in ("fps", "unit", "up")},
            **{
                name: getattr(motions, name)
                for name in ("val", "test", "labelled", "generated", "hands")
            },
        }
        self._prepare(source, motions.groups, settings, representation)


@dataclass(frozen=True)
class PrepareCmu(_PrepareInParts):
    """Cut CMU's trials as HumanML3D did and add its captions and splits."""

    trials: Path
    """Folder of CMU trials, ASF/AMC or BVH, nested in any way."""
    humanml3d: Path
    """Folder with HumanML3D's index.csv, texts (or texts.json.xz), train.txt, val.txt, test.txt."""
    uncaptioned: bool = False
    """Also keep the parts of each trial that the index leaves out, without captions, for training a
    VAE."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        data = cmu.CmuTrials.load(self.trials, self.humanml3d)
        tables = configuration.to_json([data.rows, data.splits, data.texts, data.exercises])
        digest = hashlib.sha256(json.dumps(tables).encode()).hexdigest()
        settings = {"source": "cmu", "uncaptioned": self.uncaptioned, "annotations": digest}
        notes = (
            f"HumanML3D's index has {data.missing} more CMU clips, of trials that are not in "
            f"{self.trials}; get them from {cmu.CMU.url}",
        )
        groups = partial(data.groups, uncaptioned=self.uncaptioned)
        self._prepare(cmu.CMU, groups, settings, notes=notes if data.missing else ())


@dataclass(frozen=True)
class PrepareHdm05(_PrepareInParts):
    """Take HDM05's cut clips, with their classes as action labels and as plain sentences."""

    folder: options.Folder
    """Folder of HDM_ACTOR_CLASS_NNN_120.amc files beside their ASF files, nested in any way."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        self._prepare(hdm05.HDM05, partial(hdm05.hdm05_groups, self.folder), {"source": "hdm05"})


@dataclass(frozen=True)
class PrepareSnu(_Prepare):
    """Cut Seoul National University's takes into clips, with sentences from names and labels."""

    folder: options.Folder
    """Folder of BVH and AMC files on SNU's skeletons, nested in any way."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = prepare.encode_all(snu.snu_recordings(self.folder), HUMANML3D_FEATURES)
        self._write(HUMANML3D_FEATURES, snu.SNU, recordings)


@dataclass(frozen=True)
class PrepareHumanML3D(_Prepare):
    """Take the official processed HumanML3D folder, with its features and statistics."""

    folder: options.Folder
    """Folder with new_joint_vecs, texts, train.txt, val.txt, test.txt, Mean.npy, Std.npy."""

    official: ClassVar = (humanml3d.HUMANML3D, HUMANML3D_FEATURES)

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        check_replaceable(self.output, MANIFEST)
        source, representation = self.official
        normalizer = humanml3d.official_normalizer(self.folder, representation.width)
        recordings = humanml3d.official_recordings(self.folder, source, representation.width)
        self._write(representation, source, recordings, normalizer)


@dataclass(frozen=True)
class PrepareKit(PrepareHumanML3D):
    """Take the official processed KIT-ML folder, with its features and statistics."""

    official = humanml3d.KIT, KIT_FEATURES


@dataclass(frozen=True)
class PrepareHumanAct12(_Prepare):
    """Take HumanAct12's poses as ACTOR distributes them: 12 actions, one split."""

    file: options.File
    """ACTOR's humanact12poses.pkl."""
    hold: Hold = 60

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        recordings = actor.humanact12_recordings(self.file, self.hold)
        self._write(SMPL_FEATURES, actor.HUMANACT12, recordings)


@dataclass(frozen=True)
class PrepareUestc(_Prepare):
    """Take UESTC's poses as ACTOR distributes them: 40 actions, split by subject."""

    folder: options.Folder
    """Folder with vibe_cache_refined.pkl and info: names, num_frames_min, action_classes (.txt)."""
    hold: Hold = 60

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        self._write(SMPL_FEATURES, actor.UESTC, actor.uestc_recordings(self.folder, self.hold))


@dataclass(frozen=True, kw_only=True)
class PrepareLabelled(_PrepareOwnFiles):
    """Take motion files in folders named after their actions: LABEL/take.bvh."""

    folder: options.Folder
    """Folder with one folder per action, of BVH, FBX, GLB, ASF+AMC or NPZ files; the folders above
    may be train, val and test."""
    representation: Literal["humanml3d", "smpl"] = "humanml3d"
    """Features of the motions: HumanML3D's 263 or SMPL's 150."""
    name: str = "labelled"
    """Name of this data source."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        self._prepare_files(self.folder, representation_named(self.representation), labelled=True)


@dataclass(frozen=True)
class PrepareOwn(_PrepareOwnFiles):
    """Take your own BVH, FBX, GLB, AMC, USD or NPZ files, with captions beside them or in a CSV."""

    folder: options.Folder
    """Folder of motion files, nested in any way."""
    captions: Path | None = None
    """CSV file with the columns file and caption, and optionally from, to (seconds), split, action;
    BABEL's train.json, val.json or test.json beside AMASS's files; or a folder with a text for each
    motion, as Motion-X's semantic_labels."""
    hands: bool = False
    """Keep fingers of AMASS's SMPL-H and SMPL-X files and of Motion-X's as 30 joints more than the
    body's 22; other files are left out."""
    generated: bool = False
    """Also take `.npz` files of motions that a model generated; else they are left out."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        representation = HANDS_FEATURES if self.hands else HUMANML3D_FEATURES
        choices = {name: getattr(self, name) for name in ("captions", "hands", "generated")}
        self._prepare_files(self.folder, representation, **choices)


@dataclass(frozen=True)
class PreparePlugin(_Prepare):
    """Take what a data source of another installed package reads (docs/guide/plugins.md)."""

    source: Annotated[Positional[str], arg(metavar="SOURCE")]
    """Name of the plugin."""
    folder: options.Folder
    """What it reads."""
    representation: Literal["humanml3d", "hands", "smpl"] = "humanml3d"
    """Features of the motions: HumanML3D's 263, 623 of a body with hands, or SMPL's 150."""

    def run(self) -> None:
        """Prepares the folder and prints the report."""
        source = configuration.part_named("latentmotion.data_sources", self.source)
        if missing := [name for name in ("SOURCE", "recordings") if not hasattr(source, name)]:
            raise InputError(f"the data source {self.source!r} lacks {' and '.join(missing)}")
        representation = representation_named(self.representation)
        recordings = prepare.encode_all(source.recordings(self.folder), representation)
        self._write(representation, source.SOURCE, recordings)


@dataclass(frozen=True)
class Merge(_Prepare):
    """Join prepared folders into one, with a common normalizer."""

    folders: Annotated[Positional[tuple[Path, ...]], arg(metavar="FOLDERS")]
    """Prepared folders."""

    def run(self) -> None:
        """Merges the folders and prints the report."""
        check_replaceable(self.output, MANIFEST)
        print(prepare.merge(self.folders, self.output).text())
        print(f"wrote {self.output}")


@dataclass(frozen=True)
class PackData:
    """Write a prepared folder as one small file, with captions, sources and terms.

    Example: latentmotion data pack data/starter -o starter.pack
    """

    folder: options.Folder
    """Prepared folder."""
    output: options.Output
    """File to write."""
    quantum: float = 1000 * pack_file.QUANTUM
    """Quantization step of positions in millimeters; joints return within about four thirds of
    it."""

    def run(self) -> None:
        """Writes the file and prints its size and accuracy."""
        pack = packing.pack(self.folder, self.output, self.quantum / 1000)
        size = self.output.stat().st_size
        bits = 8 * size / pack.frames
        print(f"wrote {self.output} ({size / 1e6:.2f} MB, {bits:.0f} bits per frame)")
        print(f"joints within {pack.joints_mm:.3f} mm, {pack.contacts} contact labels differ")
        squares = pack.squares.items()
        errors = (f"{name} {sqrt(total / pack.frames):.4f}" for name, total in squares)
        print(f"normalized features off by (RMS): {', '.join(errors)}")


@dataclass(frozen=True)
class UnpackData(_Prepare):
    """Write the prepared folder that a pack holds.

    Example: latentmotion data unpack starter.pack -o data/starter
    """

    file: options.File
    """File that `latentmotion data pack` wrote."""

    def run(self) -> None:
        """Writes the folder and prints what is in it."""
        manifest = pack_file.unpack(self.file, self.output)
        print(PreparationReport(parts_of(manifest), (), None).table())
        print(f"wrote {self.output}")


@dataclass(frozen=True)
class CheckData:
    """List what a folder of raw or prepared data holds, what it lacks and how to get it."""

    folder: options.Folder
    """Folder of raw or prepared data."""

    def run(self) -> None:
        """Prints what was found."""
        print("\n".join(inspection.inspect_folder(self.folder)))


@dataclass(frozen=True)
class Compose:
    """Join single actions of the train split in pairs: "A, then B", for training only.

    Examples:
        latentmotion data compose data -o composed --count 500
        latentmotion data merge data composed -o everything
    """

    folder: options.Folder
    """Prepared folder."""
    output: options.Output
    """Prepared folder to write; it holds the sequences only."""
    count: int = 500
    """Number of sequences."""
    seed: options.Seed = 0

    def run(self) -> None:
        """Composes, writes the folder and prints what came of it.

        Raises:
            DataError: The folder holds no clips that could be joined.
            InputError: The count or the seed is no number to count with.
        """
        if self.count < 1 or self.seed < 0:
            raise InputError(
                f"count {self.count}, seed {self.seed}; expected at least 1 and at least 0"
            )
        check_replaceable(self.output, MANIFEST)
        dataset = Dataset.load(self.folder)
        composed = compose(dataset, Composition(self.count, self.seed))
        preparation = prepare.Preparation(dataset.representation)
        preparation.motions.extend(composed.motions)
        left_out = ", ".join(f"{count} {why}" for why, count in composed.refused.most_common())
        note = f"{len(composed.motions)} sequences composed; refused: {left_out or 'none'}"
        print(preparation.write(self.output, (composed.source,), notes=(note,)).text())
        print(f"wrote {self.output}")


@dataclass(frozen=True)
class Describe(options.ReadingOptions):
    """Measure what motions do and write it as captions.

    A prepared folder becomes a prepared folder with more captions. A folder of BVH, FBX, GLB, AMC
    or NPZ files becomes a CSV that `latentmotion data prepare own --captions` reads.
    """

    folder: options.Folder
    """Prepared folder or pack, or folder of motion files."""
    output: options.Output
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
    seed: options.Seed = 0

    def run(self) -> None:
        """Writes the captions."""
        if min(self.windows, self.rewordings) < 0 or self.sentences < 1:
            raise InputError(
                "expected --windows and --rewordings of 0 or more and --sentences of 1 or more"
            )
        windows = described.Windows(self.windows, sentences=self.sentences, whole=self.sentences)
        if not (self.folder.is_file() or (self.folder / MANIFEST).is_file()):
            reason = f"{self.folder} is no prepared data"
            options.refuse_unused(self, reason, "edit", "windows", "sentences", "rewordings")
            motions = OwnMotions(self.folder, Source("own", "unknown", ""), stated=self.stated())
            self.write_csv(described.describe_files(motions, self.seed, self.check, self.names))
            return
        reason = f"{self.folder} is prepared data"
        options.refuse_unused(self, reason, "names", "unit", "up", "fps", "map")
        settings = (windows, self.seed, self.rewordings, self.check)
        if self.edit:
            self.write_csv(described.folder_rows(self.folder, *settings))
            return
        if self.output.suffix.lower() == ".csv":
            raise InputError(f"{self.output}: a prepared folder becomes one; add --edit for a CSV")
        check_replaceable(self.output, MANIFEST)
        report = described.describe_folder(
            self.folder, self.output, *settings, instructions.refused_captions()
        )
        print(report.text() if self.check else report.table())
        print(f"wrote {self.output}")

    def write_csv(self, items: list[described.FileRow | Dropped]) -> None:
        """Writes the captions and prints which motions were dropped."""
        for item in items:
            if isinstance(item, Dropped):
                print(f"{item.id}: {item.reason}")
        rows = [item for item in items if isinstance(item, described.FileRow)]
        if not rows:
            raise InputError(f"{self.folder}: no motion in it can be described")
        described.write_captions(self.output, rows)
        files = len({row.file for row in rows})
        print(f"wrote {self.output}: {len(rows)} captions of {files} motions")
        print("Correct it, then: latentmotion data prepare own FOLDER --captions CSV -o OUT")
