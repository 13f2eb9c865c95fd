"""Prompts that ask for acts of arms and legs: punches, waves, jumps, kicks, exercises, balance."""

from __future__ import annotations

from latentmotion.measure.facts import BOTH, SingleAction
from latentmotion.training.captioning.prompt_patterns import (
    ATHLETES,
    FIGHTERS,
    IN_A_ROW,
    KICKERS,
    ONCE,
    Wording,
    number,
    patterns,
    some,
    times,
    towards,
)


def punched(action: SingleAction) -> Wording:
    """Patterns for punches with one hand, or both in turn."""
    often, side, count = times(action.count), action.side, action.count
    punches = some(count, "punch", "punches")
    clauses = patterns(f"~punch {often}; ~throw {punches}; ~do {punches}; ~punch the air {often}")
    nouns = [punches]
    if side in ("left", "right"):
        hand = f"<the> {side} [hand|fist|hand|fist|arm]"
        hits = some(count, "[punch|punch|jab|hit|strike]", "[punches|punches|jabs|hits|strikes]")
        sided = some(
            count, f"{side} [punch|punch|jab|hook|hand punch]", f"{side} [punches|jabs|hooks]"
        )
        clauses = patterns(f"""
            ~punch with {hand} {often}; ~punch {often} [with|with|using] {hand};
            ~throw {hits} with {hand}; ~throw {sided}; ~punch [the air|ahead] with {hand} {often};
            ~hit [|something|out] with {hand} {often}; ~jab with {hand} {often};
            ~strike with {hand} {often}; ~do {hits} with {hand}; ~throw {hits} with the {side};
            ~punch with the {side} {often}; ~land {sided}
        """)
        nouns = [f"{hits} with {hand}", sided, f"{hits} with the {side}", f"{punches} with {hand}"]
    elif side == BOTH:
        clauses += patterns(f"""
            ~punch {often} with both [hands|fists]; ~punch with both [hands|fists];
            ~punch with both [hands|fists] [in turn|alternately]; ~throw punches;
            ~punch left and right; ~box in the air; ~shadowbox; ~box with both fists;
            ~throw punches with both [hands|fists]
        """)
        nouns += [f"{punches} with both [hands|fists]", "shadow boxing", "alternating punches"]
        nouns += ["a left and a right punch" if count == 2 else "lefts and rights in turn"]
    return Wording(clauses, nouns, people=FIGHTERS)


def waved(action: SingleAction) -> Wording:
    """Patterns for waves with one hand or both."""
    side = action.side
    hello = "[hello|hi|goodbye|at someone|to someone|bye]"
    if side in ("left", "right"):
        hand = f"<the> {side} [hand|hand|arm]"
        clauses = patterns(f"""
            ~wave with {hand}; ~wave {hand}; ~wave {hello} with {hand}; ~wave [with|using] {hand};
            ~wave {hand} [in the air|from side to side|in greeting|to say hello|to say goodbye];
            ~greet [someone|somebody|people] with {hand}; ~give a wave with {hand};
            ~swing {hand} from side to side in a wave; ~wave {hello} using {hand};
            ~say [hello|goodbye] by waving {hand}; ~wave {hello}
        """)
        nouns = [f"a wave with {hand}", f"a {side} hand wave", f"a [friendly|] wave with {hand}"]
        nouns += [f"a wave [hello|goodbye] with {hand}", f"a {side}-handed wave"]
        return Wording(clauses, nouns, people=("a friend", "a neighbor", "a tourist"))
    both = "both [hands|arms]" if side == BOTH else "a hand"
    clauses = [f"~wave with {both}", f"~wave {both}", f"~wave {hello} with {both}"]
    clauses += [f"~wave {both} in the air", f"~wave {hello}", f"~swing {both} to and fro"]
    clauses += [f"~wave {both} to get attention", f"~greet [someone|people] with {both}"]
    clauses += [f"~wave using {both}", f"~wave {both} from side to side"]
    nouns = patterns(f"""
        a wave with {both}; a [big|friendly] wave with {both}; a wave hello with {both}
    """)
    if side == BOTH:
        nouns += ["a two-handed wave"]
    return Wording(clauses, nouns)


def raised(action: SingleAction) -> Wording:
    """Patterns for raised hands and arms."""
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
    clauses = patterns(f"""
        ~raise {limb} {up} {often}; ~lift {limb} {up} {often}; ~raise {limb} {often};
        ~lift {it} {often}
    """)
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
    return Wording(clauses, nouns, people=("a student",), orders=orders)


