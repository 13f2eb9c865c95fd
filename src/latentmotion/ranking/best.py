"""Best of several takes: claims and match of sentence and motion, less what feet and jerk cost.

    score = (1 − rarity) (2 · claims + cosine(sentence, motion)) + advantage of its start
            − sliding − 2 · (penetration + floating + unfinished) − max(0, jerk − 150)/1000

`claims` is how closely the motion, cleaned up, does what the sentence asks: degrees, counts, sides,
ways, paces and order (`ranking/closeness.py`). Sliding is in m/s, penetration, floating and what is
unfinished at the ends in m, jerk in m/s³ (`kinematics/plausibility.py`); recordings have jerks of
some 100. Claims decide first, and ordinary differences of feet and floor only between takes that
match about as well (lab/diary/best_of.md). A take of a rare movement that starts from a clip of it
has an advantage, since claims and scorer know rare movements least (`retrieval/starts.py`), and may
be above the floor as its clip is; the largest advantage of the takes is the rarity.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from latentmotion.cleanup import USUAL, CleanUp, CleanUpWarning, clean_batch
from latentmotion.diffusion.condition import Condition, SentenceCondition
from latentmotion.errors import InputError
from latentmotion.kinematics.plausibility import (
    floating,
    foot_sliding,
    jitter,
    penetration,
    unfinished,
)
from latentmotion.language.claims import Corrections
from latentmotion.language.reading import request_of
from latentmotion.measure.scene import describe
from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.ranking.closeness import closeness
from latentmotion.ranking.scorer import Scorer, shipped_scorer

MOST_TAKES = 256  # Most takes of one prompt.

USUAL_TAKES = 4  # Takes of a sentence that the command generates if no number is given.

# Sampling steps up to which several takes take no noticeable time.
_FAST_STEPS = 16

# Weight of the claims beside the cosine.
_CLAIMS = 2.0

# Costs of a meter below or above the floor and of one m/s³ of jerk above the usual.
_OFF_FLOOR, _JERK, _USUAL_JERK = 2.0, 1e-3, 150.0


@dataclass(frozen=True, eq=False)
class Take:
    """One of several motions of a prompt, with its score and the reasons for it."""

    motion: Motion  # The motion as it was given.
    score: float  # Twice the claims, and the match, less the costs; the highest is the best.
    # Closeness of the cleaned motion to the sentence, 0 to 1; 0 where nothing is measurable.
    claims: float
    text: float  # Cosine of the vectors of sentence and motion, -1 to 1.
    sliding: float  # Mean speed of feet along the floor, m/s.
    penetration: float  # Mean depth of the lowest joint below the floor, meters.
    # Mean height of a body that nothing carries, and that neither moves nor falls, meters.
    floating: float
    # Mean height of the body, and half of that of a lifted foot, in the first and last pose of the
    # cleaned motion, meters.
    unfinished: float
    jerk: float  # Mean jerk of the joints, m/s³.
    # How much likelier its start makes what is asked, 0 for a start from noise.
    advantage: float = 0.0
    # The motion cleaned up, where its claims were measured so, or it is kept.
    cleaned: Motion | None = None

    def about(self) -> dict[str, Any]:
        """Returns seed, score and reasons, as JSON can hold them."""
        figures = ("score", "claims", "text", "sliding", "penetration")
        figures += ("floating", "unfinished", "jerk", "advantage")
        return {"seed": self.motion.metadata.get("seed")} | {
            name: round(getattr(self, name), 5) for name in figures
        }


def usual_takes(card: ModelCard, prompt: str) -> int:
    """Returns how many takes of a prompt to generate if no number is given.

    Several of a sentence where they are cheap and the shipped scorer reads the model's motions,
    otherwise one.
    """
    if not (card.condition.reads_text and prompt.strip()) or card.sampling.steps > _FAST_STEPS:
        return 1
    readable = card.representation == shipped_scorer().card.representation
    return USUAL_TAKES if readable else 1


def check_sentence(card: ModelCard, prompt: str, of: int) -> None:
    """Checks that a model's takes can be scored by their sentence.

    Raises:
        InputError: The model reads no sentences, the sentence is empty, or the number of takes is
            out of range.
    """
    if not 1 <= of <= MOST_TAKES:
        raise InputError(f"best of {of}: expected 1 to {MOST_TAKES} takes")
    if not card.condition.reads_text or not prompt.strip():
        raise InputError(
            f"best of {of}: takes are scored by their sentence, and there is none; give one, to a "
            "model of sentences"
        )


def scorer_beside(condition: Condition) -> Scorer:
    """Returns the scorer that ships, with the model's own text encoder if it reads the same."""
    scorer = shipped_scorer()
    encoder = condition.encoder if isinstance(condition, SentenceCondition) else None
    if encoder is None or encoder.name != scorer.card.text_encoder:
        return scorer
    return replace(scorer, encoder=encoder)


