"""How people type changes of pace, acts of limbs, exercises and postures.

Patterns are written as in `prompt_phrases`.
"""

from __future__ import annotations

from latentmotion.describe.facts import BOTH
from latentmotion.describe.prompt_phrases import (
    PEOPLE_ON_FOOT,
    RUNNERS,
    Wording,
    number,
    some,
    times,
    towards,
)
from latentmotion.describe.single import SingleAction

FIGHTERS = ("a fighter", "a boxer", "the boxer", "a martial artist")
KICKERS = ("a fighter", "a kickboxer", "a martial artist", "a soccer player")
ATHLETES = ("an athlete", "a gymnast", "a man at the gym")


def changed(action: SingleAction) -> Wording:
    """Starting, stopping, and changing from one gait or speed to another."""
    return _SPEEDS[action.kind](action) if action.kind in _SPEEDS else _CHANGES[action.kind]


def _faster(action: SingleAction) -> Wording:
    gait = action.gait
    clauses = ["~speed up", "~get faster [|and faster]", "~accelerate", "~pick up [speed|the pace]"]
    clauses += ["~start [slow|slowly|out slow] and ~speed up", "~start slowly, then ~get faster"]
    if gait:
        clauses += [
            f"~{gait} faster and faster",
            f"~{gait} and ~speed up",
            f"~{gait} and ~get faster",
        ]
        clauses += [f"~{gait} and ~accelerate", f"~{gait} slowly at first, then faster"]
        clauses += [f"~{gait}, then ~{gait} faster", f"~{gait}, getting faster [|and faster]"]
        clauses += [f"~{gait}, then ~speed up", f"~start to {gait} faster"]
    nouns = [f"a {gait or 'walk'} that gets faster [|and faster]", "an acceleration"]
    nouns += [f"a {gait or 'walk'} with increasing speed", f"a faster and faster {gait or 'walk'}"]
    return Wording(tuple(clauses), tuple(nouns), people=_on_foot(gait))


def _slower(action: SingleAction) -> Wording:
    gait = action.gait
    clauses = ["~slow down", "~get slower [|and slower]", "~decelerate", "~lose speed"]
    clauses += ["~start fast and ~slow down", "~reduce the pace", "~start fast, then ~get slower"]
    if gait:
        clauses += [
            f"~{gait} slower and slower",
            f"~{gait} and ~slow down",
            f"~{gait} and ~get slower",
        ]
        clauses += [f"~{gait}, then ~slow down", f"~{gait}, getting slower [|and slower]"]
        clauses += [f"~{gait} fast at first, then slower", f"~{gait}, then ~{gait} slower"]
    nouns = [f"a {gait or 'walk'} that gets slower [|and slower]", "a slowdown"]
    nouns += [f"a {gait or 'walk'} with decreasing speed", f"a slower and slower {gait or 'walk'}"]
    return Wording(tuple(clauses), tuple(nouns), people=_on_foot(gait))


def _on_foot(gait: str) -> tuple[str, ...]:
    return RUNNERS if gait in ("jog", "run") else PEOPLE_ON_FOOT


_SPEEDS = {"speed_up": _faster, "slow_down": _slower}


def _started(gait: str, going: str) -> Wording:
    still = "[~stand|~stand still|~wait|~stand for a moment|~stand there|~stay still for a moment]"
    away = "[|off|forward|away|ahead]"
    clauses = (
        f"~start {going} [|forward]",
        f"~start to {gait}",
        f"{still}, then ~{gait} {away}",
        f"~begin to {gait}",
        f"{still} and then ~{gait} {away}",
        f"~{gait} off",
        f"~begin {going}",
        f"{still}, then ~start {going}",
        f"~go from standing to {going}",
        f"~set off [{going}|at a {gait}]",
        f"{still} before {going} {away}",
        f"~stand at first, then ~{gait} {away}",
    )
    nouns = (
        f"first standing, then {going}",
        f"from standing to {going}",
        f"a {gait} from a standstill",
        f"standing and then {going}",
        f"the start of a {gait}",
    )
    return Wording(clauses, nouns, people=_on_foot(gait))


