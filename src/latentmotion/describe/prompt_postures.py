"""How people type postures and movements on the spot, and which wording belongs to which kind.

Patterns are written as in `prompt_phrases`.
"""

from __future__ import annotations

from collections.abc import Callable

from latentmotion.describe import (
    prompt_arms,
    prompt_changes,
    prompt_gaits,
    prompt_legs,
    prompt_turns,
)
from latentmotion.describe.prompt_phrases import RUNNERS, Wording
from latentmotion.describe.single import SingleAction

_FLOOR = "[floor|ground]"
_SEAT = "[a chair|a chair|a seat|a bench|the chair|a stool]"

_PLAIN: dict[str, Wording] = {
    "march": Wording(
        (
            "~march in place",
            "~march on the spot",
            "~march [|like a soldier|in place]",
            "~walk in place",
            "~walk on the spot",
            "~step in place",
            "~march with raised knees",
            "~lift the knees while marching",
            "~walk in place, lifting <his> knees",
            "~march [in place|on the spot] like a soldier",
        ),
        (
            "marching",
            "a march [in place|on the spot]",
            "[walking|stepping] [in place|on the spot]",
            "a soldier's march on the spot",
        ),
        people=("a soldier", "the soldier", "a guard"),
    ),
    "jog_in_place": Wording(
        (
            "~jog in place",
            "~jog on the spot",
            "~run in place",
            "~run on the spot",
            "~jog [without moving forward|where <he> <is>]",
            "~warm up by jogging in place",
            "~jog lightly [in place|on the spot]",
            "~keep [jogging|running] [in place|on the spot]",
            "~do a jog [in place|on the spot]",
        ),
        (
            "a jog [in place|on the spot]",
            "running [in place|on the spot]",
            "a run [in place|on the spot]",
            "jogging [in place|on the spot]",
        ),
        people=RUNNERS,
    ),
    "arms_out": Wording(
        (
            "~hold <his> arms out to the sides",
            "~stretch <the> arms out to the sides",
            "~spread <his> arms",
            "~stand in a [t-pose|t pose]",
            "~hold both arms out [sideways|to the sides]",
            "~raise both arms to the sides",
            "~extend both arms [sideways|to the sides|to either side]",
            "~stand with <his> arms [spread|stretched out|out to the sides]",
            "~spread <his> arms [wide|like wings|like an airplane]",
            "~make a [t-pose|t pose]",
            "~stand like a scarecrow",
            "~put <the> arms out to both sides",
        ),
        (
            "arms out [|to the sides|wide]",
            "a [t-pose|t pose]",
            "both arms [stretched out|out] to the sides",
            "outstretched arms",
            "arms spread [wide|to the sides]",
        ),
        orders=("arms out",),
    ),
    "hands_on_hips": Wording(
        (
            "~put <the> hands on <his> hips",
            "~stand with <his> hands on <his> hips",
            "~place both hands on <his> hips",
            "~rest <his> hands on <his> hips",
            "~hold <his> hands on <his> hips",
            "~stand with hands on hips",
            "~stand [|there ]akimbo",
            "~put both hands on <his> hips",
            "~have <his> hands on <his> hips",
            "~stand with both hands at the hips",
            "~keep <his> hands on <his> hips",
        ),
        (
            "hands on [hips|the hips]",
            "both hands on [the hips|hips]",
            "arms akimbo",
            "standing with hands on [hips|the hips]",
            "a pose with hands on [hips|the hips]",
        ),
    ),
    "sit_down": Wording(
        (
            "~sit down",
            f"~sit down on {_SEAT}",
            "~take a seat",
            f"~sit on {_SEAT}",
            "~sit down [on something|somewhere]",
            f"~have a seat on {_SEAT}",
            f"~lower <himself> onto {_SEAT}",
            "~go from standing to sitting",
            f"~settle down on {_SEAT}",
            "~stand, then ~sit down",
            "~have a seat",
        ),
        (
            "sitting down",
            f"sitting down on {_SEAT}",
            "taking a seat",
            "from standing to sitting",
        ),
        people=("a tired man", "a guest", "grandpa"),
    ),
    "sit": Wording(
        (
            "~sit",
            f"~sit on {_SEAT}",
            "~sit [there|still|quietly]",
            "~stay seated",
            "~remain seated",
            f"~keep sitting on {_SEAT}",
            "~sit [and ~wait|and ~rest|for a while]",
            f"~stay seated on {_SEAT}",
            "~remain sitting",
            f"~rest on {_SEAT}",
        ),
        (
            f"sitting on {_SEAT}",
            "a seated pose",
            "sitting",
            "a sitting [pose|position]",
            f"a rest on {_SEAT}",
        ),
        people=("a tired man", "a guest", "grandpa"),
    ),
    "stand_up": Wording(
        (
            "~stand up",
            f"~stand up from {_SEAT}",
            "~get up",
            f"~get up from {_SEAT}",
            "~rise [|to <his> feet|from the chair|from a seat]",
            "~get [to|on] <his> feet",
            "~go from sitting to standing",
            "~leave the [chair|seat]",
            "~sit, then ~stand up",
            f"~rise from {_SEAT}",
        ),
        (
            "standing up",
            f"getting up from {_SEAT}",
            "from sitting to standing",
            f"standing up from {_SEAT}",
            "a rise from a chair",
        ),
        people=("a guest", "grandpa"),
    ),
    "sit_floor": Wording(
        (
            f"~sit on the {_FLOOR}",
            f"~sit down on the {_FLOOR}",
            f"~sit on the {_FLOOR} [|quietly|and ~rest]",
            f"~take a seat on the {_FLOOR}",
            f"~be seated on the {_FLOOR}",
            f"~get down and ~sit on the {_FLOOR}",
            f"~rest on the {_FLOOR} in a sitting position",
            "~sit in the grass",
            f"~settle down on the {_FLOOR}",
            f"~stay seated on the {_FLOOR}",
        ),
        (
            f"sitting on the {_FLOOR}",
            f"a seat on the {_FLOOR}",
            f"a sitting pose on the {_FLOOR}",
            f"sitting down on the {_FLOOR}",
        ),
        people=("a kid", "a toddler"),
    ),
    "lie_down": Wording(
        (
            "~lie down",
            f"~lie down on the {_FLOOR}",
            f"~get down and ~lie on the {_FLOOR}",
            "~lie down [to rest|to sleep|flat]",
            f"~lay down on the {_FLOOR}",
            f"~lower <himself> to the {_FLOOR} and ~lie down",
            f"~stretch out on the {_FLOOR}",
            "~go from standing to lying",
            f"~lie flat on the {_FLOOR}",
            f"~get down on the {_FLOOR} and ~lie down",
            "~lay down",
        ),
        (
            "lying down",
            f"lying down on the {_FLOOR}",
            "from standing to lying",
            f"getting down to lie on the {_FLOOR}",
        ),
        people=("a tired man",),
    ),
    "lie": Wording(
        (
            f"~lie on the {_FLOOR}",
            "~lie down",
            f"~lie [still|flat|motionless] on the {_FLOOR}",
            f"~sleep on the {_FLOOR}",
            f"~rest on the {_FLOOR}, lying down",
            "~lie [there|flat|still|asleep]",
            f"~stay down on the {_FLOOR}",
            f"~lie asleep on the {_FLOOR}",
            "~be asleep",
            f"~nap on the {_FLOOR}",
            f"~remain lying on the {_FLOOR}",
        ),
        (
            f"lying on the {_FLOOR}",
            "lying flat",
            "lying down",
            f"asleep on the {_FLOOR}",
            "a lying pose",
            f"a nap on the {_FLOOR}",
        ),
        people=("a tired man", "a patient"),
    ),
    "get_up": Wording(
        (
            f"~get up from the {_FLOOR}",
            f"~get up off the {_FLOOR}",
            "~get up",
            f"~stand up from the {_FLOOR}",
            f"~rise from the {_FLOOR}",
            "~get back [up|to <his> feet|on <his> feet]",
            f"~push <himself> up from the {_FLOOR}",
            f"~rise off the {_FLOOR}",
            "~scramble to <his> feet",
            f"~climb to <his> feet from the {_FLOOR}",
            f"~stand up off the {_FLOOR}",
        ),
        (
            f"getting up from the {_FLOOR}",
            f"getting up off the {_FLOOR}",
            f"a rise from the {_FLOOR}",
            "from the floor to standing",
        ),
    ),
    "kneel": Wording(
        (
            "~kneel",
            "~kneel down",
            f"~kneel on the {_FLOOR}",
            "~get down on <his> knees",
            f"~kneel down on the {_FLOOR}",
            "~go down on <his> knees",
            "~drop to <his> knees",
            "~kneel [to pray|in prayer]",
            "~sink to <his> knees",
            "~lower <himself> into a kneel",
            "~get into a kneeling position",
        ),
        (
            "kneeling",
            f"kneeling on the {_FLOOR}",
            "a kneel",
            "kneeling down",
            "a kneeling [pose|position]",
        ),
        people=("a knight", "a monk"),
    ),
    "crawl": Wording(
        (
            "~crawl",
            "~crawl [forward|along|ahead]",
            f"~crawl on the {_FLOOR}",
            "~crawl on [all fours|hands and knees|<his> hands and knees]",
            "~move on [all fours|hands and knees]",
            f"~crawl along the {_FLOOR}",
            "~crawl like a [baby|toddler|dog]",
            "~go on all fours",
            f"~crawl across the {_FLOOR}",
            "~get around on all fours",
        ),
        (
            "crawling",
            "a crawl [|forward|on all fours]",
            f"crawling on the {_FLOOR}",
            "a baby crawl",
            "crawling on [all fours|hands and knees]",
        ),
        people=("a baby", "a toddler"),
    ),
    "sneak": Wording(
        (
            "~sneak",
            "~sneak [forward|along|ahead]",
            "~sneak [around|along] in a crouch",
            "~walk in a crouch",
            "~walk crouched [|over|down]",
            "~creep [forward|along] [|in a crouch]",
            "~walk [stooped|hunched over|bent over|bent down]",
            "~sneak [like a thief|like a ninja|hunched over]",
            "~walk with bent knees",
            "~walk low to the ground",
            "~crouch and ~walk [|forward]",
            "~prowl [|around|along]",
        ),
        (
            "sneaking",
            "a crouched walk",
            "a sneaky walk",
            "a walk in a [low |]crouch",
            "sneaking [along|forward|around]",
            "a stooped walk",
        ),
        people=("a thief", "a ninja", "a burglar"),
    ),
    "stand": Wording(
        (
            "~stand still",
            "~stand",
            "~stand [there|in place|around|on the spot|upright]",
            "~stay still",
            "~stand still [and ~wait|for a while|in one place]",
            "~wait",
            "~wait [without moving|patiently|for something]",
            "~remain [still|motionless|standing]",
            "~stand [motionless|without moving]",
            "~stay [in place|put|where <he> <is>]",
            "~hold still",
            "~do nothing",
            "~stand and ~wait",
            "~idle",
        ),
        (
            "standing still",
            "an idle [stance|pose]",
            "no movement",
            "standing [there|upright|in place]",
            "a person at rest",
            "idle",
        ),
        after=("~stand still", "~stay there", "~stop", "~stand there"),
        people=("a guard", "a statue", "a guest"),
        orders=("don't move", "freeze", "no moving", "just stand there", "stay right there"),
    ),
}


