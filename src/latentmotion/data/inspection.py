"""Contents of a folder of raw or prepared data: what is there, what is missing, how to get it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from latentmotion.data.clip import SPLITS
from latentmotion.data.dataset import Dataset
from latentmotion.data.recording import files_below
from latentmotion.data.report import PreparationReport, parts_of
from latentmotion.data.sources import actor, cmu, hdm05, humanml3d, own, snu
from latentmotion.data.store import MANIFEST
from latentmotion.errors import DataError
from latentmotion.storage.files import sha256

_EXPECTED = (
    f"expected a prepared folder ({MANIFEST}), HumanML3D's captions (index.csv, texts, train.txt), "
    f"an official processed folder ({humanml3d.FEATURES}), humanact12poses.pkl or {actor.POSES}, "
    "CMU trials (SS_TT.amc or .bvh), HDM05's clips (HDM_ACTOR_CLASS_NNN_120.amc), SNU's takes or "
    "your own BVH files"
)


def inspect_folder(folder: Path) -> list[str]:
    """Returns lines that say what is there, what is missing and what to do next.

    Raises:
        DataError: There is no such folder, nothing known in it, or it is damaged.
    """
    if folder.is_file() or (folder / MANIFEST).is_file():
        return list(_prepared(Dataset.load(folder)))
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; {_EXPECTED}")
    annotated, lines = list(_annotations_and_poses(folder)), []
    trials: set[Path] = set()
    with suppress(DataError):
        trials = set(cmu.find_trials(folder).values())
        lines += list(_cmu(folder))
    with suppress(DataError):
        lines += [
            f"HDM05: {len(hdm05.find_clips(folder))} cut clips",
            f"next: latentmotion data prepare hdm05 {folder} -o OUT",
        ]
    with suppress(DataError):
        takes = snu.find_takes(folder)
        labels = sum(path.parent.name == "annotation" for path in files_below(folder, [".lab"]))
        lines += [
            f"SNU: {len(takes)} takes on its skeletons, {labels} files of annotations",
            f"next: latentmotion data prepare snu {folder} -o OUT",
        ]
    if lines and not trials:
        return [*annotated, *lines]
    with suppress(DataError):
        motions = [path for path in own.find_motions(folder).values() if path not in trials]
        captioned = sum(path.with_suffix(".txt").is_file() for path in motions)
        if motions:
            other = "other " if trials else ""
            lines.append(
                f"{other}motion files: {len(motions)}, of which {captioned} have captions beside "
                "them"
            )
            if captioned < len(motions) and not any(folder.glob("*.csv")):
                lines.append(
                    "  missing: captions (NAME.txt beside NAME.bvh, or a CSV with file,caption)"
                )
            lines.append(f"next: latentmotion data prepare own {folder} -o OUT")
    if not annotated and not lines:
        raise DataError(f"{folder}: found nothing known; {_EXPECTED}")
    return [*annotated, *lines]


def _prepared(dataset: Dataset) -> Iterator[str]:
    folder, manifest = dataset.folder, dataset.manifest
    for shard in manifest.shards:
        if sha256(folder / shard.file) != shard.sha256:
            raise DataError(f"{folder / shard.file} is damaged (hash); copy it or prepare again")
    for split in SPLITS:
        for clip in dataset.clips(split):
            dataset.features(clip)  # which checks them
    yield f"prepared data set: {manifest.representation}, {manifest.fps:g} fps, every hash right"
    yield PreparationReport(parts_of(manifest), (), None).table()
    yield f"normalizer: {manifest.normalizer.origin}"
    if counts := Counter(clip.action for clip in manifest.clips if clip.action):
        actions = ", ".join(f"{action} {count}" for action, count in sorted(counts.items()))
        yield f"actions: {len(counts)} ({actions})"
    for source in manifest.sources:
        yield f"source {source.name}{f', {source.url}' if source.url else ''}"
        yield f"  terms: {source.license}"
        yield f"  credit: {source.credit or 'nobody is named'}"


def _annotations_and_poses(folder: Path) -> Iterator[str]:
    """Yields lines about HumanML3D's annotations and features, and about SMPL's poses."""
    for path in sorted(folder.rglob("index.csv")):
        yield f"HumanML3D's index in {path.parent}: {len(humanml3d.read_index(path.parent))} clips"
        for name, reader in (("captions", humanml3d.read_texts), ("splits", humanml3d.read_splits)):
            try:
                yield f"  {name}: {len(reader(path.parent))} ids"
            except DataError as error:
                yield f"  missing {name}: {error}"
    if (folder / humanml3d.FEATURES).is_dir():
        count = sum(1 for _ in (folder / humanml3d.FEATURES).glob("*.npy"))
        yield f"official processed folder: {count} clips (mirrored copies included)"
        for name in ("texts", "train.txt", "val.txt", "test.txt", "Mean.npy", "Std.npy"):
            if not (folder / name).exists():
                yield f"  missing {name}: {humanml3d.GET_IT}"
        yield f"next: latentmotion data prepare humanml3d {folder} -o OUT (or kit)"
    for path in sorted(folder.rglob("humanact12poses.pkl")):
        yield "HumanAct12 with SMPL's poses"
        yield f"next: latentmotion data prepare humanact12 {path} -o OUT"
    for path in sorted(folder.rglob(actor.POSES)):
        yield "UESTC with VIBE's poses"
        for name in (actor.NAMES_FILE, actor.FRAMES_FILE, actor.ACTIONS_FILE):
            if not (path.parent / name).is_file():
                yield f"  missing {name}, from {actor.UESTC.url}"
        yield f"next: latentmotion data prepare uestc {path.parent} -o OUT"


def _cmu(folder: Path) -> Iterator[str]:
    trials = cmu.find_trials(folder)
    endings = [path.suffix.lower() for path in trials.values()]
    yield f"CMU trials: {endings.count('.amc')} AMC, {endings.count('.bvh')} BVH"
    amc = [path for path in trials.values() if path.suffix.lower() == ".amc"]
    for parent in sorted({path.parent for path in amc}):
        if not any(path.suffix.lower() == ".asf" for path in parent.iterdir()):
            yield f"  missing: the ASF file in {parent}; get it from {cmu.CMU.url}"
    index = next(iter(sorted(folder.rglob("index.csv"))), None)
    if index is None:
        yield f"  missing: HumanML3D's captions and index; {humanml3d.GET_IT}"
    else:
        rows = cmu.rows_by_trial(index.parent)
        lacking = sorted(set(rows) - set(trials))
        clips, missing = sum(map(len, rows.values())), sum(len(rows[trial]) for trial in lacking)
        cut = clips - missing
        yield f"  HumanML3D has {clips} clips of CMU; {cut} of them can be cut from these"
        if lacking:
            shown = ", ".join(lacking[:8]) + (", …" if len(lacking) > 8 else "")
            yield f"  missing: {len(lacking)} trials, from {cmu.CMU.url}: {shown}"
    yield f"next: latentmotion data prepare cmu --trials {folder} --humanml3d FOLDER -o OUT"
