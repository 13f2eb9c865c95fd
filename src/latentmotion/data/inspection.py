"""What a folder holds, what it lacks and how to get it: raw data of every kind, or prepared."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from latentmotion.data.annotations import GET_IT, read_index, read_splits, read_texts
from latentmotion.data.cmu_trials import CMU, find_trials, rows_by_trial
from latentmotion.data.dataset import Dataset
from latentmotion.data.finding import files_below
from latentmotion.data.hdm05 import find_clips
from latentmotion.data.humanml3d import FEATURES
from latentmotion.data.manifest import MANIFEST
from latentmotion.data.own import find_motions
from latentmotion.data.report import Report, parts_of
from latentmotion.data.snu import find_takes
from latentmotion.data.uestc import ACTIONS, FRAMES, NAMES, POSES, UESTC
from latentmotion.errors import DataError
from latentmotion.storage.files import sha256

_EXPECTED = (
    f"expected a prepared folder ({MANIFEST}), HumanML3D's captions (index.csv, texts, train.txt), "
    f"an official processed folder ({FEATURES}), humanact12poses.pkl or {POSES}, CMU "
    "trials (SS_TT.amc or .bvh), HDM05's clips (HDM_ACTOR_CLASS_NNN_120.amc), SNU's takes or your "
    "own BVH files"
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
    looks = (_annotations, _official, _poses, _motions)
    lines = [line for look in looks for line in look(folder)]
    if not lines:
        raise DataError(f"{folder}: found nothing known; {_EXPECTED}")
    return lines


def _prepared(dataset: Dataset) -> Iterator[str]:
    folder = dataset.folder
    for shard in dataset.manifest.shards:
        if sha256(folder / shard.file) != shard.sha256:
            raise DataError(f"{folder / shard.file} is damaged (hash); copy it or prepare again")
    for split in ("train", "val", "test"):
        for clip in dataset.clips(split):
            if not np.isfinite(dataset.features(clip)).all():
                raise DataError(f"{folder}: clip {clip.id} is not finite; prepare it again")
    manifest = dataset.manifest
    yield f"prepared data set: {manifest.representation}, {manifest.fps:g} fps, every hash right"
    yield Report(parts_of(manifest), (), None).table()
    yield f"normalizer: {manifest.normalizer.origin}"
    if counts := Counter(clip.action for clip in manifest.clips if clip.action):
        every = ", ".join(f"{action} {count}" for action, count in sorted(counts.items()))
        yield f"actions: {len(counts)} ({every})"
    for source in manifest.sources:
        yield f"source {source.name}{f', {source.url}' if source.url else ''}"
        yield f"  terms: {source.license}"
        yield f"  credit: {source.credit or 'nobody is named'}"


def _annotations(folder: Path) -> Iterator[str]:
    found = [path.parent for path in sorted(folder.rglob("index.csv"))]
    for place in found:
        rows = read_index(place)
        yield f"HumanML3D's index in {place}: {len(rows)} clips"
        for name, reader in (("captions", read_texts), ("splits", read_splits)):
            try:
                yield f"  {name}: {len(reader(place))} ids"
            except DataError as error:
                yield f"  missing {name}: {error}"


def _official(folder: Path) -> Iterator[str]:
    if not (folder / FEATURES).is_dir():
        return
    count = sum(1 for _ in (folder / FEATURES).glob("*.npy"))
    yield f"official processed folder: {count} clips (mirrored copies included)"
    needed = ("texts", "train.txt", "val.txt", "test.txt", "Mean.npy", "Std.npy")
    for name in needed:
        if not (folder / name).exists():
            yield f"  missing {name}: {GET_IT}"
    yield f"next: latentmotion data prepare humanml3d {folder} -o OUT (or kit)"


def _poses(folder: Path) -> Iterator[str]:
    for path in sorted(folder.rglob("humanact12poses.pkl")):
        yield "HumanAct12 with SMPL's poses"
        yield f"next: latentmotion data prepare humanact12 --poses {path} -o OUT"
    for path in sorted(folder.rglob(POSES)):
        yield "UESTC with VIBE's poses"
        for name in (NAMES, FRAMES, ACTIONS):
            if not (path.parent / name).is_file():
                yield f"  missing {name}, from {UESTC.url}"
        yield f"next: latentmotion data prepare uestc --folder {path.parent} -o OUT"


def _motions(folder: Path) -> Iterator[str]:
    lines = [line for look in (_cmu, _hdm05, _snu) for line in _found(look, folder)]
    yield from lines or _found(_own, folder)


def _found(look: Callable[[Path], Iterator[str]], folder: Path) -> list[str]:
    try:
        return list(look(folder))
    except DataError:
        return []


def _cmu(folder: Path) -> Iterator[str]:
    trials = find_trials(folder)
    kinds = [path.suffix.lower() for path in trials.values()]
    yield f"CMU trials: {kinds.count('.amc')} AMC, {kinds.count('.bvh')} BVH"
    amc = [path for path in trials.values() if path.suffix.lower() == ".amc"]
    for place in sorted({path.parent for path in amc}):
        if not any(path.suffix.lower() == ".asf" for path in place.iterdir()):
            yield f"  missing: the ASF file in {place}; get it from {CMU.url}"
    index = next(iter(sorted(folder.rglob("index.csv"))), None)
    if index is None:
        yield f"  missing: HumanML3D's captions and index; {GET_IT}"
    else:
        yield from _coverage(trials, index.parent)
    yield f"next: latentmotion data prepare cmu --trials {folder} --humanml3d FOLDER -o OUT"


def _coverage(trials: Mapping[str, Path], humanml3d: Path) -> Iterator[str]:
    rows = rows_by_trial(humanml3d)
    lacking = sorted(set(rows) - set(trials))
    clips, missing = sum(map(len, rows.values())), sum(len(rows[trial]) for trial in lacking)
    yield f"  HumanML3D has {clips} clips of CMU; {clips - missing} of them can be cut from these"
    if lacking:
        shown = ", ".join(lacking[:8]) + (", …" if len(lacking) > 8 else "")
        yield f"  missing: {len(lacking)} trials, from {CMU.url}: {shown}"


def _hdm05(folder: Path) -> Iterator[str]:
    clips = find_clips(folder)
    yield f"HDM05: {len(clips)} cut clips"
    yield f"next: latentmotion data prepare hdm05 --clips {folder} -o OUT"


def _snu(folder: Path) -> Iterator[str]:
    takes = find_takes(folder)
    labels = sum(path.parent.name == "annotation" for path in files_below(folder, [".lab"]))
    yield f"SNU: {len(takes)} takes on its skeletons, {labels} files of annotations"
    yield f"next: latentmotion data prepare snu {folder} -o OUT"


def _own(folder: Path) -> Iterator[str]:
    motions = find_motions(folder)
    captioned = sum(path.with_suffix(".txt").is_file() for path in motions.values())
    tables = sorted(path.name for path in folder.glob("*.csv"))
    yield f"motion files: {len(motions)}, of which {captioned} have captions beside them"
    if captioned < len(motions) and not tables:
        yield "  missing: captions (NAME.txt beside NAME.bvh, or a CSV with file,caption)"
    yield f"next: latentmotion data prepare own {folder} -o OUT"
