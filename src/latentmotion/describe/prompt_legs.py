"""How people type jumps, hops, kicks, knees, exercises, balance and climbing.

Patterns are written as in `prompt_phrases`.
"""

from __future__ import annotations

from latentmotion.describe.facts import BOTH
from latentmotion.describe.prompt_phrases import (
    ATHLETES,
    IN_A_ROW,
    KICKERS,
    Wording,
    number,
    some,
    times,
    towards,
)
from latentmotion.describe.single import SingleAction


def jumped(action: SingleAction) -> Wording:
    """Jumps with both feet."""
    count, often = action.count, times(action.count)
    leaps = some(count, "[jump|jump|leap]", "[jumps|jumps|leaps]")
    if action.direction in ("", "up", "place"):
        up = "[||up|up|up in the air|into the air|in place]"
        clauses = [f"~jump {up} {often}", f"~jump {often}", f"~do {leaps}", f"~make {leaps}"]
        clauses += [
            f"~jump up {often}",
            f"~leap [up|into the air] {often}",
            f"~jump on the spot {often}",
        ]
        clauses += [f"~take {leaps}", f"~spring [up|into the air] {often}", f"~hop up {often}"]
        clauses += [f"~jump {often} with both feet", f"~jump straight up {often}"]
        nouns = [leaps, leaps, f"{leaps} [in place|on the spot|into the air]"]
        nouns += [some(count, "jump up", "jumps up")]
        nouns += [some(count, "[vertical|standing] jump", "[vertical|standing] jumps")]
        if count > 1:
            clauses += ["~jump up and down", f"~jump up and down {often}"]
        return Wording(tuple(clauses), tuple(nouns), people=ATHLETES)
    leaps = leaps.removesuffix(IN_A_ROW)
    way = {
        "forward": "[forward|forward|ahead|forwards]",
        "backward": "[backward|backwards|back]",
    }.get(action.direction, towards(action.direction))
    clauses = [f"~jump {way} {often}", f"~jump {way} {often}", f"~leap {way} {often}"]
    clauses += [f"~make {leaps} {way}", f"~hop {way} {often}"]
    clauses += [f"~do {leaps} {way}", f"~take {leaps} {way}", f"~jump {way} with both feet {often}"]
    clauses += [f"~spring {way} {often}", f"~bound {way} {often}"]
    if action.direction in ("left", "right"):
        clauses += [f"~jump sideways {way} {often}", f"~leap sideways {way} {often}"]
    return Wording(tuple(clauses), (f"{leaps} {way}", f"{leaps} {way}"), people=ATHLETES)


def hopped(action: SingleAction) -> Wording:
    """Hops on one foot."""
    often, side = times(action.count), action.side
    hops = some(action.count, "hop", "hops")
    jumps = some(action.count, "jump", "jumps")
    foot = "[one leg|one foot]"
    if side in ("left", "right"):
        foot = f"[<the> {side} [foot|leg]|<the> {side} [foot|leg]|one [leg|foot]|<his> {side} leg]"
    clauses = [
        f"~hop on {foot} {often}",
        f"~hop {often} on {foot}",
        f"~jump on {foot} {often}",
        f"~hop on {foot} {often}",
        f"~make {hops} on {foot}",
        f"~do {hops} on {foot}",
        f"~take {hops} on {foot}",
        f"~jump {often} on {foot}",
    ]
    if action.count > 1:
        clauses += [f"~hop [around|along] on {foot}", f"~keep hopping on {foot}"]
        clauses += [f"~bounce on {foot} {often}"]
    if action.direction in ("forward", "backward"):
        clauses += [f"~hop {action.direction} on {foot} {often}"]
    nouns = [f"{hops} on {foot}", f"{jumps} on {foot}", f"hopping on {foot} {often}"]
    return Wording(tuple(clauses), tuple(nouns), people=("a girl", "the kid", "a child"))


