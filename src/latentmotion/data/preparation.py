"""Encoded recordings → prepared folder: fit captions and normalizer, write, report."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.captions import fit_sentences
from latentmotion.data.clip import Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import StoredClip, StoredNormalizer
from latentmotion.data.recording import Dropped, EncodedRecording, Label
from latentmotion.data.report import REPORT, Report, parts_of
from latentmotion.data.store import (
    StoredMotion,
    caption_rows,
    stored_normalizer,
    write_dataset,
)
from latentmotion.errors import DataError
from latentmotion.representation.interface import Representation
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.configuration import read_json, write_json


class Preparation:
    """Collects motions one by one, then writes them as a folder.

    Args:
        representation: How features describe motion.
    """

    def __init__(self, representation: Representation) -> None:
        self.representation = representation
        self.motions: list[StoredMotion] = []
        self.dropped: list[Dropped] = []
        self.round_trip_mm: float | None = None

    def add(self, items: Iterable[EncodedRecording | Dropped]) -> None:
        """Takes what a source yields; what cannot be used is kept with the reason."""
        for item in items:
            if isinstance(item, Dropped):
                self.dropped.append(item)
            else:
                self._keep(item.label, item.features)
                self.note(item.round_trip_mm)

    def write(
        self,
        folder: str | Path,
        sources: tuple[Source, ...],
        normalizer: StoredNormalizer | None = None,
        notes: tuple[str, ...] = (),
    ) -> Report:
        """Writes the folder and its report.

        Args:
            folder: Where to; what was there is replaced.
            sources: Where the motions come from.
            normalizer: Statistics that come with the data; else they are fit on the train split.
            notes: What else the report should say.

        Raises:
            DataError: Nothing is left to write, or nothing to fit the normalizer on.
            InputError: The folder cannot be written.
        """
        self._check_any()
        fitted = normalizer or self._fit()
        manifest = write_dataset(folder, self.motions, sources, self.representation, fitted)
        report = Report(parts_of(manifest), tuple(self.dropped), self.round_trip_mm, notes)
        write_json(Path(folder) / REPORT, report)
        return report

    def _keep(self, label: Label, features: Float[np.ndarray, "frames features"]) -> None:
        frames = len(features)
        captions, lost = fit_sentences(label.sentences, frames)
        mirrored, _ = fit_sentences(label.mirrored_sentences, frames)
        self.dropped += [Dropped(label.id, "caption", reason) for reason in lost]
        clip = StoredClip(
            id=label.id,
            source=label.source,
            origin=label.origin,
            split=label.split,
            frames=frames,
            shard=0,
            offset=0,
            captions=caption_rows(captions),
            mirrored_captions=caption_rows(mirrored),
            action=label.action,
            mirrored_action=label.mirrored_action,
        )
        self.motions.append(StoredMotion(clip, features))

    def note(self, round_trip_mm: float | None) -> None:
        """Takes the error of one more way there and back."""
        if round_trip_mm is not None:
            self.round_trip_mm = max(self.round_trip_mm or 0.0, round_trip_mm)

    def _fit(self) -> StoredNormalizer:
        if not self.representation.normalized:
            identity = Normalizer.identity(self.representation.width)
            return stored_normalizer(identity, "none: the features are used as they are")
        train = [motion.features for motion in self.motions if motion.clip.split == "train"]
        if not train:
            raise DataError("no clip is in the train split, so no normalizer can be fit")
        both = [side for one in train for side in (one, self.representation.mirror(one))]
        fitted = Normalizer.fit(both, self.representation.blocks)
        return stored_normalizer(fitted, f"{len(train)} train clips and their mirror images")

    def _check_any(self) -> None:
        if not self.motions:
            reasons = "; ".join(f"{item.id}: {item.reason}" for item in self.dropped[:3])
            raise DataError(f"no clip can be used ({reasons or 'no clip found'})")


def merge(folders: Sequence[str | Path], out: str | Path) -> Report:
    """Joins prepared folders into one, with one normalizer for all.

    Raises:
        DataError: There is none, or they differ in representation, or share names of clips.
    """
    if not folders:
        raise DataError("nothing to merge; name two or more prepared folders")
    datasets = [Dataset.load(folder) for folder in folders]
    names = {dataset.manifest.representation for dataset in datasets}
    if len(names) > 1:
        raise DataError(f"cannot merge {' and '.join(sorted(names))}; merge like with like")
    preparation = Preparation(datasets[0].representation)
    for dataset in datasets:
        _take_all(preparation, dataset)
    sources = {source.name: source for dataset in datasets for source in dataset.sources}
    notes = [note for dataset in datasets for note in _report(dataset).notes]
    return preparation.write(out, tuple(sources.values()), notes=tuple(notes))


def _take_all(preparation: Preparation, dataset: Dataset) -> None:
    for stored in dataset.manifest.clips:
        preparation.motions.append(StoredMotion(stored, dataset.features(stored.clip())))
    report = _report(dataset)
    preparation.dropped += report.dropped
    preparation.note(report.round_trip_mm)


def _report(dataset: Dataset) -> Report:
    path = dataset.folder / REPORT
    return read_json(Report, path) if path.is_file() else Report((), (), None)
