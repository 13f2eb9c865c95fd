"""Search of motion files by a sentence: an index of windows of four seconds, kept in a cache file.

The index is one safetensors file: vectors in 16 bits, and for each file its size and time of
change, so that only new and changed files are read again. A file that cannot be read is named and
left out.

Nearest clips of the training data: what a motion may have been learned from.

A scorer's folder may hold the vectors of its training clips, 8 bits a number, and the names of
recordings, but no motions; of other data the vectors are computed from the prepared folder.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from latentmotion import errors, formats
from latentmotion.data.dataset import Dataset
from latentmotion.data.recording import files_below
from latentmotion.data.store import COMPOSED
from latentmotion.motion import Motion, features_of
from latentmotion.progress import counted
from latentmotion.ranking.scorer import CLIPS_FILE, UNIT, Scorer
from latentmotion.storage.files import atomic_file

WINDOW, STEP = 80, 20  # Frames of a window and between windows.

_FORMAT = "latentmotion index 1"

# Most bytes of an index that are read.
_MOST_INDEX = 2**31


@dataclass(frozen=True)
class Window:
    """A part of a motion file."""

    path: Path  # The file.
    take: int  # Number of the motion in the file, from 0.
    start: float  # Begin in seconds.
    end: float  # End in seconds.

    def overlaps(self, other: Window) -> bool:
        """Returns whether both are mostly the same part of one motion."""
        if (self.path, self.take) != (other.path, other.take):
            return False
        shared = min(self.end, other.end) - max(self.start, other.start)
        return shared > 0.5 * min(self.end - self.start, other.end - other.start)


@dataclass(frozen=True)
class Hit:
    """A window with its score."""

    window: Window  # The part of a file.
    score: float  # Cosine of the vectors of sentence and window, -1 to 1.


@dataclass(frozen=True, eq=False)
class IndexedFile:
    """Entry of a file in the index."""

    size: int  # Bytes.
    changed: int  # Time of the last change, nanoseconds.
    spans: tuple[tuple[int, float, float], ...]  # Take, begin and end of each window.
    vectors: Float[np.ndarray, "windows width"]  # A vector for each.
    problem: str = ""  # Why the file cannot be read, if it cannot.


@dataclass(frozen=True)
class MotionIndex:
    """The windows of a folder's motion files."""

    scorer: Scorer
    """Compares them with sentences."""
    files: dict[Path, IndexedFile] = field(default_factory=dict)
    """Entries by path."""

    @classmethod
    def of(cls, folder: str | Path, scorer: Scorer, cache: Path | None = None) -> MotionIndex:
        """Indexes the motion files below a folder.

        Args:
            folder: Where to look, at any depth but in hidden folders.
            scorer: Makes the vectors.
            cache: File that keeps the index; None for none.

        Raises:
            InputError: There is no such folder, it has no motion file, or the cache cannot be
                written.
        """
        if not Path(folder).is_dir():
            raise errors.InputError(f"{folder} is no folder; expected one of motion files")
        endings = formats.readable()
        candidates = files_below(Path(folder), endings)
        paths = [
            path
            for path in candidates
            if not any(part.startswith(".") for part in path.relative_to(folder).parts)
        ]
        if not paths:
            raise errors.InputError(f"{folder} has no motion file: {' '.join(endings)}")
        cached = _read(cache, scorer) if cache else {}
        files: dict[Path, IndexedFile] = {}
        for path in counted(paths, "indexing"):
            about = path.stat()
            old = cached.get(path.resolve())
            if old and (old.size, old.changed) == (about.st_size, about.st_mtime_ns):
                files[path] = old
                continue
            files[path] = _indexed(path, about.st_size, about.st_mtime_ns, scorer)
        # Other folders of the same cache file stay known.
        together = {**cached, **{path.resolve(): file for path, file in files.items()}}
        if cache and any(cached.get(path) is not file for path, file in together.items()):
            _write(cache, together, scorer)
        return cls(scorer, files)

    @property
    def problems(self) -> dict[Path, str]:
        """Files that cannot be read, and why."""
        return {path: file.problem for path, file in self.files.items() if file.problem}

    def search(self, sentence: str, count: int = 10) -> list[Hit]:
        """Returns the windows nearest to a sentence, the best first.

        Of windows of one motion that share more than half a window, only the best is returned.

        Args:
            sentence: What the person does.
            count: Most windows.

        Raises:
            InputError: The sentence is empty or `count` below 1.
        """
        check_search(sentence, count)
        return self.nearest(self.scorer.texts([sentence])[0], count)

    def nearest(self, vector: Float[np.ndarray, " width"], count: int) -> list[Hit]:
        """Returns the windows nearest to a vector, the best first.

        Raises:
            InputError: `count` is below 1.
        """
        if count < 1:
            raise errors.InputError(f"{count} results: expected 1 or more")
        hits = [
            Hit(Window(path, *span), score)
            for path, file in self.files.items()
            for span, score in zip(file.spans, (file.vectors @ vector).tolist(), strict=True)
        ]
        chosen: list[Hit] = []
        for hit in sorted(hits, key=lambda hit: -hit.score):
            if len(chosen) == count:
                break
            if not any(hit.window.overlaps(other.window) for other in chosen):
                chosen.append(hit)
        return chosen