def _stopped(gait: str, going: str) -> Wording:
    halt = "[~stop|~stop|~come to a stop|~halt|~come to a halt|~stand still|~come to a standstill]"
    clauses = (
        f"~stop {going}",
        f"~{gait}, then {halt}",
        f"~{gait} and {halt}",
        f"~{gait} [forward|ahead|] and then {halt}",
        f"~{gait} [forward|ahead|] and {halt}",
        f"~come to a [stop|halt] after {going}",
        f"~{gait} [a bit|a little|forward|], then {halt}",
        f"~{gait} before stopping",
        f"~{gait} [forward|up] and ~stop there",
        f"~finish {going} and ~stand still",
        f"~go from {going} to standing",
        f"~stop after {going} [a bit|a little|]",
    )
    nouns = (
        f"{going}, then standing still",
        f"a {gait}, then a stop",
        f"a {gait} followed by a stop",
        f"from {going} to standing",
        f"{going} and stopping",
        f"a {gait} that comes to a stop",
    )
    after = ("~stop", "~come to a stop", "~stand still", "~halt")
    return Wording(clauses, nouns, after, _on_foot(gait))


_CHANGES: dict[str, Wording] = {
    "start_walking": _started("walk", "walking"),
    "start_running": _started("run", "running"),
    "stop_walking": _stopped("walk", "walking"),
    "stop_running": _stopped("run", "running"),
    "walk_to_run": Wording(
        (
            "~walk, then ~run",
            "~walk and then ~run",
            "~walk [|forward|a bit], then ~start [running|to run]",
            "~go from walking to running",
            "~walk, then ~break into a [run|run|jog]",
            "~break into a run",
            "~start walking and ~end up running",
            "~walk first, then ~run",
            "~walk and ~start [running|to run]",
            "~speed up from a walk to a run",
            "~walk before running",
            "~run after walking [a bit|a little|]",
            "~switch from walking to running",
        ),
        (
            "a walk that turns into a run",
            "from a walk to a run",
            "first walking, then running",
            "a walk, then a run",
            "a walk followed by a run",
            "from walking to running",
        ),
        people=RUNNERS,
    ),
    "run_to_walk": Wording(
        (
            "~run, then ~walk",
            "~run and then ~walk",
            "~run [|forward|a bit], then ~slow down to [a walk|walking]",
            "~go from running to walking",
            "~run, then ~start walking",
            "~slow down from a run to a walk",
            "~run first, then ~walk",
            "~stop running and ~walk",
            "~run and ~slow [down |]to a walk",
            "~run before walking",
            "~walk after running [a bit|a little|]",
            "~switch from running to walking",
            "~drop from a run to a walk",
        ),
        (
            "a run that turns into a walk",
            "from a run to a walk",
            "first running, then walking",
            "a run, then a walk",
            "a run followed by a walk",
            "from running to walking",
        ),
        people=RUNNERS,
    ),
}


CHANGES = (*_SPEEDS, *_CHANGES)
"""Kinds of actions whose gait or pace changes."""


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
    way = {
        "forward": "[forward|forward|ahead|forwards]",
        "backward": "[backward|backwards|back]",
    }.get(action.direction, towards(action.direction))
    clauses = [f"~jump {way} {often}", f"~jump {way} {often}", f"~leap {way} {often}"]
    clauses += [f"~make {leaps} {way}", f"~jump {often} {way}", f"~hop {way} {often}"]
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
    often, side = times(action.count), action.side
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
        clauses += [f"~put {limb} up {often}", f"~hold {limb} up", f"~bring {it} up {often}"]
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
    clauses += ["~bring <his> knees up [in turn|alternately]", "~raise the left and the right knee"]
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
        f"~lift a foot and ~balance on {one}",
    )
    nouns = (f"a stand on {one}", f"balance on {one}", f"a balancing act on {one}")
    return Wording(clauses, nouns, people=("a yogi", "a gymnast", "a dancer"))


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
