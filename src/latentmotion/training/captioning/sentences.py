"""Description → sentences in the style of captions and of prompts.

`phrases.toml` has several verb phrases for each act: "~bend <his> knees" is said as "bends".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from latentmotion.language.words import inflect
from latentmotion.measure.facts import LEFT, RIGHT, Description, Event
from latentmotion.measure.reported_acts import ReportedAct, acts_of
from latentmotion.measure.whole_body import FAST, SLOW
from latentmotion.ranking.agreement import check
from latentmotion.storage.reading import packaged_toml
from latentmotion.training.captioning.prompting import SUBJECTS, filled, inflected

MOST_ACTS = 5  # Most acts of one sentence; of more, those that last longest are described.


def sentences(
    description: Description,
    generator: np.random.Generator,
    action: str | None = None,
    count: int = 4,
) -> list[str]:
    """Writes different sentences about a motion.

    Args:
        description: The motion's.
        generator: Draws wording and style.
        action: A sentence about it or the name of its action, from a file. It is used where the
            motion does not contradict it.
        count: Most sentences; fewer where there are fewer wordings.
    """
    caption = plain_action(action) if action else ""
    if caption and check(caption, description).verdict == "contradicts":
        caption = ""
    acts = acts_of(description)
    texts: list[str] = []
    if caption:
        texts = [caption]
        claimed = {claim.kind for claim in check(caption, description).claims}
        moves = [act for act in acts if act.kind in ("walk", "jog", "run", "turn")]
        if moves and not claimed & {"walk", "jog", "run", "turn", "circle", "move", "sit"}:
            phrase = _draw(phrases(moves[0]), generator)
            texts.append(
                f"{caption.rstrip('. ')} while {_filled(phrase, 'the', 'them', 'participle')}"
            )
        texts = texts[:count]
        # Measured sentences would only repeat or spoil what a caption says better.
        gestures = all(act.kind in ("raise", "wave", "punch") for act in acts)
        if acts[0].kind in ("stand", "still") or (len(caption.split()) > 2 and gestures):
            return texts
    for _ in range(6 * count):
        if len(texts) >= count:
            break
        sentence = _sentence(acts, generator)
        if sentence not in texts:
            texts.append(sentence)
    return texts


def plain_action(action: str) -> str:
    """Returns a name such as `wave_hello` or `WaveHello` as words; sentences stay as they are."""
    text = action.strip()
    if " " in text:
        return text
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", text).replace("_", " ").replace("-", " ")
    return re.sub(r"\s*\d+\s*", " ", words).strip().lower()


def _sentence(acts: Sequence[ReportedAct], generator: np.random.Generator) -> str:
    """Writes one sentence about the acts that last longest, in their order."""
    longest = sorted(acts, key=lambda act: -act.event.frames)[:MOST_ACTS]
    acts = [act for act in acts if len(acts) <= MOST_ACTS or act in longest]
    weights = np.array([subject[3] for subject in SUBJECTS["weighted"]], float)
    who, his, him, _ = SUBJECTS["weighted"][
        generator.choice(len(weights), p=weights / weights.sum())
    ]
    styles = ["third", "third", "third", "ing"] if who else ["third", "base", "base", "ing"]
    style = str(generator.choice(styles))
    form = "participle" if style == "ing" else style
    groups: list[str] = []
    last = acts[0]
    for act in acts:
        phrase, during = _draw(phrases(act), generator), _draw(meanwhile(act), generator)
        before = last.gait or last.event
        overlaps = act.gait is not None and act.kind != "turn" and act.gait.start <= before.start
        overlaps = overlaps or act.event.end <= last.event.end - 6
        if groups and overlaps and " while " not in groups[-1]:
            groups[-1] += f" while {_filled(during, his, him, 'participle')}"
        else:
            groups.append(_filled(phrase, his, him, form))
        last = act
    text = groups[0]
    if len(groups) > 1:
        joiners = (", then ", " and then ", " then ", " and ", ", and then ")
        if len(groups) > 2:
            joiners = (", then ", ", and then ", " and ", ", and finally ")
        comma = ", then " if len(groups) > 2 and generator.random() < 0.4 else ", "
        text = comma.join(groups[:-1]) + str(generator.choice(joiners)) + groups[-1]
    who = f"{who} is" if who and style == "ing" else who
    text = f"{who} {text}".strip()
    return f"{text}." if generator.random() < 0.6 else text


def _draw(wordings: list[str], generator: np.random.Generator) -> str:
    """Draws a wording; the plainest, which comes first, is drawn most often."""
    if generator.random() < 0.35:
        return wordings[0]
    return wordings[int(generator.integers(len(wordings)))]


def _filled(phrase: str, his: str, him: str, form: str) -> str:
    """Inflects the verbs of a phrase and fills in its pronouns."""
    return inflected(phrase.replace("<his>", his).replace("<him>", him), form)


# Meters per second above which a run is called fast.
_FAST_RUN = 3.6

# Radius in meters from which a turn on the way is called a curve or a circle.
_WIDE = 0.4


@cache
def _tables() -> Mapping[str, Any]:
    return packaged_toml(__file__, "phrases.toml")


def phrases(act: ReportedAct) -> list[str]:
    """Returns verb phrases for an act, the plainest first.

    A verb in its base form follows `~`; `<his>` and `<him>` stand for pronouns.
    """
    if act.kind not in ("walk", "jog", "run"):
        table = _tables().get(act.kind)
        return _phrases_of(table, act) if table else [f"~do {act.kind.replace('_', ' ')}"]
    event = act.event
    if act.on:
        going = inflect(event.kind, "participle")
        to = "" if event.direction in ("forward", "place") else event.direction
        texts = [f"keep {going} {to}", f"{event.kind} on {to}", f"continue {going} {to}"]
        texts += [f"{event.kind} {to or 'forward'}"]
        return [f"~{' '.join(text.split())}" for text in texts]
    # Every combination of verb, direction, pace and posture of a gait.
    sideways = event.direction in (LEFT, RIGHT) and event.kind == "walk"
    paces = _paces(event)
    texts = [
        f"{verb} {direction} {pace} {low}"
        for verb in (["step", "walk", "move"] if sideways else [event.kind])
        for direction in SUBJECTS["directions"][event.direction]
        for pace in paces
        for low in SUBJECTS["low"].get(act.posture, [""])
    ]
    if event.kind == "walk" and event.direction == "forward" and not act.posture:
        texts += [f"walk {pace}" for pace in paces]
        texts += [f"walk in a straight line {pace}" for pace in paces]
    texts += [f"sidestep to the {event.direction}"] if sideways else []
    return [f"~{' '.join(text.split())}" for text in texts]


def meanwhile(act: ReportedAct) -> list[str]:
    """Returns verb phrases for an act that happens during another, after "while"."""
    return _phrases_of(_tables()["turn_meanwhile"], act) if act.kind == "turn" else phrases(act)


def _phrases_of(table: Sequence[Mapping[str, Any]], act: ReportedAct) -> list[str]:
    event, gait, degrees = act.event, act.gait, act.event.amount
    often = (
        SUBJECTS["times"][event.count] if event.count < len(SUBJECTS["times"]) else "several times"
    )
    onward = gait is not None and gait.direction == "forward"
    # The path is as long as the gait is fast; divided by the angle it is the radius. Angles below
    # 0.3 rad would make any path a wide one.
    wide = gait is not None and gait.amount * gait.seconds / max(degrees / 57.3, 0.3) > _WIDE
    properties = {
        "side": event.side, "direction": event.direction, "count": event.count, "amount": degrees,
        "often": often, "number": often.removesuffix(" times").replace("twice", "two"),
        "gait": gait.kind if gait else "", "pace": _paces(gait)[0] if gait else "",
        "onward": "yes" if onward else "", "circling": "yes" if onward and wide else "",
        "slightly": "slightly" if degrees < 45 else "",
        "clock": "counterclockwise" if event.side == LEFT else "clockwise",
    }  # fmt: skip
    # Plain repetition counts are likelier than vague ones.
    counts = [""] if event.count == 1 else [often, often]
    counts += ["repeatedly", "several times"] if event.count > 3 else []
    texts = []
    for part in filled(table, properties, ("phrases", "counted")):
        texts += part["phrases"]
        texts += [f"{text} {count}".strip() for text in part["counted"] for count in counts]
    return texts


def _paces(gait: Event) -> list[str]:
    """Returns adverbs of the pace of a gait."""
    if gait.kind == "walk" and gait.amount < SLOW:
        return ["slowly", "slowly", "at a slow pace"]
    if gait.kind == "walk" and gait.amount > FAST:
        return ["quickly", "briskly", "fast", "at a fast pace"]
    if gait.kind == "run" and gait.amount > _FAST_RUN:
        return ["", "fast", "quickly"]
    return ["", "", "", "", "at a normal pace" if gait.kind == "walk" else ""]