def check_search(sentence: str, count: int) -> None:
    """Checks what is searched for, which takes no time, before any file is read.

    Raises:
        InputError: The sentence is empty or `count` below 1.
    """
    if not sentence.strip():
        raise errors.InputError("the sentence is empty; say what the person does")
    if count < 1:
        raise errors.InputError(f"{count} results: expected 1 or more")


def index_name(folder: Path, scorer: Scorer) -> str:
    """Returns the name of a folder's index in the user's cache."""
    key = f"{folder.resolve()}\n{scorer.card.fingerprint}"
    return f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.safetensors"


def windows_of(frames: int) -> list[tuple[int, int]]:
    """Returns first and one past the last frame of each window; short motions are one."""
    if frames <= WINDOW + STEP // 2:
        return [(0, frames)]
    starts = list(range(0, frames - WINDOW, STEP))
    return [(start, start + WINDOW) for start in (*starts, frames - WINDOW)]


def _indexed(path: Path, size: int, changed: int, scorer: Scorer) -> IndexedFile:
    """Reads a file; what cannot be read is noted."""
    empty = np.zeros((0, scorer.card.width), np.float32)
    spans: list[tuple[int, float, float]] = []
    parts: list[Float[np.ndarray, "_ features"]] = []
    fps = scorer.representation.fps
    try:
        for take, motion in enumerate(formats.load(path)):
            if motion.seconds * fps <= UNIT + 1:
                continue
            features = features_of(motion, scorer.representation)
            for start, end in windows_of(len(features)):
                spans.append((take, start / fps, end / fps))
                parts.append(features[start:end])
    except (errors.MissingExtraError, errors.MissingProgramError) as error:
        # It may be installed next time.
        return IndexedFile(-1, changed, (), empty, str(error))
    except errors.LatentMotionError as error:
        return IndexedFile(size, changed, (), empty, str(error))
    # As it is kept, so that a cached index gives the same scores.
    vectors = scorer.embed(parts).astype(np.float16).astype(np.float32) if parts else empty
    return IndexedFile(size, changed, tuple(spans), vectors)


def _read(path: Path, scorer: Scorer) -> dict[Path, IndexedFile]:
    """Returns the files of an index; none if it is absent, damaged or of another scorer."""
    try:
        if path.stat().st_size > _MOST_INDEX:
            return {}
        with safe_open(path, "numpy") as opened:
            about = opened.metadata() or {}
            vectors = opened.get_tensor("vectors").astype(np.float32)
        if (about["format"], about["scorer"]) != (_FORMAT, scorer.card.fingerprint):
            return {}
        files, first = {}, 0
        for name, size, changed, spans, problem in json.loads(about["files"]):
            rows = tuple((int(take), float(start), float(end)) for take, start, end in spans)
            part = vectors[first : first + len(rows)]
            if part.shape != (len(rows), scorer.card.width) or not np.isfinite(part).all():
                return {}
            files[Path(name)] = IndexedFile(int(size), int(changed), rows, part, str(problem))
            first += len(rows)
    except (OSError, SafetensorError, KeyError, TypeError, ValueError):
        return {}
    return files


