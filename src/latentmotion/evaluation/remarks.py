"""What a reader of a report must know to compare its figures."""

from __future__ import annotations

from latentmotion.condition.task import TASKS
from latentmotion.evaluation.bodies import remarks_on_body
from latentmotion.evaluation.observation import Extractor, reads_text
from latentmotion.evaluation.settings import Protocol
from latentmotion.evaluation.trials import Plan


def remarks(plan: Plan, extractor: Extractor | None) -> list[str]:
    """Returns the notes of a report, a sentence each."""
    protocol, lengths, items = plan.protocol, plan.lengths, plan.items
    clips = len(plan.dataset.clips(protocol.split))
    notes = [
        f"{len(items)} items {TASKS[plan.needs].asks_for} of {lengths.shortest} to "
        f"{lengths.longest} frames, from {clips} clips of the {protocol.split} split"
    ]
    if extractor is None:
        notes.append("no evaluator, so metrics of positions alone")
    elif reads_text(extractor):
        notes += _of_text(len(items), extractor.width, protocol)
    notes += remarks_on_body(plan.dataset, extractor)
    if extractor is not None and not protocol.quirks.permuted_truth:
        notes.append(
            f"FID and KID of the ground truth are between random halves of {len(items) // 2} "
            "motions: the noise of so few, not what a model should reach"
        )
    if protocol.nearest_clip:
        notes.append("the nearest training clip is looked for in the first replication alone")
    return notes


def _of_text(items: int, width: int, protocol: Protocol) -> list[str]:
    pairs, repeats, rest = protocol.quirks.drawn_pairs, protocol.repeats, items % protocol.group
    notes = []
    if items < protocol.group:
        notes.append(f"R-precision ranks among {items} motions, since there are no more")
    elif rest and protocol.quirks.remainder_dropped:
        notes.append(
            f"{rest} items of each replication have no R-precision, as in the authors' code"
        )
    if items <= width:
        notes.append(
            f"FID from {items} motions and {width} features is biased upward: compare it with rows "
            "of as many motions alone, or see KID"
        )
    if pairs and items < pairs.text_diversity:
        notes.append(f"diversity is of {items} pairs, not {pairs.text_diversity}")
    if repeats.texts > items:
        notes.append(f"MultiModality is of {items} captions, not {repeats.texts}")
    return notes