def ranked(
    motions: Sequence[Motion],
    prompt: str,
    scorer: Scorer,
    clean_up: CleanUp | None = USUAL,
    corrections: Sequence[Corrections] | None = None,
    advantages: Sequence[float] | None = None,
) -> list[Take]:
    """Returns the takes of a prompt, the best first.

    Args:
        motions: At least one take, of the skeleton that the scorer reads.
        prompt: The sentence.
        scorer: Compares motions with sentences.
        clean_up: Steps that the kept take goes through, which may mend a count or a turn; None
            where it stays as it is.
        corrections: What clean-up makes exact in each motion; by default nothing.
        advantages: Of the motions' starts; by default all start from noise.

    Raises:
        InputError: A motion has another skeleton or is too short.
    """
    matches = scorer.motions(motions) @ scorer.texts([prompt])[0]
    request = request_of(prompt)
    cleaned: Sequence[Motion | None] = [None] * len(motions)
    notes: list[warnings.WarningMessage] = []
    # Without a claim there is nothing to measure, and only the kept take is cleaned up, later.
    if clean_up is not None and request.claims:
        with warnings.catch_warnings(record=True) as notes:
            warnings.simplefilter("always", CleanUpWarning)
            cleaned = clean_batch(motions, replace(clean_up, in_place=False), corrections)
    advantages = [0.0] * len(motions) if advantages is None else advantages
    usual = 1 - max(advantages, default=0.0)
    takes = []
    for motion, match, after, advantage in zip(
        motions, matches.tolist(), cleaned, advantages, strict=True
    ):
        joints, fps = motion.joints.astype(np.float64), motion.fps
        sliding, depth = foot_sliding(joints, fps, motion.skeleton), penetration(joints)
        hovers, jerk, claims = floating(joints, fps), jitter(joints, fps), 0.0
        final = (after or motion).joints.astype(np.float64)
        # One who climbs ends above the floor, on what no motion shows.
        climbs = any(claim.kind == "climb" for claim in request.claims)
        ends = 0.0 if climbs else float(unfinished(final[[0, -1]], motion.skeleton).mean())
        if request.claims:
            claims = closeness(request, describe(final))
        # A clip shows what bears the body: a ladder, a bed, the hands.
        off_floor = _OFF_FLOOR * (depth + (0.0 if advantage else hovers + ends))
        score = usual * (_CLAIMS * claims + match) + advantage
        score -= sliding + off_floor + _JERK * max(0.0, jerk - _USUAL_JERK)
        figures = (score, claims, match, sliding, depth, hovers, ends, jerk, advantage)
        takes.append(Take(motion, *figures, after))
    takes.sort(key=lambda take: -take.score)
    for note in notes:  # of takes that are not kept nobody needs to know
        if getattr(note.message, "motion", None) in (None, takes[0].motion):
            warnings.warn(note.message, stacklevel=2)
    return takes


def best_of(takes: Sequence[Take]) -> Motion:
    """Returns the best take's motion, cleaned up if it was, whose metadata tell of all takes."""
    first = takes[0].cleaned or takes[0].motion
    about = {**first.metadata, "best_of": [take.about() for take in takes]}
    return replace(first, metadata=about).with_recorded(first.recorded)
