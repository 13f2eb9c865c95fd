"""Instructions, motions, checks: the figures of a model beside real motions and chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from latentmotion.describe.scene import Scene, scene_of
from latentmotion.evaluation.instructions.checking import fulfills
from latentmotion.evaluation.instructions.intervals import Share
from latentmotion.evaluation.instructions.prompts import GROUPS, VERSION, Instruction
from latentmotion.evaluation.instructions.truth import Claimed

Joints = Float[np.ndarray, "_ 22 3"]

OVERALL = "overall"
"""Name of all groups together."""


@dataclass(frozen=True)
class Outcome:
    """One prompt and what became of it."""

    id: str
    """Name of the prompt."""
    group: str
    """Its group."""
    prompt: str
    """The sentence."""
    check: str
    """What was demanded."""
    fulfilled: tuple[bool, ...]
    """Whether each take did it."""
    seconds: tuple[float, ...]
    """Length of each take."""


@dataclass(frozen=True)
class Benchmark:
    """What the benchmark found."""

    subject: str
    """Whose motions they are."""
    about: Mapping[str, str]
    """How they were made."""
    model: Mapping[str, Share]
    """Figures by group."""
    chance: Mapping[str, Share]
    """The same motions checked for what a prompt of another group asks."""
    real: Mapping[str, Share]
    """Real motions whose captions claim the like, where data was given."""
    outcomes: tuple[Outcome, ...]
    """All prompts."""
    real_outcomes: tuple[Outcome, ...] = field(default=())
    """All claims about real motions: `id` is the clip, `prompt` the caption."""
    version: int = VERSION
    """Version of the list of prompts."""


def judge(
    subject: str,
    about: Mapping[str, str],
    instructions: Sequence[Instruction],
    motions: Sequence[Sequence[Joints]],
    real: Sequence[Claimed] = (),
) -> Benchmark:
    """Checks the motions of every prompt.

    Args:
        subject: Whose motions they are.
        about: How they were made.
        instructions: The prompts.
        motions: Some takes of each, 20 frames per second.
        real: Claims about real motions.

    Raises:
        InputError: A motion is too short, or not of 22 joints.
    """
    scenes = [[scene_of(joints) for joints in takes] for takes in motions]
    outcomes = tuple(
        Outcome(
            one.id,
            one.group,
            one.prompt,
            str(one.check),
            tuple(fulfills(scene, one.check) for scene in takes),
            tuple(scene.facts.seconds for scene in takes),
        )
        for one, takes in zip(instructions, scenes, strict=True)
    )
    claims = tuple(_of_real(claim) for claim in real)
    return Benchmark(
        subject=subject,
        about=about,
        model=shares(outcomes),
        chance=shares(_by_chance(instructions, scenes)),
        real=shares(claims),
        outcomes=outcomes,
        real_outcomes=claims,
    )


def shares(outcomes: Sequence[Outcome]) -> dict[str, Share]:
    """Returns figures by group and overall; what belongs to one prompt or clip is dependent."""
    found: dict[str, Share] = {}
    for group in (*GROUPS, OVERALL):
        rows: dict[str, list[bool]] = {}
        for one in outcomes:
            if group in (one.group, OVERALL):
                rows.setdefault(one.id, []).extend(one.fulfilled)
        if rows:
            found[group] = Share.of(list(rows.values()))
    return found


def _of_real(claim: Claimed) -> Outcome:
    scene = scene_of(claim.joints)
    fulfilled, check = fulfills(scene, claim.check), str(claim.check)
    return Outcome(
        claim.clip, claim.group, claim.caption, check, (fulfilled,), (scene.facts.seconds,)
    )


def _by_chance(
    instructions: Sequence[Instruction], scenes: Sequence[Sequence[Scene]]
) -> list[Outcome]:
    """Each prompt's check on as many motions of prompts of other groups, drawn alike each time."""
    generator = np.random.default_rng(VERSION)
    out = []
    for one in instructions:
        pool = [
            takes
            for other, takes in zip(instructions, scenes, strict=True)
            if other.group != one.group
        ]
        drawn = [pool[n] for n in generator.integers(len(pool), size=len(scenes[0]))]
        fulfilled = tuple(fulfills(takes[n], one.check) for n, takes in enumerate(drawn))
        out.append(Outcome(one.id, one.group, one.prompt, str(one.check), fulfilled, ()))
    return out
