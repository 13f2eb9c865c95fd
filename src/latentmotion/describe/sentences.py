"""Description → sentences as people write captions and type prompts, in several styles."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from latentmotion.describe.acts import Act, acts_of
from latentmotion.describe.agreement import check
from latentmotion.describe.facts import Description
from latentmotion.describe.verbs import present_participle, third_person
from latentmotion.describe.wording import Phrase, meanwhile, phrases

Form = Callable[[str], str]
"""How a verb is written."""

_SUBJECTS = (
    ("a person", "their", "them", 8),
    ("the person", "their", "them", 3),
    ("someone", "their", "them", 2),
    ("a man", "his", "him", 3),
    ("the man", "his", "him", 1),
    ("a woman", "her", "her", 1),
    ("he", "his", "him", 1),
    ("a figure", "its", "it", 1),
    ("", "the", "them", 4),
)
"""Who acts, possessive, object, weight; the last leaves the subject out."""

MOST_ACTS = 5
"""More than this is not told in one sentence: the motion is described by its beginning and end."""


def sentences(
    description: Description,
    generator: np.random.Generator,
    action: str | None = None,
    count: int = 4,
) -> list[str]:
    """Writes different sentences about a motion.

    Args:
        description: The motion's.
        generator: What draws wording and style.
        action: A sentence about it or the name of its action, from a file. It is used where the
            motion does not contradict it.
        count: How many sentences at most; fewer where there are fewer ways to tell it.
    """
    known = plain_action(action) if action else ""
    if known and check(known, description).verdict == "contradicts":
        known = ""
    acts = acts_of(description)
    found: list[str] = []
    if known:
        found = _with_action(known, description, acts, generator)[:count]
        if acts[0].kind in ("stand", "still") or _covers(known, acts):
            return found
    for _ in range(6 * count):
        if len(found) >= count:
            break
        sentence = _sentence(acts, generator)
        if sentence not in found:
            found.append(sentence)
    return found


def plain_action(action: str) -> str:
    """Returns a name such as `wave_hello` or `WaveHello` as words; sentences stay as they are."""
    text = action.strip()
    if " " in text:
        return text
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", text).replace("_", " ").replace("-", " ")
    return re.sub(r"\s*\d+\s*", " ", words).strip().lower()


def _covers(known: str, acts: Sequence[Act]) -> bool:
    """Says whether measured sentences would only repeat or spoil what a caption says better."""
    return len(known.split()) > 2 and all(act.kind in ("raise", "wave", "punch") for act in acts)


def _with_action(
    known: str, description: Description, acts: Sequence[Act], generator: np.random.Generator
) -> list[str]:
    """The caption itself, and with the way that it does not tell."""
    agreement = check(known, description)
    told = {claim.kind for claim in agreement.claims}
    ways = [act for act in acts if act.kind in ("walk", "jog", "run", "turn")]
    out = [known]
    if ways and not told & {"walk", "jog", "run", "turn", "circle", "move", "sit"}:
        verb, rest = _draw(phrases(ways[0]), generator)
        tail = _filled(present_participle(verb), rest, "the", "them", present_participle)
        out.append(f"{known.rstrip('. ')} while {tail}")
    return out


def _sentence(acts: Sequence[Act], generator: np.random.Generator) -> str:
    told = _chosen(acts)
    weights = np.array([subject[3] for subject in _SUBJECTS], float)
    who, his, him, _ = _SUBJECTS[generator.choice(len(_SUBJECTS), p=weights / weights.sum())]
    style = (
        str(generator.choice(["third", "third", "third", "ing"]))
        if who
        else (str(generator.choice(["third", "base", "base", "ing"])))
    )
    form = {"third": third_person, "base": _same, "ing": present_participle}[style]
    parts = [_part(act, form, his, him, generator) for act in told]
    text = _join(parts, told, generator)
    who = f"{who} is" if who and style == "ing" else who
    text = f"{who} {text}".strip()
    return f"{text}." if generator.random() < 0.6 else text


def _chosen(acts: Sequence[Act]) -> Sequence[Act]:
    """Too many acts are told by those that last longest, in their order."""
    if len(acts) <= MOST_ACTS:
        return acts
    longest = sorted(acts, key=lambda act: -act.event.frames)[:MOST_ACTS]
    return [act for act in acts if act in longest]


def _part(
    act: Act, form: Form, his: str, him: str, generator: np.random.Generator
) -> tuple[str, str]:
    """Returns the act in the form of the sentence, and with -ing."""
    verb, rest = _draw(phrases(act), generator)
    during, how = _draw(meanwhile(act), generator)
    going = present_participle(during)
    return (
        _filled(form(verb), rest, his, him, form),
        _filled(going, how, his, him, present_participle),
    )


def _draw(found: list[Phrase], generator: np.random.Generator) -> Phrase:
    """Plain wording comes first in the list, and is drawn half of the time."""
    if generator.random() < 0.35:
        return found[0]
    return found[int(generator.integers(len(found)))]


def _filled(verb: str, rest: str, his: str, him: str, form: Form) -> str:
    rest = rest.replace("{his}", his).replace("{him}", him)
    rest = re.sub(r"\{(\w+)\}", lambda match: form(match[1]), rest)
    return f"{verb} {rest}".strip()


def _join(parts: list[tuple[str, str]], acts: Sequence[Act], generator: np.random.Generator) -> str:
    groups, last = [parts[0][0]], acts[0]
    for (plain, gerund), act in zip(parts[1:], acts[1:], strict=True):
        before = last.gait or last.event
        during = act.gait is not None and act.kind != "turn" and act.gait.start <= before.start
        if (during or act.event.end <= last.event.end - 6) and " while " not in groups[-1]:
            groups[-1] += f" while {gerund}"
        else:
            groups.append(plain)
        last = act
    if len(groups) == 1:
        return groups[0]
    joiners = (", then ", " and then ", " then ", " and ", ", and then ")
    if len(groups) > 2:
        joiners = (", then ", ", and then ", " and ", ", and finally ")
    text = ", ".join(groups[:-1])
    if len(groups) > 2 and generator.random() < 0.4:
        text = ", then ".join(groups[:-1])
    return text + str(generator.choice(joiners)) + groups[-1]


def _same(verb: str) -> str:
    return verb