def clapped(action: SingleAction) -> Wording:
    """Patterns for claps."""
    count, often = action.count, times(action.count)
    claps = some(count, "clap", "claps")
    clauses = [f"~clap {often}", f"~clap <his> hands {often}", f"~clap {often}"]
    clauses += [f"~clap <the> hands together {often}", f"~do {claps}", f"~give {claps}"]
    if count >= 2:
        clauses += ["~clap <his> hands", "~clap"]
    if count >= 3:
        clauses += ["~applaud", "~give a round of applause", "~clap [along|in applause]"]
    nouns = [claps, some(count, "clap of the hands", "claps of the hands")]
    nouns += [some(count, "hand clap", "hand claps"), f"hands clapping {often}"]
    return Wording(clauses, nouns, people=("a fan", "an audience member"))


def circled_arms(action: SingleAction) -> Wording:
    """Patterns for circles of the arms."""
    side, count = action.side, action.count
    both = side == BOTH
    arm = "[both|both|<his>] arms" if both else f"<the> {side} arm"
    way = {
        "forward": "[|forward|forwards]",
        "backward": "[|backward|backwards]",
    }.get(action.direction, "")
    often = times(count) if count > 1 else "[|||once]"
    round_ = "circles" if count > 1 else "a circle"
    plain = f"~do arm circles {way} with {arm}" if count > 1 else f"~make a circle with {arm}"
    clauses = patterns(f"""
        ~circle {arm} {way} {often}; ~swing {arm} {way} in {round_} {often};
        ~rotate {arm} {way} {often}; {plain}; ~make {some(count, "circle", "circles")} with {arm};
        ~move {arm} in {round_} {often}; ~windmill {arm} {way} {often}
    """)
    circles = some(count, "arm circle", "arm circles")
    nouns = [f"{circles} {way} with {arm}", f"circling {arm} {way} {often}"]
    if not both:
        nouns += [some(count, f"{side} arm circle", f"{side} arm circles")]
    return Wording(clauses, nouns, people=ATHLETES)


def picked_up(action: SingleAction) -> Wording:
    """Patterns for a reach to the floor."""
    side = action.side
    hand = "" if not side else f"[||with <the> {side} hand]"
    if side == BOTH:
        hand = "[||with both hands]"
    floor = "[floor|ground]"
    thing = "[something|something|an object|a coin|a box|a ball]"
    clauses = patterns(f"""
        ~pick {thing} up {hand};
        ~pick [something|something|an object|it] up [off|from] the {floor} {hand};
        ~pick up {thing} [|from the {floor}|off the {floor}] {hand};
        ~reach down to the {floor} {hand}; ~bend down and ~pick [something|it] up {hand};
        ~grab [something|an object] [off|from] the {floor} {hand};
        ~bend down to pick up {thing} {hand};
        ~reach for [something|an object] on the {floor} {hand};
        ~lift something off the {floor} {hand}; ~bend down and ~touch the {floor} {hand};
        ~take something from the {floor} {hand}
    """)
    nouns = patterns(f"""
        picking {thing} up {hand}; a reach down to the {floor} {hand};
        reaching down to the {floor} {hand}; grabbing something off the {floor} {hand}
    """)
    return Wording(clauses, nouns, people=("a worker", "a cleaner"))


def touched_head(action: SingleAction) -> Wording:
    """Patterns for a hand at the head."""
    hand = "[a|one|<his>] hand"
    if action.side in ("left", "right"):
        hand = f"<the> {action.side} hand"
    elif action.side == BOTH:
        hand = "both hands"
    clauses = patterns(f"""
        ~touch <the> head with {hand}; ~put {hand} [on|to] <his> head;
        ~scratch <his> head with {hand}; ~hold {hand} to <his> head; ~raise {hand} to <his> head;
        ~place {hand} on <his> head; ~bring {hand} to <his> head; ~reach for <his> head with {hand};
        ~hold <his> head with {hand}; ~touch <his> hair with {hand}
    """)
    nouns = (f"{hand} on the head", f"{hand} to the head", f"a touch of the head with {hand}")
    return Wording(clauses, nouns)


def jumped(action: SingleAction) -> Wording:
    """Patterns for jumps with both feet."""
    count, often = action.count, times(action.count)
    leaps = some(count, "[jump|jump|leap]", "[jumps|jumps|leaps]")
    if action.direction in ("", "up", "place"):
        up = "[||up|up|up in the air|into the air|in place]"
        clauses = patterns(f"""
            ~jump {up} {often}; ~jump {often}; ~do {leaps}; ~make {leaps}; ~jump up {often};
            ~leap [up|into the air] {often}; ~jump on the spot {often}; ~take {leaps};
            ~spring [up|into the air] {often}; ~hop up {often}; ~jump {often} with both feet;
            ~jump straight up {often}
        """)
        nouns = [leaps, leaps, f"{leaps} [in place|on the spot|into the air]"]
        nouns += [some(count, "jump up", "jumps up")]
        nouns += [some(count, "[vertical|standing] jump", "[vertical|standing] jumps")]
        if count > 1:
            clauses += ["~jump up and down", f"~jump up and down {often}"]
        return Wording(clauses, nouns, people=ATHLETES)
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
    return Wording(clauses, (f"{leaps} {way}", f"{leaps} {way}"), people=ATHLETES)


