"""How people type punches, waves and other acts of hands and arms.

Patterns are written as in `prompt_phrases`.
"""

from __future__ import annotations

from latentmotion.describe.facts import BOTH
from latentmotion.describe.prompt_phrases import (
    ATHLETES,
    FIGHTERS,
    ONCE,
    Wording,
    number,
    some,
    times,
)
from latentmotion.describe.single import SingleAction


def punched(action: SingleAction) -> Wording:
    """Punches with one hand, or both in turn."""
    often, side, count = times(action.count), action.side, action.count
    punches = some(count, "punch", "punches")
    clauses = [f"~punch {often}", f"~throw {punches}", f"~do {punches}"]
    clauses += [f"~punch the air {often}"]
    nouns = [punches]
    if side in ("left", "right"):
        hand = f"<the> {side} [hand|fist|hand|fist|arm]"
        hits = some(count, "[punch|punch|jab|hit|strike]", "[punches|punches|jabs|hits|strikes]")
        sided = some(
            count, f"{side} [punch|punch|jab|hook|hand punch]", f"{side} [punches|jabs|hooks]"
        )
        clauses = [
            f"~punch with {hand} {often}",
            f"~punch {often} [with|with|using] {hand}",
            f"~throw {hits} with {hand}",
            f"~throw {sided}",
            f"~punch [the air|ahead] with {hand} {often}",
            f"~hit [|something|out] with {hand} {often}",
            f"~jab with {hand} {often}",
            f"~strike with {hand} {often}",
            f"~do {hits} with {hand}",
            f"~throw {hits} with the {side}",
            f"~punch with the {side} {often}",
            f"~land {sided}",
        ]
        nouns = [f"{hits} with {hand}", sided, f"{hits} with the {side}", f"{punches} with {hand}"]
    elif side == BOTH:
        clauses += [f"~punch {often} with both [hands|fists]", "~punch with both [hands|fists]"]
        clauses += ["~punch with both [hands|fists] [in turn|alternately]", "~throw punches"]
        clauses += [
            "~punch left and right",
            "~box in the air",
            "~shadowbox",
            "~box with both fists",
        ]
        clauses += ["~throw punches with both [hands|fists]"]
        nouns += [f"{punches} with both [hands|fists]", "shadow boxing", "alternating punches"]
        nouns += ["a left and a right punch" if count == 2 else "lefts and rights in turn"]
    return Wording(tuple(clauses), tuple(nouns), people=FIGHTERS)


def waved(action: SingleAction) -> Wording:
    """Waves with one hand or both."""
    side = action.side
    hello = "[hello|hi|goodbye|at someone|to someone|bye]"
    if side in ("left", "right"):
        hand = f"<the> {side} [hand|hand|arm]"
        clauses = [
            f"~wave with {hand}",
            f"~wave {hand}",
            f"~wave {hello} with {hand}",
            f"~wave [with|using] {hand}",
            f"~wave {hand} [in the air|from side to side|in greeting|to say hello|to say goodbye]",
            f"~greet [someone|somebody|people] with {hand}",
            f"~give a wave with {hand}",
            f"~swing {hand} from side to side in a wave",
            f"~wave {hello} using {hand}",
            f"~say [hello|goodbye] by waving {hand}",
            f"~wave {hello}",
        ]
        nouns = [f"a wave with {hand}", f"a {side} hand wave", f"a [friendly|] wave with {hand}"]
        nouns += [f"a wave [hello|goodbye] with {hand}", f"a {side}-handed wave"]
        return Wording(tuple(clauses), tuple(nouns), people=("a friend", "a neighbor", "a tourist"))
    both = "both [hands|arms]" if side == BOTH else "a hand"
    clauses = [f"~wave with {both}", f"~wave {both}", f"~wave {hello} with {both}"]
    clauses += [f"~wave {both} in the air", f"~wave {hello}", f"~swing {both} to and fro"]
    clauses += [f"~wave {both} to get attention", f"~greet [someone|people] with {both}"]
    clauses += [f"~wave using {both}", f"~wave {both} from side to side"]
    nouns = [
        f"a wave with {both}",
        f"a [big|friendly] wave with {both}",
        f"a wave hello with {both}",
    ]
    if side == BOTH:
        nouns += ["a two-handed wave"]
    return Wording(tuple(clauses), tuple(nouns))


