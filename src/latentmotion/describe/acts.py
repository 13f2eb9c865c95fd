"""Description → what is worth telling, in order: repeated events counted, side effects left out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from latentmotion.describe.facts import BOTH, FPS, Description, Event

STILL = 0.12
"""Mean speed of hands, feet and head, m/s, below which a body stands still."""

LIVELY = 0.45
"""The same, above which a body that stays where it is does something with its arms."""

_LEAST_WAY = 0.5
"""Meters of the shortest move that is told."""

_WHOLE_BODY = (
    "jump",
    "hop",
    "kick",
    "squat",
    "pick_up",
    "sit_down",
    "stand_up",
    "lie_down",
    "climb",
    "get_up",
)
_ARMS = ("raise", "wave", "punch", "clap", "arm_circle")
_REPEATED = (*_ARMS, "jump", "hop", "kick", "knee", "squat", "bow", "pick_up")
_FLOOR = ("sit", "floor", "lie", "kneel")


@dataclass(frozen=True)
class Act:
    """One thing that a sentence tells."""

    event: Event
    """What happens."""
    gait: Event | None = None
    """The move that a turn is part of, or during which the hands act."""
    posture: str = ""
    """`crouch` or `bend`, if a move happens so."""
    on: bool = False
    """Whether a move only goes on after a turn."""

    @property
    def kind(self) -> str:
        """What happens."""
        return self.event.kind


def acts_of(description: Description) -> tuple[Act, ...]:
    """Returns what is worth telling about a motion, in order."""
    events = _grouped(_told_events(description))
    moves = _told_moves(description, events)
    turns = _told_turns(description, events)
    acts = [*_ways(description, moves, turns), *_placed(events, moves)]
    acts += _held(description, acts)
    acts.sort(key=lambda act: (act.event.start, act.event.end))
    acts = [act for act in acts if act.event.frames > 0]
    return (*acts, *_stop(description, acts))


def _told_events(description: Description) -> list[Event]:
    events = list(description.events)
    fast = any(move.kind in ("jog", "run") for move in description.moves)
    tests: tuple[Callable[[Event], bool], ...] = (
        lambda e: e.kind == "raise" and (e.frames < 6 or (e.amount < 0.12 and fast)),
        lambda e: e.kind == "raise" and _meets(e, events, ("wave", "arm_circle", "clap"), 0),
        lambda e: e.kind == "raise" and _meets(e, events, ("jump", "hop"), 8),
        lambda e: e.kind == "punch" and _meets(e, events, ("wave", "arm_circle", "raise"), 0),
        lambda e: e.kind in ("squat", "bow") and _meets(e, events, ("jump", "hop"), 5),
        lambda e: e.kind == "bow" and _meets(e, events, ("kick", "sit_down", "stand_up"), 4),
        lambda e: e.kind in ("knee", "balance") and _meets(e, events, ("kick", "hop"), 5),
        lambda e: e.kind == "balance" and _meets(e, events, ("knee",), 0) and e.seconds < 2,
        lambda e: e.kind == "squat" and _meets(e, events, ("kick", "climb"), 4),
        lambda e: e.kind in ("knee", "bow", "balance") and _meets(e, events, ("climb",), 10),
        lambda e: e.kind == "hop" and _meets(e, events, ("kick",), 4),
    )
    return [event for event in events if not any(test(event) for test in tests)]


def _meets(event: Event, events: Iterable[Event], kinds: tuple[str, ...], gap: int) -> bool:
    """Says whether an event of other kinds, of the same side if it has one, is at the same time."""
    for other in events:
        near = other.start - gap < event.end and event.start < other.end + gap
        sides = {event.side, other.side}
        same = len(sides) == 1 or BOTH in sides or "" in sides or other.kind not in _ARMS
        if other.kind in kinds and other is not event and near and same:
            return True
    return False


def _grouped(events: list[Event]) -> list[Event]:
    """Counts events that follow each other and are alike; legs in turn are legs of both sides."""
    out: list[Event] = []
    for event in sorted(events, key=lambda one: one.start):
        index = _same_series(out, event)
        if index is None:
            out.append(event)
            continue
        last = out[index]
        out[index] = replace(
            last,
            end=max(last.end, event.end),
            direction=last.direction if last.direction == event.direction else "",
            amount=max(last.amount, event.amount),
            count=last.count + event.count,
        )
    return _in_turn(out)


def _same_series(out: list[Event], event: Event) -> int | None:
    """Returns which of the events so far goes on with this one."""
    if event.kind not in _REPEATED:
        return None
    arms = event.kind in _ARMS
    for index in range(len(out) - 1, -1, -1):
        last = out[index]
        if (last.kind, last.side) == (event.kind, event.side):
            return index if event.start - last.end < 2.0 * FPS else None
        if not arms and last.kind not in _ARMS:
            return None
    return None


def _in_turn(events: list[Event]) -> list[Event]:
    """Joins three and more single kicks, knees or punches of changing sides."""
    out: list[Event] = []
    run: list[Event] = []
    for event in [*events, None]:
        last = run[-1] if run else None
        if (
            event
            and last
            and event.kind == last.kind
            and event.side != last.side
            and event.start - last.end < 2.0 * FPS
        ):
            run.append(event)
            continue
        if len(run) >= 3 and run[0].kind in ("kick", "knee", "punch"):
            count, end = sum(one.count for one in run), max(one.end for one in run)
            out.append(replace(run[0], end=end, side=BOTH, direction="", count=count))
        else:
            out += run
        run = [event] if event else []
    return out


def _told_moves(description: Description, events: list[Event]) -> list[Event]:
    """Leaves out small shifts, and the way that a jump or a kick takes."""
    moves = []
    whole = [event for event in events if event.kind in _WHOLE_BODY]
    for move in description.moves:
        if move.kind == "stand":
            continue
        move = _trimmed(move, whole)
        far = move.amount * move.seconds
        taken = sum(_shared(move, event, 8) for event in whole)
        if move.direction == "place" or (far > _LEAST_WAY and taken < 0.6 * move.frames):
            moves.append(move)
    return _joined(moves)


def _trimmed(move: Event, events: list[Event]) -> Event:
    """Lets a move begin after the body got up, and end before it goes down."""
    for event in events:
        early = event.end < move.start + 0.6 * move.frames
        if event.kind in ("stand_up", "get_up") and move.start < event.end and early:
            move = replace(move, start=event.end)
        if event.kind in ("sit_down", "lie_down") and move.start < event.start < move.end:
            move = replace(move, end=event.start)
    return move


def _joined(moves: list[Event]) -> list[Event]:
    """Joins moves that are alike with less than a second between."""
    out: list[Event] = []
    for move in moves:
        last = out[-1] if out else None
        if (
            last
            and (last.kind, last.direction) == (move.kind, move.direction)
            and move.start - last.end < FPS
        ):
            frames = last.frames + move.frames
            amount = (last.amount * last.frames + move.amount * move.frames) / frames
            out[-1] = replace(last, end=move.end, amount=amount)
        else:
            out.append(move)
    return out


def _told_turns(description: Description, events: list[Event]) -> list[Event]:
    """Leaves out turns on the spot that are small, belong to a kick, or happen on the floor."""
    low = [p for p in description.postures if p.kind in _FLOOR]
    whole = [event for event in events if event.kind in _WHOLE_BODY]
    turns = []
    for turn in description.turns:
        busy = sum(_shared(turn, event, 4) for event in (*low, *whole)) > 0.5 * turn.frames
        least = 50 if turn.direction == "place" or description.path.length < 1 else 30
        if turn.amount >= (150 if busy else least):
            turns.append(turn)
    return turns


def _shared(one: Event, other: Event, more: int = 0) -> int:
    return max(min(one.end, other.end + more) - max(one.start, other.start - more), 0)


def _ways(description: Description, moves: list[Event], turns: list[Event]) -> list[Act]:
    """Puts moves and turns together: curves and circles, or one after the other."""
    acts, used = [], set()
    for move in moves:
        inside = [t for t in turns if _shared(move, t) > 0.5 * t.frames and id(t) not in used]
        used |= {id(turn) for turn in inside}
        posture = _posture(description, move)
        curve = [t for t in inside if _shared(move, t) > 0.6 * move.frames]
        if len(curve) == len(inside) == 1:
            acts.append(Act(replace(curve[0], start=move.start, end=move.end), move, posture))
        else:
            acts += _cut_at_turns(move, inside, posture)
    return acts + [Act(turn) for turn in turns if id(turn) not in used]


def _cut_at_turns(move: Event, turns: list[Event], posture: str) -> list[Act]:
    """A move before, between and after the turns in it; short parts belong to the turn."""
    acts: list[Act] = []
    at = move.start
    for turn in turns:
        before = replace(move, start=at, end=max(min(turn.start, move.end), at))
        if _is_way(before, 0.8):
            acts.append(Act(before, posture=posture, on=bool(acts)))
            acts.append(Act(turn))
        else:
            acts.append(Act(turn, move if turn.direction == "walking" else None, posture))
        at = max(at, turn.end)
    rest = replace(move, start=min(at, move.end))
    if not acts or _is_way(rest, 1.2):
        acts.append(Act(rest, posture=posture, on=bool(acts)))
    return acts


def _is_way(move: Event, seconds: float) -> bool:
    return move.seconds >= seconds and move.amount * move.seconds > _LEAST_WAY


def _posture(description: Description, move: Event) -> str:
    for kind in ("crouch", "bend"):
        held = sum(_shared(move, p) for p in description.find(kind) if p in description.postures)
        if held > 0.6 * move.frames:
            return kind
    return ""


def _placed(events: list[Event], moves: list[Event]) -> list[Act]:
    """What the hands do while the body goes somewhere happens during that."""
    acts = []
    for event in events:
        during = [m for m in moves if _shared(event, m) > 0.7 * event.frames]
        gait = during[0] if during and event.kind in _ARMS else None
        acts.append(Act(event, gait))
    return acts


def _held(description: Description, acts: list[Act]) -> list[Act]:
    """Postures that last, where no act tells how they begin."""
    out = []
    changes = (
        "sit_down",
        "lie_down",
        "kneel_down",
        "squat",
        "pick_up",
        "bow",
        "stand_up",
        "get_up",
    )
    told = [act.event for act in acts if act.kind in changes]
    for posture in description.postures:
        if posture.kind == "stand" or posture.seconds < 1.0:
            continue
        moving = any(_shared(posture, a.event) > 0.3 * posture.frames for a in acts if a.posture)
        if not moving and not any(_shared(posture, event, 6) for event in told):
            out.append(Act(replace(posture, kind=f"stay_{posture.kind}")))
    if not acts and not out:
        kind = "still" if description.activity < STILL else "stand"
        kind = "gesture" if description.activity > LIVELY else kind
        out.append(Act(Event(kind, 0, description.frames)))
    return out


def _stop(description: Description, acts: list[Act]) -> list[Act]:
    """A move after which the body stands to the end."""
    last = description.moves[-1]
    if not acts or last.kind != "stand" or last.seconds < 0.6:
        return []
    final = acts[-1]
    gone = final.kind in ("walk", "jog", "run") or final.gait is not None
    if gone and final.event.direction != "place" and final.event.end <= last.start + 12:
        return [Act(Event("stop", last.start, last.end))]
    return []