def _crouched(action: SingleAction) -> Wording:
    """A crouch, held or not."""
    clauses = ["~crouch", "~crouch down", "~crouch [low|down low]", "~go into a crouch"]
    clauses += ["~get down low", "~crouch close to the [floor|ground]", "~hunker down"]
    clauses += [
        "~duck down",
        "~get into a [crouch|crouching position]",
        "~lower <himself> into a crouch",
    ]
    if action.act[1] - action.act[0] >= 40:
        clauses += ["~stay [crouched|in a crouch|low]", "~squat down and ~stay there"]
        clauses += ["~hold a [squat|crouch]", "~crouch down and ~stay down"]
    nouns = ("crouching", "a [low|deep|] crouch", "crouching down", "a crouched pose")
    return Wording(tuple(clauses), nouns, people=("a hunter", "a catcher"))


_WORDINGS: dict[str, Callable[[SingleAction], Wording]] = {
    **dict.fromkeys(("walk", "jog", "run"), prompt_gaits.gait),
    "steps": prompt_gaits.steps,
    "turn": prompt_turns.turn,
    **dict.fromkeys(("walk_then_turn", "turn_then_walk"), prompt_turns.walk_and_turn),
    "turn_and_return": prompt_turns.turn_and_return,
    "circle": prompt_turns.circle,
    "half_circle": prompt_turns.half_circle,
    "weave": prompt_turns.weave,
    **dict.fromkeys(prompt_changes.CHANGES, prompt_changes.changed),
    "jump": prompt_legs.jumped,
    "hop": prompt_legs.hopped,
    "kick": prompt_legs.kicked,
    "punch": prompt_arms.punched,
    "wave": prompt_arms.waved,
    "raise": prompt_arms.raised,
    "clap": prompt_arms.clapped,
    "knee": prompt_legs.kneed,
    **dict.fromkeys(("jack", "squat", "bow"), prompt_legs.counted),
    "arm_circle": prompt_arms.circled_arms,
    "pick_up": prompt_arms.picked_up,
    "balance": prompt_legs.balanced,
    "touch_head": prompt_arms.touched_head,
    "climb": prompt_legs.climbed,
    "crouch": _crouched,
}

KINDS = (*_WORDINGS, *_PLAIN)
"""All kinds of actions that have words."""


def wording(action: SingleAction) -> Wording:
    """Returns the patterns for an action.

    Raises:
        KeyError: Its kind is none of `KINDS`.
    """
    return _PLAIN[action.kind] if action.kind in _PLAIN else _WORDINGS[action.kind](action)