def raised(action: SingleAction) -> Wording:
    """Raised hands and arms."""
    often, side = times(action.count).replace(ONCE, "[||||||once]"), action.side
    if side == BOTH:
        limb, it = "[both|both|<his>|<the>] [arms|hands]", "both [arms|hands]"
    else:
        limb = it = f"<the> {side} [arm|hand]"
    high = action.direction in ("", "up")
    up = "[||up|up in the air|in the air|high]" if high else "[|up]"
    if action.direction == "forward":
        up = "[|in front of <him>|to the front]"
    elif action.direction == "side":
        up = f"[|to the side{'s' * (side == BOTH)}|sideways]"
    clauses = [
        f"~raise {limb} {up} {often}",
        f"~lift {limb} {up} {often}",
        f"~raise {limb} {often}",
        f"~lift {it} {often}",
    ]
    if high:
        clauses += [f"~put {limb} up {often}", f"~bring {it} up {often}"]
        clauses += [f"~hold {limb} up"] if action.count == 1 else []
        clauses += [f"~stretch {it} up {often}", f"~put {limb} in the air {often}"]
        clauses += [f"~reach up with {it} {often}", f"~throw {limb} up {often}"]
    else:
        clauses += [f"~bring {it} up {often}", f"~move {it} up {often}"]
    nouns = [f"{number(action.count)} raises of {it}" if action.count > 1 else f"{it} up"]
    nouns += [f"raising {limb} {often}", f"lifting {it} {often}", f"{it} going up {often}"]
    orders = ("hands up", "arms up", "both hands up") if side == BOTH and high else ()
    return Wording(tuple(clauses), tuple(nouns), people=("a student",), orders=orders)


def clapped(action: SingleAction) -> Wording:
    """Claps."""
    count, often = action.count, times(action.count)
    clauses = [f"~clap {often}", f"~clap <his> hands {often}", f"~clap {often}"]
    clauses += [f"~clap <the> hands together {often}", f"~do {some(count, 'clap', 'claps')}"]
    clauses += [f"~give {some(count, 'clap', 'claps')}"]
    if count >= 2:
        clauses += ["~clap <his> hands", "~clap"]
    if count >= 3:
        clauses += ["~applaud", "~give a round of applause", "~clap [along|in applause]"]
    nouns = [some(count, "clap", "claps"), some(count, "clap of the hands", "claps of the hands")]
    nouns += [some(count, "hand clap", "hand claps"), f"hands clapping {often}"]
    return Wording(tuple(clauses), tuple(nouns), people=("a fan", "an audience member"))


def circled_arms(action: SingleAction) -> Wording:
    """Arms that go round."""
    side, count = action.side, action.count
    both = side == BOTH
    arm = "[both|both|<his>] arms" if both else f"<the> {side} arm"
    way = {
        "forward": "[|forward|forwards]",
        "backward": "[|backward|backwards]",
    }.get(action.direction, "")
    often = times(count) if count > 1 else "[|||once]"
    round_ = "circles" if count > 1 else "a circle"
    clauses = [
        f"~circle {arm} {way} {often}",
        f"~swing {arm} {way} in {round_} {often}",
        f"~rotate {arm} {way} {often}",
        f"~do arm circles {way} with {arm}" if count > 1 else f"~make a circle with {arm}",
        f"~make {some(count, 'circle', 'circles')} with {arm}",
        f"~move {arm} in {round_} {often}",
        f"~windmill {arm} {way} {often}",
    ]
    circles = some(count, "arm circle", "arm circles")
    nouns = [f"{circles} {way} with {arm}", f"circling {arm} {way} {often}"]
    if not both:
        nouns += [some(count, f"{side} arm circle", f"{side} arm circles")]
    return Wording(tuple(clauses), tuple(nouns), people=ATHLETES)


def picked_up(action: SingleAction) -> Wording:
    """A reach to the floor."""
    side = action.side
    hand = "" if not side else f"[||with <the> {side} hand]"
    if side == BOTH:
        hand = "[||with both hands]"
    floor = "[floor|ground]"
    thing = "[something|something|an object|a coin|a box|a ball]"
    clauses = (
        f"~pick {thing} up {hand}",
        f"~pick [something|something|an object|it] up [off|from] the {floor} {hand}",
        f"~pick up {thing} [|from the {floor}|off the {floor}] {hand}",
        f"~reach down to the {floor} {hand}",
        f"~bend down and ~pick [something|it] up {hand}",
        f"~grab [something|an object] [off|from] the {floor} {hand}",
        f"~bend down to pick up {thing} {hand}",
        f"~reach for [something|an object] on the {floor} {hand}",
        f"~lift something off the {floor} {hand}",
        f"~bend down and ~touch the {floor} {hand}",
        f"~take something from the {floor} {hand}",
    )
    nouns = (
        f"picking {thing} up {hand}",
        f"a reach down to the {floor} {hand}",
        f"reaching down to the {floor} {hand}",
        f"grabbing something off the {floor} {hand}",
    )
    return Wording(clauses, nouns, people=("a worker", "a cleaner"))


def touched_head(action: SingleAction) -> Wording:
    """A hand at the head."""
    hand = "[a|one|<his>] hand"
    if action.side in ("left", "right"):
        hand = f"<the> {action.side} hand"
    elif action.side == BOTH:
        hand = "both hands"
    clauses = (
        f"~touch <the> head with {hand}",
        f"~put {hand} [on|to] <his> head",
        f"~scratch <his> head with {hand}",
        f"~hold {hand} to <his> head",
        f"~raise {hand} to <his> head",
        f"~place {hand} on <his> head",
        f"~bring {hand} to <his> head",
        f"~reach for <his> head with {hand}",
        f"~hold <his> head with {hand}",
        f"~touch <his> hair with {hand}",
    )
    nouns = (f"{hand} on the head", f"{hand} to the head", f"a touch of the head with {hand}")
    return Wording(clauses, nouns)