def hopped(action: SingleAction) -> Wording:
    """Patterns for hops on one foot."""
    often, side = times(action.count), action.side
    hops = some(action.count, "hop", "hops")
    jumps = some(action.count, "jump", "jumps")
    foot = "[one leg|one foot]"
    if side in ("left", "right"):
        foot = f"[<the> {side} [foot|leg]|<the> {side} [foot|leg]|one [leg|foot]|<his> {side} leg]"
    clauses = patterns(f"""
        ~hop on {foot} {often}; ~hop {often} on {foot}; ~jump on {foot} {often};
        ~hop on {foot} {often}; ~make {hops} on {foot}; ~do {hops} on {foot};
        ~take {hops} on {foot}; ~jump {often} on {foot}
    """)
    if action.count > 1:
        clauses += [f"~hop [around|along] on {foot}", f"~keep hopping on {foot}"]
        clauses += [f"~bounce on {foot} {often}"]
    if action.direction in ("forward", "backward"):
        clauses += [f"~hop {action.direction} on {foot} {often}"]
    nouns = [f"{hops} on {foot}", f"{jumps} on {foot}", f"hopping on {foot} {often}"]
    return Wording(clauses, nouns, people=("a girl", "the kid", "a child"))


def kicked(action: SingleAction) -> Wording:
    """Patterns for kicks with one leg, or both in turn."""
    often, side, count = times(action.count), action.side, action.count
    kicks, leg = some(count, "kick", "kicks"), ""
    clauses, nouns = [f"~do {kicks}", f"~throw {kicks}"], [kicks]
    if side in ("left", "right"):
        leg = f"<the> {side} [leg|foot|leg|foot|leg]"
        with_leg = f"[with|with|with|using] {leg}"
        sided = some(count, f"{side} kick", f"{side} kicks")
        last = f"~swing <the> {side} leg in {kicks}" if count == 1 else f"~kick {often} {with_leg}"
        clauses = patterns(f"""
            ~kick {with_leg} {often}; ~kick {often} {with_leg};
            ~kick <the> {side} [leg|foot] {often}; ~do {kicks} with {leg};
            ~throw {kicks} with {leg}; ~do {sided}; ~kick out with {leg} {often};
            ~give {kicks} with {leg};
            ~kick [something|the air|a ball] {often} {with_leg}; ~deliver {kicks} with {leg};
            ~throw {sided}; {last}
        """)
        leg_kicks = some(count, f"{side} leg kick", f"{side} leg kicks")
        nouns = [f"{kicks} with {leg}", sided, leg_kicks, f"{kicks} with {leg}"]
        leg = f" with <the> {side} [leg|foot]"
    elif side == BOTH:
        clauses += ["~kick with [both legs|the left and the right leg] [in turn|alternately]"]
        clauses += [f"~kick {often} with both legs in turn", "~do kicks with both legs"]
        nouns += [f"{kicks} with both legs in turn", "alternating kicks"]
    if action.direction == "forward":
        clauses += [
            f"~kick forward{leg} {often}",
            f"~do {some(count, 'front kick', 'front kicks')}{leg}",
        ]
    elif action.direction in ("side", "left", "right"):
        clauses += [
            f"~kick to the side{leg} {often}",
            f"~do {some(count, 'side kick', 'side kicks')}{leg}",
        ]
    elif action.direction == "backward":
        clauses += [f"~kick backward{leg} {often}", f"~kick backwards{leg} {often}"]
    return Wording(clauses, nouns, people=KICKERS)


def kneed(action: SingleAction) -> Wording:
    """Patterns for raised knees."""
    often, side, count = times(action.count), action.side, action.count
    if side in ("left", "right"):
        knee = f"<the> {side} knee"
        raises = some(count, f"{side} knee raise", f"{side} knee raises")
        clauses = patterns(f"""
            ~raise {knee} {often}; ~lift {knee} {often}; ~lift {knee} up {often};
            ~bring {knee} up {often}; ~pull {knee} up {often}; ~raise {knee} up {often};
            ~lift {knee} in front of <him> {often};
            ~do {raises};
            ~raise the {side} leg with a bent knee {often}
        """)
        nouns = [raises, f"{side} knee up {often}"]
        nouns += [some(count, f"{side} knee lift", f"{side} knee lifts"), f"lifting {knee} {often}"]
        return Wording(clauses, nouns, people=ATHLETES)
    clauses = patterns("""
        ~raise <his> knees [in turn|one after the other|alternately];
        ~lift <his> knees [in turn|one after the other|one by one]; ~do knee raises;
        ~bring <his> knees up [in turn|alternately]; ~raise the left and right knee in turn;
        ~lift one knee, then the other; ~pull up <his> knees in turn; ~lift both knees in turn
    """)
    clauses += [
        f"~do {some(count, 'knee raise', 'knee raises')}"
        if count > 1
        else "~raise both knees in turn"
    ]
    nouns = ["[alternating|] knee raises", "knee lifts [on both sides|in turn]", "knees up in turn"]
    return Wording(clauses, nouns, people=ATHLETES)