def kicked(action: SingleAction) -> Wording:
    """Kicks with one leg, or both in turn."""
    often, side, count = times(action.count), action.side, action.count
    kicks = some(count, "kick", "kicks")
    clauses, nouns = [f"~do {kicks}", f"~throw {kicks}"], [kicks]
    if side in ("left", "right"):
        leg = f"<the> {side} [leg|foot|leg|foot|leg]"
        with_it = f"[with|with|with|using] {leg}"
        clauses = [
            f"~kick {with_it} {often}",
            f"~kick {often} {with_it}",
            f"~kick <the> {side} [leg|foot] {often}",
            f"~do {kicks} with {leg}",
            f"~throw {kicks} with {leg}",
            "~do " + some(count, f"{side} kick", f"{side} kicks"),
            f"~kick out with {leg} {often}",
            f"~give {kicks} with {leg}",
            f"~kick [something|the air|a ball] {often} {with_it}",
            f"~deliver {kicks} with {leg}",
            "~throw " + some(count, f"{side} kick", f"{side} kicks"),
            f"~swing <the> {side} leg in {kicks}" if count == 1 else f"~kick {often} {with_it}",
        ]
        nouns = [
            f"{kicks} with {leg}",
            some(count, f"{side} kick", f"{side} kicks"),
            some(count, f"{side} leg kick", f"{side} leg kicks"),
            f"{kicks} with {leg}",
        ]
    elif side == BOTH:
        clauses += ["~kick with [both legs|the left and the right leg] [in turn|alternately]"]
        clauses += [f"~kick {often} with both legs in turn", "~do kicks with both legs"]
        nouns += [f"{kicks} with both legs in turn", "alternating kicks"]
    extra = _kick_way(action)
    return Wording((*clauses, *extra), tuple(nouns), people=KICKERS)


def _kick_way(action: SingleAction) -> tuple[str, ...]:
    side, often = action.side, times(action.count)
    leg = f" with <the> {side} [leg|foot]" if side in ("left", "right") else ""
    if action.direction == "forward":
        named = some(action.count, "front kick", "front kicks")
        return (f"~kick forward{leg} {often}", f"~do {named}{leg}")
    if action.direction in ("side", "left", "right"):
        named = some(action.count, "side kick", "side kicks")
        return (f"~kick to the side{leg} {often}", f"~do {named}{leg}")
    if action.direction == "backward":
        return (f"~kick backward{leg} {often}", f"~kick backwards{leg} {often}")
    return ()


def kneed(action: SingleAction) -> Wording:
    """Raised knees."""
    often, side, count = times(action.count), action.side, action.count
    if side in ("left", "right"):
        knee = f"<the> {side} knee"
        clauses = [f"~raise {knee} {often}", f"~lift {knee} {often}", f"~lift {knee} up {often}"]
        clauses += [
            f"~bring {knee} up {often}",
            f"~pull {knee} up {often}",
            f"~raise {knee} up {often}",
        ]
        clauses += [f"~lift {knee} in front of <him> {often}"]
        clauses += [f"~do {some(count, f'{side} knee raise', f'{side} knee raises')}"]
        clauses += [f"~raise the {side} leg with a bent knee {often}"]
        nouns = [
            some(count, f"{side} knee raise", f"{side} knee raises"),
            f"{side} knee up {often}",
        ]
        nouns += [some(count, f"{side} knee lift", f"{side} knee lifts"), f"lifting {knee} {often}"]
        return Wording(tuple(clauses), tuple(nouns), people=ATHLETES)
    clauses = ["~raise <his> knees [in turn|one after the other|alternately]"]
    clauses += ["~lift <his> knees [in turn|one after the other|one by one]", "~do knee raises"]
    clauses += [
        "~bring <his> knees up [in turn|alternately]",
        "~raise the left and right knee in turn",
    ]
    clauses += [
        "~lift one knee, then the other",
        "~pull up <his> knees in turn",
        "~lift both knees in turn",
    ]
    clauses += [
        f"~do {some(count, 'knee raise', 'knee raises')}"
        if count > 1
        else "~raise both knees in turn"
    ]
    nouns = ["[alternating|] knee raises", "knee lifts [on both sides|in turn]", "knees up in turn"]
    return Wording(tuple(clauses), tuple(nouns), people=ATHLETES)


