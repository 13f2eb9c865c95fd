"""Prompts with checks, drawn by the thousand: what a model may be trained to obey.

They are worded by the describer's grammar, in the benchmark's groups; none is a sentence of the
benchmark's list, nor the mirror image of one.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from latentmotion.data.instructions import Instruction, parse, refused_captions
from latentmotion.measure.facts import BOTH, LEFT, RIGHT, SingleAction
from latentmotion.plugins import entries
from latentmotion.storage.reading import packaged_toml
from latentmotion.training.captioning.prompting import prompts, prompts_in_order

_TABLE = packaged_toml(__file__, "drawn_instructions.toml")

SHARES: dict[str, float] = _TABLE["shares"]  # Share of each group.

_SIDE_WORDS = re.compile(r"\b(?:left|right|(?:anti|counter-?)?clockwise)\b", re.IGNORECASE)
_ONCE = re.compile(r"\b(?:once|one time|one|single)\b", re.IGNORECASE)
_SOME = re.compile(r"\ba few\b", re.IGNORECASE)
_OFTEN = re.compile(r"\b(?:several|again and again|repeatedly|over and over)\b", re.IGNORECASE)


@dataclass(frozen=True)
class _Asked:
    """One action, or two in order, with what a motion must show.

    A single action's check has `{side}`, `{way}`, `{count}`, `{steps}` and `{often}`, a count if
    one is said, where the sentence decides what it demands.
    """

    actions: tuple[SingleAction, ...]
    check: str

    def demanded(self, text: str) -> str:
        """Returns the check: of a side and a count no more than the sentence says."""
        action = self.actions[0]
        says_side = action.side == BOTH or _SIDE_WORDS.search(text)
        side = action.side if says_side and action.side else "any"
        if "turn({side}" in self.check and side == "any":
            side = "either"
        way = action.direction if says_side else "sideways"
        count = "3, 99" if _OFTEN.search(text) else "2, 5" if _SOME.search(text) else action.count
        steps = f"{count}, {count + 1}" if isinstance(count, int) else count
        often = f", {count}" if action.count > 1 or _ONCE.search(text) else ""
        if len(self.actions) > 1 and not _SIDE_WORDS.search(text):
            check = re.sub(r"turn\((?:left|right)", "turn(either", self.check)
            return re.sub(r"(?<!go)\((?:left|right)\)", "(any)", check)
        return self.check.format(side=side, often=often, count=count, steps=steps, way=way)


Draw = Callable[[np.random.Generator], _Asked]

# What draws an instruction of a group; functions below register themselves.
_GROUPS: dict[str, Draw] = {
    "posture": lambda generator: _plain("posture", generator),
    "action": lambda generator: _plain("action", generator),
}


_group = entries(_GROUPS)  # Registers what draws the instructions of a group.


def drawn_instructions(count: int, seed: int) -> list[Instruction]:
    """Returns different prompts with their checks, none of them of the benchmark.

    Args:
        count: How many, at most; a sentence that comes again is left out.
        seed: What draws actions, parameters and words.
    """
    generator = np.random.default_rng(seed)
    refused = refused_captions()
    instructions: dict[str, Instruction] = {}
    for group in generator.choice(list(SHARES), count, p=list(SHARES.values())).tolist():
        drawn = _GROUPS[group](generator)
        if len(drawn.actions) == 1:
            texts = prompts(drawn.actions[0], generator, 1, refused)
        else:
            texts = prompts_in_order(drawn.actions[0], drawn.actions[1], generator, 1, refused)
        for text in texts:
            name = f"drawn-{seed}-{len(instructions):05d}"
            check = parse(drawn.demanded(text))
            instructions.setdefault(text, Instruction(name, group, text, check))
    return list(instructions.values())


def _pick(generator: np.random.Generator, some: tuple | list | dict) -> object:
    values = list(some)
    return values[int(generator.integers(len(values)))]


def _action(kind: str, **more: object) -> SingleAction:
    return SingleAction(kind, 0, 60, **more)  # type: ignore[arg-type]


@_group("side")
def _side(generator: np.random.Generator) -> _Asked:
    side = str(_pick(generator, (LEFT, RIGHT)))
    if generator.random() < 0.2:
        return _turned(side, int(generator.choice([60, 90])), "turn({side}, 30, 200)", generator)
    kind = str(_pick(generator, [*_TABLE["sided"], "kick", "punch", "wave", "hop"]))
    often = "" if kind in ("raise", "wave", "balance", "touch_head") else "{often}"
    place = ", head" if kind == "touch_head" else ""
    return _Asked((_action(kind, side=side),), f"{_TABLE['sided'][kind]}({{side}}{place}{often})")


def _turned(side: str, degrees: int, check: str, generator: np.random.Generator) -> _Asked:
    gait = "walk" if generator.random() < 0.4 and degrees < 290 else ""
    travel = " & travel(1)" if gait else ""
    return _Asked((_action("turn", side=side, degrees=degrees, gait=gait),), check + travel)


@_group("turns")
def _turns(generator: np.random.Generator) -> _Asked:
    side = str(_pick(generator, (LEFT, RIGHT)))
    kind = generator.choice(
        ["turn", "circle", "half_circle", "turn_and_return"], p=[0.6, 0.2, 0.12, 0.08]
    )
    gait = "walk" if generator.random() < 0.7 else "jog"
    if kind == "turn":
        degrees = int(generator.choice(_TABLE["angles"]["degrees"], p=_TABLE["angles"]["shares"]))
        least, most = _TABLE["angles"]["fulfilled"][_TABLE["angles"]["degrees"].index(degrees)]
        return _turned(side, degrees, f"turn({{side}}, {least}, {most})", generator)
    far, (least, most) = 1, (120, 240)
    if kind == "circle":
        far, (least, most) = 2, (270, 4000)
    elif kind == "turn_and_return":
        least, most = 130, 230
    degrees = 330 if kind == "circle" else 180
    action = _action(kind, side=side, degrees=degrees, gait=gait)
    return _Asked((action,), f"turn({{side}}, {least}, {most}) & travel({far})")


@_group("counts")
def _counts(generator: np.random.Generator) -> _Asked:
    kind = str(_pick(generator, [*_TABLE["counted"], "jump", "kick", "punch", "steps", "steps"]))
    if kind == "steps":
        count, way = int(generator.integers(1, 6)), str(_pick(generator, ("forward", "backward")))
        action = _action("steps", count=count, direction=way)
        far = f"{0.15 * count:.2f}"
        return _Asked((action,), f"step({{steps}}) & move({way}, {far})")
    name, most = _TABLE["counted"][kind]
    count = int(generator.integers(1, most + 1))
    if kind in ("jump", "squat", "jack", "bow", "clap"):
        return _Asked((_action(kind, count=count),), f"{name}({{count}})")
    side = str(_pick(generator, (LEFT, RIGHT)))
    if kind == "raise" and generator.random() < 0.5:
        side = BOTH
    return _Asked((_action(kind, count=count, side=side),), f"{name}({{side}}, {{count}})")


@_group("order")
def _orders(generator: np.random.Generator) -> _Asked:
    if generator.random() < 0.2:
        kind = str(_pick(generator, ("kick", "raise", "punch")))
        sides = (LEFT, RIGHT) if generator.random() < 0.5 else (RIGHT, LEFT)
        both = tuple(_action(kind, side=side) for side in sides)
        return _Asked(both, " > ".join(f"{kind}({side})" for side in sides))
    if generator.random() < 0.15:
        directions = (("forward", "backward"), (LEFT, RIGHT))[int(generator.integers(2))]
        directions = directions if generator.random() < 0.5 else directions[::-1]
        kind = "walk" if "forward" in directions else "steps"
        both = tuple(_action(kind, direction=way, pace="normal") for way in directions)
        return _Asked(both, " > ".join(f"go({way})" for way in directions))
    kinds = [*_TABLE["in_order"], "walk", "walk", "run", "jump", "kick", "punch", "wave", "turn"]
    first, other = str(_pick(generator, kinds)), str(_pick(generator, kinds))
    if first == other or {first, other} == {"stand", "turn"} or first in ("lie_down", "sit_down"):
        return _orders(generator)
    actions, terms = [], []
    for kind in (first, other):
        name, more = _TABLE["in_order"][kind], dict[str, str | int]()
        if kind in ("walk", "run"):
            more |= {"pace": "normal", "direction": "forward"}
        elif kind in ("kick", "punch", "wave", "raise", "turn"):
            sides = (LEFT, RIGHT, BOTH) if kind == "raise" else (LEFT, RIGHT)
            more["side"] = side = str(_pick(generator, sides))
            name = f"turn({side}, 30, 240)" if kind == "turn" else f"{name}({side})"
        if kind == "turn":
            more["degrees"] = int(generator.choice([90, 180]))
        actions.append(_action(kind, **more))
        terms.append(name)
    return _Asked(tuple(actions), " > ".join(terms))


@_group("pace")
def _paces(generator: np.random.Generator) -> _Asked:
    if generator.random() < 0.2:
        return _plain("pace", generator)
    paces = _TABLE["paces"]
    key = list(paces)[int(generator.integers(len(paces)))]
    kind, pace = key.split("-")
    return _Asked((_action(kind, pace=pace, direction="forward"),), paces[key])


@_group("direction")
def _directions(generator: np.random.Generator) -> _Asked:
    way = str(_pick(generator, ("backward", LEFT, RIGHT)))
    kind = str(_pick(generator, ("walk", "steps", "jump")))
    count = int(generator.integers(1, 4)) if kind == "steps" else 1
    far = {"walk": 0.5, "steps": 0.15 * count, "jump": 0.2}[kind]
    jumps = "jump & " if kind == "jump" else ""
    action = _action(kind, direction=way, count=count, pace="normal" if kind == "walk" else "")
    towards = "{way}" if way in (LEFT, RIGHT) else way
    return _Asked((action,), f"{jumps}move({towards}, {far:.2f})")


def _plain(group: str, generator: np.random.Generator) -> _Asked:
    kind = str(_pick(generator, _TABLE["plain"][group]))
    return _Asked((_action(kind),), _TABLE["plain"][group][kind])