def counted(action: SingleAction) -> Wording:
    """Patterns for jumping jacks, squats and bows."""
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
        return Wording(clauses, (jacks, jacks), people=ATHLETES)
    if action.kind == "squat":
        squats = some(count, "[squat|squat|knee bend|deep squat]", "[squats|squats|knee bends]")
        clauses = [f"~do {squats}", f"~squat {often}", f"~squat down and ~stand up {often}"]
        clauses += [f"~perform {squats}", f"~squat and ~come back up {often}"]
        clauses += [f"~squat down {often}"]
        clauses += [f"~bend <the> knees deeply {often}", f"~go down into a squat {often}"]
        clauses += [f"~go down and up in {squats}"]
        clauses += ["~do squats", "~exercise with squats"] if count > 1 else []
        return Wording(clauses, (squats, squats), people=ATHLETES)
    bows = some(count, "[bow|bow|polite bow]", "bows")
    clauses = [f"~bow {often}", f"~take {bows}", f"~bend forward {often}", f"~make {bows}"]
    clauses += [f"~bow down {often}", f"~bow politely {often}", f"~lean forward {often}"]
    clauses += [f"~bow to [the audience|someone|the crowd] {often}", f"~bend over {often}"]
    clauses += [f"~bend at the [waist|hips] {often}", f"~bow forward {often}", f"~give {bows}"]
    return Wording(clauses, (bows, f"{bows} forward"), people=("an actor", "a butler"))


def balanced(action: SingleAction) -> Wording:
    """Patterns for a stand on one leg."""
    one = "one [leg|foot]"
    if action.side in ("left", "right"):
        one = f"[<the> {action.side} [leg|foot]|<the> {action.side} [leg|foot]|one [leg|foot]]"
    clauses = patterns(f"""
        ~stand on {one}; ~balance on {one}; ~balance on {one}; ~keep <his> balance on {one};
        ~stay on {one}; ~stand still on {one}; ~hold <his> balance on {one};
        ~stand like a flamingo on {one}; ~balance [for a moment|in place] on {one};
        ~stand [there|steadily] on {one}
    """)
    nouns = (f"a stand on {one}", f"balance on {one}", f"a balancing act on {one}")
    return Wording(clauses, nouns, people=("a yogi", "a gymnast", "a dancer"))


def climbed(action: SingleAction) -> Wording:
    """Patterns for steps up or down."""
    way = action.direction if action.direction in ("up", "down") else "up"
    stairs = "[the stairs|stairs|some stairs|the steps|a staircase|a few steps]"
    clauses = [f"~walk {way} {stairs}", f"~go {way} {stairs}", f"~climb {way} {stairs}"]
    clauses += [f"~go {way}stairs", f"~walk {way}stairs", f"~take the stairs {way}"]
    if way == "up":
        clauses += patterns("""
            ~climb [stairs|the stairs|some steps|a staircase]; ~climb up; ~step up onto something;
            ~ascend the stairs; ~climb up [on|onto] something
        """)
        nouns = patterns("""
            a climb up [the stairs|some steps]; stairs up; climbing stairs; a way upstairs
        """)
    else:
        clauses += ["~climb down", "~descend the [stairs|steps]", "~step down from something"]
        nouns = ["a climb down [the stairs|some steps]", "stairs down", "a descent down the stairs"]
    return Wording(clauses, nouns[:3])


def crouched(action: SingleAction) -> Wording:
    """Patterns for a crouch, held or not."""
    clauses = patterns("""
        ~crouch; ~crouch down; ~crouch [low|down low]; ~go into a crouch; ~get down low;
        ~crouch close to the [floor|ground]; ~hunker down; ~duck down;
        ~get into a [crouch|crouching position]; ~lower <himself> into a crouch
    """)
    if action.act[1] - action.act[0] >= 40:
        clauses += ["~stay [crouched|in a crouch|low]", "~squat down and ~stay there"]
        clauses += ["~hold a [squat|crouch]", "~crouch down and ~stay down"]
    nouns = ("crouching", "a [low|deep|] crouch", "crouching down", "a crouched pose")
    return Wording(clauses, nouns, people=("a hunter", "a catcher"))
