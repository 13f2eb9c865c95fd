"""Description → acts worth reporting, in order: repetitions counted, side effects left out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from latentmotion.language.claims import kinds
from latentmotion.measure.facts import BOTH, FPS, TABLES, Description, Event, joined_moves

STILL = 0.12  # Mean speed of hands, feet and head, m/s, below which a body stands still.

# Mean speed of hands, feet and head, m/s, above which a body in place moves its arms.
LIVELY = 0.45

# Meters of the shortest move that is reported.
_SHORTEST_WAY = 0.5

# Kinds of events that are only part of others, those others, and the frames between them.
_SIDE_EFFECTS = TABLES["side_effects"]["rows"]


@dataclass(frozen=True)
class ReportedAct:
    """One act that a sentence can report."""

    event: Event  # The event, move, turn or posture.
    gait: Event | None = None  # The move that a turn is part of, or during which the hands act.
    posture: str = ""  # `crouch` or `bend`, if a move happens so.
    on: bool = False  # Whether a move only continues after a turn.

    @property
    def kind(self) -> str:
        """The kind of the event."""
        return self.event.kind


def acts_of(description: Description) -> tuple[ReportedAct, ...]:
    """Returns the acts of a motion that are worth reporting, in order."""
    fast = any(move.kind in ("jog", "run") for move in description.moves)
    reported = []
    for event in description.events:
        small = event.kind == "raise" and (event.frames < 6 or (event.amount < 0.12 and fast))
        brief = event.kind == "balance" and event.seconds < 2
        brief = brief and _meets(event, description.events, ("knee",), 0)
        hidden = any(
            event.kind in parts and _meets(event, description.events, others, gap)
            for parts, others, gap in _SIDE_EFFECTS
        )
        if not small and not brief and not hidden:
            reported.append(event)
    events = _alternating(_grouped(reported))
    moves = _reported_moves(description, events)
    acts = _moves_and_turns(description, events, moves)
    for event in events:  # acts of the hands may happen during a move
        during = [move for move in moves if event.overlap(move) > 0.7 * event.frames]
        acts.append(
            ReportedAct(event, during[0] if during and event.kind in kinds("arms") else None)
        )
    acts += _held_postures(description, acts)
    acts.sort(key=lambda act: (act.event.start, act.event.end))
    acts = [act for act in acts if act.event.frames > 0]
    last = description.moves[-1]
    if acts and last.kind == "stand" and last.seconds >= 0.6:
        final = acts[-1]
        moved = final.kind in ("walk", "jog", "run") or final.gait is not None
        if moved and final.event.direction != "place" and final.event.end <= last.start + 12:
            acts.append(ReportedAct(Event("stop", last.start, last.end)))
    return tuple(acts)


def _meets(event: Event, events: Iterable[Event], others: tuple[str, ...], gap: int) -> bool:
    """Whether an event of other kinds, of the same side if it has one, is at the same time."""
    for other in events:
        near = other.start - gap < event.end and event.start < other.end + gap
        sides = {event.side, other.side}
        same = len(sides) == 1 or BOTH in sides or "" in sides or other.kind not in kinds("arms")
        if other.kind in others and other is not event and near and same:
            return True
    return False


def _grouped(events: list[Event]) -> list[Event]:
    """Counts events that are alike and follow each other within two seconds."""
    groups: list[Event] = []
    for event in sorted(events, key=lambda one: one.start):
        series = None
        for index in range(len(groups) - 1, -1, -1) if event.kind in kinds("repeated") else ():
            last = groups[index]
            if (last.kind, last.side) == (event.kind, event.side):
                series = index if event.start - last.end < 2.0 * FPS else None
                break
            if event.kind not in kinds("arms") and last.kind not in kinds("arms"):
                break
        if series is None:
            groups.append(event)
            continue
        last = groups[series]
        groups[series] = replace(
            last,
            end=max(last.end, event.end),
            direction=last.direction if last.direction == event.direction else "",
            amount=max(last.amount, event.amount),
            count=last.count + event.count,
        )
    return groups


def _alternating(events: list[Event]) -> list[Event]:
    """Joins three and more single kicks, knees or punches of alternating sides."""
    joined: list[Event] = []
    run: list[Event] = []
    for event in [*events, None]:
        last = run[-1] if run else None
        same_kind = event and last and event.kind == last.kind and event.side != last.side
        if event and last and same_kind and event.start - last.end < 2.0 * FPS:
            run.append(event)
            continue
        if len(run) >= 3 and run[0].kind in ("kick", "knee", "punch"):
            count, end = sum(repeat.count for repeat in run), max(repeat.end for repeat in run)
            joined.append(replace(run[0], end=end, side=BOTH, direction="", count=count))
        else:
            joined += run
        run = [event] if event else []
    return joined


def _reported_moves(description: Description, events: list[Event]) -> list[Event]:
    """Leaves out small shifts, and moves that are part of a jump, a kick or a change of posture."""
    moves = []
    acts = [event for event in events if event.kind in kinds("whole_body")]
    for move in description.moves:
        if move.kind == "stand":
            continue
        for act in acts:
            early = act.end < move.start + 0.6 * move.frames
            if act.kind in ("stand_up", "get_up") and move.start < act.end and early:
                move = replace(move, start=act.end)
            if act.kind in ("sit_down", "lie_down") and move.start < act.start < move.end:
                move = replace(move, end=act.start)
        shared = sum(move.overlap(act, 8) for act in acts)
        far = move.amount * move.seconds > _SHORTEST_WAY
        if move.direction == "place" or (far and shared < 0.6 * move.frames):
            moves.append(move)
    return joined_moves(moves, int(FPS))


def _moves_and_turns(
    description: Description, events: list[Event], moves: list[Event]
) -> list[ReportedAct]:
    """Combines moves and turns: curves and circles, or one after the other."""
    busy = [p for p in description.postures if p.kind in kinds("on_floor")]
    busy += [event for event in events if event.kind in kinds("whole_body")]
    turns = []
    # Small ones, parts of a kick and those on the floor are left out.
    for turn in description.turns:
        shared = sum(turn.overlap(event, 4) for event in busy)
        least = 50 if turn.direction == "place" or description.path.length < 1 else 30
        if turn.amount >= (150 if shared > 0.5 * turn.frames else least):
            turns.append(turn)
    acts, used = [], set()
    for move in moves:
        inside = [t for t in turns if move.overlap(t) > 0.5 * t.frames and id(t) not in used]
        used |= {id(turn) for turn in inside}
        low = {
            kind: sum(move.overlap(p) for p in description.postures if p.kind == kind)
            for kind in ("crouch", "bend")
        }
        posture = next((kind for kind in low if low[kind] > 0.6 * move.frames), "")
        curves = [turn for turn in inside if move.overlap(turn) > 0.6 * move.frames]
        if len(curves) == len(inside) == 1:
            acts.append(
                ReportedAct(replace(curves[0], start=move.start, end=move.end), move, posture)
            )
        else:
            acts += _divided_at_turns(move, inside, posture)
    return acts + [ReportedAct(turn) for turn in turns if id(turn) not in used]


def _divided_at_turns(move: Event, turns: list[Event], posture: str) -> list[ReportedAct]:
    """Returns a move before, between and after its turns; short parts belong to the turn."""
    acts: list[ReportedAct] = []
    start = move.start
    for turn in turns:
        before = replace(move, start=start, end=max(min(turn.start, move.end), start))
        if before.seconds >= 0.8 and before.amount * before.seconds > _SHORTEST_WAY:
            acts.append(ReportedAct(before, posture=posture, on=bool(acts)))
            acts.append(ReportedAct(turn))
        else:
            acts.append(ReportedAct(turn, move if turn.direction == "walking" else None, posture))
        start = max(start, turn.end)
    rest = replace(move, start=min(start, move.end))
    if not acts or (rest.seconds >= 1.2 and rest.amount * rest.seconds > _SHORTEST_WAY):
        acts.append(ReportedAct(rest, posture=posture, on=bool(acts)))
    return acts


def _held_postures(description: Description, acts: list[ReportedAct]) -> list[ReportedAct]:
    """Returns postures that last, unless an act reports how they begin, or else standing."""
    held = []
    changes = [act.event for act in acts if act.kind in kinds("change")]
    for posture in description.postures:
        if posture.kind == "stand" or posture.seconds < 1.0:
            continue
        low = [act.event for act in acts if act.posture]
        moving = any(posture.overlap(event) > 0.3 * posture.frames for event in low)
        if not moving and not any(posture.overlap(event, 6) for event in changes):
            held.append(ReportedAct(replace(posture, kind=f"stay_{posture.kind}")))
    if not acts and not held:
        kind = "still" if description.activity < STILL else "stand"
        kind = "gesture" if description.activity > LIVELY else kind
        held.append(ReportedAct(Event(kind, 0, description.frames)))
    return held
