"""`latentmotion search` and `nearest`: motions by a sentence, and training clips by a motion."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cli import options
from latentmotion.data.dataset import Dataset
from latentmotion.ranking import search
from latentmotion.ranking.scorer import Scorer
from latentmotion.storage.files import cache_folder, check_writable

_FILES = " ".join(formats.READABLE)

ScorerFolder = Annotated[
    Path | None,
    arg(help="Folder of a scorer (latentmotion export scorer); by default the one that ships."),
]


@dataclass(frozen=True)
class Search:
    """Find motions in your own files by a sentence.

    Example: latentmotion search mocap "a high kick" -n 5
    """

    folder: Annotated[
        Positional[Path], arg(metavar="FOLDER", help=f"Folder of motion files, any depth: {_FILES}")
    ]
    sentence: Annotated[Positional[str], arg(metavar="SENTENCE")]
    """What the person does."""
    count: Annotated[int, arg(aliases=["-n"])] = 10
    """Most parts of files to print."""
    index: Path | None = None
    """File that keeps the index, so that only new and changed files are read again; by default in
    the user's cache folder."""
    scorer: ScorerFolder = None
    json: options.PrintJson = False

    def run(self) -> None:
        """Indexes what is new and prints the parts of files that match best.

        Raises:
            InputError: The folder has no motion file, the sentence is empty, or a number is out of
                range.
            ModelError: The scorer cannot be loaded.
        """
        search.check_search(self.sentence, self.count)
        if self.index is not None:
            check_writable(self.index)
        scorer, caches = Scorer.load(self.scorer), cache_folder()
        index_path = self.index or (
            caches and caches / "search" / search.index_name(self.folder, scorer)
        )
        index = search.MotionIndex.of(self.folder, scorer, index_path)
        hits = index.search(self.sentence, self.count)
        for path, problem in index.problems.items():
            print(f"warning: left out: {problem or path}", file=sys.stderr)
        if self.json:
            rows = [
                {"file": str(hit.window.path), "take": hit.window.take, "start": hit.window.start}
                | {"end": hit.window.end, "score": round(hit.score, 4)}
                for hit in hits
            ]
            print(json.dumps({"sentence": self.sentence, "found": rows}))
            return
        for hit in hits:
            window = hit.window
            take = f" take {window.take + 1}" if window.take else ""
            span = f"{window.start:6.2f}–{window.end:6.2f} s"
            print(f"{hit.score:6.3f}  {span}  {window.path}{take}")


@dataclass(frozen=True)
class Nearest(options.MotionOptions):
    """Report the clips of the training data that are nearest to a motion.

    Example: latentmotion nearest walk.bvh -n 5
    """

    motion: Annotated[Positional[Path], arg(metavar="MOTION", help=options.MOTION_FILE)]
    count: Annotated[int, arg(aliases=["-n"])] = 5
    """Clips to print for each motion."""
    data: options.OptionalData = None
    """Prepared folder whose train split is searched in place of the shipped list of clips."""
    scorer: ScorerFolder = None
    json: options.PrintJson = False

    def run(self) -> None:
        """Prints the clips.

        Raises:
            InputError: The file cannot be read, or a number is out of range.
            ModelError: The scorer cannot be loaded.
        """
        scorer = Scorer.load(self.scorer)
        motions = self.load(self.motion)
        if self.data is not None:
            training = search.training_vectors(Dataset.load(self.data), scorer)
        else:
            training = search.read_training_vectors(scorer)
        rows = [
            {"motion": number, **row}
            for number, motion in enumerate(motions)
            for row in search.nearest_clips(motion, scorer, training, self.count)
        ]
        if self.json:
            print(json.dumps({"file": str(self.motion), "nearest": rows}))
            return
        for row in rows:
            take = f"motion {row['motion'] + 1}  " if len(motions) > 1 else ""
            mirrored = ", mirrored" if row["mirrored"] else ""
            print(f"{take}{row['similarity']:6.3f}  {row['source']}  {row['origin']}{mirrored}")
        share = training.share_nearer(rows[0]["similarity"])
        print(
            f"{share:.0%} of the training clips have a clip of another recording that is at least "
            f"as near as {rows[0]['similarity']:.3f}"
        )
