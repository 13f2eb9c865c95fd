"""How often the describer agrees with captions that people wrote, by what these claim.

    python -m benchmarks.quality.description --data FOLDER --source cmu [--disagreements]

FOLDER is a prepared one. Every caption's claims are compared with its own frames; `silent` is what
cannot be told either way, and the rate is of the others. Disagreements are errors of the describer,
of its reading of the sentence, or of who wrote it: see lab/diary/describing.md.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness.contest import table
from latentmotion.data.clip import SPLITS, Clip
from latentmotion.data.dataset import Dataset
from latentmotion.language.claims import Claim
from latentmotion.language.reading import claims_of
from latentmotion.measure.facts import BOTH, Description
from latentmotion.measure.scene import describe
from latentmotion.ranking.agreement import Verdict, check

GAITS = ("walk", "jog", "run", "move")
SHORTEST = 8  # Frames of the shortest part that is compared.


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--source", default="cmu")
    parser.add_argument("--disagreements", action="store_true")
    given = parser.parse_args()
    counts: dict[str, Counter[Verdict]] = defaultdict(Counter)
    for clip, caption, claim, verdict, reason in compared(Dataset.load(given.data), given.source):
        for group in groups(claim):
            counts[group][verdict] += 1
        if given.disagreements and verdict == "contradicts":
            print(f"{clip.id}: {caption!r}: {reason}")
    print(table(["claim", "n", "agree", "contradict", "silent", "agreement"], rows(counts)))


def compared(data: Dataset, source: str) -> Iterator[tuple[Clip, str, Claim, Verdict, str]]:
    """Yields every claim of every caption with what the describer says."""
    for clip in (clip for split in SPLITS for clip in data.clips(split)):
        told = [caption for caption in clip.captions if claims_of(caption.text)]
        if clip.source != source or not told:
            continue
        joints = data.representation.decode(data.features(clip))
        known: dict[tuple[int, int], Description] = {}
        for caption in told:
            span = caption.start_frame, caption.end_frame
            if span[1] - span[0] < SHORTEST:
                continue
            known.setdefault(span, describe(joints[span[0] : span[1]]))
            found = check(caption.text, known[span])
            for one in zip(found.claims, found.verdicts, found.reasons, strict=True):
                yield clip, caption.text, *one


def groups(claim: Claim) -> Iterator[str]:
    """Yields the lines of the table that a claim counts in."""
    yield claim.kind
    if claim.kind in ("turn", "circle") and claim.side:
        yield f"{claim.kind}: side"
    elif claim.side and claim.side != BOTH and claim.kind not in ("twist", "lift"):
        yield "hand, arm, leg, foot, knee: side"
    if claim.kind in GAITS and claim.direction:
        yield f"way: {claim.direction}"
    if claim.count:
        yield "number of times"
    if claim.degrees:
        yield "degrees"
    if claim.pace and claim.kind in GAITS:
        yield f"pace: {claim.pace}"
    if claim.then:
        yield "order"


def rows(counts: dict[str, Counter[Verdict]]) -> list[list[str]]:
    """Returns the lines of the table; what is never measured is left out."""
    out = []
    for group, found in sorted(counts.items()):
        judged = found["agrees"] + found["contradicts"]
        if judged:
            figures = (found.total(), found["agrees"], found["contradicts"], found["silent"])
            out.append([group, *map(str, figures), f"{100 * found['agrees'] / judged:.0f} %"])
    return out


if __name__ == "__main__":
    main()