def _write(path: Path, files: dict[Path, IndexedFile], scorer: Scorer) -> None:
    rows = [
        [str(name), file.size, file.changed, file.spans, file.problem]
        for name, file in files.items()
    ]
    empty = np.zeros((0, scorer.card.width), np.float32)
    vectors: Sequence[np.ndarray] = [empty, *(file.vectors for file in files.values())]
    metadata = {"format": _FORMAT, "scorer": scorer.card.fingerprint, "files": json.dumps(rows)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as temporary:
        save_file({"vectors": np.concatenate(vectors).astype(np.float16)}, temporary, metadata)


@dataclass(frozen=True)
class KnownClip:
    """A training clip as a report names it."""

    id: str  # Its name.
    source: str  # Name of its source.
    origin: str  # The recording and the frames.


@dataclass(frozen=True, eq=False)
class TrainingVectors:
    """Vectors of training clips."""

    clips: tuple[KnownClip, ...]  # The clips.
    vectors: Float[np.ndarray, "clips width"]  # A vector for each.

    def nearest(
        self, vector: Float[np.ndarray, " width"], count: int
    ) -> list[tuple[KnownClip, float]]:
        """Returns the clips nearest to a vector, with their cosines, the nearest first.

        Raises:
            InputError: `count` is below 1.
        """
        if count < 1:
            raise errors.InputError(f"{count} clips: expected 1 or more")
        cosines = self.vectors @ vector
        order = np.argsort(-cosines, kind="stable")[:count]
        return [(self.clips[row], float(cosines[row])) for row in order]

    def share_nearer(self, similarity: float) -> float:
        """Returns the share of training clips with another recording's clip at least as near.

        Args:
            similarity: A cosine.
        """
        recordings = np.array([clip.origin.partition("[")[0] for clip in self.clips])
        sample = np.random.default_rng(0).permutation(len(self.clips))[:500]
        nearest = []
        for row in sample:
            others = recordings != recordings[row]
            nearest.append(float((self.vectors[others] @ self.vectors[row]).max(initial=-1.0)))
        return float(np.mean(np.array(nearest) >= similarity)) if nearest else 0.0

    def write(self, path: Path) -> None:
        """Writes the vectors, 8 bits a number.

        Raises:
            InputError: The folder cannot be written.
        """
        scales = np.abs(self.vectors).max(axis=1, keepdims=True).clip(1e-6) / 127
        arrays = {
            "vectors": np.round(self.vectors / scales).astype(np.int8),
            "scales": scales[:, 0].astype(np.float32),
        }
        names = json.dumps([[c.id, c.source, c.origin] for c in self.clips], separators=(",", ":"))
        with atomic_file(path) as temporary:
            save_file(arrays, temporary, {"clips": names})


def read_training_vectors(scorer: Scorer) -> TrainingVectors:
    """Reads the vectors in a scorer's folder.

    Raises:
        InputError: There are none; they can be computed from the data.
        ModelError: The file is damaged.
    """
    path = scorer.folder / CLIPS_FILE
    if not path.is_file():
        raise errors.InputError(
            f"{scorer.folder} has no {CLIPS_FILE}; name the prepared training data by --data"
        )
    try:
        with safe_open(path, "numpy") as opened:
            names = json.loads((opened.metadata() or {})["clips"])
            vectors = opened.get_tensor("vectors").astype(np.float32)
            vectors = vectors * opened.get_tensor("scales")[:, None]
        clips = tuple(KnownClip(*map(str, row)) for row in names)
        if vectors.shape != (len(clips), scorer.card.width) or not np.isfinite(vectors).all():
            raise ValueError(f"{len(clips)} clips with vectors of shape {vectors.shape}")
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise errors.ModelError(f"{path} is damaged ({error}); copy the folder again") from error
    return TrainingVectors(clips, vectors)


def training_vectors(data: Dataset, scorer: Scorer) -> TrainingVectors:
    """Computes the vectors of the recorded clips of the split `train`.

    Args:
        data: Prepared data of the scorer's features.
        scorer: Makes the vectors.

    Raises:
        DataError: There are no such clips, or the features are of another kind.
    """
    if data.representation.name != scorer.card.representation:
        raise errors.DataError(
            f"{data.folder} has features {data.representation.name!r}, the scorer reads "
            f"{scorer.card.representation!r}"
        )
    clips = [
        clip for clip in data.clips("train") if clip.source != COMPOSED and clip.frames >= UNIT
    ]
    if not clips:
        raise errors.DataError(f"{data.folder} has no recorded clip in its train split")
    names = tuple(KnownClip(clip.id, clip.source, clip.origin) for clip in clips)
    starts = range(0, len(clips), 256)
    rows = [scorer.embed([data.features(c) for c in clips[n : n + 256]]) for n in starts]
    return TrainingVectors(names, np.concatenate(rows))


def nearest_clips(
    motion: Motion, scorer: Scorer, training: TrainingVectors, count: int
) -> list[dict[str, str | float | bool]]:
    """Returns the training clips nearest to a motion or to its mirror image, as JSON can hold them.

    Raises:
        InputError: The motion has another skeleton or is too short, or `count` is below 1.
    """
    features = features_of(motion, scorer.representation)
    sides = scorer.embed([features, scorer.representation.mirror(features)])
    neighbors = [
        (cosine, mirrored, clip)
        for mirrored, vector in zip((False, True), sides, strict=True)
        for clip, cosine in training.nearest(vector, count)
    ]
    return [
        {
            "clip": clip.id,
            "mirrored": mirrored,
            "source": clip.source,
            "origin": clip.origin,
            "similarity": round(cosine, 4),
        }
        for cosine, mirrored, clip in sorted(neighbors, key=lambda one: -one[0])[:count]
    ]
