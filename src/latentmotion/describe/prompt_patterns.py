"""Patterns of prompts as users type them, words for counts, and the prompts of postures.

`prompting` expands a pattern: `[a|b|]` is one of the alternatives, `~turn` is a verb in the form
of the sentence, `<his>`, `<him>`, `<he>` and `<is>` agree with the subject, `<the>` is "the" or
"his". The plainest patterns come first and are drawn most often.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from latentmotion.describe.facts import LEFT

_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

GOING = {"walk": "walking", "jog": "jogging", "run": "running"}
"""Participles of gaits."""

ONCE = "[|||once|once|once|one time|just once]"
"""A single repetition, left out half of the time."""

ONE = "[a|a|a|one|a single|just one]"
"""The article or number of a single thing."""

IN_A_ROW = "[|||| in a row]"
"""Words that may follow a counted noun."""

PEOPLE_ON_FOOT = ("a pedestrian", "a passerby", "our hero")

RUNNERS = ("a runner", "the runner", "an athlete", "a jogger")

FIGHTERS = ("a fighter", "a boxer", "the boxer", "a martial artist")

KICKERS = ("a fighter", "a kickboxer", "a martial artist", "a soccer player")

ATHLETES = ("an athlete", "a gymnast", "a man at the gym")


@dataclass(frozen=True)
class Wording:
    """Patterns for one action."""

    clauses: Sequence[str]
    """Verb phrases without a subject."""
    nouns: Sequence[str] = ()
    """Noun phrases."""
    after: Sequence[str] = ()
    """Verb phrases that fit only after another action, such as "walk away"."""
    people: Sequence[str] = ()
    """Subjects that fit this action best."""
    places: Sequence[str] = ()
    """Harmless contexts to put at the end."""
    orders: Sequence[str] = ()
    """Whole prompts without a verb to inflect."""


def patterns(text: str) -> list[str]:
    """Returns the patterns of a block of text, which are separated by semicolons."""
    return [" ".join(pattern.split()) for pattern in text.split(";")]


def people_on_foot(gait: str) -> Sequence[str]:
    """Returns subjects that fit a gait."""
    return RUNNERS if gait in ("jog", "run") else PEOPLE_ON_FOOT


def number(count: int) -> str:
    """Returns a number in letters or digits."""
    return f"[{_NUMBERS[count]}|{_NUMBERS[count]}|{count}]" if count < len(_NUMBERS) else str(count)


def times(count: int) -> str:
    """Returns how often: "twice", "three times"; "once" is left out half of the time."""
    if count == 1:
        return ONCE
    if count == 2:
        return "[twice|twice|twice|two times|2 times|twice in a row|a couple of times]"
    vague = "|several times" if count >= 4 else "|a few times"
    vague += "|again and again|repeatedly|over and over" if count >= 5 else ""
    return f"[{number(count)} times|{number(count)} times|{number(count)} times in a row{vague}]"


def some(count: int, one: str, many: str) -> str:
    """Returns a counted noun: "a kick", "one kick", "two kicks", "several kicks"."""
    if count == 1:
        return f"{ONE} {one}"
    vague = "|a couple of" if count == 2 else "|several" if count >= 4 else "|a few"
    return f"[{number(count)}|{number(count)}|{number(count)}{vague}] {many}{IN_A_ROW}"


def towards(side: str) -> str:
    """Returns the direction of a turn or a step to a side."""
    return f"[{side}|to the {side}|{side}|to the {side}|to <his> {side}]"


def clockwise(side: str) -> str:
    """Returns the sense of rotation, seen from above, of a turn to a side."""
    if side == LEFT:
        return "[counterclockwise|counterclockwise|counter-clockwise|anticlockwise]"
    return "clockwise"


_FLOOR = "[floor|ground]"
_SEAT = "[a chair|a chair|a seat|a bench|the chair|a stool]"

POSTURES: dict[str, Wording] = {
    "march": Wording(
        patterns("""
            ~march in place; ~march on the spot; ~march [|like a soldier|in place]; ~walk in place;
            ~walk on the spot; ~step in place; ~march with raised knees;
            ~lift the knees while marching; ~walk in place, lifting <his> knees;
            ~march [in place|on the spot] like a soldier
        """),
        patterns("""
            marching; a march [in place|on the spot]; [walking|stepping] [in place|on the spot];
            a soldier's march on the spot
        """),
        people=("a soldier", "the soldier", "a guard"),
    ),
    "jog_in_place": Wording(
        patterns("""
            ~jog in place; ~jog on the spot; ~run in place; ~run on the spot;
            ~jog [without moving forward|where <he> <is>]; ~warm up by jogging in place;
            ~jog lightly [in place|on the spot]; ~keep [jogging|running] [in place|on the spot];
            ~do a jog [in place|on the spot]
        """),
        patterns("""
            a jog [in place|on the spot]; running [in place|on the spot];
            a run [in place|on the spot]; jogging [in place|on the spot]
        """),
        people=RUNNERS,
    ),
    "arms_out": Wording(
        patterns("""
            ~hold <his> arms out to the sides; ~stretch <the> arms out to the sides;
            ~spread <his> arms; ~stand in a [t-pose|t pose];
            ~hold both arms out [sideways|to the sides]; ~raise both arms to the sides;
            ~extend both arms [sideways|to the sides|to either side];
            ~stand with <his> arms [spread|stretched out|out to the sides];
            ~spread <his> arms [wide|like wings|like an airplane]; ~make a [t-pose|t pose];
            ~stand like a scarecrow; ~put <the> arms out to both sides
        """),
        patterns("""
            arms out [|to the sides|wide]; a [t-pose|t pose];
            both arms [stretched out|out] to the sides; outstretched arms;
            arms spread [wide|to the sides]
        """),
        orders=("arms out",),
    ),
    "hands_on_hips": Wording(
        patterns("""
            ~put <the> hands on <his> hips; ~stand with <his> hands on <his> hips;
            ~place both hands on <his> hips; ~rest <his> hands on <his> hips;
            ~hold <his> hands on <his> hips; ~stand with hands on hips; ~stand [|there ]akimbo;
            ~put both hands on <his> hips; ~have <his> hands on <his> hips;
            ~stand with both hands at the hips; ~keep <his> hands on <his> hips
        """),
        patterns("""
            hands on [hips|the hips]; both hands on [the hips|hips]; arms akimbo;
            standing with hands on [hips|the hips]; a pose with hands on [hips|the hips]
        """),
    ),
    "sit_down": Wording(
        patterns(f"""
            ~sit down; ~sit down on {_SEAT}; ~take a seat; ~sit on {_SEAT};
            ~sit down [on something|somewhere]; ~have a seat on {_SEAT};
            ~lower <himself> onto {_SEAT}; ~go from standing to sitting; ~settle down on {_SEAT};
            ~stand, then ~sit down; ~have a seat
        """),
        patterns(f"sitting down; sitting down on {_SEAT}; taking a seat; from standing to sitting"),
        people=("a tired man", "a guest", "grandpa"),
    ),
    "sit": Wording(
        patterns(f"""
            ~sit; ~sit on {_SEAT}; ~sit [there|still|quietly]; ~stay seated; ~remain seated;
            ~keep sitting on {_SEAT}; ~sit [and ~wait|and ~rest|for a while];
            ~stay seated on {_SEAT}; ~remain sitting; ~rest on {_SEAT}
        """),
        patterns(f"""
            sitting on {_SEAT}; a seated pose; sitting; a sitting [pose|position]; a rest on {_SEAT}
        """),
        people=("a tired man", "a guest", "grandpa"),
    ),
    "stand_up": Wording(
        patterns(f"""
            ~stand up; ~stand up from {_SEAT}; ~get up; ~get up from {_SEAT};
            ~rise [|to <his> feet|from the chair|from a seat]; ~get [to|on] <his> feet;
            ~go from sitting to standing; ~leave the [chair|seat]; ~sit, then ~stand up;
            ~rise from {_SEAT}
        """),
        patterns(f"""
            standing up; getting up from {_SEAT}; from sitting to standing;
            standing up from {_SEAT}; a rise from a chair
        """),
        people=("a guest", "grandpa"),
    ),
    "sit_floor": Wording(
        patterns(f"""
            ~sit on the {_FLOOR}; ~sit down on the {_FLOOR};
            ~sit on the {_FLOOR} [|quietly|and ~rest]; ~take a seat on the {_FLOOR};
            ~be seated on the {_FLOOR}; ~get down and ~sit on the {_FLOOR};
            ~rest on the {_FLOOR} in a sitting position; ~sit in the grass;
            ~settle down on the {_FLOOR}; ~stay seated on the {_FLOOR}
        """),
        patterns(f"""
            sitting on the {_FLOOR}; a seat on the {_FLOOR}; a sitting pose on the {_FLOOR};
            sitting down on the {_FLOOR}
        """),
        people=("a kid", "a toddler"),
    ),
    "lie_down": Wording(
        patterns(f"""
            ~lie down; ~lie down on the {_FLOOR}; ~get down and ~lie on the {_FLOOR};
            ~lie down [to rest|to sleep|flat]; ~lay down on the {_FLOOR};
            ~lower <himself> to the {_FLOOR} and ~lie down; ~stretch out on the {_FLOOR};
            ~go from standing to lying; ~lie flat on the {_FLOOR};
            ~get down on the {_FLOOR} and ~lie down; ~lay down
        """),
        patterns(f"""
            lying down; lying down on the {_FLOOR}; from standing to lying;
            getting down to lie on the {_FLOOR}
        """),
        people=("a tired man",),
    ),
    "lie": Wording(
        patterns(f"""
            ~lie on the {_FLOOR}; ~lie down; ~lie [still|flat|motionless] on the {_FLOOR};
            ~sleep on the {_FLOOR}; ~rest on the {_FLOOR}, lying down;
            ~lie [there|flat|still|asleep]; ~stay down on the {_FLOOR}; ~lie asleep on the {_FLOOR};
            ~be asleep; ~nap on the {_FLOOR}; ~remain lying on the {_FLOOR}
        """),
        patterns(f"""
            lying on the {_FLOOR}; lying flat; lying down; asleep on the {_FLOOR}; a lying pose;
            a nap on the {_FLOOR}
        """),
        people=("a tired man", "a patient"),
    ),
    "get_up": Wording(
        patterns(f"""
            ~get up from the {_FLOOR}; ~get up off the {_FLOOR}; ~get up;
            ~stand up from the {_FLOOR}; ~rise from the {_FLOOR};
            ~get back [up|to <his> feet|on <his> feet]; ~push <himself> up from the {_FLOOR};
            ~rise off the {_FLOOR}; ~scramble to <his> feet; ~climb to <his> feet from the {_FLOOR};
            ~stand up off the {_FLOOR}
        """),
        patterns(f"""
            getting up from the {_FLOOR}; getting up off the {_FLOOR}; a rise from the {_FLOOR};
            from the floor to standing
        """),
    ),
    "kneel": Wording(
        patterns(f"""
            ~kneel; ~kneel down; ~kneel on the {_FLOOR}; ~get down on <his> knees;
            ~kneel down on the {_FLOOR}; ~go down on <his> knees; ~drop to <his> knees;
            ~kneel [to pray|in prayer]; ~sink to <his> knees; ~lower <himself> into a kneel;
            ~get into a kneeling position
        """),
        patterns(f"""
            kneeling; kneeling on the {_FLOOR}; a kneel; kneeling down; a kneeling [pose|position]
        """),
        people=("a knight", "a monk"),
    ),
    "crawl": Wording(
        patterns(f"""
            ~crawl; ~crawl [forward|along|ahead]; ~crawl on the {_FLOOR};
            ~crawl on [all fours|hands and knees|<his> hands and knees];
            ~move on [all fours|hands and knees]; ~crawl along the {_FLOOR};
            ~crawl like a [baby|toddler|dog]; ~go on all fours; ~crawl across the {_FLOOR};
            ~get around on all fours
        """),
        patterns(f"""
            crawling; a crawl [|forward|on all fours]; crawling on the {_FLOOR}; a baby crawl;
            crawling on [all fours|hands and knees]
        """),
        people=("a baby", "a toddler"),
    ),
    "sneak": Wording(
        patterns("""
            ~sneak; ~sneak [forward|along|ahead]; ~sneak [around|along] in a crouch;
            ~walk in a crouch; ~walk crouched [|over|down]; ~creep [forward|along] [|in a crouch];
            ~walk [stooped|hunched over|bent over|bent down];
            ~sneak [like a thief|like a ninja|hunched over]; ~walk with bent knees;
            ~walk low to the ground; ~crouch and ~walk [|forward]; ~prowl [|around|along]
        """),
        patterns("""
            sneaking; a crouched walk; a sneaky walk; a walk in a [low |]crouch;
            sneaking [along|forward|around]; a stooped walk
        """),
        people=("a thief", "a ninja", "a burglar"),
    ),
    "stand": Wording(
        patterns("""
            ~stand still; ~stand; ~stand [there|in place|around|on the spot|upright]; ~stay still;
            ~stand still [and ~wait|for a while|in one place]; ~wait;
            ~wait [without moving|patiently|for something]; ~remain [still|motionless|standing];
            ~stand [motionless|without moving]; ~stay [in place|put|where <he> <is>]; ~hold still;
            ~do nothing; ~stand and ~wait; ~idle
        """),
        patterns("""
            standing still; an idle [stance|pose]; no movement; standing [there|upright|in place];
            a person at rest; idle
        """),
        after=("~stand still", "~stay there", "~stop", "~stand there"),
        people=("a guard", "a statue", "a guest"),
        orders=("don't move", "freeze", "no moving", "just stand there", "stay where you are"),
    ),
}
"""Prompts of postures and of movements on the spot that have no side, count or direction."""
