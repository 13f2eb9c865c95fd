"""English verbs of movement: their third person and participle, and which word is a form of one."""

from __future__ import annotations

import re

_VERB_WORDS = """
    act adjust advance answer applaud approach attempt balance bat begin bend block bounce bow box
    brace break bring brush bump carry cartwheel cast catch celebrate chop circle clap clean climb
    clutch collapse come conduct continue cook cough cower crawl creep crouch cry curl cut dance
    dash descend dig dip direct do dodge drag draw dribble drift drink drive drop drum duck eat
    elevate emulate end enter examine exercise extend fake fall fight finish fix flail flap flex
    flip fling fold follow gallop gather gesture get give glance go golf grab grasp greet grip
    hang hesitate hit hold hop hug hunch hurry imitate indicate inspect jab jerk jog jump juggle
    kick kneel knock land laugh lay lead lean leap let lie lift limp look loosen lower lunge make
    march meander mime mimic mix motion move nod open paddle paint pace pass pat pause peck pedal
    perform pet pick pirouette pitch pivot place plant play point pose pour practice pray prepare
    press pretend proceed prowl pull pump punch push put raise reach read recover regain relax
    release remain remove repeat rest resume return ride rise roam roll rotate row rub run salute
    saunter scoop scratch scrub search shadowbox shake shift shimmy shiver shoot shout shove show
    shrug shuffle shush sidestep signal sing sip sit skate ski skip slam slap slide slouch slow
    slump smack smoke sneak speed spin spread sprint sprinkle squat stagger stand start stay step
    stir stomp stoop stop straighten strafe stretch stride strike stroke stroll strum strut
    stumble swat sway sweep swerve swim swing swipe switch swivel take talk tap taunt teeter throw
    thrust tie tilt tiptoe toss touch transition travel tread trip trot trudge try tuck turn twirl
    twist twitch type uncross unscrew use veer waddle wait wake walk waltz wander warm wash wave
    weave whistle wiggle wind wipe wobble work wrap write yawn zigzag alternate appear arch assume
    change check clasp clench close complete cover cross demonstrate flick form grow keep kiss
    leave lose maintain mop mount poke position rearrange reverse rock seem slip smash sprawl
    squeeze stack steady stare stick swoop teach tense tumble undo unfold watch wring
"""

VERBS = tuple(_VERB_WORDS.split())
"""Base forms. Words that are parts of the body as well (hand, knee, elbow, face) are left out."""

_THIRD = {"do": "does", "go": "goes", "have": "has", "undo": "undoes"}

_PARTICIPLE = {"begin": "beginning", "mimic": "mimicking", "tiptoe": "tiptoeing"}

_DOUBLED = re.compile(r"[^aeiou]*(?:qu)?[aeiou][bdgklmnprt]|(?:un|zig|side)?(?:zag|step)")


def third_person(verb: str) -> str:
    """Returns "walks" for "walk"."""
    if verb in _THIRD:
        return _THIRD[verb]
    if re.search(r"(s|x|z|ch|sh|[^o]o)$", verb):
        return f"{verb}es"
    return re.sub(r"(?<=[^aeiou])y$", "ie", verb) + "s"


def present_participle(verb: str) -> str:
    """Returns "walking" for "walk", "running" for "run", "dancing" for "dance"."""
    if verb in _PARTICIPLE:
        return _PARTICIPLE[verb]
    if _DOUBLED.fullmatch(verb):
        return f"{verb}{verb[-1]}ing"
    if verb.endswith("ie"):
        return f"{verb[:-2]}ying"
    return re.sub(r"(?<=[^eoy])e$", "", verb) + "ing"


BASE_OF_THIRD = {third_person(verb): verb for verb in VERBS}
"""Base form by third person."""

BASE_OF_PARTICIPLE = {present_participle(verb): verb for verb in VERBS}
"""Base form by participle."""
