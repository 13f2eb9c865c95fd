"""Recordings → prepared folder: encode, fit captions and normalizer, write, report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from latentmotion.data import report as reports
from latentmotion.data import store
from latentmotion.data.clip import Source, TaggedSentence, fit_sentences, mirror_sentence
from latentmotion.data.dataset import Dataset
from latentmotion.data.quality import find_glitch
from latentmotion.data.recording import Dropped, EncodedRecording, Label, Recording
from latentmotion.data.report import PreparationReport
from latentmotion.data.sources import LABELS
from latentmotion.data.store import StoredClip, StoredMotion, StoredNormalizer, stored_normalizer
from latentmotion.errors import DataError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.representation.canonical import canonicalize
from latentmotion.representation.interface import Normalizer, Representation
from latentmotion.storage.configuration import write_json

MIN_FRAMES = 10  # Shortest clip that is kept; half a second holds a hop, or one turn of the arms.

# Most reasons in the error if no clip is left.
_LISTED = 10


def encode_all(
    items: Iterable[Recording | Dropped], representation: Representation
) -> Iterator[EncodedRecording | Dropped]:
    """Encodes the recordings of a source; those too short or glitchy are dropped with a reason."""
    for item in items:
        yield item if isinstance(item, Dropped) else encode(item, representation)


def encode(recording: Recording, representation: Representation) -> EncodedRecording | Dropped:
    """Retargets and encodes one recording, or returns why it cannot be used."""
    joints = recording.joints
    if len(joints) < MIN_FRAMES:
        reason: str | None = f"{len(joints)} frames, fewer than {MIN_FRAMES}"
    else:
        reason = find_glitch(joints[:, : len(HUMANML3D)], representation.fps)
    if reason:
        return Dropped(recording.label.id, "clip", reason)
    joints = representation.retarget(joints)
    features = representation.encode(joints)
    expected = canonicalize(joints[:-1], representation.skeleton)
    decoded = canonicalize(representation.decode(features), representation.skeleton)
    error_mm = float(np.linalg.norm(decoded - expected, axis=-1).max() * 1000)
    return EncodedRecording(recording.label, features, error_mm)


def corrected(label: Label) -> Label:
    """Returns the label of a train clip with the corrections of `sources/labels.toml`."""
    if label.split != "train":
        return label
    wrong, added = LABELS["corrections"]["wrong"], LABELS["corrections"]["added"]
    trial = label.origin.partition("[")[0]
    further = [TaggedSentence(text) for name in (label.id, trial) for text in added.get(name, ())]
    refused = [TaggedSentence(text) for text in wrong.get(label.id, ())]
    mirrored = {mirror_sentence(sentence).text for sentence in refused}
    right = [s for s in label.sentences if s.text not in {sentence.text for sentence in refused}]
    sides = [s for s in label.mirrored_sentences if s.text not in mirrored]
    if label.mirrored_sentences:
        sides += map(mirror_sentence, further)
    return replace(label, sentences=(*right, *further), mirrored_sentences=tuple(sides))


class Preparation:
    """Collects motions one by one, then writes them as a folder.

    Args:
        representation: Representation of the features.
    """

    def __init__(self, representation: Representation) -> None:
        self.representation = representation
        self.motions: list[StoredMotion] = []
        self.dropped: list[Dropped] = []
        self.round_trip_mm: float | None = None

    def add(self, items: Iterable[EncodedRecording | Dropped]) -> None:
        """Adds the recordings of a source; those that cannot be used are kept with the reason."""
        for item in items:
            if isinstance(item, Dropped):
                self.dropped.append(item)
                continue
            label, frames = corrected(item.label), len(item.features)
            captions, reasons = fit_sentences(label.sentences, frames)
            mirrored, _ = fit_sentences(label.mirrored_sentences, frames)
            self.dropped += [Dropped(label.id, "caption", reason) for reason in reasons]
            clip = StoredClip(
                id=label.id,
                source=label.source,
                origin=label.origin,
                split=label.split,
                frames=frames,
                shard=0,
                offset=0,
                captions=store.caption_rows(captions),
                mirrored_captions=store.caption_rows(mirrored),
                action=label.action,
                mirrored_action=label.mirrored_action,
            )
            self.motions.append(StoredMotion(clip, item.features))
            self.note(item.round_trip_mm)

    def note(self, round_trip_mm: float | None) -> None:
        """Adds the round-trip error of one more motion or folder."""
        if round_trip_mm is not None:
            self.round_trip_mm = max(self.round_trip_mm or 0.0, round_trip_mm)

    def write(
        self,
        folder: str | Path,
        sources: tuple[Source, ...],
        normalizer: StoredNormalizer | None = None,
        notes: tuple[str, ...] = (),
    ) -> PreparationReport:
        """Writes the folder and its report.

        Args:
            folder: The folder to write; what was there is replaced.
            sources: Origins of the motions.
            normalizer: Statistics that come with the data; else they are fit on the train split.
            notes: Further remarks for the report.

        Raises:
            DataError: Nothing is left to write, or nothing to fit the normalizer on.
            InputError: The folder cannot be written.
        """
        if not self.motions:
            reasons: dict[str, list[str]] = {}
            for item in self.dropped:
                if item.what == "clip":
                    reasons.setdefault(item.reason, []).append(item.id)
            listed = []
            for reason, ids in reasons.items():
                others = f" and {len(ids) - 3} more" if len(ids) > 3 else ""
                listed.append(f"{', '.join(ids[:3])}{others}: {reason}")
            more = [f"{len(listed) - _LISTED} more reasons"] if len(listed) > _LISTED else []
            summary = "; ".join([*listed[:_LISTED], *more])
            raise DataError(f"no clip can be used ({summary or 'no clip found'})")
        if normalizer is None and not self.representation.normalized:
            identity = Normalizer.identity(self.representation.width)
            normalizer = stored_normalizer(identity, "none: the features are used as they are")
        if normalizer is None:
            train = [motion.features for motion in self.motions if motion.clip.split == "train"]
            if not train:
                raise DataError("no clip is in the train split, so no normalizer can be fit")
            both = [side for clip in train for side in (clip, self.representation.mirror(clip))]
            fitted = Normalizer.fit(both, self.representation.blocks)
            normalizer = stored_normalizer(
                fitted, f"{len(train)} train clips and their mirror images"
            )

        def report_of(manifest: store.DatasetManifest) -> PreparationReport:
            dropped = tuple(self.dropped)
            return PreparationReport(reports.parts_of(manifest), dropped, self.round_trip_mm, notes)

        def describe(place: Path, manifest: store.DatasetManifest) -> None:
            report, title = report_of(manifest), Path(folder).resolve().name
            write_json(place / reports.REPORT, report)
            (place / reports.README).write_text(
                reports.readme(manifest, report.parts, title), encoding="utf-8"
            )

        settings = sources, self.representation, normalizer
        return report_of(store.write_dataset(folder, self.motions, *settings, describe))


def merge(folders: Sequence[str | Path], out: str | Path) -> PreparationReport:
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
    notes: list[str] = []
    for dataset in datasets:
        for stored in dataset.manifest.clips:
            preparation.motions.append(StoredMotion(stored, dataset.features(stored.clip())))
        if report := reports.read_report(dataset.folder):
            preparation.dropped += report.dropped
            preparation.note(report.round_trip_mm)
            notes += report.notes
    sources = {source.name: source for dataset in datasets for source in dataset.sources}
    return preparation.write(out, tuple(sources.values()), notes=tuple(notes))