def counted(action: SingleAction) -> Wording:
    """Jumping jacks, squats and bows."""
    count, often = action.count, times(action.count)
    if action.kind == "jack":
        jacks = some(
            count,
            "[jumping jack|jumping jack|star jump]",
            "[jumping jacks|jumping jacks|star jumps]",
        )
        clauses = [f"~do {jacks}", f"~do {jacks}", f"~perform {jacks}", f"~make {jacks}"]
        clauses += [f"~do a set of {number(count)} jumping jacks"] if count > 2 else []
        if count > 1:
            clauses += ["~do [jumping jacks|star jumps]", "~exercise with jumping jacks"]
            clauses += ["~warm up with [jumping jacks|star jumps]"]
        return Wording(tuple(clauses), (jacks, jacks), people=ATHLETES)
    if action.kind == "squat":
        squats = some(count, "[squat|squat|knee bend|deep squat]", "[squats|squats|knee bends]")
        clauses = [f"~do {squats}", f"~squat {often}", f"~squat down and ~stand up {often}"]
        clauses += [f"~perform {squats}", f"~squat and ~come back up {often}"]
        clauses += [f"~squat down {often}"]
        clauses += [f"~bend <the> knees deeply {often}", f"~go down into a squat {often}"]
        clauses += [f"~go down and up in {squats}"]
        clauses += ["~do squats", "~exercise with squats"] if count > 1 else []
        return Wording(tuple(clauses), (squats, squats), people=ATHLETES)
    bows = some(count, "[bow|bow|polite bow]", "bows")
    clauses = [f"~bow {often}", f"~take {bows}", f"~bend forward {often}", f"~make {bows}"]
    clauses += [f"~bow down {often}", f"~bow politely {often}", f"~lean forward {often}"]
    clauses += [f"~bow to [the audience|someone|the crowd] {often}", f"~bend over {often}"]
    clauses += [f"~bend at the [waist|hips] {often}", f"~bow forward {often}", f"~give {bows}"]
    return Wording(tuple(clauses), (bows, f"{bows} forward"), people=("an actor", "a butler"))


def balanced(action: SingleAction) -> Wording:
    """A stand on one leg."""
    one = "one [leg|foot]"
    if action.side in ("left", "right"):
        one = f"[<the> {action.side} [leg|foot]|<the> {action.side} [leg|foot]|one [leg|foot]]"
    clauses = (
        f"~stand on {one}",
        f"~balance on {one}",
        f"~balance on {one}",
        f"~keep <his> balance on {one}",
        f"~stay on {one}",
        f"~stand still on {one}",
        f"~hold <his> balance on {one}",
        f"~stand like a flamingo on {one}",
        f"~balance [for a moment|in place] on {one}",
        f"~stand [there|steadily] on {one}",
    )
    nouns = (f"a stand on {one}", f"balance on {one}", f"a balancing act on {one}")
    return Wording(clauses, nouns, people=("a yogi", "a gymnast", "a dancer"))


def climbed(action: SingleAction) -> Wording:
    """Up or down steps."""
    way = action.direction if action.direction in ("up", "down") else "up"
    stairs = "[the stairs|stairs|some stairs|the steps|a staircase|a few steps]"
    clauses = [f"~walk {way} {stairs}", f"~go {way} {stairs}", f"~climb {way} {stairs}"]
    clauses += [f"~go {way}stairs", f"~walk {way}stairs", f"~take the stairs {way}"]
    if way == "up":
        clauses += ["~climb [stairs|the stairs|some steps|a staircase]", "~climb up"]
        clauses += [
            "~step up onto something",
            "~ascend the stairs",
            "~climb up [on|onto] something",
        ]
        nouns = [
            "a climb up [the stairs|some steps]",
            "stairs up",
            "climbing stairs",
            "a way upstairs",
        ]
    else:
        clauses += ["~climb down", "~descend the [stairs|steps]", "~step down from something"]
        nouns = ["a climb down [the stairs|some steps]", "stairs down", "a descent down the stairs"]
    return Wording(tuple(clauses), tuple(nouns[:3]))
